"""A core whose ledger lies in a PostgreSQL server, as a process: killed, frozen, cut off, and never twice or lost."""

import http.client
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from core.journal.store import LEDGER_FILE
from core.settings import STORE
from core.store_file import STORE_FILE
from tests import postgres
from tests.integration.house import WITH_SPARE, House, bytes_of
from tests.integration.lone_core import ROOT, Core, clean_environment, moving, ready, started
from tests.waiting import WAIT_S, until

CLIENTS = 4
EACH = 12
SECRET = "whisperedword"
FENCED, COMMIT_FAILED, BUSY, CONFIG_INVALID = 75, 74, 69, 78
_GONE = (OSError, http.client.HTTPException)


@pytest.fixture(scope="module")
def server() -> Iterator[postgres.Postgres]:
    with postgres.served() as made:
        yield made


@pytest.fixture
def store(server: postgres.Postgres) -> str:
    return server.place()


def opened(core: Core) -> Core:
    ready(core)
    for name, kind in (("bank", "asset"), ("food", "expense")):
        assert core.open(name, kind).status == 201
    return core


def booked_until_done(cores: list[Core], key: str) -> str:
    """Book once under this key, asking whichever core is the last one again until it says that it is done."""

    def once() -> str | None:
        try:
            answer = cores[-1].ask(
                "POST", "/api/ledger/transactions", moving(1, "food", "bank"), Idempotency_Key=key
            )
        except _GONE:
            return None
        return answer.body["id"] if answer.status == 201 else None

    found = until(once, f"{key} to be booked")
    assert found is not None
    return found


def balance(core: Core) -> Any:
    return core.ask("GET", "/api/ledger/accounts/food").body["balances"]["posted"]


def test_what_was_booked_under_load_is_there_once_after_a_kill(tmp_path: Path, store: str) -> None:
    data = tmp_path / "data"
    with started(data, CORE_STORE=store) as first, ThreadPoolExecutor(CLIENTS) as clients:
        cores = [opened(first)]
        keys = [f"{client}-{number}" for client in range(CLIENTS) for number in range(EACH)]
        asked = [clients.submit(booked_until_done, cores, key) for key in keys]
        until(lambda: sum(one.done() for one in asked) > EACH, "some of them to be booked")
        first.process.kill()
        first.process.wait(WAIT_S)
        with started(data, CORE_STORE=store) as second:
            cores.append(ready(second))
            ids = [one.result() for one in asked]
            assert len(set(ids)) == len(keys)
            assert balance(second) == str(len(keys))
            again = [booked_until_done(cores, key) for key in keys]
            assert again == ids
    found = run_core("verify", data, store)
    assert found.returncode == 0, found.stderr
    assert run_core("verify", data, store, "--quick").returncode == 0


def test_a_core_that_was_frozen_at_work_while_another_took_over_writes_nothing_when_it_thaws(
    tmp_path: Path, store: str
) -> None:
    keys = [str(number) for number in range(CLIENTS * EACH)]
    with (
        started(
            tmp_path / "one", sock=tmp_path / "old", HARDCORE_EXPECTED_EPOCH="0", CORE_STORE=store
        ) as old,
        ThreadPoolExecutor(CLIENTS) as clients,
    ):
        cores = [opened(old)]
        asked = [clients.submit(booked_until_done, cores, key) for key in keys]
        until(lambda: sum(one.done() for one in asked) > EACH, "some of them to be booked")
        old.process.send_signal(signal.SIGSTOP)
        # It may hold the row of the epoch at this moment: then its successor has its session ended.
        with started(
            tmp_path / "two", sock=tmp_path / "new", HARDCORE_EXPECTED_EPOCH="1", CORE_STORE=store
        ) as new:
            cores.append(ready(new))
            old.process.send_signal(signal.SIGCONT)
            ids = [one.result() for one in asked]
            assert len(set(ids)) == len(keys)
            assert tried(old) != 201
            assert old.ends_with() in {FENCED, COMMIT_FAILED}
            assert balance(new) == str(len(keys))


def tried(core: Core) -> int | None:
    try:
        return core.move(7, "food", "bank", Idempotency_Key="late").status
    except _GONE:
        return None


def test_a_core_outlives_its_server_and_goes_on_with_it(
    tmp_path: Path, server: postgres.Postgres, store: str
) -> None:
    with started(tmp_path / "data", CORE_STORE=store) as core:
        opened(core)
        with server.away():
            assert core.move(1, "food", "bank", Idempotency_Key="k").status == 503
            assert core.ask("GET", "/api/ledger/accounts/food").status == 503
        booked_until_done([core], "k")
        booked_until_done([core], "k")
        assert balance(core) == "1"


