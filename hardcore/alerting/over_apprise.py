"""A message by way of Apprise, where somebody has installed it: in a process of its own, with a limit of its own.

It knows more than a hundred services and brings their code along; none of that is let into the sender. The address goes
in over a pipe: on a command line every user of the machine could read it.
"""

import json
import subprocess
import sys
from importlib.util import find_spec
from typing import Final

from hardcore.alerting.outcomes import ARRIVED, Sent, failed
from hardcore.alerting.wording import Message
from hardcore.recovery.channels import Channel

WAIT_S: Final = 12.0
#: How the child ends: it arrived, the service did not take it, there is no Apprise.
ARRIVED_CODE, REFUSED_CODE, ABSENT_CODE = 0, 3, 4


def is_installed() -> bool:
    """Tell whether Apprise can be had here."""
    return find_spec("apprise") is not None


def to_service(channel: Channel, message: Message) -> Sent:
    """Have it sent by the child."""
    told = json.dumps({"url": channel.url, "title": message.title, "body": message.body}).encode()
    argv = [sys.executable, "-I", "-m", "hardcore.alerting.apprise_child"]
    try:
        done = subprocess.run(
            argv,
            input=told,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=WAIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return failed("timeout")
    except OSError:
        return failed("fault")
    if done.returncode == ARRIVED_CODE:
        return ARRIVED
    if done.returncode == ABSENT_CODE:
        return failed("apprise", final=True)
    return failed("status" if done.returncode == REFUSED_CODE else "fault")
