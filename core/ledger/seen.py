"""What somebody has seen: accounts with their versions, by which a command is held against a book that has moved on.

The version of an account counts the events that have touched it. Who has read an account and then wishes something of it may
say so, and is refused where anybody was quicker. A lock was not chosen: nobody would know when to take it back.
"""

from collections.abc import Iterator
from typing import Final

import msgspec

from core.ledger import fields
from core.ledger.money import INT64_MAX
from core.ledger.reasons import Fault, Reason, Rejection, Slug

ACCOUNTS_MAX: Final = 500


class SeenBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The body of a command that says all else in its path: what its sender has seen. It may as well be empty."""

    expected_versions: dict[str, int] = {}


def seen(versions: dict[str, int]) -> dict[str, int] | Rejection:
    """Return the versions of accounts, or everything that is wrong with them."""
    faults = tuple(version_faults(versions))
    return Rejection(Slug.INVALID_BODY, faults) if faults else versions


def version_faults(versions: dict[str, int]) -> Iterator[Fault]:
    """Say what is wrong with the versions of accounts."""
    if len(versions) > ACCOUNTS_MAX:
        yield Fault("/expected_versions", Reason.TOO_MANY)
        return
    for name, version in versions.items():
        here = f"/expected_versions/{name.replace('~', '~0').replace('/', '~1')}"
        yield from fields.id_faults(here, name)
        if not 0 <= version <= INT64_MAX:
            yield Fault(here, Reason.OUT_OF_RANGE)
