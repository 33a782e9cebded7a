import base64
import hashlib
import html
import io
import json
import re
import zipfile
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from postmortem import bundle, cli, reading
from postmortem.cli import Refused
from postmortem.reports import as_zip
from postmortem.reports.as_html import as_html
from postmortem.reports.drawings import Moment, Span, Wait, draw_day, draw_memory, draw_ring, draw_timeline
from postmortem.reports.redaction import MASK, Sieve
from postmortem.reports.report import Change, Report, change_line, repetition_line
from tests.unit.postmortem import story
from tests.unit.postmortem.test_reading import keep
from tests.unit.postmortem.test_reports import HOSTILE, hostile, report

LANGUAGES = ("ko", "en")
#: Stands wherever a person or a program could have put a secret; must never leave in an archive.
CANARY = "canary7Qx9secretLantern"
NEXT = "0199b000-0000-7000-8000-00000000000d"


class Elements(HTMLParser):
    """Collects what a browser would see of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.names: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.append(tag)
        self.attributes += attrs


def seen(page: str) -> Elements:
    elements = Elements()
    elements.feed(page)
    return elements


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_saved_page_says_what_the_other_papers_say_and_needs_nothing_but_itself(language: str) -> None:
    page = as_html(report(), language)
    for part in ("KILLED_FROM_OUTSIDE", "assets:bank:kb", "tx-1", "912 ms", "recorder.bin"):
        assert part in page
    elements = seen(page)
    assert not {"script", "link", "img", "iframe", "form"} & set(elements.names)
    names = {name for name, _ in elements.attributes}
    assert not {"style", "src", "href"} & names
    assert not any(name.startswith("on") for name in names)


def test_a_saved_page_allows_its_own_style_and_nothing_else() -> None:
    page = as_html(report(), "en")
    policy = html.unescape(re.findall(r'Content-Security-Policy" content="([^"]*)"', page)[0])
    sheet = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)[0]
    digest = base64.b64encode(hashlib.sha256(sheet.encode()).digest()).decode()
    assert policy.startswith(f"default-src 'none'; style-src 'sha256-{digest}';")


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_text_of_the_ledger_becomes_markup_of_a_page(language: str) -> None:
    page = as_html(hostile(), language)
    assert "<script" not in page
    assert not set("\x1b\x07\x00\u202e\r") & set(page)
    assert seen(page).names.count("h1") == 1


def packed(incidents: Path, incident_id: str = story.ID) -> dict[str, bytes]:
    out = incidents.parent / "out.zip"
    assert cli.export(incidents, incident_id, out) is None
    with zipfile.ZipFile(io.BytesIO(out.read_bytes())) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def full_of_secrets() -> dict[str, Any]:
    command = story.command("cmd-1", "DECIDING", "tx-1", ["assets:cash"], "a" * 32)
    return {
        "diagnosis": "CRASHED",
        "reason": f"because {CANARY} said so",
        "last_words": {"code": "BUG", "text": f"password {CANARY}"},
        "evidence": [{"kind": "core", "text": f"it said {CANARY} ({CANARY})"}],
        "in_flight": [command | {"kind": CANARY, "payload": CANARY, "password": CANARY, CANARY: 1}],
        "requests": [
            {
                "method": "POST",
                "path": f"/api/ledger/{CANARY}?token={CANARY}",
                "key_hash": CANARY,
                "outcome": CANARY,
            }
        ],
        "trials": [{"name": CANARY, "command_id": CANARY, "ordeal": "died", "letter": CANARY, "why": CANARY}],
        "deaths": [{"at": None, "diagnosis": CANARY, "exit": {}}],
        "audit": {"ok": False, "seq": 1, "fault": CANARY},
        "waits_for": CANARY,
        "drill": CANARY,
        "build": CANARY,
        "policy_sha256": CANARY,
    }


def test_a_secret_put_anywhere_never_leaves_in_an_archive(tmp_path: Path) -> None:
    incidents = tmp_path / "incidents"
    stack = story.thread(7, story.frame(CANARY, 1, f"{CANARY}.txt", note=CANARY), name=CANARY)
    files = {
        "stacks.json": json.dumps([stack]).encode(),
        "stacks.txt": CANARY.encode(),
        "log.txt": f'Traceback (most recent call last):\n  File "x.py", line 1, in f\nKeyError: {CANARY}'.encode(),
        "recorder.json": json.dumps(
            {"in_flight": [{"command_id": CANARY}], "components": [{"name": CANARY}]}
        ).encode(),
        "process.json": json.dumps({"environ": {"PASSWORD": CANARY}, "cmdline": [CANARY]}).encode(),
        "observations.jsonl": f'{{"policy_sha256": "{CANARY}"}}'.encode(),
        f"{CANARY}.json": b"{}",
    }
    keep(incidents, files=files, **full_of_secrets())
    for language in LANGUAGES:
        lines = cli.export_preview(incidents, story.ID, language)
        assert not isinstance(lines, Refused)
        assert CANARY not in "\n".join(lines)
    told = packed(incidents)
    assert {"report.md", "report.html", "report.json", "contents.txt", "evidence/incident.json"} <= set(told)
    for name, data in told.items():
        assert CANARY not in name
        assert CANARY.encode() not in data, name


def test_an_archive_keeps_what_an_incident_is_understood_by(tmp_path: Path) -> None:
    keep(tmp_path / "incidents", diagnosis="CRASHED")
    facts = json.loads(packed(tmp_path / "incidents")["evidence/incident.json"])
    assert facts["diagnosis"] == "CRASHED"
    assert facts["in_flight"][1]["account_ids"] == ["assets:bank:kb", "expenses:food"]
    assert facts["outage_ms"] == 912.3
    assert [step["step"] for step in facts["timeline"]] == ["fault", "detected", "serving"]


def test_an_archive_says_what_was_left_out_and_why(tmp_path: Path) -> None:
    keep(tmp_path / "incidents", files={"log.txt": b"x", "stacks.json": b"{broken"})
    lines = packed(tmp_path / "incidents")["contents.txt"].decode().splitlines()
    assert "log.txt: left out (raw contents with values)" in lines
    assert "recorder.bin: left out (raw contents with values)" in lines
    assert "stacks.json: left out (unreadable)" in lines


def test_the_same_incident_makes_the_same_archive(tmp_path: Path) -> None:
    keep(tmp_path / "incidents")
    found = reading.find(tmp_path / "incidents", story.ID)[0]
    archives = {as_zip.as_zip(as_zip.pack(found, reading.read_report(found), "en").files) for _ in range(2)}
    assert len(archives) == 1


@pytest.mark.parametrize(
    ("secret", "name"),
    [
        ("eyJhbGciOiJIUzI1NiJ9.eyJzdWIiOiIxIn0.abc", "place"),
        ("4111 1111 1111 1111", "text"),
        ("800101-1234567", "text"),
        ("https://me:pass@bank.example", "path"),
        ("hunter2", "password"),
        ("assets:cash", "session_id"),
    ],
)
def test_what_looks_like_a_secret_is_hidden_wherever_it_stands(secret: str, name: str) -> None:
    told = json.dumps(
        Sieve().value({name: secret, "list": [secret]} if name != "session_id" else {name: secret})
    )
    assert secret not in told
    assert MASK in told


@pytest.mark.parametrize("ending", cli.EXPORTS)
def test_an_incident_is_exported_for_its_owner_only(tmp_path: Path, ending: str) -> None:
    keep(tmp_path / "incidents")
    out = tmp_path / f"x{ending}"
    assert cli.export(tmp_path / "incidents", story.ID, out) is None
    assert out.stat().st_mode & 0o777 == 0o600
    assert out.stat().st_size > 0


@pytest.mark.parametrize("strange", ["../../etc/passwd", "..", "/", "a/b", "\x1b[2J", ""])
def test_an_id_that_is_a_path_names_no_incident(tmp_path: Path, strange: str) -> None:
    keep(tmp_path / "incidents")
    assert isinstance(cli.export(tmp_path / "incidents", strange, tmp_path / "x.zip"), Refused)
    assert isinstance(cli.export_preview(tmp_path / "incidents", strange), Refused)


def test_repetition_counts_equal_deaths_before_this_one_and_none_after(tmp_path: Path) -> None:
    for number, incident_id in enumerate((story.ID, NEXT)):
        folder = keep(
            tmp_path, incident_id, opened_at=f"2026-11-21T14:0{number}:00.000Z", policy_sha256=f"p{number}"
        )
        assert cli.write_report(folder) is None
    first, second = (json.loads((tmp_path / one / "report.json").read_text()) for one in (story.ID, NEXT))
    assert first["repetition"] == {"count": 0, "last": ""}
    assert second["repetition"] == {"count": 1, "last": story.ID}
    assert first["fingerprint"] == second["fingerprint"]
    assert first["changes"] == []
    assert [(one["what"], one["before"], one["now"]) for one in second["changes"]] == [("policy", "p0", "p1")]
    assert cli.write_report(tmp_path / story.ID) is None
    assert json.loads((tmp_path / story.ID / "report.json").read_text())["repetition"]["count"] == 0


@pytest.mark.parametrize(
    "report_json", [b"", b"\xff\x00", b"[" * 50_000, b"x" * (1 << 20), b' "fingerprint": "a",\n' * 9]
)
def test_a_damaged_report_beside_it_costs_only_itself(tmp_path: Path, report_json: bytes) -> None:
    damaged = keep(tmp_path, NEXT, files={"report.json": report_json})
    folder = keep(tmp_path)
    assert cli.write_report(folder) is None
    assert damaged.exists()
    assert json.loads((folder / "report.json").read_text())["repetition"]["count"] == 0


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_is_not_on_record_is_never_told_as_unchanged(language: str) -> None:
    assert change_line(Change("build", None, "abc"), language) == change_line(
        Change("build", "abc", None), language
    )
    assert change_line(Change("build", "abc", "abc"), language) != change_line(
        Change("build", None, None), language
    )
    assert repetition_line(None, language) != ""


def test_a_story_has_what_is_kept_of_it_in_the_archive_of_incidents(tmp_path: Path) -> None:
    stack = story.thread(
        101, story.frame("decide", 8, "core/ledger/decider.py"), story.frame("run", 9, "asyncio/x.py")
    )
    folder = keep(tmp_path, files={"stacks.json": json.dumps([stack]).encode()}, diagnosis="LOOP_BLOCKED")
    assert cli.write_report(folder) is None
    told = json.loads((folder / "report.json").read_text())
    assert set(told["title"]) == {"ko", "en"}
    assert told["why"] == ["diagnosis LOOP_BLOCKED", "frame decide (decider.py)"]
    assert [frame["own"] for frame in told["stacks"][0]["frames"]] == [True, False]
    assert {"culprit", "trials", "waits", "memory", "changes", "proposals"} <= set(told)


def test_the_pieces_of_a_timeline_are_those_of_the_outage_and_none_is_lost_to_sight() -> None:
    moments = [Moment(HOSTILE, 0), Moment("b", 0.1), Moment("c", 1000), Moment("d", 1500, outage=False)]
    drawn = draw_timeline(moments, "en")
    assert drawn is not None
    widths = [float(width) for width in re.findall(r'd-piece[^>]*? width="([\d.]+)"', drawn.svg)]
    assert len(widths) == 2
    assert sum(widths) == pytest.approx(720, abs=0.1)
    assert min(widths) >= 3
    assert [row[4] for row in drawn.rows] == ["", "0 %", "100 %", ""]
    assert "<b" not in drawn.svg
    assert not set("\x1b\x00") & set(str(drawn.rows))


def test_what_has_no_sensible_picture_has_none() -> None:
    assert draw_timeline([Moment("a", 5)], "en") is None
    assert draw_timeline([Moment("a", 5), Moment("b", 5)], "ko") is None
    assert draw_memory([(0.0, 5)], None, "en") is None
    assert draw_ring([], "en") is None
    assert draw_ring([Wait("a", "x", "a")], "en") is None
    assert draw_day([], "en") is None
    assert draw_day([Span(-5, -1, "up")], "en") is None


def test_a_memory_curve_keeps_its_peak_and_its_end_however_many_looks_there_were() -> None:
    points = [(float(at) / 10 - 1000, 100 << 20) for at in range(10_000)]
    points[5_000] = (points[5_000][0], 900 << 20)
    drawn = draw_memory(points, 512 << 20, "en")
    assert drawn is not None
    assert len(re.findall(r"[\d.]+,[\d.]+", drawn.svg)) <= 700
    assert any(row[1] == "900 MiB" for row in drawn.rows)
    assert "The limit is 512 MiB." in drawn.title


def test_every_number_in_the_bar_of_a_timeline_is_told_beside_it() -> None:
    drawn = draw_timeline(
        [Moment("fault", 0), Moment("seen <b>", 3), Moment("ready", 900), Moment("end", 1_000)], "en"
    )
    assert drawn is not None
    assert re.findall(r"<text[^>]*>(\d+)</text>", drawn.svg) == [
        one.partition(" ")[0] for one in drawn.legend
    ]
    assert drawn.legend[0] == "2 ready 897 ms"


@pytest.mark.parametrize("many", [2, 3, 12, 40])
def test_a_ring_of_any_size_is_drawn_within_its_frame(many: int) -> None:
    waits = [Wait(f"t{n}<b>", HOSTILE, f"t{(n + 1) % many}<b>") for n in range(many)]
    drawn = draw_ring(waits, "ko")
    assert drawn is not None
    assert "<b>" not in drawn.svg
    assert len(drawn.rows) == min(many, 12)
    frame = re.search(r'viewBox="0 0 \d+ (\d+)"', drawn.svg)
    assert frame is not None
    assert all(0 <= float(down) <= float(frame[1]) for down in re.findall(r' y="([\d.-]+)"', drawn.svg))


def test_the_strip_of_a_day_shows_an_outage_of_a_second() -> None:
    drawn = draw_day(
        [Span(80_000, 80_001, "down", HOSTILE), Span(0, 86_400, "up"), Span(3, 4, HOSTILE)], "en"
    )
    assert drawn is not None
    assert drawn.svg.index('d-up"') < drawn.svg.index('d-down"'), "what is short is drawn over what is long"
    assert HOSTILE not in drawn.svg
    assert "d-unknown" in drawn.svg


def test_a_bundle_with_lines_of_a_megabyte_is_read_in_bounded_words(tmp_path: Path) -> None:
    long = "A" * (1 << 20)
    folder = keep(
        tmp_path,
        files={
            "log.txt": long.encode(),
            "stacks.txt": long.encode(),
            "observations.jsonl": (long + "\n").encode() * 3,
        },
        last_words={"code": long, "text": long},
        evidence=[{"kind": long, "text": long}] * 50,
    )
    assert cli.write_report(folder) is None
    assert (folder / "report.json").stat().st_size < 1 << 20
    assert bundle.verify_bundle(folder) == []


def test_a_report_is_the_same_with_and_without_a_past_but_for_repetition() -> None:
    alone: Report = report()
    assert (alone.repetition, alone.changes) == (None, None)
