import json
import re
from typing import Any

import pytest

from frontend import catalogue_reports as texts
from frontend.catalogue_findings import FINDINGS
from postmortem import incident
from postmortem.analyzer.case import Case
from postmortem.reports import as_terminal
from postmortem.reports.as_json import as_item, as_story
from postmortem.reports.as_markdown import as_markdown, escape
from postmortem.reports.as_terminal import Look
from postmortem.reports.report import Contents, Report, make_report, money_line, outage_word
from postmortem.reports.telling import words_of
from tests.unit.postmortem import story

ITEM = (
    "id opened_at closed_at diagnosis grade summary account_ids transaction_ids command_ids outage_ms detected_ms"
    " outcome fingerprint evidence_complete money"
)
STORY = "timeline evidence findings proposals requests"
HOSTILE = (
    "\x1b]0;owned\x07\x1b[2J`x` | **b** <script>alert(1)</script> [a](http://e) \u202egnp\r\n# head\x00\ud800"
)


def report(**other: Any) -> Report:
    read = incident.from_facts(story.ID, story.facts(**other))
    contents = Contents(
        complete=False,
        partial=False,
        files={"recorder.bin": 364_544},
        missing={"stacks.json": HOSTILE},
        faults=(),
    )
    return make_report(Case(read, (), {}, {}, ""), contents)


def hostile() -> Report:
    command = story.command(HOSTILE, HOSTILE, HOSTILE, [HOSTILE], HOSTILE)
    step = {"at": HOSTILE, "offset_ms": 1, "step": HOSTILE}
    request = {"method": HOSTILE, "path": HOSTILE, "key_hash": HOSTILE, "outcome": HOSTILE}
    return report(
        opened_at=HOSTILE,
        closed_at=HOSTILE,
        diagnosis=HOSTILE,
        reason=HOSTILE,
        planned=True,
        evidence=[{"kind": HOSTILE, "text": HOSTILE}],
        timeline=[step],
        audit={"ok": False, "seq": HOSTILE, "fault": HOSTILE},
        in_flight=[command],
        suspects=[HOSTILE],
        requests=[request],
        deaths=[{"at": HOSTILE, "diagnosis": HOSTILE, "exit": {}}],
        last_words={"code": HOSTILE, "text": HOSTILE},
    )


def terminal(one: Report, language: str, look: Look) -> str:
    lines = {language: money_line(one, language) for language in texts.LANGUAGES}
    shown = {**as_story(one, language), "money_line": lines, "folder": "incidents/x"}
    written: list[str] = []
    as_terminal.print_show(shown, language, written.append, look)
    as_terminal.print_list([as_item(one, language)] * 2, language, written.append, look)
    return "".join(written)


def test_an_item_and_a_story_have_the_fields_that_programs_rely_on() -> None:
    item, whole = as_item(report(), "en"), as_story(report(), "en")
    assert set(ITEM.split()) <= set(item)
    assert set(STORY.split()) <= set(whole)
    assert item["money"] == {"lost": 0, "doubled": 0, "verified": True}
    assert item["transaction_ids"] == ["tx-1", "tx-2"]
    assert item["account_ids"] == ["assets:bank:kb", "expenses:food", "assets:cash"]
    assert item["command_ids"] == ["cmd-1", "cmd-2"]
    assert whole["timeline"][1] == {"step": "detected", "at": "2026-11-21T14:08:15.001Z", "offset_ms": 0.8}
    json.dumps(whole)


def test_the_proof_of_the_whole_ledger_is_told_beside_the_first_one() -> None:
    one = report(audit={"ok": True, "seq": 40, "fault": None})
    assert money_line(one, "en").endswith("the whole ledger was checked, from its first record to number 40.")
    assert money_line(one, "en").startswith("No acknowledged record is lost")
    unsound = report(audit={"ok": False, "seq": None, "fault": "Event 5 is odd."})
    assert money_line(unsound, "en") == "The whole ledger was checked, and it is not whole. (Event 5 is odd.)"
    assert money_line(unsound, "ko").endswith("(Event 5 is odd.)")


