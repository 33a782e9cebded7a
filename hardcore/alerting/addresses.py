"""What the sender goes by: the channels in force, their secrets, and whether somebody has muted it.

The channels are read from the last policy that was found right, as the guard keeps it: a file that somebody is just
editing changes nobody's address.
"""

import datetime as dt
import errno
import json
import os
import stat
import time
from pathlib import Path
from typing import Final

from hardcore.host.folders import Folders
from hardcore.host.muting import muted_until_ms
from hardcore.recovery.channels import Channel, Moment, good_channels
from hardcore.recovery.policy import POLICY_BYTES_MAX

SECRET_BYTES_MAX: Final = 4096


class SecretMissingError(OSError):
    """A channel names a file for its secret, and that can't be read."""


def channels_in_force(folders: Folders) -> tuple[Channel, ...] | None:
    """Return the channels of the policy in force; before a guard has kept one, those of the file.

    None: there is a policy and nobody can say now whom it names, which is another thing than that it names nobody.
    """
    unread = False
    for path in (folders.good_policy, folders.policy):
        try:
            value = json.loads(_small(path, POLICY_BYTES_MAX).decode("utf-8-sig"))
        except FileNotFoundError:
            continue
        except (OSError, ValueError, RecursionError):
            unread = True
            continue
        if isinstance(value, dict):
            named = value.get("alerts", [])
            return good_channels(named) or (() if named == [] else None)
        unread = True
    return None if unread else ()


def _small(path: Path | str, bytes_max: int) -> bytes:
    """Return what a file begins with. Raises OSError where there is none, and where it is no file."""
    fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(fd, "rb") as file:
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            raise OSError(errno.EINVAL, "no regular file")
        return file.read(bytes_max)


def secret_of(channel: Channel) -> str:
    """Return the channel's secret; empty if it has none. Raises SecretMissingError where its file can't be used."""
    if not channel.secret_file:
        return ""
    try:
        secret = _small(channel.secret_file, SECRET_BYTES_MAX).decode().strip()
    except (OSError, UnicodeDecodeError) as error:
        raise SecretMissingError from error
    if not secret or not secret.isprintable():
        raise SecretMissingError
    return secret


def now(folders: Folders) -> Moment:
    """Return the present moment as the manners see it."""
    today = dt.datetime.now().astimezone()
    return Moment(time.time_ns() // 1_000_000, today.hour * 60 + today.minute, muted_until_ms(folders))
