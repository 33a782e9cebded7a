"""The dashboard's pages on an archive that was filled by hand; the real one is looked at in the contract tests."""

import csv
import io
import json
import os
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from frontend.admin_paper import admin_files
from postmortem import bundle, reading
from postmortem.cli import exported
from postmortem.views import Act, Drill, ProposalState
from tests.unit.postmortem import story
from tests.unit.postmortem.web_archive import LETTER_ID, TOKEN, Archive, Visitor, letter, line, proposal

PAGES = (
    "/admin/", "/admin/incidents", "/admin/incidents?view=all", "/admin/dlq", "/admin/snapshots",
    "/admin/trends", "/admin/policy", "/admin/settings",
)  # fmt: skip
ONE = f"/admin/incidents/{story.ID}"
LETTER = f"/admin/dlq/{LETTER_ID}"
HOSTILE = "<script>alert(1)</script>\u202egnp.exe\x1b[2J"


@pytest.fixture
def visitor(tmp_path: Path) -> Visitor:
    (tmp_path / "incidents").mkdir()
    return Visitor(tmp_path, Archive())


def with_incident(
    visitor: Visitor, threads: list[Any] | None = None, printed: str = "", **facts: Any
) -> Visitor:
    files = {
        "incident.json": story.facts(**facts),
        "stacks.json": threads or [],
        "recorder.json": {"finished": [story.command("cmd-0", "FREE", "tx-0", ["assets:bank:kb"], "")]},
    }
    packed = {name: json.dumps(told).encode() for name, told in files.items()}
    packed |= {"stacks.txt": printed.encode()} if printed else {}
    written = bundle.write_bundle(
        visitor.folder / "incidents", story.ID, packed, {"memory.json": "disk full"}
    )
    assert isinstance(written, Path)
    visitor.archive.lines.append(line())
    return visitor


@pytest.mark.parametrize("lang", ["ko", "en"])
@pytest.mark.parametrize("path", PAGES)
def test_a_page_stands_before_anything_has_happened_and_without_a_guard(
    visitor: Visitor, path: str, lang: str
) -> None:
    visitor.lang = lang
    answer = visitor.get(path)
    assert answer.status == 200
    assert f'<html lang="{lang}">' in answer.text
    assert "script-src 'self'" in answer.headers["content-security-policy"]
    assert answer.headers["cache-control"] == "no-store"


def test_silence_is_told_with_the_date_of_the_last_proof(visitor: Visitor) -> None:
    assert "never been drilled" in visitor.get("/admin/").text
    long_ago = (datetime.now(UTC) - timedelta(days=34, hours=2)).isoformat()
    visitor.archive.lines.append(line(opened_at=long_ago))
    visitor.archive.drilled.append(Drill("2026-11-20T09:00:00Z", "crash", True, 84.0, None, False))
    page = visitor.get("/admin/").text
    assert "No incident in 34 days" in page
    assert "back after 84 ms" in page


def test_a_drill_that_only_left_an_incident_is_a_proof_and_stands_once_among_the_drills(
    visitor: Visitor,
) -> None:
    visitor.archive.lines.append(line(drill="crash", outage_ms=84.0))
    assert "back after 84 ms" in visitor.get("/admin/").text
    assert visitor.get("/admin/trends").text.count("sudden death") == 1
    visitor.archive.drilled.append(Drill("2026-11-21T14:08:20Z", "crash", True, 84.0, story.ID, False))
    assert visitor.get("/admin/trends").text.count("sudden death") == 1


def test_the_outcome_of_an_incident_whose_guard_died_is_said_in_words_and_can_be_filtered_by(
    visitor: Visitor,
) -> None:
    visitor.archive.lines.append(line(outcome="abandoned"))
    page = visitor.get("/admin/incidents?view=all").text
    assert '<option value="abandoned">not known</option>' in page
    assert ">not known</td>" in page
    assert ">abandoned<" not in page