def test_the_summary_is_one_plain_sentence_in_both_languages() -> None:
    assert report().summary == {
        "en": "The ledger was killed from outside; it answered again after 912 ms.",
        "ko": "장부 서버가 밖에서 강제 종료됐고 912 ms 만에 다시 응답했어요.",
    }


@pytest.mark.parametrize(
    ("outage_ms", "said"),
    [(0.4, "after 0 ms"), (25.0, "after 25 ms"), (999.0, "after 999 ms"), (1040.0, "after 1.0 s")],
)
def test_an_outage_of_less_than_a_second_is_told_in_milliseconds(outage_ms: float, said: str) -> None:
    assert report(outage_ms=outage_ms).summary["en"].endswith(f"it answered again {said}.")


def test_a_likely_cause_is_never_told_as_certain() -> None:
    assert report(grade="likely").summary["en"].startswith("Most likely ")
    assert report(grade="likely").summary["ko"].startswith("아마도 ")
    assert report(grade="unknown").summary["en"].startswith("As far as can be told, ")


def test_what_recovery_waits_for_is_told_with_the_next_step() -> None:
    one = report(outcome="manual", waits_for="DB_LOCKED")
    assert one.summary == {
        "en": "The ledger was killed from outside; recovery waits for a person: DB_LOCKED — another program "
        "holds the ledger's lock.",
        "ko": "장부 서버가 밖에서 강제 종료됐고 자동 복구를 멈추고 사람의 확인을 기다려요: DB_LOCKED — 다른 프로그램이 "
        "장부의 잠금을 쥐고 있어요.",
    }
    for language in texts.LANGUAGES:
        step = texts.NEXT_STEPS["DB_LOCKED"][language]
        assert step.replace("`", "\\`") in as_markdown(one, language)
        assert " ".join(step.split()) in " ".join(terminal(one, language, Look(300)).split())
    assert as_story(one, "en")["waits_for"] == "DB_LOCKED"


def test_a_loop_of_deaths_is_told_in_a_plain_sentence() -> None:
    one = report(outcome="manual", waits_for="CRASH_LOOP")
    assert one.summary["en"].endswith("CRASH_LOOP — it failed more often than the restart budget allows.")


def test_an_incident_that_was_served_after_waits_for_nobody() -> None:
    one = report(outcome="manual", waits_for="DB_LOCKED", served_again_at="2026-11-21T09:30:00.000Z")
    assert one.summary["en"].endswith("; recovery had stopped, and it was open again later.")
    assert one.summary["ko"].endswith("자동 복구를 멈췄지만 나중에 다시 열렸어요.")
    assert as_item(one, "en")["served_again_at"] == "2026-11-21T09:30:00.000Z"
    for language in texts.LANGUAGES:
        said = as_markdown(one, language) + terminal(one, language, Look())
        assert texts.OUTCOME_WORDS["served"][language] in said
        assert texts.OUTCOME_WORDS["manual"][language] not in said
        assert texts.WORDS["next_step"][language] not in said
        assert texts.WORDS["served_again"][language] in terminal(one, language, Look())


@pytest.mark.parametrize("outcome", ["recovered", "open"])
def test_nobody_is_asked_to_do_anything_where_nothing_waits(outcome: str) -> None:
    one = report(outcome=outcome, waits_for="DB_LOCKED")
    assert "DB_LOCKED" not in one.summary["en"]
    assert texts.WORDS["next_step"]["en"] not in as_markdown(one, "en") + terminal(one, "en", Look())


@pytest.mark.parametrize("waits_for", [*texts.CAUSES, None, "SOMETHING_NEW"])
def test_whatever_waits_for_a_person_has_a_next_step(waits_for: str | None) -> None:
    for language in texts.LANGUAGES:
        one = report(outcome="manual", waits_for=waits_for)
        assert texts.WORDS["next_step"][language] in as_markdown(one, language)


