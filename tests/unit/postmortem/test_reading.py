import json
import os
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from postmortem import bundle, cli, reading
from postmortem.cli import Refused
from postmortem.reports.as_terminal import Look
from tests.unit.postmortem import story

NEXT = "0199b000-0000-7000-8000-00000000000d"
#: Shares its beginning with story.ID.
TWIN = "0199a000-0000-7000-8000-0000000000ff"


def keep(
    incidents: Path, incident_id: str = story.ID, files: dict[str, bytes] | None = None, **other: Any
) -> Path:
    facts = json.dumps(story.facts(id=incident_id, **other)).encode()
    path = bundle.write_bundle(
        incidents, incident_id, {"recorder.bin": b"page", "incident.json": facts, **(files or {})}, {}
    )
    assert isinstance(path, Path), path
    return path


def shown(incidents: Path, incident_id: str, lang: str = "en") -> dict[str, Any]:
    found = cli.show_incident(incidents, incident_id, lang)
    assert isinstance(found, dict), found
    return found


def printed(incidents: Path, lang: str = "en") -> str:
    written: list[str] = []
    items = cli.list_incidents(incidents, lang)
    cli.print_list(items, lang, written.append, Look())
    for item in items:
        cli.print_show(shown(incidents, item["id"], lang), lang, written.append, Look())
    return "".join(written)


def test_the_list_is_newest_first(tmp_path: Path) -> None:
    keep(tmp_path, opened_at="2026-11-21T14:00:00Z")
    keep(tmp_path, NEXT, opened_at="2026-11-21T15:00:00Z")
    assert [item["id"] for item in cli.list_incidents(tmp_path)] == [NEXT, story.ID]


def test_no_incident_is_said_calmly(tmp_path: Path) -> None:
    assert cli.list_incidents(tmp_path / "none") == []
    assert printed(tmp_path / "none") == "No incident on record.\n"


def test_an_id_may_be_shortened_to_a_beginning_of_its_own(tmp_path: Path) -> None:
    keep(tmp_path)
    keep(tmp_path, NEXT)
    assert shown(tmp_path, "0199b")["id"] == NEXT
    assert shown(tmp_path, story.ID)["id"] == story.ID


@pytest.mark.parametrize("asked", ["0199c", "", "../../etc", "\x1b[2J", "x" * 10_000, story.ID + "0"])
def test_an_unknown_id_is_one_sentence_with_the_next_step(tmp_path: Path, asked: str) -> None:
    keep(tmp_path)
    found = cli.show_incident(tmp_path, asked)
    assert isinstance(found, Refused)
    assert "`hardcore incidents`" in found.sentence
    assert found.sentence.isprintable()
    assert len(found.sentence) < 200


def test_a_beginning_that_two_share_is_refused_with_examples(tmp_path: Path) -> None:
    keep(tmp_path)
    keep(tmp_path, TWIN)
    found = cli.show_incident(tmp_path, "0199a")
    assert isinstance(found, Refused)
    assert story.ID in found.sentence
    assert TWIN in found.sentence


def test_shown_ids_are_long_enough_to_tell_them_apart(tmp_path: Path) -> None:
    keep(tmp_path)
    keep(tmp_path, TWIN)
    written: list[str] = []
    cli.print_list(cli.list_incidents(tmp_path), "en", written.append, Look(110))
    shorts = [line.split()[2] for line in "".join(written).splitlines()]
    assert len(set(shorts)) == 2
    assert all(isinstance(cli.show_incident(tmp_path, short), dict) for short in shorts)


def test_an_open_incident_is_told_from_its_bundle(tmp_path: Path) -> None:
    page = json.dumps({"pid": 5, "in_flight": story.facts()["in_flight"]}).encode()
    bundle.write_bundle(tmp_path, story.ID, {"recorder.bin": b"page", "recorder.json": page}, {})
    one = shown(tmp_path, story.ID)
    assert (one["outcome"], one["closed_at"], one["outage_ms"]) == ("open", None, None)
    assert one["transaction_ids"] == ["tx-1", "tx-2"]
    assert one["money"] == {"lost": None, "doubled": None, "verified": False}
    assert one["evidence_complete"] is True


