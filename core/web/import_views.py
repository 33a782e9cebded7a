"""How an import is shown: the shapes of `docs/wires.md` section 11, with each reason's sentence beside it.

Sentences are chosen here, at the last moment, because the same import is read in two languages. While rows are
being booked and afterwards, the numbers are those of the booking; before, those of the look at the file.
"""

from typing import Final

import msgspec

from core.imports.desk import Kept
from core.imports.reading.formats import Format
from core.imports.reading.mapping import Mapping, MappingFault, faults_of
from core.imports.reading.own_formats import with_own
from core.imports.records import EntryShown, Problem, SampleRow
from core.imports.states import State
from core.ledger.moments import timestamp
from frontend.catalogue_imports import BOOKING, REASONS, WAITING
from frontend.catalogue_problems import PROBLEMS
from frontend.render import Language, problem_text

FORMAT_BROKEN: Final = "format-broken"
_PAIRS: Final = {**REASONS, **BOOKING, **WAITING}


class FormatChoice(msgspec.Struct, frozen=True):
    """A layout whose header the file has."""

    id: str
    name: str


class RowCounts(msgspec.Struct, frozen=True):
    """Rows of the file: `total` are good, refused and skipped ones; good ones are `new` or `duplicates`.

    `new` are those that the ledger does not hold yet, or (once committed) that this import has booked.
    """

    total: int
    good: int
    new: int
    duplicates: int
    refused: int
    skipped: int


class RowView(msgspec.Struct, frozen=True):
    """One of the first rows of the file."""

    line: int
    cells: tuple[str, ...]
    entry: EntryShown | None
    reason: str | None
    sentence: str | None


class RefusedView(msgspec.Struct, frozen=True):
    """A row that is not booked, and why."""

    line: int
    reason: str
    sentence: str
    cells: tuple[str, ...]


class FaultView(msgspec.Struct, frozen=True):
    """What is still missing in the mapping, or wrong with it."""

    pointer: str
    reason: str
    sentence: str


class ReasonView(msgspec.Struct, frozen=True):
    """A word about the whole file, with its sentence."""

    reason: str
    sentence: str


class ImportSummary(msgspec.Struct, frozen=True):
    """An import in a list."""

    id: str
    state: State
    name: str
    bytes: int
    made_at: str
    format: str | None
    format_name: str | None
    account: str | None
    rows: RowCounts
    done: int
    total: int


class ImportView(msgspec.Struct, frozen=True):
    """An import, whole. `fault` says why one failed; `faults` what its mapping still needs.

    `waiting` says why one that is being booked does not go on at this moment.
    """

    id: str
    state: State
    name: str
    bytes: int
    made_at: str
    container: str | None
    encoding: str | None
    format: str | None
    format_name: str | None
    formats: tuple[FormatChoice, ...]
    header_line: int | None
    columns: tuple[str, ...]
    mapping: Mapping
    faults: tuple[FaultView, ...]
    notes: tuple[ReasonView, ...]
    account: str | None
    currency: str | None
    rows: RowCounts
    sample: tuple[RowView, ...]
    problems: tuple[RefusedView, ...]
    balance_check: str
    done: int
    total: int
    fault: ReasonView | None
    waiting: ReasonView | None


class ImportList(msgspec.Struct, frozen=True):
    """The newest imports, newest first."""

    items: tuple[ImportSummary, ...]


def summary_of(kept: Kept, lang: Language) -> ImportSummary:
    """Return an import as a list shows it."""
    wish = kept.manifest
    return ImportSummary(
        id=wish.id,
        state=wish.state,
        name=wish.name,
        bytes=wish.file_bytes,
        made_at=timestamp(wish.made_ns),
        format=wish.format,
        format_name=_format_name(wish.format, wish.own_formats, lang),
        account=wish.account,
        rows=_counts(kept),
        done=kept.progress.done,
        total=_total(kept),
    )