def test_an_incident_whose_guard_died_is_neither_open_nor_over_well() -> None:
    one = report(outcome="open", diagnosis="UNKNOWN", grade="unknown")
    assert one.summary["en"].endswith("; the guard itself ended before it could tell how it came out.")
    assert texts.OUTCOME_WORDS["untold"]["ko"] in as_markdown(one, "ko")
    assert "not known" in terminal(one, "en", Look())
    assert report(outcome="open", closed_at=None).summary["en"].endswith("has not ended yet.")


def test_an_incident_that_its_guard_did_not_live_to_end_says_when_the_ledger_answered_again() -> None:
    at = "2026-11-21T14:08:19.000Z"
    one = report(outcome="abandoned", served_again_at=at, outage_ms=440.0)
    assert one.summary["en"].endswith("ended before it was over; it answered again after 440 ms.")
    assert texts.OUTCOME_WORDS["taken_over"]["ko"] in as_markdown(one, "ko")
    unmeasured = report(outcome="abandoned", served_again_at=at, outage_ms=None)
    assert unmeasured.summary["en"].endswith("; the ledger answered again later.")
    assert report(outcome="abandoned").summary["en"].endswith("could tell how it came out.")


def test_a_guard_that_died_in_the_middle_of_an_outage_is_not_told_as_if_nobody_had_waited() -> None:
    one = went_on("recovered", "SENTINEL_LOST", left_open="01a2030f-8")
    for language in texts.LANGUAGES:
        text = as_markdown(one, language) + terminal(one, language, Look(110))
        assert "01a2030f-8" in one.summary[language]
        assert outage_word(one.incident, language) == texts.WORDS["nothing_recorded"][language]
        assert texts.OUTCOMES["went_on"][language] not in text
        assert texts.MONEY["went_on"][language] not in " ".join(text.split())


@pytest.mark.parametrize("diagnosis", [*texts.CAUSES, "SOMETHING_NEW"])
@pytest.mark.parametrize("outcome", sorted(incident.OUTCOMES))
def test_every_diagnosis_and_outcome_has_its_words(diagnosis: str, outcome: str) -> None:
    for language, sentence in report(diagnosis=diagnosis, outcome=outcome).summary.items():
        assert "{" not in sentence, language
        assert sentence.endswith(".")
    title = report(diagnosis=diagnosis, outcome=outcome).title
    assert "요" in title["ko"]
    assert title["en"][0].isupper()


def test_every_cause_in_korean_can_stand_alone_and_lead_on() -> None:
    for diagnosis, cause in texts.CAUSES.items():
        stem = cause["ko"].removesuffix("고")
        assert stem != cause["ko"], diagnosis
        assert (ord(stem[-1]) - ord("가")) % 28 == 20, f"{diagnosis}: {stem} takes no -어요"


def test_no_text_lacks_a_language() -> None:
    tables = (texts.CAUSES, texts.GRADES, texts.OUTCOMES, texts.OUTCOME_WORDS, texts.STEPS, FINDINGS)
    for table in (
        *tables,
        texts.WAITS,
        texts.NEXT_STEPS,
        texts.REQUEST_OUTCOMES,
        texts.MONEY,
        texts.WORDS,
        texts.ERRORS,
    ):
        for key, text in table.items():
            assert set(text) == set(texts.LANGUAGES), key
            assert all(text.values()), key


@pytest.mark.parametrize("language", texts.LANGUAGES)
def test_nothing_is_said_about_losses_without_a_witness(language: str) -> None:
    chain = {"kind": "chain", "tail": 1000, "seq": 40, "witness_seq": None}
    assert money_line(report(proof=chain), language) == texts.MONEY["chain"][language].format(tail=1000)
    assert money_line(report(proof=None), language) == texts.MONEY["no_proof"][language]
    assert money_line(report(proof=None, closed_at=None), language) == texts.MONEY["none"][language]
    for proof in (chain, None):
        text = as_markdown(report(proof=proof), language) + terminal(report(proof=proof), language, Look())
        assert texts.MONEY["witness"][language].split(".")[0].split(":")[0] not in text