def test_the_list_of_incidents_is_a_file_without_formulas(visitor: Visitor) -> None:
    visitor.archive.lines += [line(id=f"a{n}", account_ids=("=cmd()",)) for n in range(700)]
    rows = list(csv.reader(io.StringIO(visitor.get("/admin/incidents.csv").body.decode("utf-8-sig"))))
    assert len(rows) == 701
    assert "'=cmd()" in rows[1]
    told = json.loads(visitor.get("/admin/incidents.json?diagnosis=DEADLOCK").body)
    assert told == []
    assert visitor.get("/admin/incidents.exe").status == 404


def test_no_cell_of_the_file_moves_what_shows_it(visitor: Visitor) -> None:
    visitor.archive.lines.append(line(account_ids=("a\x1b[2J\x00\u202e",), summary={"en": "\t=cmd()\ud800"}))
    told = visitor.get("/admin/incidents.csv").body.decode("utf-8-sig")
    assert not {"\x1b", "\x00", "\u202e", "\t", "\ud800"} & set(told)
    assert r"a\x1b[2J\x00\u202e" in told


def test_a_failed_drill_proves_nothing(visitor: Visitor) -> None:
    visitor.archive.drilled.append(Drill("2026-11-20T09:00:00Z", "crash", False, None, None, False))
    assert "did not end as promised" in visitor.get("/admin/").text


def test_what_the_guard_does_not_say_is_left_out(visitor: Visitor) -> None:
    visitor.status = {"state": "RECOVERY", "core": {"pid": None}, "gateway": "?", "since": 5}
    page = visitor.get("/admin/").text
    assert "Recovering" in page
    assert "Heartbeat" not in page
    visitor.status = {"state": "<b>"}
    assert "The guard does not answer" in visitor.get("/admin/").text


def test_memory_is_told_with_its_limit(visitor: Visitor) -> None:
    visitor.status = {"state": "OPERATIONAL", "core": {"rss_bytes": 61 << 20}}
    assert "61 MiB (limit 512 MiB)" in visitor.get("/admin/").text


def test_the_strip_of_the_day_claims_nothing_for_the_time_before_somebody_watched(visitor: Visitor) -> None:
    assert "d-up" not in visitor.get("/admin/").text
    visitor.status = {"state": "OPERATIONAL", "launcher": {"pid": os.getpid()}}
    widths = re.findall(r'd-span d-up" x="([\d.]+)"', visitor.get("/admin/").text)
    assert len(widths) == 1
    assert float(widths[0]) > 300, "this test has not run for half a day"


def test_a_drill_is_an_outage_on_the_strip_and_no_incident_in_the_calm(visitor: Visitor) -> None:
    at = (datetime.now(UTC) - timedelta(hours=1)).isoformat()
    visitor.archive.lines.append(line(opened_at=at, drill="crash"))
    page = visitor.get("/admin/").text
    assert "d-down" in page
    assert "No incident besides drills" in page


@pytest.mark.parametrize(
    ("outcome", "kind"), [("safe_mode", "reads"), ("manual", "unknown"), ("recovered", "")]
)
def test_an_incident_without_an_outage_is_not_drawn_as_one(visitor: Visitor, outcome: str, kind: str) -> None:
    at = datetime.now(UTC) - timedelta(hours=1)
    closed_at = (at + timedelta(minutes=10)).isoformat()
    told = line(opened_at=at.isoformat(), closed_at=closed_at, outage_ms=None, outcome=outcome)
    visitor.archive.lines.append(told)
    drawn = set(re.findall(r"d-span d-(\w+)", visitor.get("/admin/").text)) - {"unknown"}
    assert drawn == ({kind} - {"", "unknown"})


