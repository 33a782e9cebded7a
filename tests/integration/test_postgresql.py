"""A core whose ledger lies in a PostgreSQL server, as a process: killed, frozen, cut off, and never twice or lost."""

import http.client
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from core.settings import STORE
from tests import postgres
from tests.integration.lone_core import ROOT, Core, clean_environment, moving, ready, started
from tests.waiting import WAIT_S, until

CLIENTS = 4
EACH = 12
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


def proven(data: Path, store: str, *more: str) -> "subprocess.CompletedProcess[bytes]":
    command = [sys.executable, "-m", "core", "verify", "--data", str(data), *more]
    environment = {**clean_environment(), STORE: store}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, timeout=WAIT_S, check=False
    )


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
    found = proven(data, store)
    assert found.returncode == 0, found.stderr
    assert proven(data, store, "--quick").returncode == 0


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


def test_a_server_that_is_away_at_the_start_is_said_with_the_next_step_and_without_its_password(
    tmp_path: Path,
) -> None:
    away = f"postgresql://keeper:hidden@/ledger?host={tmp_path}"
    with started(tmp_path / "data", CORE_STORE=away) as core:
        assert core.ends_with() == BUSY
        assert "see that its server runs" in core.said()
        assert "hidden" not in core.said()


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
