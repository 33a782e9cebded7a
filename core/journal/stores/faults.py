"""What a store may say no with, whichever it is."""

from enum import Enum

import msgspec
from sqlalchemy import Connection, Engine
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as NoneFreeError


class StoreFault(Enum):
    """What kind of no the store gave."""

    BUSY = "busy"
    NO_ROOM = "no room"
    READ_ONLY = "read only"
    DAMAGED = "damaged"
    TAKEN = "taken"  # by our own reads, every connection
    AWAY = "away"  # a server that can't be reached, or that ended the connection
    UNFIT = "unfit"  # a server that is not set up as a ledger needs it, or does not let us in
    OTHER = "other"


class StoreError(msgspec.Struct, frozen=True):
    """An error of the store: its kind and its own words."""

    fault: StoreFault
    text: str


class EveryReaderTakenError(Exception):
    """No connection that reads became free in time."""


def connected(engine: Engine) -> Connection:
    """Return a connection of this engine's; where none becomes free in time, that is an error of the store's."""
    try:
        return engine.connect()
    except NoneFreeError as error:
        raise OperationalError(None, None, EveryReaderTakenError()) from error