def test_an_incident_is_told_with_its_sentence_its_course_and_its_money(visitor: Visitor) -> None:
    page = with_incident(visitor).get(ONE).text
    assert "the ledger was killed from outside" in page.lower()
    assert "912 ms" in page
    assert 'class="drawing"' in page
    assert "Money" in page or "money" in page
    assert "memory.json" in page
    assert "disk full" in page  # partial evidence says what is missing, and why


def test_an_account_is_masked_until_somebody_asks_and_that_is_written_down(visitor: Visitor) -> None:
    with_incident(visitor)
    assert "assets:bank:kb" not in visitor.get(ONE).text
    assert visitor.written == []
    shown = visitor.post(f"{ONE}/reveal")
    assert "assets:bank:kb" in shown.text
    assert visitor.written == [("reveal", story.ID, "", "shown")]


def test_what_is_not_there_is_not_written_down_as_shown(visitor: Visitor) -> None:
    assert visitor.post(f"{ONE}/reveal").status == 404
    assert visitor.written == []


def test_frames_of_ours_come_first_and_those_of_the_system_are_folded(visitor: Visitor) -> None:
    frames = [
        {"name": "wait", "short_filename": "threading.py", "line": 3},
        {"name": "Writer._run", "short_filename": "core/journal/writer.py", "line": 9},
    ]
    idle = {"thread_name": "pool", "frames": frames[:1]}
    page = with_incident(visitor, [idle, {"thread_name": "writer", "frames": frames}]).get(ONE).text
    assert page.index("Writer._run") < page.index("threading.py")
    assert page.index(">writer<") < page.index(">pool<")
    assert "1 frame of the system" in page


def test_stacks_that_only_the_dying_process_printed_are_shown(visitor: Visitor) -> None:
    printed = (
        "Fatal Python error: Segmentation fault\n\nThread 0x00007f1 (most recent call first):\n"
        '  File "/opt/python3.11/threading.py", line 3 in wait\n\n'
        'Current thread 0x00007f2 (most recent call first):\n  File "/srv/core/x.py", line 9 in decide\n'
    )
    page = with_incident(visitor, printed=printed, diagnosis="CRASHED").get(ONE).text
    assert "No stacks were recorded" not in page
    assert page.index("core/x.py:9") < page.index("0x00007f1")
    assert "1 frame of the system" in page


def test_half_a_character_in_a_bundle_is_written_out(visitor: Visitor) -> None:
    page = with_incident(visitor, reason="\ud800", evidence=[{"kind": "core", "text": "\ud800"}]).get(ONE)
    assert page.status == 200
    assert "\\ud800" in page.text


def test_a_deadlock_is_drawn_as_a_ring_with_its_table(visitor: Visitor) -> None:
    def waiter(tid: int, name: str, lock: str, holder: int) -> dict[str, Any]:
        shown = [{"name": "lock_name", "repr": f"'{lock}'"}, {"name": "held_by", "repr": f"'{holder}'"}]
        return {
            "os_thread_id": tid,
            "thread_name": name,
            "frames": [{"name": "wait_for_lock", "short_filename": "core/guarded/locks.py", "locals": shown}],
        }

    threads = [waiter(1, "writer", "book", 2), waiter(2, "auditor", "index", 1)]
    page = with_incident(visitor, threads, diagnosis="DEADLOCK").get(ONE).text
    assert 'id="ring"' in page
    assert "writer waits for auditor" in page
    assert "<td>book</td>" in page