def test_a_household_in_a_server_comes_back_from_a_kill_and_its_password_is_in_one_file_alone(
    tmp_path: Path, store: str
) -> None:
    house = House(tmp_path / "data", WITH_SPARE)
    house.data.mkdir(mode=0o700)
    (house.data / STORE_FILE).write_text(store.replace("keeper@", f"keeper:{SECRET}@"))
    try:
        house.up()
        house.open_accounts()
        assert house.book("before").status == 201
        house.spared()
        house.hit("core")
        assert house.book("after").status == 201
        assert house.book("before").headers.get("idempotent-replayed") == "true"
        assert sorted(house.booked()) == ["after", "before"]
        house.closed(1)
        examined = house.cli("doctor")
        assert "PostgreSQL" in examined.out, examined
        done = house.cli("verify")
        assert done.code == 0, done
        shown = [
            path for path in files_of(house.data, house.folders.run) if SECRET.encode() in bytes_of(path)
        ]
        assert shown == [house.data / STORE_FILE]
        assert [pid for pid in house.processes() if SECRET.encode() in told_to(pid)] == []
    finally:
        house.end()


def files_of(*folders: Path) -> list[Path]:
    return [path for folder in folders for path in folder.rglob("*") if path.is_file()]


def told_to(pid: int) -> bytes:
    """What a process was told at its start: its arguments and its environment."""
    return bytes_of(Path(f"/proc/{pid}/cmdline")) + bytes_of(Path(f"/proc/{pid}/environ"))


def test_a_ledger_is_carried_out_of_its_server_into_a_file_that_opens_alone(
    tmp_path: Path, store: str
) -> None:
    data, other = tmp_path / "data", tmp_path / "other"
    with started(data, CORE_STORE=store) as core:
        opened(core)
        booked_until_done([core], "k")
        found = run_core("backup", data, store)
        assert found.returncode == 0, found.stderr
        assert run_core("rehearse-restore", data, store).returncode == 0
    kept = Path(json.loads(run_core("backup", data, store, "--json").stdout)["path"])
    restored = run_core("restore", other, None, str(kept))
    assert restored.returncode == 0, restored.stderr
    with started(other) as alone:
        assert booked_until_done([ready(alone)], "k")
        assert balance(alone) == "1"


def run_core(verb: str, data: Path, store: str | None, *more: str) -> "subprocess.CompletedProcess[bytes]":
    command = [sys.executable, "-m", "core", verb, "--data", str(data), *more]
    environment = clean_environment() | ({STORE: store} if store else {})
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, timeout=WAIT_S, check=False
    )


def test_a_folder_that_holds_a_file_is_not_started_on_a_server(tmp_path: Path, store: str) -> None:
    data = tmp_path / "data"
    data.mkdir()
    (data / LEDGER_FILE).touch()
    with started(data, CORE_STORE=store) as core:
        assert core.ends_with() == CONFIG_INVALID
        assert "does not move into a server by itself" in core.said()


def test_a_server_that_is_away_at_the_start_is_said_with_the_next_step_and_without_its_password(
    tmp_path: Path,
) -> None:
    away = f"postgresql://keeper:hidden@/ledger?host={tmp_path}"
    with started(tmp_path / "data", CORE_STORE=away) as core:
        assert core.ends_with() == BUSY
        assert "see that its server runs" in core.said()
        assert "hidden" not in core.said()
    for verb in ("verify", "look-at-store"):
        looked = run_core(verb, tmp_path / "data", away)
        assert looked.returncode == BUSY
        assert b"can't be reached" in looked.stderr
        assert b"hidden" not in looked.stderr


def test_a_password_is_not_taken_from_the_command_line(tmp_path: Path) -> None:
    arguments = ("--store", "postgresql://keeper:hidden@localhost/ledger")
    with started(tmp_path / "data", arguments=arguments) as core:
        assert core.ends_with() == CONFIG_INVALID
        assert STORE in core.said()
        assert "hidden" not in core.said()


def test_two_folders_of_data_are_not_served_from_one_database(tmp_path: Path, store: str) -> None:
    with (
        started(tmp_path / "one", CORE_STORE=store) as first,
        started(tmp_path / "two", CORE_FENCE_BUSY_MS="50", CORE_STORE=store) as second,
    ):
        cores = [first, second]
        until(lambda: [core.process.poll() for core in cores].count(BUSY) == 1, "one of them to leave")
        assert any("Serving the ledger" in core.said() for core in cores)