def went_on(outcome: str, diagnosis: str, **more: object) -> Report:
    steps = [
        {"at": None, "offset_ms": offset, "step": step} for offset, step in ((0, "fault"), (9, "closed"))
    ]
    return report(
        outcome=outcome,
        diagnosis=diagnosis,
        timeline=steps,
        outage_ms=None,
        core={"pid": 101, "epoch": 7, "exit": None},
        requests=[],
        proof=None,
        deaths=[],
        next_epoch=None,
        **more,
    )


@pytest.mark.parametrize("language", texts.LANGUAGES)
def test_a_trouble_that_stopped_nobody_claims_no_gap_in_what_is_known(language: str) -> None:
    one = went_on("recovered", "DB_LOCKED")
    for text in (as_markdown(one, language), terminal(one, language, Look(110))):
        assert texts.WORDS["nothing_stopped"][language] in text
        assert texts.WORDS["refusals_untold"][language].split(". ")[0] in text
        assert texts.WORDS["no_requests"][language] not in text
        assert texts.MONEY["went_on"][language] in " ".join(text.split())
        assert texts.MONEY["none"][language] not in text


def test_a_guard_that_died_alone_is_not_told_as_an_outage() -> None:
    summary = went_on("recovered", "SENTINEL_LOST").summary
    assert summary["en"].endswith("another took over; the ledger went on answering all the while.")
    assert summary["ko"].endswith("이어받았고 장부는 계속 응답했어요.")


@pytest.mark.parametrize("language", texts.LANGUAGES)
def test_an_incident_that_was_read_only_and_is_over_does_not_read_as_if_it_still_were(language: str) -> None:
    one = went_on("safe_mode", "DISK_FULL")
    assert texts.OUTCOME_WORDS["safe_mode"] == {"ko": "한때 읽기 전용", "en": "was read-only"}
    for text in (as_markdown(one, language), terminal(one, language, Look(110))):
        assert texts.OUTCOME_WORDS["safe_mode"][language] in text
        assert texts.WORDS["reads_went_on"][language] in text


def test_a_request_that_was_committed_before_the_death_is_not_told_as_run_after_it() -> None:
    command = story.command("cmd-1", "COMMITTED", "tx-1", [], "a" * 32)
    one = report(in_flight=[command])
    assert one.incident.requests[0].outcome == "replayed"
    for language in texts.LANGUAGES:
        for text in (as_markdown(one, language), terminal(one, language, Look(110))):
            assert texts.REQUEST_OUTCOMES["committed"][language].split(" ")[0] in text
            assert texts.REQUEST_OUTCOMES["replayed"][language] not in text


def test_a_witness_that_says_that_all_is_well_is_no_evidence() -> None:
    lines = [
        {"kind": "beats", "colour": "green", "text": "both beats are fresh"},
        {
            "kind": "store",
            "colour": "yellow",
            "text": "process 7 (x) has held the store's write lock for 400 ms",
        },
        {"kind": "operator", "colour": "green", "text": "the backup needs it"},
        {
            "kind": "store",
            "colour": "yellow",
            "text": "process 7 (x) has held the store's write lock for 900 ms",
        },
        {
            "kind": "store",
            "colour": "yellow",
            "text": "process 8 (y) has held the store's write lock for 900 ms",
        },
    ]
    told = as_story(report(evidence=lines), "en")["evidence"]
    assert [line["text"] for line in told] == [
        "process 7 (x) has held the store's write lock for 900 ms",
        "the backup needs it",
        "process 8 (y) has held the store's write lock for 900 ms",
    ]


def test_last_words_are_told_beside_the_evidence() -> None:
    one = report(last_words={"code": "EXCEPTION", "text": "ValueError at x"})
    assert "EXCEPTION: ValueError at x" in as_markdown(one, "en")
    assert "EXCEPTION: ValueError at x" in terminal(one, "en", Look())


