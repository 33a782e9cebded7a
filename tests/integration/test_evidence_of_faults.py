"""The evidence of real cores that were broken in one way or another: whole, in time, and without a secret."""

import asyncio
import json
import os
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from hardcore.host.recorder import PageReader, PageUnusable, make_page
from hardcore.model.recorder import Beats, Page, SlotStage
from hardcore.snapshot import stacks, writer
from hardcore.snapshot.image import ImageLimits
from hardcore.snapshot.subject import Evidence, Subject, Tools
from postmortem import bundle
from tests.integration.lone_core import Core, moving, ready, started
from tests.waiting import until

ID = "0199a000-0000-7000-8000-00000000000b"
NONCE = "abcdef0123456789"
CANARY = "canary-5d1e"
#: Generous: the tests ask what is in a bundle, not how fast a loaded machine fills it.
BUDGET_MS = 20_000
STALE_NS = 500_000_000


@dataclass
class Guarded:
    """A real core with everything that a guard gives it, and nobody who watches."""

    core: Core
    place: Path
    pidfd: int
    pool: ThreadPoolExecutor

    @property
    def subject(self) -> Subject:
        return Subject(
            pid=self.core.process.pid,
            pidfd=self.pidfd,
            nonce=NONCE,
            recorder=self.place / "page",
            logs=(self.core.log,),
            incident=ID,
            incidents=self.place / "incidents",
            data=self.place / "data",
            control=self.place / "control",
        )

    def order(self, fault: str) -> None:
        """Tell the core to break; the answer may be the last thing that it says."""
        with socket.socket(socket.AF_UNIX) as door:
            door.connect(str(self.place / "control"))
            door.sendall(json.dumps({"verb": "drill", "fault": fault, "generation": 1}).encode() + b"\n")
            assert json.loads(door.recv(4096)) == {"ok": True}

    def page(self) -> Page:
        reader = PageReader(self.place / "page", NONCE)
        try:
            page = reader.read()
        finally:
            reader.close()
        assert not isinstance(page, PageUnusable), page
        return page

    def deciding(self) -> bool:
        return any(note.stage is SlotStage.DECIDING for note in self.page().in_flight)

    def silent(self) -> bool:
        """Whether the loop has beaten no more for a while."""
        beats: Beats = self.page().beats
        return beats.loop_ns + STALE_NS < time.monotonic_ns()

    def evidence(
        self, *, stop: bool = True, image: ImageLimits | None = None, tools: Tools | None = None
    ) -> Evidence:
        tools = tools or stacks.find_tools()
        taken = asyncio.run(
            writer.take_live(self.subject, BUDGET_MS, self.pool, tools, stop=stop, image=image)
        )
        assert isinstance(taken, Evidence), taken
        assert bundle.verify_bundle(taken.path) == []
        return taken


@contextmanager
def guarded(place: Path, **environ: str) -> Iterator[Guarded]:
    (place / "data").mkdir()
    make_page(place / "page", NONCE, "b" * 36)
    paths = {"HARDCORE_RECORDER": str(place / "page"), "HARDCORE_CONTROL": str(place / "control")}
    named: dict[str, Any] = {**paths, **environ}
    with (
        ThreadPoolExecutor(4) as pool,
        started(place / "data", sock=place / "sock", **named) as core,
    ):
        pidfd = os.pidfd_open(core.process.pid)
        try:
            ready(core)
            for name in ("assets:kb", "expenses:food"):
                assert core.open(name, name.partition(":")[0].rstrip("s")).status == 201
            yield Guarded(core, place, pidfd, pool)
        finally:
            os.close(pidfd)


@pytest.fixture
def one(tmp_path: Path) -> Iterator[Guarded]:
    with guarded(tmp_path) as core:
        yield core


def read(taken: Evidence, name: str) -> Any:
    return json.loads((taken.path / name).read_text())


@pytest.mark.parametrize("fault", ["block", "spin", "gil", "freeze", "slow-tx", "deadlock"])
def test_the_evidence_of_every_hang_is_whole_before_the_kill(one: Guarded, fault: str) -> None:
    one.order(fault)
    if fault in {"slow-tx", "deadlock"}:
        until(one.deciding, "the command to be decided")
    else:
        until(one.silent, "the loop to be silent")
    taken = one.evidence()
    assert taken.missing == {}
    assert taken.complete
    assert one.core.process.poll() is None
    frames = [frame["name"] for thread in read(taken, "stacks.json") for frame in thread["frames"]]
    expected = {"spin": "_spin", "gil": "_hold_interpreter", "deadlock": "wait_for_lock"}
    assert expected.get(fault, frames[0]) in frames


