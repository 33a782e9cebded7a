"""What people write beside an act: made harmless before it is kept, and a reason has to say something."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

from postmortem.acts import Desk
from postmortem.bulks import Lane
from postmortem.courts import Court
from postmortem.dead_letters import slip as slips
from postmortem.deciding import Decider
from postmortem.diary import Diary
from postmortem.guard_line import GuardLine
from postmortem.incident_acts import IncidentDesk
from postmortem.records import letters
from postmortem.records.opening import Records, open_records
from postmortem.records.reads import Archive
from postmortem.retrying import Retrier
from postmortem.views import Letter, LetterState, Refusal
from postmortem.wording import cleaned, cleaned_lines, is_said
from tests.unit.postmortem.letter_slips import slip

HOSTILE = "gone\ud800\x1b[2J\u202etxt.\x00"


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    """A desk with one letter, of which only the archive is there."""
    records = open_records(tmp_path / "hardcore.db")
    assert isinstance(records, Records)
    archive, diary, guard = Archive(records, tmp_path / "hits"), Diary(records), GuardLine(tmp_path / "none")
    found = slips.letter(slip())
    assert found is not None
    with records.writing() as connection:
        letters.take(connection, found)

    async def none_is_run(*_: str) -> Refusal:
        return Refusal("not_found", {})

    yield Desk(
        records,
        archive,
        Retrier(records, guard, Court(tmp_path)),
        Decider(records, archive, guard, diary),
        Lane(records, guard, none_is_run),
        diary,
        IncidentDesk(records, archive, diary, tmp_path),
    )
    records.close()


@pytest.mark.parametrize(
    "reason", ["", "  ", "\u200b", "\u202e", "\u3164", "\ufe0f", "...", "\ud800", "\x00\n"]
)
def test_a_reason_needs_a_letter_or_a_digit_that_can_be_seen(desk: Desk, reason: str) -> None:
    identity = slip()["id"]
    assert asyncio.run(desk.discard(identity, reason)) == Refusal("reason_needed", {})
    assert asyncio.run(desk.bulk("discard", [identity], reason)) == Refusal("reason_needed", {})
    before = desk.archive.letter(identity)
    assert before is not None
    assert before.state is LetterState.QUARANTINED


@pytest.mark.parametrize("reason", ["x", "7", "중복", "\u200bok"])
def test_a_reason_of_one_visible_letter_is_one(reason: str) -> None:
    assert is_said(reason)


def test_what_can_not_be_seen_is_written_out_before_it_is_kept(desk: Desk) -> None:
    identity = slip()["id"]
    noted = asyncio.run(desk.note(identity, f"first\n{HOSTILE}"))
    assert isinstance(noted, Letter)
    assert noted.note == "first\n" + r"gone\ud800\x1b[2J\u202etxt.\x00"
    gone = asyncio.run(desk.discard(identity, HOSTILE))
    assert isinstance(gone, Letter)
    assert (gone.discarded_because or "").isprintable()
    assert asyncio.run(desk.mark_fixed("f", HOSTILE)) == Refusal("group_unknown", {})
    assert asyncio.run(desk.decide("p", "accept", HOSTILE, HOSTILE)) == Refusal("proposal_unknown", {})
    asyncio.run(desk.incidents.note("i", HOSTILE))
    written = desk.archive.audit(50).items
    assert len(written) == 5
    assert all(one.reason.isprintable() for one in written)


def test_lines_and_letters_of_every_language_stay_as_they_are() -> None:
    assert cleaned(" 두 번 보냄 ", 100) == "두 번 보냄"
    assert cleaned_lines("한 줄\r\n두\t줄\n", 100) == "한 줄\n두 줄\n"
    assert cleaned("abcdef", 3) == "abc"


def test_a_correction_does_not_book_what_was_hidden(desk: Desk) -> None:
    refused = asyncio.run(desk.correct(slip()["id"], '{"password": "<masked>"}'))
    assert refused == Refusal("correction_masked", {})
