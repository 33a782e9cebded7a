"""What the sender goes by: the channels in force, their secrets, and whether somebody has muted it.

The channels are read from the last policy that was found right, as the guard keeps it: a file that somebody is just
editing changes nobody's address.
"""

import datetime as dt
import json
import os
import stat
import time
from typing import Final

from hardcore.host.folders import Folders
from hardcore.host.muting import muted_until_ms
from hardcore.recovery.channels import Channel, Moment, read_channels
from hardcore.recovery.policy import POLICY_BYTES_MAX

SECRET_BYTES_MAX: Final = 4096


class SecretMissingError(OSError):
    """A channel names a file for its secret, and that can't be read."""


def channels_in_force(folders: Folders) -> tuple[Channel, ...]:
    """Return the channels of the policy in force; before a guard has kept one, those of the file."""
    for path in (folders.good_policy, folders.policy):
        try:
            value = json.loads(path.read_bytes()[:POLICY_BYTES_MAX].decode("utf-8-sig"))
        except (OSError, ValueError, RecursionError):
            continue
        if isinstance(value, dict):
            read = read_channels(value.get("alerts", []))
            return read if isinstance(read, tuple) else ()
    return ()


def secret_of(channel: Channel) -> str:
    """Return the channel's secret; empty if it has none. Raises SecretMissingError where its file can't be used."""
    if not channel.secret_file:
        return ""
    try:
        fd = os.open(channel.secret_file, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise SecretMissingError from error
    with os.fdopen(fd, "rb") as file:
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            raise SecretMissingError
        try:
            secret = file.read(SECRET_BYTES_MAX).decode().strip()
        except (OSError, UnicodeDecodeError) as error:
            raise SecretMissingError from error
    if not secret or not secret.isprintable():
        raise SecretMissingError
    return secret


def now(folders: Folders) -> Moment:
    """Return the present moment as the manners see it."""
    today = dt.datetime.now().astimezone()
    return Moment(time.time_ns() // 1_000_000, today.hour * 60 + today.minute, muted_until_ms(folders))