def test_hostile_text_in_every_field_of_a_bundle_stays_text(visitor: Visitor) -> None:
    request = {
        "method": HOSTILE,
        "path": HOSTILE,
        "key_hash": "",
        "outcome": HOSTILE,
        "status": 1,
        "held_ms": 1,
    }
    facts: dict[str, Any] = {
        "diagnosis": HOSTILE,
        "reason": HOSTILE,
        "evidence": [{"kind": HOSTILE, "text": HOSTILE + "x" * 100_000}],
        "timeline": [{"step": HOSTILE, "at": HOSTILE, "offset_ms": n} for n in (0, 5)],
        "in_flight": [story.command(HOSTILE, HOSTILE, HOSTILE, [HOSTILE], HOSTILE)],
        "requests": [request],
    }
    threads = [{"thread_name": HOSTILE, "frames": [{"name": HOSTILE, "short_filename": HOSTILE}]}]
    with_incident(visitor, threads, **facts)
    visitor.archive.proposed.append(proposal(text={"ko": HOSTILE, "en": HOSTILE}, note=HOSTILE))
    for answer in (visitor.get(ONE), visitor.post(f"{ONE}/reveal")):
        assert answer.status == 200
        assert "<script>alert" not in answer.text
        assert "\u202e" not in answer.text.split('name="note"')[0]
        assert "\x1b" not in answer.text
        assert len(answer.text) < 100_000


@pytest.mark.parametrize("name", ["..", "%2e%2e", "x" * 65, "a.b", "nobody", "..%2fsecret"])
def test_an_id_that_is_a_path_or_nobodys_leads_nowhere(visitor: Visitor, name: str) -> None:
    (visitor.folder / "secret").mkdir()
    for path in (f"/admin/incidents/{name}", f"/admin/incidents/{name}/export.json", f"/admin/dlq/{name}"):
        assert visitor.get(path).status == 404


def test_an_incident_without_its_folder_is_told_from_the_list(visitor: Visitor) -> None:
    visitor.archive.lines.append(line())
    answer = visitor.get(ONE)
    assert answer.status == 200
    assert "can&#39;t be read" in answer.text


def test_a_bundle_that_was_tampered_with_says_so(visitor: Visitor) -> None:
    with_incident(visitor)
    (visitor.folder / "incidents" / story.ID / "stacks.json").write_bytes(b"[")
    page = visitor.get(ONE).text
    assert "Part of the evidence is missing" in page
    assert "stacks.json" in page


@pytest.mark.parametrize("form", ["md", "json", "html", "zip"])
def test_an_export_is_a_file_and_never_a_page(visitor: Visitor, form: str) -> None:
    answer = with_incident(visitor).get(f"{ONE}/export.{form}")
    assert answer.status == 200
    assert answer.headers["content-disposition"].startswith("attachment")
    assert "sandbox" in answer.headers["content-security-policy"]


def test_an_export_of_a_page_says_the_same_as_that_of_the_command_line(visitor: Visitor) -> None:
    with_incident(visitor)
    folder = visitor.folder / "incidents"
    assert (
        exported(folder, reading.find(folder, story.ID)[0], ".md", "en")
        == visitor.get(f"{ONE}/export.md").body
    )


def test_the_redacted_bundle_is_shown_before_it_is_taken(visitor: Visitor) -> None:
    page = with_incident(visitor).get(f"{ONE}/bundle").text
    assert "report.md" in page
    assert "export.zip" in page