def test_a_half_written_bundle_is_listed_as_such(tmp_path: Path) -> None:
    partial = tmp_path / f".{story.ID}.partial"
    partial.mkdir()
    (partial / "recorder.bin").write_bytes(b"pa")
    (item,) = cli.list_incidents(tmp_path)
    assert (item["id"], item["outcome"], item["evidence_complete"]) == (story.ID, "open", False)
    assert "never written to the end" in printed(tmp_path)


def test_a_whole_bundle_hides_the_partial_one_of_the_same_incident(tmp_path: Path) -> None:
    keep(tmp_path)
    (tmp_path / f".{story.ID}.partial").mkdir()
    (item,) = cli.list_incidents(tmp_path)
    assert item["evidence_complete"] is True


def test_an_incident_without_evidence_is_not_called_complete(tmp_path: Path) -> None:
    bundle.write_bundle(tmp_path, story.ID, {"incident.json": json.dumps(story.facts()).encode()}, {})
    assert shown(tmp_path, story.ID)["evidence_complete"] is False


def test_what_lies_about_in_the_folder_is_no_incident(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("x")
    (tmp_path / "a b").mkdir()
    (tmp_path / story.ID).symlink_to("/")
    os.mkfifo(tmp_path / NEXT)
    assert cli.list_incidents(tmp_path) == []


NAMES = ("manifest.json", "incident.json", "recorder.json", "stacks.json", "process.json", "stacks.txt")
BYTES = st.one_of(
    st.binary(max_size=64),
    st.sampled_from([b"[" * 50_000, b'{"a":' * 5_000, b"null", b"[[]]", b'[{"frames": [{"locals": 3}]}]']),
    st.recursive(
        st.none() | st.integers() | st.text(max_size=4),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
        max_leaves=8,
    ).map(lambda value: json.dumps(value).encode()),
)


@settings(
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.dictionaries(st.sampled_from(NAMES), BYTES))
def test_hostile_bytes_never_end_in_a_traceback(tmp_path: Path, files: dict[str, bytes]) -> None:
    path = tmp_path / story.ID
    path.mkdir(exist_ok=True)
    for name in NAMES:
        (path / name).unlink(missing_ok=True)
    for name, data in files.items():
        (path / name).write_bytes(data)
    for lang in ("ko", "en"):
        assert all(one.isprintable() or one == "\n" for one in printed(tmp_path, lang))
    assert cli.export(tmp_path, story.ID, tmp_path / "out.md") is None


@pytest.mark.parametrize("ending", [".md", ".json"])
def test_an_export_is_its_owners_alone(tmp_path: Path, ending: str) -> None:
    keep(tmp_path / "incidents")
    out = tmp_path / f"story{ending}"
    assert cli.export(tmp_path / "incidents", "0199a", out, "ko") is None
    assert stat.S_IMODE(out.stat().st_mode) == 0o600
    assert "tx-1" in out.read_text()


def test_an_export_of_another_kind_is_refused_in_one_sentence(tmp_path: Path) -> None:
    keep(tmp_path / "incidents")
    for out in (tmp_path / "story.docx", tmp_path / "none" / "story.md"):
        refused = cli.export(tmp_path / "incidents", story.ID, out)
        assert isinstance(refused, Refused)
        assert out.name in refused.sentence


def test_a_report_made_twice_is_the_same(tmp_path: Path) -> None:
    path = keep(tmp_path)
    texts = []
    for _ in range(2):
        assert cli.write_report(path) is None
        texts.append([(path / name).read_bytes() for name in reading.REPORTS])
    assert texts[0] == texts[1]
    assert bundle.verify_bundle(path) == []


def test_the_list_does_not_load_the_template_engine() -> None:
    code = "import sys, postmortem.cli; print(sorted({'jinja2', 'sqlalchemy'} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=50, check=True
    )
    assert done.stdout.strip() == "[]"