def view_of(kept: Kept, lang: Language) -> ImportView:
    """Return an import as it is shown by itself."""
    wish, head = kept.manifest, kept.table.head if kept.table is not None else None
    faults = faults_of(wish.mapping, head.columns) if head is not None else ()
    found = kept.survey.problems if wish.state is State.PREVIEW else kept.progress.problems
    return ImportView(
        id=wish.id,
        state=wish.state,
        name=wish.name,
        bytes=wish.file_bytes,
        made_at=timestamp(wish.made_ns),
        container=head.container.value if head is not None else None,
        encoding=head.encoding if head is not None else None,
        format=wish.format,
        format_name=_format_name(wish.format, wish.own_formats, lang),
        formats=tuple(
            FormatChoice(one, _format_name(one, wish.own_formats, lang) or one) for one in kept.survey.fitting
        ),
        header_line=head.header_line if head is not None else None,
        columns=head.columns if head is not None else (),
        mapping=wish.mapping,
        faults=faults_shown(faults, lang),
        notes=_notes(kept, lang),
        account=wish.account,
        currency=wish.currency,
        rows=_counts(kept),
        sample=tuple(_row(row, lang) for row in kept.survey.sample),
        problems=tuple(_refused(problem, lang) for problem in found),
        balance_check=kept.survey.balance_check.value,
        done=kept.progress.done,
        total=_total(kept),
        fault=None if wish.fault is None else reason_shown(wish.fault, lang),
        waiting=None if kept.waiting is None else reason_shown(kept.waiting.value, lang),
    )


def faults_shown(faults: tuple[MappingFault, ...], lang: Language) -> tuple[FaultView, ...]:
    """Return what is wrong with a mapping, with a sentence each."""
    return tuple(
        FaultView(f"/mapping/{one.field}", one.kind.value, sentence(one.kind.value, lang)) for one in faults
    )


def reason_shown(reason: str, lang: Language) -> ReasonView:
    """Return a reason with its sentence."""
    return ReasonView(reason, sentence(reason, lang))


def sentence(reason: str, lang: Language, **values: str) -> str:
    """Return the sentence of a reason: of reading, of booking, or of the ledger's own refusals."""
    if reason in _PAIRS:
        return _PAIRS[reason][lang].format_map(values)
    assert reason in PROBLEMS, f"nothing says what {reason!r} means"
    return problem_text(reason, lang, **values)[1]


def _row(row: SampleRow, lang: Language) -> RowView:
    said = None if row.reason is None else sentence(row.reason, lang, **row.values)
    return RowView(row.line, row.cells, row.entry, row.reason, said)


def _refused(problem: Problem, lang: Language) -> RefusedView:
    said = sentence(problem.reason, lang, **problem.values)
    return RefusedView(problem.line, problem.reason, said, problem.cells)


def _counts(kept: Kept) -> RowCounts:
    seen, booked = kept.survey, kept.progress
    if kept.manifest.state is State.PREVIEW:
        new = seen.good - seen.duplicates
        return RowCounts(seen.total, seen.good, new, seen.duplicates, seen.refused, seen.skipped)
    good = booked.booked + booked.duplicates
    return RowCounts(_total(kept), good, booked.booked, booked.duplicates, booked.refused, booked.skipped)


def _total(kept: Kept) -> int:
    return kept.table.head.row_count if kept.table is not None else kept.survey.total


def _notes(kept: Kept, lang: Language) -> tuple[ReasonView, ...]:
    notes = kept.table.head.notes if kept.table is not None else ()
    return (
        *(reason_shown(note.value, lang) for note in notes),
        *(
            ReasonView(FORMAT_BROKEN, sentence(FORMAT_BROKEN, lang, file=one.file, why=one.why))
            for one in kept.survey.broken_formats
        ),
    )


def _format_name(format_id: str | None, own: tuple[Format, ...], lang: Language) -> str | None:
    form = with_own(own).get(format_id) if format_id is not None else None
    return form.name[lang] if form is not None else format_id
