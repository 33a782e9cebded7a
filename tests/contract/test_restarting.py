"""`hardcore restart` before a guard that is played: what is said of a switch that waits, is done, or is given up."""

import json
import os
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from hardcore import status
from hardcore.host.folders import Folders, locate
from tests.integration.house import Done, run_cli


@dataclass
class Guard:
    """Answers at the control socket: `restart` as told, and one status after another, the last one for ever."""

    folders: Folders
    restarted: dict[str, object] = field(default_factory=dict)
    after: list[dict[str, Any]] = field(default_factory=list)
    _asked: bool = False

    def shown(self, **changes: Any) -> dict[str, Any]:
        """Return a status: a core that serves under epoch 7, but for `changes`."""
        told = status.from_files(self.folders) | {"state": "OPERATIONAL", "phase": "RUNNING"}
        told["core"] |= {"pid": 101, "epoch": 7, "ready": True}
        told["sentinel"] |= {"pid": 11}
        for name, value in changes.items():
            told[name] = told[name] | value if isinstance(value, dict) else value
        return told

    def serve(self, listener: socket.socket) -> None:
        while True:
            try:
                client, _address = listener.accept()
            except OSError:
                return  # closed: the test is over
            with client:
                asked = json.loads(client.recv(65536))
                client.sendall(json.dumps(self.answer(asked["verb"])).encode() + b"\n")

    def answer(self, verb: str) -> dict[str, Any]:
        if verb == "restart":
            self._asked = True
            return {"ok": True, "incident": None, "phase": "RUNNING", "changed": False, **self.restarted}
        if not self._asked:
            return self.shown()
        return self.after.pop(0) if len(self.after) > 1 else self.after[0]


@pytest.fixture
def guard(tmp_path: Path) -> Iterator[Guard]:
    # Short, for the socket in it.
    with tempfile.TemporaryDirectory(prefix="played-") as base, socket.socket(socket.AF_UNIX) as listener:
        folders = Folders(tmp_path, Path(base) / locate(tmp_path).run.name)
        folders.run.mkdir(mode=0o700)
        (tmp_path / "run").symlink_to(folders.run)
        listener.bind(str(folders.control))
        listener.listen()
        played = Guard(folders)
        serving = threading.Thread(target=played.serve, args=(listener,), daemon=True)
        serving.start()
        yield played
        listener.shutdown(socket.SHUT_RDWR)
        serving.join(10)


def restart(guard: Guard, *words: str, lang: str = "en") -> Done:
    kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    env = {**kept, "LANG": "C.UTF-8", "PYTHONPATH": str(Path(__file__).parents[2])}
    assert sys.executable
    return run_cli("--data", str(guard.folders.data), "--lang", lang, "restart", *words, env=env)


@pytest.mark.parametrize("lang", ["ko", "en"])
def test_an_update_that_does_not_start_is_told_with_the_spares_last_words_and_the_next_step(
    guard: Guard, lang: str
) -> None:
    guard.restarted = {"waits": True, "updates": True}
    guard.after = [guard.shown(switch_waits=True), guard.shown(switch_fault="SyntaxError in main.py")]
    done = restart(guard, lang=lang)
    assert done.code == 1
    assert ("with the new code" if lang == "en" else "새 코드로") in done.out
    assert "SyntaxError in main.py" in done.err
    assert "core.log" in done.err
    assert "hardcore restart" in done.err


def test_an_update_that_was_done_says_that_another_core_serves(guard: Guard) -> None:
    guard.restarted = {"waits": True, "updates": True}
    another = {"pid": 102, "epoch": 8}
    guard.after = [
        guard.shown(switch_waits=True),
        guard.shown(phase="DRAINING", core={"ready": False}, switch_waits=True),
        guard.shown(phase="PROBATION", core=another),
        guard.shown(core=another),
    ]
    done = restart(guard)
    assert done.code == 0, done
    assert "A new core serves" in done.out


def test_a_wish_that_its_guard_took_along_is_told_as_gone(guard: Guard) -> None:
    guard.restarted = {"waits": True}
    guard.after = [guard.shown(switch_waits=True), guard.shown(sentinel={"pid": 12})]
    done = restart(guard)
    assert done.code == 1
    assert "the wish is gone" in done.err


def test_a_restart_that_was_refused_before_is_no_fault_of_this_one(guard: Guard) -> None:
    guard.restarted = {"changed": True, "phase": "DRAINING"}
    another = {"pid": 102, "epoch": 8}
    guard.after = [guard.shown(core=another, switch_fault="an older one's")]
    done = restart(guard)
    assert done.code == 0, done
    assert "Switching to the spare" in done.out


@pytest.mark.parametrize(("lang", "why"), [("en", "it ended without a word"), ("ko", "아무 말 없이 종료됨")])
def test_a_reason_of_the_guards_own_is_said_in_the_operators_language(
    guard: Guard, lang: str, why: str
) -> None:
    guard.restarted = {"waits": True, "updates": True}
    guard.after = [guard.shown(switch_fault="it ended without a word", spare_lack="died")]
    done = restart(guard, lang=lang)
    assert (done.code, why in done.err) == (1, True)
    assert ("no spare waits" if lang == "en" else "예비 서버가 없어요") in done.err


def test_a_hard_restart_is_never_told_as_a_switch_that_was_refused(guard: Guard) -> None:
    guard.restarted = {"changed": True, "phase": "KILLING"}
    another = {"pid": 102, "epoch": 8}
    none = {"pid": None, "epoch": None, "ready": False}
    guard.after = [
        guard.shown(phase="KILLING", state="RECOVERY", core=none, switch_fault="an older one's"),
        guard.shown(core=another, switch_fault="an older one's"),
    ]
    done = restart(guard, "--hard")
    assert done.code == 0, done
    assert "A new core serves" in done.out


def test_nobody_is_told_that_a_core_goes_on_where_none_serves(guard: Guard) -> None:
    guard.restarted = {"waits": True, "updates": True}
    none = {"pid": None, "epoch": None, "ready": False}
    guard.after = [
        guard.shown(phase="BACKOFF", state="RECOVERY", core=none, switch_fault="SyntaxError"),
        guard.shown(phase="FATAL", state="MANUAL_INTERVENTION", core=none, start_fault="SyntaxError in it"),
    ]
    done = restart(guard)
    assert (done.code, "goes on" in done.err) == (1, False), done
    assert "SyntaxError in it" in done.err


def test_a_restart_of_what_is_stopped_meanwhile_waits_for_nothing(guard: Guard) -> None:
    guard.restarted = {"waits": True}
    guard.after = [guard.shown(switch_waits=True), guard.shown(state="SHUTDOWN", wanted="DOWN")]
    done = restart(guard)
    assert done.code == 1
    assert "was stopped meanwhile" in done.err


def test_a_restart_whose_guard_is_gone_for_good_waits_for_nothing(guard: Guard) -> None:
    guard.restarted = {"waits": True}
    guard.after = [guard.shown(switch_waits=True), guard.shown(state="UNKNOWN")]
    (guard.folders.data / "state").mkdir()
    done = restart(guard)
    assert done.code == 1
    assert "`hardcore up`" in done.err
