"""The survey: once a second, at once when asked, and never in anybody's way."""

import os
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from hardcore.host import disk, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.host.survey import Survey
from hardcore.model.looks import DiskFacts
from hardcore.model.observations import Surveyed
from tests.waiting import WAIT_S, until

NEVER_S = 3600.0


@pytest.fixture
def life(tmp_path: Path) -> Iterator[Life]:
    argv = [sys.executable, "-c", "import sys; sys.stdin.read()"]
    with subprocess.Popen(argv, stdin=subprocess.PIPE) as process:
        handle = processes.find(processes.Identity(process.pid, processes.start_of(process.pid) or 0))
        assert handle is not None
        yield Life(7, "0" * 16, Folders(tmp_path, tmp_path), None, handle)
        process.kill()
        handle.close()


@pytest.fixture
def facts() -> "queue.SimpleQueue[Surveyed]":
    return queue.SimpleQueue()


@pytest.fixture
def survey(tmp_path: Path, life: Life, facts: "queue.SimpleQueue[Surveyed]") -> Iterator[Survey]:
    """Give a survey that watches `life`, and ends before it: nobody looks by a number that was given back."""
    troubles: list[str] = []
    made = Survey(tmp_path, tmp_path, NEVER_S, facts.put, troubles.append)
    made.watch(life)
    yield made
    assert made.close(WAIT_S)
    assert troubles == []


def test_a_life_is_surveyed_under_its_number_with_disk_and_conduct(
    survey: Survey, life: Life, facts: "queue.SimpleQueue[Surveyed]"
) -> None:
    survey.begin()
    told = facts.get(timeout=WAIT_S)
    assert told.life == life.number
    assert told.disk is not None
    assert told.disk.free_bytes > 0
    assert told.disk.size_bytes >= told.disk.free_bytes
    assert told.conduct is not None
    assert told.oom_kills is None
    assert told.private_bytes is not None
    assert 0 < told.private_bytes < told.disk.size_bytes
    assert told.fds_limit is not None


def test_who_asks_need_not_wait_for_the_next_round(
    survey: Survey, facts: "queue.SimpleQueue[Surveyed]"
) -> None:
    survey.begin()
    facts.get(timeout=WAIT_S)
    survey.ask()
    assert facts.get(timeout=WAIT_S).disk is not None


def test_of_a_core_that_is_gone_the_disk_alone_is_told(
    survey: Survey, life: Life, facts: "queue.SimpleQueue[Surveyed]"
) -> None:
    assert life.handle is not None
    life.handle.kill_tree()
    os.waitpid(life.handle.pid, 0)
    survey.begin()
    told = facts.get(timeout=WAIT_S)
    assert told.conduct is None
    assert told.disk is not None


def test_a_disk_that_hangs_keeps_nobody_from_hearing_of_the_rest_and_is_told_by_its_length(
    survey: Survey, facts: "queue.SimpleQueue[Surveyed]", monkeypatch: pytest.MonkeyPatch
) -> None:
    let_go = threading.Event()

    def hang(_path: Path) -> str:
        let_go.wait(WAIT_S)
        return ""

    monkeypatch.setattr(disk, "write_once", hang)
    survey.begin()

    def stalled() -> bool:
        survey.ask()
        told = facts.get(timeout=WAIT_S)
        assert told.conduct is not None
        return told.disk is not None and told.disk.pending_ns > 0

    try:
        until(stalled, "the stall to be told")
    finally:
        let_go.set()


def test_a_write_that_was_under_way_is_told_when_it_is_back_however_rarely_we_survey(
    survey: Survey, facts: "queue.SimpleQueue[Surveyed]", monkeypatch: pytest.MonkeyPatch
) -> None:
    let_go = threading.Event()

    def hang(_path: Path) -> str:
        let_go.wait(WAIT_S)
        return ""

    monkeypatch.setattr(disk, "write_once", hang)
    survey.begin()

    def told() -> DiskFacts:
        fact = facts.get(timeout=WAIT_S).disk
        assert fact is not None
        return fact

    try:
        pending = [told().pending_ns for _ in range(3)]
    finally:
        let_go.set()
    assert 0 < pending[0] < pending[1] < pending[2]
    until(lambda: told().write_ns is not None, "the write to be back")


def test_a_look_that_fails_is_told_once_and_the_next_one_is_tried(
    tmp_path: Path, life: Life, monkeypatch: pytest.MonkeyPatch, facts: "queue.SimpleQueue[Surveyed]"
) -> None:
    troubles: list[str] = []
    tries: list[int] = []

    def fail(_self: object, _now_ns: int, *, now: bool) -> None:
        tries.append(1)
        raise RuntimeError(f"no thread {now}"[:9])

    survey = Survey(tmp_path, tmp_path, NEVER_S, facts.put, troubles.append)
    with monkeypatch.context() as broken:
        broken.setattr(disk.DiskWatch, "look", fail)
        survey.watch(life)
        survey.begin()

        def failed_thrice() -> bool:
            survey.ask()
            return len(tries) >= 3

        until(failed_thrice, "three looks")
        assert troubles == ["RuntimeError: no thread"]
    survey.ask()
    assert facts.get(timeout=WAIT_S).life == 7
    assert survey.close(WAIT_S)