def test_both_threads_and_locks_of_a_deadlock_stand_in_the_stacks(one: Guarded) -> None:
    one.order("deadlock")
    until(one.deciding, "the command to be decided")

    def waits() -> list[tuple[str, str, str]]:
        sampled = stacks.sample(
            one.core.process.pid, stacks.find_tools(), time.monotonic_ns() + 10_000_000_000
        )
        assert not isinstance(sampled, str), sampled
        named = [
            (str(thread.tid), dict(frame.names))
            for thread in sampled[0]
            for frame in thread.frames
            if frame.function == "wait_for_lock"
        ]
        return [(tid, names["lock_name"], names["held_by"]) for tid, names in named if "held_by" in names]

    first, second = until(lambda: len(found := waits()) == 2 and found, "both to wait") or []
    assert (first[0], second[0]) == (second[2], first[2]), "each waits for what the other one holds"
    assert {first[1], second[1]} == {"drill.ours", "drill.theirs"}


def test_a_core_that_serves_on_is_looked_at_without_being_stopped(one: Guarded) -> None:
    taken = one.evidence(stop=False)
    assert taken.missing == {}
    assert [name for name, _ in taken.steps] == ["dumped"]
    assert one.core.ask("GET", "/healthz").status == 200


def test_the_suspended_tasks_of_a_living_loop_are_asked_for(one: Guarded) -> None:
    one.order("slow-tx")
    until(one.deciding, "the command to be decided")
    told = read(one.evidence(), "tasks.json")
    assert told["asked"] is True
    assert told["count"] >= 1
    assert any(task["waits_at"] for task in told["tasks"])


def test_a_loop_that_does_not_beat_is_not_asked_for_its_tasks(one: Guarded) -> None:
    one.order("block")
    until(one.silent, "the loop to be silent")
    assert read(one.evidence(), "tasks.json") == {"asked": False, "why": "the loop did not beat"}


def test_the_memory_is_summed_up_by_the_kernel_and_by_the_core(one: Guarded) -> None:
    told = read(one.evidence(), "memory.json")
    assert told["rollup_bytes"]["Rss"] > 1 << 20
    assert told["kernel"]["VmRSS"] > 1 << 20
    assert isinstance(told["censuses"], list)


def test_whoever_holds_the_ledgers_lock_is_named(one: Guarded) -> None:
    held = _holder(one.place / "data")
    try:
        told = read(one.evidence(stop=False), "locks.json")
    finally:
        held.kill()
        held.wait()
        assert held.stdout is not None
        held.stdout.close()
    assert [(holder["pid"], holder["ours"]) for holder in told["store_write_lock"]] == [(held.pid, False)]


def _holder(data: Path) -> "subprocess.Popen[bytes]":
    script = (
        "import sqlite3, sys, time; c = sqlite3.connect(sys.argv[1], isolation_level=None);"
        "c.execute('BEGIN IMMEDIATE'); print('held', flush=True); time.sleep(600)"
    )
    held = subprocess.Popen([sys.executable, "-c", script, str(data / "ledger.db")], stdout=subprocess.PIPE)
    assert held.stdout is not None
    assert held.stdout.readline() == b"held\n"
    return held


def test_no_secret_that_went_into_the_core_is_in_any_file_of_the_bundle(tmp_path: Path) -> None:
    with guarded(tmp_path, HOUSEHOLD_PIN=CANARY, API_TOKEN=f"{CANARY}-env") as one:
        with one.core.log.open("ab") as log:
            log.write(f"a line of somebody's with {CANARY} in it\npassword: {CANARY}\n".encode())
        booked = moving(3, "expenses:food", "assets:kb") | {"description": f"lunch {CANARY}"}
        headers = {"X_Note": CANARY, "Authorization": f"Bearer {CANARY}", "Cookie": f"session={CANARY}"}
        assert one.core.ask("POST", "/api/ledger/transactions", booked, **headers).status == 201
        one.order("slow-tx")
        until(one.deciding, "the command to be decided")
        with ThreadPoolExecutor(1) as client:
            waiting = client.submit(_quietly, one.core, booked, headers)
            until(lambda: len(one.page().in_flight) > 1, "the request to wait behind it")
            taken = one.evidence()
            one.core.process.kill()
            waiting.result()
        assert CANARY.encode() in (one.place / "page").read_bytes(), "else this asks nothing"
        files = {file.name: file.read_bytes() for file in taken.path.iterdir()}
        assert {"recorder.bin", "stacks.json", "log.txt", "tasks.json", "memory.json"} <= set(files)
        assert [name for name, data in files.items() if CANARY.encode() in data] == []


