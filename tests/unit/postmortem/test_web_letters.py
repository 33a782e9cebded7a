"""The dashboard's pages of dead letters: what one says, and what may be done with one or with many at once."""

import json
from datetime import UTC, datetime
from pathlib import Path

import pytest

from postmortem.views import Attempt, DryRun, LetterState
from postmortem.web.letter import is_fresh
from postmortem.web.letters import sums_of
from tests.unit.postmortem.web_archive import LETTER_ID, Archive, Visitor, letter

LETTER = f"/admin/dlq/{LETTER_ID}"
HOSTILE = "<script>alert(1)</script>\u202egnp.exe\x1b[2J"


@pytest.fixture
def visitor(tmp_path: Path) -> Visitor:
    return Visitor(tmp_path, Archive())


def test_nothing_set_aside_is_told_as_that(visitor: Visitor) -> None:
    assert "Nothing set aside" in visitor.get("/admin/dlq").text


def test_a_letter_says_its_reason_and_what_to_do_next(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    page = visitor.get(LETTER).text
    assert "makes the core die" in page
    assert "12000 KRW" in page
    assert page.index("Dry run</button>") < page.index("Retry</button>")
    visitor.archive.kept[0] = letter(reason="NEWER_THAN_US")
    assert "NEWER_THAN_US" in visitor.get(LETTER).text


def test_a_dry_run_that_the_ledger_refused_is_not_told_as_a_good_end(visitor: Visitor) -> None:
    answer = {"type": "/problems/not-found"}
    run = DryRun("2026-11-22T10:00:00Z", "survived", 404, 40, answer, "")
    visitor.archive.kept.append(letter(dry_run=run))
    page = visitor.get(LETTER).text
    assert "the ledger would refuse it: 404" in page
    assert "ordeal-survived" not in page
    assert "&#34;type&#34;: &#34;/problems/not-found&#34;" in page
    assert "A retry would be refused as well" in page


@pytest.mark.parametrize(
    ("lang", "said"), [("ko", "다시 따로 보관했어요."), ("en", "It was set aside again.")]
)
def test_what_was_tried_is_told_in_words_and_a_code_that_is_none_as_it_is(
    visitor: Visitor, lang: str, said: str
) -> None:
    visitor.lang = lang
    tried = [Attempt("2026-11-22T10:00:00Z", "retry", one, None, "") for one in ("set aside again", "<b>")]
    visitor.archive.kept.append(letter(attempts=tuple(tried)))
    page = visitor.get(LETTER).text
    assert said in page
    assert "&lt;b&gt;" in page


def test_a_discard_wants_a_reason_and_can_be_undone(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    asked = visitor.post(f"{LETTER}/discard")
    assert "Discard this request?" in asked.text
    assert "No money moves. It stays on record." in asked.text
    assert "The reason is empty" in visitor.post(f"{LETTER}/discard", sure="1", text="  ").text
    assert visitor.archive.done == []
    done = visitor.post(f"{LETTER}/discard", sure="1", text="sent twice")
    page = visitor.get(done.headers["location"]).text
    assert "sent twice" in page
    assert f"{LETTER}/undo" in page
    assert f"{LETTER}/undo" not in visitor.get(LETTER).text
    visitor.post(f"{LETTER}/undo")
    assert visitor.archive.kept[0].state is LetterState.QUARANTINED


def test_a_retry_without_a_fresh_dry_run_has_to_be_said_as_that(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    asked = visitor.post(f"{LETTER}/retry").text
    assert "Retry anyway" in asked
    assert 'name="anyway" value="1"' in asked
    now = datetime.now(UTC).isoformat()
    visitor.archive.kept[0] = letter(dry_run=DryRun(now, "survived", 201, 40, None, ""))
    asked = visitor.post(f"{LETTER}/retry").text
    assert "anyway" not in asked
    visitor.post(f"{LETTER}/retry", sure="1")
    assert visitor.archive.done == [("retry", False, LETTER_ID)]


def test_a_dry_run_is_fresh_for_ten_minutes_if_it_went_well() -> None:
    at = datetime(2026, 11, 22, 12, 0, tzinfo=UTC)

    def ran(ordeal: str, when: str) -> DryRun:
        return DryRun(when, ordeal, None, 1, None, "")

    assert is_fresh(ran("survived", "2026-11-22T11:50:01Z"), at)
    assert not is_fresh(ran("survived", "2026-11-22T11:50:00Z"), at)
    assert not is_fresh(ran("survived", "2026-11-22T12:00:01Z"), at)
    assert not is_fresh(ran("died", "2026-11-22T11:59:59Z"), at)
    assert not is_fresh(ran("survived", "yesterday"), at)
    assert not is_fresh(None, at)


def test_a_refusal_is_told_where_the_question_stood(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    visitor.archive.refuses = "letter_busy"
    answer = visitor.post(f"{LETTER}/hold")
    assert answer.status == 409
    assert "it is not run twice" in answer.text
    assert 'id="confirm"' in answer.text
    assert '<button class="primary">' not in answer.text


def test_a_payload_is_an_attackers_text(visitor: Visitor) -> None:
    visitor.archive.kept.append(
        letter(payload=HOSTILE + "A" * 1_000_000, kind=HOSTILE, path=HOSTILE, source=HOSTILE)
    )
    for path in (LETTER, "/admin/dlq"):
        page = visitor.get(path).text
        assert "<script>alert" not in page
        assert "\u202e" not in page
        assert len(page) < 40_000
    whole = visitor.get(f"{LETTER}/payload")
    assert len(whole.body) > 1_000_000
    assert whole.headers["content-disposition"].startswith("attachment")
    assert whole.headers["content-type"].startswith("text/plain")


def test_postings_are_a_table_and_the_rest_a_form(visitor: Visitor) -> None:
    payload = {
        "date": "2026-11-21",
        "postings": [{"account": HOSTILE, "amount": "-12000", "currency": "KRW"}],
    }
    visitor.archive.kept.append(letter(payload=payload))
    page = visitor.get(LETTER).text
    assert "-12000 KRW</td>" in page
    assert "<dt>postings</dt>" not in page
    assert "<script>alert" not in page
    visitor.archive.kept[0] = letter(payload={"postings": [{"account": 5}]})
    assert "<dt>postings</dt>" in visitor.get(LETTER).text


def test_many_are_asked_about_with_number_accounts_and_sum(visitor: Visitor) -> None:
    other = LETTER_ID[:-1] + "b"
    visitor.archive.kept += [letter(), letter(id=other, account_ids=("assets:cash",), sums=("500.50 USD",))]
    asked = visitor.post("/admin/dlq/bulk", verb="retry", id=[LETTER_ID, other]).text
    assert "Retry 2 requests?" in asked
    assert "3 accounts, total 12,000 KRW, 500.50 USD." in asked
    assert visitor.archive.done == []
    begun = visitor.post("/admin/dlq/bulk", verb="retry", id=[LETTER_ID, other], sure="1")
    assert begun.headers["location"] == "/admin/dlq/bulk/b-1"
    assert visitor.archive.done == [("bulk", "retry", [LETTER_ID, other], "")]
    assert "1 of 3 finished" in visitor.get("/admin/dlq/bulk/b-1").text
    visitor.post("/admin/dlq/bulk/b-1/cancel")
    assert "the others are where they were" in visitor.get("/admin/dlq/bulk/b-1").text


def test_all_that_match_means_the_filter_and_not_the_page(visitor: Visitor) -> None:
    visitor.archive.kept += [letter(), letter(id=LETTER_ID[:-1] + "b", reason="UNPROVEN")]
    asked = visitor.post("/admin/dlq/bulk", verb="discard", all="1", reason="UNPROVEN", id=LETTER_ID)
    assert "Discard 1 request?" in asked.text
    assert 'name="reason" value="UNPROVEN"' in asked.text
    visitor.post("/admin/dlq/bulk", verb="discard", all="1", reason="UNPROVEN", sure="1", text="old")
    _, verb, wanted, why = visitor.archive.done[0]
    assert (verb, wanted.reason, why) == ("discard", "UNPROVEN", "old")


def test_nothing_selected_is_told_and_nothing_is_begun(visitor: Visitor) -> None:
    answer = visitor.post("/admin/dlq/bulk", verb="hold")
    assert "select requests first" in visitor.get(answer.headers["location"]).text


def test_sums_are_added_by_currency_and_nonsense_is_passed_over() -> None:
    assert sums_of([letter(sums=("1 KRW", "x USD")), letter(sums=("2.50 KRW",))]) == ["3.50 KRW"]


def test_a_letter_is_corrected_only_after_a_question_and_shows_the_new_key(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    assert f"{LETTER}/correct" in visitor.get(LETTER).text
    body = json.dumps({"amount": "-1"})
    asked = visitor.post(f"{LETTER}/correct", text=body)
    assert (asked.status, visitor.archive.done) == (200, [])
    assert "&#34;amount&#34;" in asked.text
    visitor.post(f"{LETTER}/correct", text=body, sure="1")
    assert visitor.archive.done == [("correct", body, LETTER_ID)]
    page = visitor.get(LETTER).text
    assert "under the key key-2" in page
    assert f"{LETTER}/correct" not in page


def test_the_secrets_of_a_letter_are_on_its_page_once_that_is_written_down(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter(payload={"password": "c4nary", "memo": "x"}, path="/x?token=c4nary"))
    page = visitor.get(LETTER).text
    assert "c4nary" not in page
    assert f'action="{LETTER}/reveal"' in page
    assert f'action="{LETTER}/correct"' not in page
    assert visitor.get(f"{LETTER}/reveal").status in {404, 405}
    assert visitor.post(f"{LETTER}/reveal", token="no").status == 403
    assert visitor.written == []
    page = visitor.post(f"{LETTER}/reveal").text
    assert "c4nary" in page
    assert f'action="{LETTER}/correct"' in page
    assert visitor.written == [("reveal", f"letter {LETTER_ID}", "", "shown")]


def test_who_takes_a_payload_along_is_written_down(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    assert visitor.get(f"{LETTER}/payload").status == 200
    assert visitor.written == [("payload", f"letter {LETTER_ID}", "", "given")]


def test_a_letter_without_a_secret_has_nothing_to_reveal(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    assert "/reveal" not in visitor.get(LETTER).text


def test_a_reason_that_nobody_can_see_is_asked_for_again(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    for unseen in ("\u200b", "\u3164", "\u202e", "..."):
        assert "The reason is empty" in visitor.post(f"{LETTER}/discard", sure="1", text=unseen).text
        visitor.post("/admin/dlq/bulk", verb="discard", id=LETTER_ID, sure="1", text=unseen)
    assert visitor.archive.done == []


def test_nothing_on_the_list_turns_what_is_read_around(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter(reason=f"X{HOSTILE}\x00"))
    for path in (
        "/admin/dlq",
        "/admin/dlq?account=%E2%80%AEx%00%1B&reason=%E2%81%A6",
        "/admin/incidents?account=%E2%80%AE",
    ):
        page = visitor.get(path).text
        assert not {"\u202e", "\x1b", "\x00", "\u2066"} & set(page)
