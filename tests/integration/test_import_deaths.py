"""Imports on a lone core whose disk, files and neighbours fail it: nothing half-done, nothing half-dead."""

import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from core.departure import ExitCode
from core.imports.desk import UPLOADS_MAX
from tests.integration.lone_core import ROOT, Answer, Core, ready, started
from tests.integration.test_imports import form, statement
from tests.waiting import until

MANY = 20_000
BANK = "bank"
END_S = 60.0


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return tmp_path / "data"


@pytest.fixture
def core(data: Path) -> Iterator[Core]:
    with started(data) as made:
        ready(made).open(BANK)
        yield made


def uploaded(core: Core, file: bytes, **fields: str) -> Answer:
    body, kind = form(file, {"account": BANK, **fields}, "bank.csv")
    return core.ask("POST", "/api/ledger/imports", body, Content_Type=kind, Idempotency_Key=uuid.uuid4().hex)


def made(core: Core, file: bytes) -> str:
    answer = uploaded(core, file)
    assert answer.status == 201, answer
    import_id: str = answer.body["id"]
    return import_id


def on(core: Core, import_id: str, what: str, **body: Any) -> Answer:
    return core.ask("POST", f"/api/ledger/imports/{import_id}/{what}", body)


def seen(core: Core, import_id: str) -> dict[str, Any]:
    answer = core.ask("GET", f"/api/ledger/imports/{import_id}")
    assert answer.status == 200, answer
    body: dict[str, Any] = answer.body
    return body


def over(core: Core, import_id: str) -> dict[str, Any]:
    def look() -> dict[str, Any] | None:
        now = seen(core, import_id)
        return now if now["state"] != "committing" else None

    ended = until(look, "the import to end", END_S)
    assert ended is not None
    return ended


def has_a_child(core: Core) -> bool:
    tasks = Path(f"/proc/{core.process.pid}/task").iterdir()
    return any((task / "children").read_text().strip() for task in tasks)


def folder_of(data: Path, import_id: str) -> Path:
    return data / "imports" / import_id


def test_a_core_serves_although_the_leftovers_of_an_import_can_not_be_cleared_away(data: Path) -> None:
    stuck = data / "imports" / str(uuid.uuid4()) / "rows-stuck"
    stuck.mkdir(parents=True)
    with started(data) as core:
        assert ready(core).open(BANK).status == 201
        import_id = made(core, statement(3, "row"))
        assert on(core, import_id, "commit").status == 202
        assert over(core, import_id)["rows"]["new"] == 3
        core.process.terminate()
        assert core.ends_with() == ExitCode.ASKED
    assert stuck.is_dir()


def killed_while_booking(data: Path, count: int) -> str:
    """Leave an import that a death has interrupted."""
    with started(data) as core:
        ready(core).open(BANK)
        import_id = made(core, statement(count, "row"))
        assert on(core, import_id, "commit").status == 202
        core.process.kill()
        core.process.wait()
    return import_id


def test_a_look_in_one_tab_never_changes_the_rows_that_another_tab_has_committed(
    core: Core, data: Path
) -> None:
    import_id = made(core, statement(MANY, "row"))
    rows = folder_of(data, import_id) / "rows.jsonl"
    before = rows.read_bytes()
    with ThreadPoolExecutor(1) as tab:
        looking = tab.submit(on, core, import_id, "preview", encoding="iso-8859-1")
        until(lambda: has_a_child(core), "the reading to begin")
        assert on(core, import_id, "commit").status == 202
        answer = looking.result()
    assert (answer.status, answer.body["type"]) == (409, "/problems/import-committed")
    assert rows.read_bytes() == before
    assert {path.name for path in rows.parent.iterdir()} <= {
        "file", "manifest.json", "survey.json", "rows.jsonl", "progress.json", "progress.json.new"
    }  # fmt: skip


def test_rows_that_do_not_fit_their_wish_end_that_import_and_not_the_next_core(data: Path) -> None:
    import_id = killed_while_booking(data, MANY)
    rows = folder_of(data, import_id) / "rows.jsonl"
    rows.write_text(rows.read_text().replace("적요", "다른", 1))
    manifest = folder_of(data, import_id) / "manifest.json"
    assert "적요" in manifest.read_text()
    with started(data) as core:
        ended = over(ready(core), import_id)
        assert (ended["state"], ended["fault"]["reason"]) == ("failed", "internal")
        assert core.ask("GET", "/api/ledger/verify").body["ok"] is True


