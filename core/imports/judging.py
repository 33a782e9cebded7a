"""Judging a row: what becomes of it in this account, before the book is asked.

Pure. Reading says what a row means; here the account it is for is known too, and so a row in another currency
can be refused with its reason. Converting was not chosen: a rate that nobody named is an invented number.
"""

from typing import Final, assert_never

import msgspec

from core.imports.reading.candidates import Candidate, RefusedRow, Result, SkippedRow
from core.imports.reading.fingerprints import fingerprint
from core.imports.records import EntryShown, Manifest, Problem, SampleRow, shown
from core.ledger.entries import EntryBody, Origin, RecordEntry, record_entry
from core.ledger.fields import DESCRIPTION_CHARACTERS_MAX
from core.ledger.reasons import Rejection

OTHER_CURRENCY: Final = "other-currency"


def judge(result: Result, currency: str | None) -> Candidate | Problem | SkippedRow:
    """Return the row if it may be booked on an account of this currency (None: not chosen yet)."""
    match result:
        case Candidate():
            if currency is not None and result.currency != currency:
                values = {"given": result.currency, "currency": currency}
                return Problem(result.line, OTHER_CURRENCY, shown(result.cells), values)
            return result
        case RefusedRow():
            values = {} if result.column is None else {"column": result.column}
            return Problem(result.line, result.reason.value, shown(result.cells), values)
        case SkippedRow():
            return result
        case _:
            assert_never(result)


def sample_of(judged: Candidate | Problem | SkippedRow) -> SampleRow:
    """Return how a row is shown."""
    match judged:
        case Candidate():
            entry = EntryShown(
                judged.date,
                judged.amount,
                judged.currency,
                description_of(judged),
                judged.category,
                judged.payment_method,
            )
            return SampleRow(judged.line, shown(judged.cells), entry, None)
        case Problem():
            return SampleRow(judged.line, judged.cells, None, judged.reason, judged.values)
        case SkippedRow():
            return SampleRow(judged.line, shown(judged.cells), None, judged.reason.value)
        case _:
            assert_never(judged)


def description_of(candidate: Candidate) -> str:
    """Return description and memo as one text."""
    words = " · ".join(part for part in (candidate.description, candidate.memo) if part)
    return words[:DESCRIPTION_CHARACTERS_MAX]


def command_of(
    candidate: Candidate, ordinal: int, manifest: Manifest, entry_id: str
) -> RecordEntry | Rejection:
    """Return the wish to book the row that stands at `ordinal` (from 1) in its file."""
    assert manifest.account is not None, "an import is committed to an account"
    body = EntryBody(
        date=candidate.date,
        amount=candidate.amount,
        currency=candidate.currency,
        account=manifest.account,
        category=candidate.category,
        description=description_of(candidate),
        payment_method=candidate.payment_method,
    )
    origin = Origin(manifest.id, ordinal, fingerprint(manifest.account, candidate))
    return record_entry(body, entry_id, origin, duplicates_wanted=not manifest.skip_duplicates)


def key_of(manifest: Manifest, ordinal: int) -> str:
    """Return the key of a row: whoever books it again, after whatever death, is told what was done."""
    return f"{manifest.id}:{ordinal}"


def payload_of(candidate: Candidate) -> bytes:
    """Return what evidence keeps of a row."""
    return msgspec.json.encode(candidate.cells)
