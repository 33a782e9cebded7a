"""Trials as processes: what a case does to a throw-away core is said, and nothing else happens to anything."""

import asyncio
import base64
import hashlib
import json
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import pytest

from core.ledger.commands import PostTransaction, TransactionBody, fingerprint_of, post_transaction
from hardcore.host.docket import Heard, Said
from hardcore.host.folders import Folders
from hardcore.sitting import Over, Terms, sit
from tests import leftovers, waiting
from tests.integration.lone_core import ROOT, clean_environment, moving, ready, started
from tests.integration.test_imports import form, statement

LIMIT_MS = 10_000  # more than any innocent takes on a loaded machine
SHORT_MS = 3_000  # for whoever is to be waited for
EVENTS = 240
ABORTS, FINE = "2026-03-09 09:00:00,abort-1,100,0,1", "2026-03-09 10:00:00,fine-1,1,0,0"
POISONED = "tests.contract.poisoned_court"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ledger of some hundred events, with an import whose rows are not booked; nobody is at work in it."""
    data = tmp_path_factory.mktemp("trials") / "data"
    data.mkdir()
    with started(data) as core:
        ready(core)
        for name in ("bank", "food"):
            assert core.open(name).status == 201
        for n in range(EVENTS - 2):
            assert core.move(n + 1, "food", "bank", Idempotency_Key=f"booked-{n}").status == 201
        body, kind = form(statement(3, "exit", ABORTS, FINE), {"account": "bank"}, "b.csv")
        made = core.ask("POST", "/api/ledger/imports", body, Content_Type=kind)
        assert made.status == 201, made.body
        (data / "import").write_text(made.body["id"])
        core.process.terminate()
        assert core.ends_with() == 0
    (data / "state").mkdir()
    return data


@pytest.fixture(autouse=True)
def unarmed(data: Path) -> Iterator[None]:
    yield
    for name in ("drill.json", "quarantine.json"):
        (data / "state" / name).unlink(missing_ok=True)


def name_of(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()[:32]


def posting(key: str, says: str = "moved", amount: int = 5, to: str = "food") -> dict[str, Any]:
    body = {**moving(amount, to, "bank"), "description": says}
    headers = [["Content-Type", "application/json"], ["Idempotency-Key", key]]
    request = {
        "method": "POST",
        "path": "/api/ledger/transactions",
        "headers": headers,
        "body": base64.b64encode(json.dumps(body).encode()).decode(),
    }
    return {"name": name_of(key), "request": request}


def row(data: Path, ordinal: int) -> dict[str, Any]:
    return {"name": f"row-{ordinal}", "row": {"import": (data / "import").read_text(), "ordinal": ordinal}}


def command(
    data: Path, docket: Path, *cases: dict[str, Any], program: str = "core", **members: Any
) -> list[str]:
    said = {"version": 1, "limit_ms": LIMIT_MS, "memory_bytes": None, "cases": cases, **members}
    docket.write_text(json.dumps(said))
    return [sys.executable, "-m", program, "try", "--data", str(data), "--docket", str(docket)]


def lines_of(said: bytes) -> list[dict[str, Any]]:
    return [json.loads(line) for line in said.splitlines()]


def tried(data: Path, folder: Path, *cases: dict[str, Any], **named: Any) -> list[dict[str, Any]]:
    """Have cases tried and return the verdicts; everything is said, and nothing is left."""
    argv = command(data, folder / "docket.json", *cases, **named)
    done = subprocess.run(
        argv, cwd=ROOT, env=clean_environment(), capture_output=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    lines = lines_of(done.stdout)
    assert lines[-1] == {"type": "over"}
    assert list((data / "trials").iterdir()) == []
    verdicts = [line for line in lines if line["type"] == "tried"]
    assert [one["name"] for one in verdicts] == [case["name"] for case in cases]
    return verdicts


@contextmanager
def sitting(
    data: Path, folder: Path, *cases: dict[str, Any], **named: Any
) -> Iterator["subprocess.Popen[bytes]"]:
    """A court that is at its first case."""
    argv = command(data, folder / "docket.json", *cases, **named)
    process = subprocess.Popen(argv, cwd=ROOT, env=clean_environment(), stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        for line in process.stdout:
            if json.loads(line)["type"] == "begun":
                break
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


def arm(data: Path, at: str, key: str = "drilled", seq: int | None = None) -> None:
    said = {"version": 1, "fault": "poison", "name": name_of(key), "at": at, "seq": seq}
    (data / "state" / "drill.json").write_text(json.dumps(said))


def bytes_of(data: Path) -> str:
    return hashlib.sha256((data / "ledger.db").read_bytes()).hexdigest()


def head(data: Path) -> Any:
    with sqlite3.connect(f"file:{data}/ledger.db?mode=ro", uri=True) as connection:
        return connection.execute("SELECT epoch, head_seq, hex(head_hash) FROM meta").fetchone()


def test_an_innocent_survives_with_its_answer_and_the_ledger_is_what_it_was(
    data: Path, tmp_path: Path
) -> None:
    before = bytes_of(data), head(data)
    events = {"name": "log", "events": {"after": 0}}
    first, second, log = tried(data, tmp_path, posting("one"), posting("two"), events)
    assert (first["ordeal"], first["status"], first["kind"]) == ("survived", 201, "transaction.post")
    assert first["answer"]["seq"] == EVENTS + 1
    assert first["account_ids"] == ["food", "bank"]
    assert first["transaction_id"] == first["answer"]["id"]
    body = msgspec.json.decode(base64.b64decode(posting("one")["request"]["body"]), type=TransactionBody)
    wish = post_transaction(body, "any")
    assert isinstance(wish, PostTransaction)
    assert first["fingerprint"] == hashlib.sha256(fingerprint_of(wish)).hexdigest()
    assert second["answer"]["seq"] == EVENTS + 2
    assert (log["ordeal"], log["seq"]) == ("survived", None)
    assert (bytes_of(data), head(data)) == before


def test_what_is_in_the_ledger_is_not_run_and_what_the_ledger_refuses_has_survived(
    data: Path, tmp_path: Path
) -> None:
    rules = data / "state" / "quarantine.json"
    letter = {
        "id": "l-1",
        "type": "letter",
        "name": name_of("set-aside"),
        "digest": None,
        "fingerprint": None,
    }
    rules.write_text(json.dumps({"version": 1, "serial": 1, "rules": [letter], "suspects": []}))
    nowhere = posting("nowhere", to="nobody's")
    two_in_one = posting("two")
    two_in_one["request"]["headers"].append(["X-Evil", "a\r\nHost: b"])
    known, refused, on_trial, unusable = tried(
        data, tmp_path, posting("booked-7", amount=8), nowhere, posting("set-aside"), two_in_one
    )
    assert unusable["ordeal"] == "untried"
    assert (known["ordeal"], known["fingerprint"], known["status"]) == ("committed", None, None)
    assert refused["ordeal"] == "survived"
    assert 400 <= refused["status"] < 500
    assert on_trial["status"] == 201, "no rule keeps a case from its trial"


def test_whoever_ends_its_core_or_grows_is_named_and_nobody_beside_it(data: Path, tmp_path: Path) -> None:
    arm(data, "decide")
    cases = [
        posting("a"),
        posting("drilled"),
        posting("b"),
        posting("c", "exit"),
        posting("d"),
        posting("e", "eat"),
        posting("f"),
    ]
    said = tried(data, tmp_path, *cases, program=POISONED, memory_bytes=400 << 20)
    drilled, exits, eats = said[1::2]
    assert [one["ordeal"] for one in said[::2]] == ["survived"] * 4
    assert [one["ordeal"] for one in said[1::2]] == ["died", "died", "grew"]
    assert drilled["exit"] == {"code": None, "signal": signal.SIGSEGV}
    assert drilled["frame"].startswith("_die (core/guarded/poison.py")
    assert exits["exit"] == {"code": 3, "signal": None}
    assert {len(one["fingerprint"]) for one in (drilled, exits, eats)} == {64}


def test_whoever_never_answers_is_named_with_the_place_where_it_waits(data: Path, tmp_path: Path) -> None:
    # Alone in its core, so that its silence is waited for once.
    (waits,) = tried(data, tmp_path, posting("waits", "wait"), program=POISONED, limit_ms=SHORT_MS)
    assert waits["ordeal"] == "hung"
    assert waits["frame"].startswith("decide (core/journal/batch.py")
    assert len(waits["fingerprint"]) == 64


def test_a_poison_that_strikes_while_its_batch_is_written_is_named(data: Path, tmp_path: Path) -> None:
    arm(data, "write")
    before, poison = tried(data, tmp_path, posting("a"), posting("drilled"))
    assert (before["ordeal"], poison["ordeal"]) == ("survived", "died")


def test_what_another_has_left_behind_convicts_nobody(data: Path, tmp_path: Path) -> None:
    spoils, after, last = tried(
        data, tmp_path, posting("a", "spoil"), posting("b"), posting("c"), program=POISONED
    )
    assert [one["ordeal"] for one in (spoils, after, last)] == ["survived"] * 3


def test_a_poison_that_strikes_a_moment_later_convicts_nobody_else(data: Path, tmp_path: Path) -> None:
    arm(data, "later")
    cases = [posting("drilled"), *(posting(f"after-{n}") for n in range(60))]
    assert {one["ordeal"] for one in tried(data, tmp_path, *cases)} == {"survived"}


def test_a_death_from_outside_convicts_nobody(data: Path, tmp_path: Path) -> None:
    killed, stopped = tried(
        data,
        tmp_path,
        posting("k", "killed from outside"),
        posting("s", "stopped from outside"),
        program=POISONED,
        limit_ms=SHORT_MS,
    )
    assert (killed["ordeal"], stopped["ordeal"]) == ("untried", "untried")
    assert killed["exit"]["signal"] is None
    assert "outside" in killed["why"]
    assert "outside" in stopped["why"]


def test_a_row_is_tried_as_the_importer_books_it(data: Path, tmp_path: Path) -> None:
    exits, aborts, good, gone = tried(
        data, tmp_path, row(data, 3), row(data, 4), row(data, 5), row(data, 9), program=POISONED
    )
    assert (good["ordeal"], good["status"], good["kind"]) == ("survived", 201, "import.row")
    assert good["account_ids"] == ["bank"]
    assert (exits["ordeal"], aborts["ordeal"], gone["ordeal"]) == ("died", "died", "untried")


@pytest.mark.parametrize("seq", [1, 117, EVENTS])
def test_the_one_event_that_kills_whoever_rebuilds_it_is_found(data: Path, tmp_path: Path, seq: int) -> None:
    arm(data, "log", seq=seq)
    (log,) = tried(data, tmp_path, {"name": "log", "events": {"after": 0}})
    assert (log["ordeal"], log["seq"], log["exit"]["signal"]) == ("died", seq, signal.SIGSEGV)
    assert log["account_ids"] == (["bank"] if seq == 1 else ["food", "bank"])


def test_a_log_whose_killer_is_parked_survives(data: Path, tmp_path: Path) -> None:
    arm(data, "log", seq=100)
    rules = data / "state" / "quarantine.json"
    parked = {"id": "letter-1", "type": "parked", "seq": 100, "account_ids": ["food", "bank"]}
    rules.write_text(json.dumps({"version": 1, "serial": 1, "rules": [parked], "suspects": []}))
    (log,) = tried(data, tmp_path, {"name": "log", "events": {"after": 0}})
    assert log["ordeal"] == "survived"


def test_a_ledger_that_is_too_large_leaves_every_case_untried(data: Path, tmp_path: Path) -> None:
    verdicts = tried(data, tmp_path, posting("one"), posting("two"), copy_bytes_max=1000)
    assert {one["ordeal"] for one in verdicts} == {"untried"}
    assert "1000" in verdicts[0]["why"]


def test_a_docket_that_cannot_be_used_ends_with_78_and_one_sentence(data: Path, tmp_path: Path) -> None:
    argv = command(data, tmp_path / "docket.json", posting("one"), posting("one"))
    done = subprocess.run(argv, cwd=ROOT, env=clean_environment(), capture_output=True, check=False)
    assert (done.returncode, done.stdout) == (78, b"")
    assert done.stderr.count(b"\n") == 1


def test_a_court_that_is_killed_leaves_no_process_and_the_next_one_removes_its_folder(
    data: Path, tmp_path: Path
) -> None:
    waits = posting("w", "wait")
    with sitting(data, tmp_path, waits, program=POISONED) as court:
        folder = next((data / "trials").iterdir())
        waiting.until(lambda: len(leftovers.at_work_in(folder)) >= 1, "a throw-away core")
        court.send_signal(signal.SIGKILL)
        waiting.until(lambda: not leftovers.at_work_in(folder), "its core to be gone with it")
        assert folder.is_dir()
    assert tried(data, tmp_path, posting("next"))[0]["ordeal"] == "survived"
    assert not folder.exists()


def test_a_court_that_is_told_to_end_takes_everything_with_it(data: Path, tmp_path: Path) -> None:
    with sitting(data, tmp_path, posting("w", "wait"), program=POISONED) as court:
        folder = next((data / "trials").iterdir())
        waiting.until(lambda: len(leftovers.at_work_in(folder)) >= 1, "a throw-away core")
        court.send_signal(signal.SIGTERM)
        assert court.wait(waiting.WAIT_S) == 128 + signal.SIGTERM
        assert not folder.exists()
        assert not leftovers.at_work_in(folder)


def test_a_court_at_work_keeps_its_folder_while_another_one_sits(data: Path, tmp_path: Path) -> None:
    with sitting(data, tmp_path, posting("w", "wait"), program=POISONED):
        folder = next((data / "trials").iterdir())
        other = tmp_path / "other"
        other.mkdir()
        argv = command(data, other / "docket.json", posting("beside"))
        done = subprocess.run(argv, cwd=ROOT, env=clean_environment(), capture_output=True, check=False)
        assert lines_of(done.stdout)[-1] == {"type": "over"}
        assert folder.is_dir()


def test_a_ledger_that_is_written_meanwhile_is_copied_as_it_was_at_one_moment(
    data: Path, tmp_path: Path
) -> None:
    at_work = tmp_path / "at-work"
    at_work.mkdir()
    shutil.copy(data / "ledger.db", at_work / "ledger.db")
    with started(at_work) as core:
        ready(core)
        for n in range(5):
            core.move(1, "food", "bank", Idempotency_Key=f"since-{n}")
        known, fresh = tried(at_work, tmp_path, posting("since-4", amount=1), posting("fresh"))
        assert (known["ordeal"], fresh["status"]) == ("committed", 201)
        assert core.move(2, "food", "bank", Idempotency_Key="after").status == 201
        assert core.ask("GET", "/api/ledger/verify").body["events"] == EVENTS + 6


def test_without_room_for_a_copy_nothing_is_begun(data: Path, tmp_path: Path) -> None:
    unshare = shutil.which("unshare") or "unshare"
    small = tmp_path / "small"
    small.mkdir()
    mount = 'mount -t tmpfs -o size=4m none "$1" && cp "$2"/ledger.db "$1" && shift 2 && exec "$@"'
    argv = command(small, tmp_path / "docket.json", posting("one"))
    whole = [unshare, "--mount", "sh", "-c", mount, "sh", str(small), str(data), *argv]
    done = subprocess.run(whole, cwd=ROOT, env=clean_environment(), capture_output=True, check=False)
    if b"mount" in done.stderr or b"unshare" in done.stderr:
        pytest.skip("no mounts of one's own here: that needs root")
    assert (done.returncode, done.stdout) == (73, b"")
    assert b"ENOSPC" in done.stderr
    assert list(small.iterdir()) == []


class Hands:
    """Hands that work at once."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        return work(*args)

    def note(self, kind: str, **particulars: object) -> None:
        raise AssertionError((kind, particulars))


def test_a_guard_hears_of_each_step_of_a_court_so_that_none_counts_as_silent(
    data: Path, tmp_path: Path
) -> None:
    folders = Folders(data, tmp_path)
    folders.logs.mkdir(exist_ok=True)
    told: list[Heard | Said] = []
    over = asyncio.run(sit(Hands(), folders, [posting("heard")], Terms(LIMIT_MS, 0), told.append))
    assert over == Over("")
    assert [type(one) for one in told] == [Said, Said, Heard], "copied, begun, tried"