@pytest.mark.parametrize("torn", [b"", b'[77,["2026-'])
def test_an_import_whose_rows_are_lost_is_never_called_done(data: Path, torn: bytes) -> None:
    import_id = killed_while_booking(data, MANY)
    rows = folder_of(data, import_id) / "rows.jsonl"
    whole = rows.read_bytes().splitlines(keepends=True)
    rows.write_bytes(b"".join(whole[: MANY // 4]) + torn)
    with started(data) as core:
        ended = over(ready(core), import_id)
    assert (ended["state"], ended["fault"]["reason"]) == ("failed", "kept-file-lost")
    assert 0 < ended["done"] < ended["total"] == MANY


def test_a_mistake_after_ready_ends_the_process_with_its_code(tmp_path: Path, data: Path) -> None:
    broken = "from core import audit\ndef behind(*_):\n    raise ValueError('a mistake')\naudit.audit_behind = behind\n"
    (tmp_path / "sitecustomize.py").write_text(broken)
    with started(data, PYTHONPATH=f"{tmp_path}:{ROOT}") as core:
        assert core.ends_with() == ExitCode.BUG
        assert "Serving the ledger" in core.said()


def test_uploads_that_find_no_place_take_no_place(core: Core, data: Path) -> None:
    (data / "imports").write_bytes(b"in the way")
    for _ in range(UPLOADS_MAX + 1):
        answer = uploaded(core, statement(1, "row"))
        assert (answer.status, answer.body["type"]) == (507, "/problems/import-not-kept")
    (data / "imports").unlink()
    assert uploaded(core, statement(1, "row")).status == 201


def test_an_end_that_could_not_be_written_is_written_as_soon_as_it_can_be(core: Core, data: Path) -> None:
    import_id = made(core, statement(1_000, "row"))
    obstacle = folder_of(data, import_id) / "progress.json"
    obstacle.mkdir()
    assert on(core, import_id, "commit").status == 202
    until(lambda: "The end of import" in core.said(), "the end to fail", END_S)
    now = seen(core, import_id)
    assert (now["state"], now["done"]) == ("committing", 1_000)
    obstacle.rmdir()
    ended = over(core, import_id)
    assert (ended["state"], ended["rows"]["new"]) == ("done", 1_000)


def test_a_look_that_can_not_be_kept_says_so(core: Core, data: Path) -> None:
    import_id = made(core, statement(2, "row"))
    obstacle = folder_of(data, import_id) / "survey.json"
    obstacle.unlink()
    obstacle.mkdir()
    answer = on(core, import_id, "preview")
    assert (answer.status, answer.body["type"]) == (507, "/problems/import-not-kept")


def test_a_boundary_that_no_parser_takes_is_a_malformed_upload(core: Core) -> None:
    answer = core.ask(
        "POST", "/api/ledger/imports", b"", Content_Type=f"multipart/form-data; boundary={'b' * 300}"
    )
    assert (answer.status, answer.body["type"]) == (400, "/problems/malformed-upload")


def test_a_look_that_takes_too_long_is_refused_with_its_reason_and_changes_nothing(data: Path) -> None:
    with started(data) as core:
        ready(core).open(BANK)
        import_id = made(core, statement(MANY, "row"))
    with started(data, CORE_IMPORT_LOOKING_MS="10") as core:
        before = seen(ready(core), import_id)
        for body in ({}, {"encoding": "cp949"}):
            answer = on(core, import_id, "preview", **body)
            assert (answer.status, answer.body.get("reason")) == (422, "too-slow")
        assert seen(core, import_id) == before


def test_a_decimal_mark_that_nobody_chose_follows_the_column_that_was_chosen(core: Core) -> None:
    core.open("euro", currency="EUR")
    file = b"Wann;Was;Wieviel\n2026-01-31;Brot;-3,20\n2026-02-01;Lohn;1.200,00\n"
    answer = uploaded(core, file, account="euro")
    mapping = {**answer.body["mapping"], "date": "Wann", "description": "Was", "amount": "Wieviel"}
    looked = on(core, answer.body["id"], "preview", mapping=mapping).body
    assert (looked["mapping"]["decimal"], looked["mapping"]["date_format"]) == (",", "ymd")
    assert (looked["rows"]["new"], looked["rows"]["refused"]) == (2, 0)
    chosen = {**looked["mapping"], "decimal": "."}
    again = on(core, answer.body["id"], "preview", mapping=chosen).body
    assert again["mapping"]["decimal"] == "."
