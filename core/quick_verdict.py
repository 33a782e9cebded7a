"""`python -m core verify --quick`: what is said of a quick proof, to a person or to a program.

It always says where it began, because that is what it does not prove again: a checkpoint, or the ground that every start
has. It uses checkpoints and makes none; they belong to the core that writes.
"""

import logging
from collections.abc import Callable
from pathlib import Path

import msgspec
from sqlalchemy import Engine

from core import departure
from core.departure import Departure, ExitCode
from core.journal.chain import Broken
from core.journal.checkpoints import Checkpoints
from core.journal.ground import Ground
from core.journal.quick import Quick, prove_quickly
from core.journal.rebuilding import Rebuilding
from core.journal.store import StoreError
from core.journal.verify import GivenUp
from core.saying import say
from core.settings import Settings

logger = logging.getLogger("core")


class QuickVerdict(msgspec.Struct, frozen=True):
    """What came of it. `checked`: how many events were hashed; `checkpoint`: where it began, None: at none."""

    ok: bool
    events: int
    checked: int
    checkpoint: str | None
    first_bad_seq: int | None
    reason: str | None


def verify_quickly(
    data: Path,
    readers: Engine,
    settings: Settings,
    rebuilding: Rebuilding,
    tell: Callable[[str], object],
    *,
    as_json: bool,
) -> int:
    """Prove a ledger from its newest good checkpoint, `tell` what came of it, and return the exit code. Blocks."""
    ground = Ground(Checkpoints.of(data, lambda name, what: logger.info("Checkpoint %s: %s.", name, what)))
    found = prove_quickly(
        readers, settings.read_ms_max, settings.tail_events, ground, lambda: False, rebuilding
    )
    assert not isinstance(found, GivenUp), "nobody asks this process to leave"
    if isinstance(found, StoreError):
        return _said(departure.corrupt(f"it can't be read ({found.text})"))
    verdict = _verdict(found, ground.gone_by or None)
    if as_json:
        tell(msgspec.json.encode(verdict).decode())
    elif verdict.ok:
        began = f"from checkpoint {ground.gone_by}" if ground.gone_by else "from the last attestation"
        tell(f"The ledger is whole {began}: {verdict.checked} of {verdict.events} events were proven again.")
    if verdict.ok:
        return ExitCode.ASKED
    return ExitCode.STORE_CORRUPT if as_json else _said(departure.corrupt(verdict.reason or ""))


def _verdict(found: Quick | Broken, began_at: str | None) -> QuickVerdict:
    if isinstance(found, Broken):
        return QuickVerdict(
            ok=False, events=0, checked=0, checkpoint=began_at, first_bad_seq=found.seq, reason=found.sentence
        )
    return QuickVerdict(
        ok=True,
        events=found.proof.head_seq,
        checked=found.proof.tail,
        checkpoint=began_at,
        first_bad_seq=None,
        reason=None,
    )


def _said(left: Departure) -> int:
    say(left.sentence)
    return left.code.value
