import re
import string

import msgspec
import pytest

from core.imports.desk import Kept
from core.imports.importer import KEPT_FILE_LOST
from core.imports.judging import OTHER_CURRENCY, judge, sample_of
from core.imports.outcomes import FAILED_INSIDE
from core.imports.reading.candidates import Candidate, Refusal, RefusedRow, Skip, SkippedRow
from core.imports.reading.mapping import FaultKind
from core.imports.reading.table import Note, Why
from core.imports.records import Manifest, Problem, Progress, Survey, shown
from core.imports.states import State, Waiting
from core.imports.survey import survey
from core.web.import_views import sentence, summary_of
from frontend.catalogue_imports import BOOKING

REASONS = sorted({*Refusal, *Skip, *FaultKind, *Why, *Note, *Waiting, KEPT_FILE_LOST, FAILED_INSIDE})


def candidate(currency: str) -> Candidate:
    return Candidate(2, ("a",), "2026-03-01", -500, currency, "shop", None, None, None, None, ("a",), 1)


@pytest.mark.parametrize("reason", REASONS)
def test_every_reason_has_a_sentence_in_both_languages(reason: str) -> None:
    assert sentence(reason, "ko")
    assert sentence(reason, "en")


def test_a_row_of_another_currency_is_refused_and_both_currencies_are_named() -> None:
    judged = judge(candidate("USD"), "KRW")
    assert judged == Problem(2, OTHER_CURRENCY, ("a",), {"given": "USD", "currency": "KRW"})
    for lang in ("ko", "en"):
        said = sentence(OTHER_CURRENCY, lang, **judged.values)
        assert "USD" in said
        assert "KRW" in said


def test_before_an_account_is_chosen_no_currency_is_wrong() -> None:
    assert judge(candidate("USD"), None) == candidate("USD")


def test_a_row_is_shown_with_its_entry_or_with_its_reason() -> None:
    assert sample_of(candidate("KRW")).entry is not None
    assert sample_of(SkippedRow(3, ("x",), Skip.FOOTER)).reason == "footer"
    refused = judge(RefusedRow(4, ("x",), Refusal.NO_DATE, "Date"), "KRW")
    assert sample_of(refused).reason == "no-date"


@pytest.mark.parametrize("slug", sorted(BOOKING))
def test_the_sentences_of_booking_are_alike_in_both_languages(slug: str) -> None:
    named = [
        {name for _, name, _, _ in string.Formatter().parse(BOOKING[slug][lang]) if name}
        for lang in ("ko", "en")
    ]
    assert named[0] == named[1]
    assert "!" not in "".join(BOOKING[slug].values())
    assert not re.findall(r"\}[가-힣]", BOOKING[slug]["ko"])


@pytest.mark.parametrize("state", [State.PREVIEW, State.DONE])
def test_the_numbers_of_rows_mean_the_same_before_and_after_the_booking(state: State) -> None:
    manifest = Manifest("id", state, "bank.csv", 1, "00", 0)
    found = Survey(16, good=13, refused=2, skipped=1, duplicates=5)
    booked = Progress(16, booked=8, duplicates=5, refused=2, skipped=1)
    rows = summary_of(Kept(manifest, None, found, booked), "ko").rows
    assert (rows.new, rows.duplicates, rows.good) == (8, 5, 13)
    assert rows.new + rows.duplicates == rows.good
    assert rows.good + rows.refused + rows.skipped == rows.total


def test_of_a_wide_row_only_what_an_eye_takes_in_is_kept() -> None:
    wide = RefusedRow(3, ("x" * 4_000,) * 100, Refusal.NO_DATE, "Date")
    judged = judge(wide, "KRW")
    assert isinstance(judged, Problem)
    assert judged.cells == (*(("x" * 79 + "…",) * 12), "…")
    found = survey([wide] * 300, None, "KRW").found(0, ())
    assert (len(found.problems), len(found.sample)) == (200, 20)
    assert len(msgspec.json.encode(found)) < 1 << 19
    narrow = ("2026-03-01", "shop", "-500")
    assert shown(narrow) == narrow