@pytest.mark.skipif(stacks.find_tools().gcore is None, reason="gcore is not installed")
def test_a_memory_image_is_its_owners_alone_and_leaves_the_core_stopped(one: Guarded) -> None:
    taken = one.evidence(image=ImageLimits(60_000, 1 << 30))
    assert taken.complete, taken.missing
    image = taken.path / "core.1"
    assert image.read_bytes()[:4] == b"\x7fELF"
    assert stat.S_IMODE(image.stat().st_mode) == 0o600
    assert Path(f"/proc/{one.core.process.pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"


IMAGE_TOOLS = {
    "never": (None, "gcore is not installed"),
    "fails": ("echo 'no such process' >&2; exit 1", "gcore: ended with 1: no such process"),
    "lies": ("exit 0", "gcore left no whole file: No such file or directory"),
    "hangs": ("exec sleep 600", "gcore: it took too long"),
    "grows": ("head -c 160000000 /dev/zero > $2.$3; exec sleep 600", "gcore: it grew over 134217728 bytes"),
}


@pytest.mark.parametrize("how", IMAGE_TOOLS)
def test_an_image_that_can_not_be_had_is_named_and_leaves_nothing(one: Guarded, how: str) -> None:
    script, reason = IMAGE_TOOLS[how]
    gcore = None
    if script is not None:
        gcore = one.place / "gcore"
        gcore.write_text(f"#!/bin/sh\n{script}\n")
        gcore.chmod(0o700)
    tools = Tools(stacks.find_tools().py_spy, gcore)
    budget_ms = 500 if how == "hangs" else 60_000
    taken = one.evidence(image=ImageLimits(budget_ms, 128 << 20), tools=tools)
    assert taken.missing == {"image": reason}
    told = bundle.read_manifest(taken.path)
    assert isinstance(told, bundle.Manifest)
    assert told.missing == {"image": reason}
    assert not list(taken.path.glob("*core*"))


def test_an_image_that_would_not_fit_is_not_begun(one: Guarded) -> None:
    taken = one.evidence(image=ImageLimits(60_000, 1 << 20))
    assert "the policy allows 1048576" in taken.missing["image"]


def test_a_core_that_serves_on_is_never_stopped_for_an_image(one: Guarded) -> None:
    taken = one.evidence(stop=False, image=ImageLimits(60_000, 1 << 30))
    assert taken.missing == {"image": "a core that goes on serving is not stopped for it"}
    assert one.core.ask("GET", "/healthz").status == 200


def test_what_was_seen_before_the_verdict_stands_in_the_bundle(one: Guarded) -> None:
    seen = replace(one.subject, first_stacks=b"[]")
    taken = asyncio.run(writer.take_live(seen, BUDGET_MS, one.pool, stacks.find_tools()))
    assert isinstance(taken, Evidence), taken
    assert (taken.path / "stacks-first.json").read_bytes() == b"[]"


def _quietly(core: Core, body: Any, headers: dict[str, str]) -> None:
    with suppress(OSError, EOFError):
        core.ask("POST", "/api/ledger/transactions", body, **headers)


def test_the_masked_page_still_reads_as_a_page_with_the_same_story(one: Guarded) -> None:
    one.order("slow-tx")
    until(one.deciding, "the command to be decided")
    taken = one.evidence()
    reader = PageReader(taken.path / "recorder.bin", NONCE)
    try:
        kept = reader.read()
    finally:
        reader.close()
    assert not isinstance(kept, PageUnusable), kept
    assert taken.page is not None
    assert kept.torn == taken.page.torn
    assert [note.command_id for note in kept.in_flight] == [note.command_id for note in taken.page.in_flight]
    assert [event.code for event in kept.events] == [event.code for event in taken.page.events]
    assert kept.witness == taken.page.witness
