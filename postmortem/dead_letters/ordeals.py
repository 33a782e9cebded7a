"""What a dry run's end means: whether the ledger took the request, and what it answered, in one line.

Pure. A core that lives on has not therefore taken what it was given: a request that the ledger refuses comes to its end
without harm, and yet a retry of it would be refused as well. So the two are told apart here, once for all who show it.
"""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, Final

from postmortem.views import DryRun

#: Ends after which a retry may be tried.
FIT: Final = frozenset({"survived", "committed"})
ANSWER_MAX: Final = 300


def read_dry_run(told: Mapping[str, Any]) -> DryRun:
    """A dry run as programs are told of it, read back."""
    return DryRun(*(told[name] for name in ("at", "ordeal", "status", "took_ms", "answer", "why")))


def was_refused(found: DryRun) -> bool:
    """Tell whether it did no harm, and yet the ledger said no."""
    return found.ordeal == "survived" and found.status is not None and found.status >= HTTPStatus.BAD_REQUEST


def went_well(found: DryRun) -> bool:
    """Tell whether a retry may be expected to be booked."""
    return found.ordeal in FIT and not was_refused(found)


def answered(found: DryRun) -> str:
    """What the ledger answered, in one line; empty where it did not."""
    if found.status is None:
        return ""
    told = found.answer if isinstance(found.answer, Mapping) else {}
    said = told.get("detail") or told.get("title")
    return f"{found.status}: {said}"[:ANSWER_MAX] if isinstance(said, str) else str(found.status)