def test_an_incident_leads_to_what_was_set_aside_by_it(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    trial = {"name": "a" * 32, "ordeal": "died", "letter": LETTER_ID}
    assert LETTER in with_incident(visitor, trials=[trial]).get(ONE).text


def test_proposals_are_decided_with_owner_and_note(visitor: Visitor) -> None:
    with_incident(visitor).archive.proposed.append(proposal())
    assert "Accept" in visitor.get(ONE).text
    answer = visitor.post("/admin/proposals/p-1/accept", incident=story.ID, owner="Kim", note="now")
    assert (answer.status, answer.headers["location"]) == (303, f"{ONE}?said=done")
    assert visitor.archive.done == [("decide", "p-1", "accept", "Kim", "now")]
    visitor.archive.proposed[0] = proposal(state=ProposalState.ACCEPTED, hits=7)
    page = visitor.get(ONE).text
    assert "It has stopped 7 so far" in page
    assert "Revoke" in page


@pytest.mark.parametrize(
    ("token", "site"),
    [("wrong", "same-origin"), ("", "same-origin"), (TOKEN, "cross-site"), (TOKEN, "same-site")],
)
def test_a_form_from_elsewhere_does_nothing(visitor: Visitor, token: str, site: str) -> None:
    visitor.archive.kept.append(letter())
    visitor.status = {"state": "OPERATIONAL"}
    for path in (f"{LETTER}/hold", f"{LETTER}/discard", "/admin/dlq/bulk", "/admin/drill", f"{ONE}/reveal"):
        answer = visitor.post(
            path, token=token, site=site, sure="1", text="x", verb="hold", id=LETTER_ID, fault="crash"
        )
        assert answer.status == 403
    assert visitor.archive.done == []
    assert visitor.asked == []


def test_no_act_is_done_by_looking(visitor: Visitor) -> None:
    visitor.archive.kept.append(letter())
    for path in ("/admin/restart", "/admin/drill", f"{LETTER}/discard", "/admin/dlq/bulk/b-1/cancel"):
        assert visitor.get(path).status in {404, 405}
    assert visitor.archive.done == []


def test_a_restart_wants_its_word(visitor: Visitor) -> None:
    visitor.status = {"state": "OPERATIONAL", "gateway": {"held_requests": 3}}
    asked = visitor.post("/admin/restart")
    assert "3 requests" in asked.text
    assert "another word" in visitor.post("/admin/restart", sure="1", word="reboot").text
    assert [one["verb"] for one in visitor.asked] == ["status", "status"]
    answer = visitor.post("/admin/restart", sure="1", word=" Restart ")
    assert answer.headers["location"] == "/admin/?said=restarted"
    assert visitor.asked[-1]["verb"] == "restart"
    assert visitor.written == [("restart", "core", "", "asked for")]


def test_a_guard_that_is_away_is_not_said_to_have_obeyed(visitor: Visitor) -> None:
    answer = visitor.post("/admin/drill", fault="crash", sure="1")
    assert answer.headers["location"] == "/admin/?said=guard_away"
    assert "nothing was done" in visitor.get(answer.headers["location"]).text
    assert visitor.post("/admin/drill", fault="rm -rf", sure="1").status == 404


def test_a_group_is_marked_as_mended(visitor: Visitor) -> None:
    with_incident(visitor)
    answer = visitor.post(f"/admin/groups/{'f' * 16}/fixed", version="1.2")
    assert answer.headers["location"] == "/admin/incidents?said=done"
    assert visitor.archive.done == [("fixed", "f" * 16, "1.2")]


def test_groups_are_merged_and_taken_apart_again(visitor: Visitor) -> None:
    visitor.archive.lines += [line(), line(id="b" * 8, fingerprint="e" * 16)]
    page = visitor.get("/admin/incidents").text
    assert f'action="/admin/groups/{"f" * 16}/merge"' in page
    visitor.post(f"/admin/groups/{'f' * 16}/merge", into="e" * 16)
    visitor.post(f"/admin/groups/{'f' * 16}/split")
    visitor.post(f"/admin/groups/{'f' * 16}/split", incident=story.ID)
    assert visitor.archive.done == [
        ("merge", "f" * 16, "e" * 16), ("split", "f" * 16, ""), ("split", "f" * 16, story.ID),
    ]  # fmt: skip
    assert visitor.post(f"/admin/groups/{'f' * 16}/split", incident="../x").status == 404
    assert visitor.post(f"/admin/groups/{'9' * 16}/split").status == 409


def test_a_note_stands_beside_an_incident(visitor: Visitor) -> None:
    with_incident(visitor)
    assert visitor.post(f"{ONE}/note", text="the disk was swapped").status == 303
    assert visitor.archive.done == [("note", "the disk was swapped", story.ID)]
    visitor.archive.lines[0] = line(note=HOSTILE)
    assert "<script>alert" not in visitor.get(ONE).text
    assert visitor.post("/admin/incidents/a..b/note", text="x").status == 404


def test_evidence_is_deleted_only_after_a_question(visitor: Visitor) -> None:
    with_incident(visitor)
    asked = visitor.post(f"{ONE}/remove")
    assert (asked.status, visitor.archive.done) == (200, [])
    assert "does not come back" in asked.text
    assert visitor.post(f"{ONE}/remove", sure="1").status == 303
    assert visitor.archive.done == [("remove", story.ID)]


def test_evidence_is_listed_with_what_is_missing(visitor: Visitor) -> None:
    page = with_incident(visitor).get("/admin/snapshots").text
    assert "3 files" in page
    assert "memory.json: disk full" in page


def test_few_incidents_make_no_trend(visitor: Visitor) -> None:
    visitor.archive.lines += [line(id=f"a{n}") for n in range(4)]
    assert "too few to speak of a trend" in visitor.get("/admin/trends").text
    visitor.archive.lines.append(line(id="a4"))
    assert "31.5" in visitor.get("/admin/trends").text


def test_estimates_stand_beside_what_it_took_and_nonsense_is_passed_over(visitor: Visitor) -> None:
    assert "No estimate was given so far" in visitor.get("/admin/trends").text
    rows = [
        {"total_ms": 900, "told_s": [0, 1]}, {"total_ms": 2500, "told_s": [1, 2]}, {"total_ms": 5, "told_s": None},
        {"total_ms": "x", "told_s": [0, 1]}, {"total_ms": 5, "told_s": [3, 1]}, 7,
    ]  # fmt: skip
    (visitor.folder / "state").mkdir()
    (visitor.folder / "state" / "recoveries.json").write_text(json.dumps({"recoveries": rows}))
    page = visitor.get("/admin/trends").text
    assert "Of 2 estimates 1 held" in page
    assert page.index("1 to 2 s") < page.index("0 to 1 s")
    (visitor.folder / "state" / "recoveries.json").write_text("[[" * 100_000)
    assert visitor.get("/admin/trends").status == 200


def test_every_act_stands_in_the_audit_log(visitor: Visitor) -> None:
    visitor.archive.written.append(
        Act("2026-11-22T09:00:00Z", "dashboard", "discard", LETTER_ID, HOSTILE, "done")
    )
    page = visitor.get("/admin/settings").text
    assert LETTER_ID in page
    assert "<script>alert" not in page


def test_the_language_is_changed_by_a_form_and_leads_back_here_alone(visitor: Visitor) -> None:
    answer = visitor.post("/admin/language", lang="ko", back="/admin/dlq?state=HELD")
    assert answer.headers["location"] == "/admin/dlq?state=HELD"
    assert "lang=ko" in answer.headers["set-cookie"]
    for back in ("//evil.example", "https://evil.example", "/admin/\\evil", "/admin/\r\nX: y"):
        assert visitor.post("/admin/language", lang="ko", back=back).headers["location"] == "/admin/"


def test_files_are_kept_for_ever_under_their_hash_and_nothing_else_is_served(visitor: Visitor) -> None:
    folder, files = admin_files()
    for name in files:
        answer = visitor.get(f"/admin/static/{folder}/{name}")
        assert (answer.status, answer.body) == (200, files[name].body)
        assert "immutable" in answer.headers["cache-control"]
    assert visitor.get(f"/admin/static/{'0' * 12}/admin.css").status == 404
    assert visitor.get(f"/admin/static/{folder}/catalogue_admin.py").status == 404


@pytest.mark.parametrize("path", PAGES)
def test_every_link_of_a_page_leads_to_a_page(visitor: Visitor, path: str) -> None:
    with_incident(visitor).archive.kept.append(letter())
    found = set(re.findall(r'href="(/admin/[^"#]*)', visitor.get(path).text))
    assert found
    for link in found:
        assert visitor.get(link.replace("&amp;", "&")).status == 200, link