@pytest.mark.parametrize("language", texts.LANGUAGES)
def test_the_markdown_tells_the_whole_story(language: str) -> None:
    text = as_markdown(report(), language)
    for part in (
        "KILLED_FROM_OUTSIDE",
        "912 ms",
        "assets:bank:kb",
        "tx-1",
        "/api/ledger/transactions",
        "recorder.bin",
    ):
        assert part in text
    assert "None" not in text
    headings = [line.lstrip("# ") for line in text.splitlines() if line.startswith("## ")]
    fields = (
        *("summary", "impact", "root_causes", "trigger", "resolution", "detection_head"),
        *("action_items", "lessons", "timeline", "supporting"),
    )
    words = words_of(language)
    assert headings == [words[field] for field in fields]
    assert all(f"| {words[field]} |" in text for field in ("title", "date", "authors", "status"))
    assert all(f"## {words[word]}" in text for word in ("requests", "files", "repetition", "changes"))
    assert money_line(report(), language) in text


@pytest.mark.parametrize("language", texts.LANGUAGES)
def test_no_text_of_the_ledger_breaks_out_of_a_report(language: str) -> None:
    text = as_markdown(hostile(), language)
    assert all(character.isprintable() or character == "\n" for character in text)
    assert "\n# head" not in text
    for raw in ("<script>", "](http", "`x`", "**b**"):
        assert re.search(rf"(?<!\\){re.escape(raw)}", text) is None


@pytest.mark.parametrize("language", texts.LANGUAGES)
@pytest.mark.parametrize("width", [56, 80, 110])
def test_no_text_of_the_ledger_reaches_the_terminal_raw(language: str, width: int) -> None:
    text = terminal(hostile(), language, Look(width))
    assert all(character.isprintable() or character == "\n" for character in text)


@pytest.mark.parametrize("language", texts.LANGUAGES)
@pytest.mark.parametrize("width", [56, 64, 80, 110])
def test_no_line_is_wider_than_the_window(language: str, width: int) -> None:
    for line in terminal(hostile(), language, Look(width)).splitlines():
        assert as_terminal.cells(line) <= width, line
    for line in terminal(report(), language, Look(width)).splitlines():
        assert as_terminal.cells(line) <= width, line


def test_colour_is_only_where_it_is_wanted() -> None:
    assert "\x1b" not in terminal(report(), "en", Look())
    assert "\x1b[32mrecovered" in terminal(report(), "en", Look(100, colour=True))


def test_an_escape_shows_exactly_the_characters() -> None:
    assert escape("assets:bank_kb") == "assets:bank_kb"
    assert escape("_a_ *b* `c`") == r"\_a\_ \*b\* \`c\`"
    assert escape("a\nb\x1b") == r"a\\nb\\x1b"


@pytest.mark.parametrize(("text", "width"), [("abc", 3), ("한글", 4), ("e\u0301", 1), ("a한", 3)])
def test_a_korean_syllable_takes_two_cells(text: str, width: int) -> None:
    assert as_terminal.cells(text) == width
    assert as_terminal.cells(as_terminal.cut("한글 설명이 아주 길어요", 9)) <= 9
    assert as_terminal.pad("한글", 6) == "한글  "


@pytest.mark.parametrize("language", texts.LANGUAGES)
def test_the_sentence_says_first_that_a_request_was_convicted(language: str) -> None:
    died = {"name": "a" * 32, "command_id": "cmd-1", "ordeal": "died", "letter": "letter-1"}
    once = report(
        diagnosis="CRASHED", grade="likely", trials=[died, died | {"ordeal": "survived", "letter": ""}]
    )
    assert once.summary[language].startswith(texts.CONVICTED["died"][language])
    assert "912 ms" in once.summary[language]
    twice = report(diagnosis="CRASHED", trials=[died, died | {"name": "b" * 32, "ordeal": "hung"}])
    assert twice.summary[language].startswith(texts.CONVICTED["many"][language].format(count=2))


def test_of_an_empty_ledger_no_first_and_last_record_are_told() -> None:
    assert "number 0" not in money_line(report(audit={"ok": True, "seq": 0}), "en")
