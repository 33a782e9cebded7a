"""The agents in gateway and core, each against the same sentinels: dead, stopped, stuck, slow, busy, and strangers."""

import contextlib
import itertools
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import pytest

import core.guarded.agent
import core.guarded.sentinel_seen
import hardcore.crisis.agent
from hardcore.agents_file import Guard, write_agents
from hardcore.host import files, vitals
from hardcore.host.folders import Folders
from hardcore.host.processes import start_of
from hardcore.host.sentinel_page import SentinelPage, read_page
from hardcore.recovery.policy import Policy
from tests.waiting import until

SIDES: Final = {"core": core.guarded.agent, "gateway": hardcore.crisis.agent}
FAKE: Final = str(Path(__file__).with_name("fake_sentinel.py"))
AFTER_MS, STALE_MS = 100, 200
NS_PER_MS = 1_000_000
#: So many looks of an agent, each as soon after the one before as an agent's are.
LOOKS = 40


@dataclass
class Scene:
    """A run folder with a sentinel, and what an agent has to do with."""

    run: Path
    listener: socket.socket
    pidfds: dict[int, int] = field(default_factory=dict)

    @property
    def word(self) -> dict[str, Any]:
        return files.read_json(self.run / "agents.json")

    def tell(self, **changes: Any) -> None:
        files.write_json(self.run / "agents.json", {**self.word, **changes}, durable=False)

    def begin(self, how: str = "beats") -> int:
        """Start a sentinel as an agent would, and hold it; return its number. It leaves word to start a good one."""
        before = len(self.started())
        folders = Folders(self.run, self.run)
        write_agents(folders, Guard(1, 1, 1, "nobody", "http://127.0.0.1:1"), Policy())
        told = self.word["argv"]
        starter = told[: told.index(sys.executable, 1)]
        self.tell(
            argv=[*starter, sys.executable, FAKE, str(self.run), how, "{listen_fd}"],
            environment={"PATH": os.environ["PATH"], "GIVEN": "by the sentinel before"},
            after_ms=AFTER_MS,
            stale_ms=STALE_MS,
            wanted=str(self.run / "wanted.json"),
        )
        orders = core.guarded.sentinel_seen.read_orders(self.run / "agents.json")
        assert orders is not None
        core.guarded.agent.begin(orders, self.listener.fileno())
        return self.next_after(before)

    def next_after(self, count: int) -> int:
        """Wait for the next one that got the lock and has left word; hold it."""
        until(lambda: len(self.started()) > count, "a sentinel to start")
        pid = int(self.started()[-1]["pid"])
        until(lambda: self.word["sentinel"]["pid"] == pid, "it to leave word")
        self.pidfds[pid] = os.pidfd_open(pid)
        return pid

    def started(self) -> list[dict[str, Any]]:
        path = self.run / "started"
        return [json.loads(line) for line in path.read_text("utf-8").splitlines()] if path.exists() else []

    def hit(self, pid: int, number: int) -> None:
        signal.pidfd_send_signal(self.pidfds[pid], number)

    def lives(self, pid: int) -> bool:
        """By its descriptor, as an agent sees it: its first thread is a zombie some milliseconds before."""
        waiting = select.poll()
        waiting.register(self.pidfds[pid], select.POLLIN)
        return not waiting.poll(0)

    def agent(self, side: str) -> Any:
        return SIDES[side].Agent(self.run / "agents.json", self.listener.fileno())

    def end(self) -> None:
        for found in self.started():
            pid = int(found["pid"])
            if pid not in self.pidfds:
                self.pidfds[pid] = os.pidfd_open(pid)
        for pidfd in self.pidfds.values():
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(pidfd, signal.SIGKILL)
            os.close(pidfd)


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    (tmp_path / "state").mkdir()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        made = Scene(tmp_path, listener)
        yield made
        made.end()


@pytest.fixture(params=list(SIDES))
def side(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def watch(agent: Any, holds: Callable[[], object], what: str) -> None:
    """Let the agent look until something has come of it."""

    def look() -> object:
        agent.look(time.monotonic_ns())
        return holds()

    until(look, what)


def watch_on(agent: Any) -> None:
    """Let the agent look for longer than it needs to find anything."""
    over_ns = time.monotonic_ns() + 8 * STALE_MS * NS_PER_MS
    watch(agent, lambda: time.monotonic_ns() > over_ns, "time to pass")


def watch_in_vain(agent: Any, looks: int = LOOKS, every_ns: int = 200 * NS_PER_MS) -> None:
    """Let the agent look at one that does not run, as if so much time had passed between two looks."""
    now_ns = time.monotonic_ns()
    for _ in range(looks):
        now_ns += every_ns
        agent.look(now_ns)


def test_a_dead_sentinel_is_followed_by_one_that_is_nobodys_child(scene: Scene, side: str) -> None:
    old = scene.begin()
    agent = scene.agent(side)
    agent.look(time.monotonic_ns())
    scene.hit(old, signal.SIGKILL)
    watch(agent, lambda: len(scene.started()) == 2, "another sentinel")
    new = scene.next_after(1)
    found = scene.started()[-1]
    assert int(vitals.stat_fields(new)[1]) != os.getpid()
    assert found["session"] not in {os.getsid(0), 0}
    assert found["environment"].get("GIVEN") == "by the sentinel before"
    assert not set(found["environment"]) & {"HARDCORE_RECORDER", "NOTIFY_SOCKET", "PYTEST_CURRENT_TEST"}
    assert found["listener"] == Path(f"/proc/self/fd/{scene.listener.fileno()}").readlink().name
    kept = files.read_json(scene.run / f"agent-budget-{side}.json")
    assert isinstance(kept["acts_ns"], list)
    assert len(kept["acts_ns"]) == 1
    watch_on(agent)
    assert scene.lives(new)
    assert len(scene.started()) == 2, "the one that lives is left alone"


def test_a_stopped_sentinel_is_ended_and_followed(scene: Scene, side: str) -> None:
    old = scene.begin()
    nonce = scene.word["sentinel"]["nonce"]
    agent = scene.agent(side)
    scene.hit(old, signal.SIGSTOP)
    watch(agent, lambda: len(scene.started()) == 2, "another sentinel")
    assert not scene.lives(old)
    assert files.read_json(scene.run / f"agent-budget-{side}.json")["ended"] == nonce


def test_a_loop_that_sleeps_in_one_place_beside_a_thread_that_beats_is_ended_and_followed(
    scene: Scene, side: str
) -> None:
    old = scene.begin("stuck")
    agent = scene.agent(side)
    watch(agent, lambda: len(scene.started()) == 2, "another sentinel")
    assert not scene.lives(old)


@pytest.mark.parametrize("how", ["busy", "slow"])
def test_a_sentinel_that_is_only_late_is_left_alone(scene: Scene, side: str, how: str) -> None:
    old = scene.begin(how)
    watch_on(scene.agent(side))
    assert scene.lives(old)
    assert len(scene.started()) == 1


def test_whoever_was_kept_from_looking_concludes_nothing_from_it(scene: Scene, side: str) -> None:
    old = scene.begin()
    agent = scene.agent(side)
    agent.look(time.monotonic_ns())
    scene.hit(old, signal.SIGSTOP)
    watch_in_vain(agent, every_ns=600 * NS_PER_MS)
    assert scene.lives(old)


@pytest.mark.parametrize(
    ("why", "number"),
    [
        *itertools.product(("wanted down", "policy", "budget"), (signal.SIGKILL, signal.SIGSTOP)),
        ("another watches", signal.SIGKILL),
    ],
)
def test_what_may_not_be_started_anew_is_not_started_and_not_ended(
    scene: Scene, side: str, why: str, number: int
) -> None:
    old = scene.begin()
    taken = None
    match why:
        case "wanted down":
            (scene.run / "wanted.json").write_text('{"wanted": "DOWN"}')
        case "policy":
            scene.tell(sentinel_lost=False)
        case "budget":  # which a core before this one has spent
            spent = [time.monotonic_ns() + at for at in range(scene.word["budget"]["limit"])]
            files.write_json(scene.run / f"agent-budget-{side}.json", {"version": 1, "acts_ns": spent})
        case _:
            assert why == "another watches"
    agent = scene.agent(side)
    agent.look(time.monotonic_ns())
    scene.hit(old, number)
    if number == signal.SIGKILL:
        until(lambda: not scene.lives(old), "it to be gone")
    if why == "another watches":
        taken = until(lambda: files.take_lock(scene.run / "sentinel.lock"), "its lock to be free")
    watch_in_vain(agent)
    if taken is not None:
        os.close(taken)
    assert len(scene.started()) == 1
    assert scene.lives(old) is (number == signal.SIGSTOP)


def test_a_budget_ages(scene: Scene, side: str) -> None:
    old = scene.begin()
    long_ago = [time.monotonic_ns() - 61_000 * NS_PER_MS] * scene.word["budget"]["limit"]
    files.write_json(scene.run / f"agent-budget-{side}.json", {"version": 1, "acts_ns": long_ago})
    scene.hit(old, signal.SIGKILL)
    watch(scene.agent(side), lambda: len(scene.started()) == 2, "another sentinel")


def test_to_end_a_frozen_one_and_to_start_the_next_is_one_act_and_counts(scene: Scene, side: str) -> None:
    old = scene.begin()
    limit = scene.word["budget"]["limit"]
    spent = [time.monotonic_ns()] * (limit - 1)
    spent = [at + number for number, at in enumerate(spent)]
    files.write_json(scene.run / f"agent-budget-{side}.json", {"version": 1, "acts_ns": spent})
    agent = scene.agent(side)
    scene.hit(old, signal.SIGSTOP)
    watch(agent, lambda: len(scene.started()) == 2, "another sentinel")
    assert len(files.read_json(scene.run / f"agent-budget-{side}.json")["acts_ns"]) == limit  # type: ignore[arg-type]
    new = scene.next_after(1)
    agent.look(time.monotonic_ns())
    scene.hit(new, signal.SIGSTOP)
    watch_in_vain(agent)
    assert scene.lives(new), "the budget is spent"


def test_after_one_that_ended_as_it_was_told_nobody_is_brought(scene: Scene, side: str) -> None:
    old = scene.begin()
    (scene.run / "sentinel.json").write_text("{}")
    agent = scene.agent(side)
    agent.look(time.monotonic_ns())
    (scene.run / "agents.json").rename(scene.run / "taken back")
    scene.hit(old, signal.SIGKILL)
    until(lambda: not scene.lives(old), "it to be gone")
    watch_in_vain(agent)
    assert len(scene.started()) == 1
    (scene.run / "taken back").rename(scene.run / "agents.json")
    watch(agent, lambda: len(scene.started()) == 2, "another sentinel once there is word again")


def test_what_an_agent_does_is_said_in_the_run_folder_and_not_in_a_log(
    scene: Scene, side: str, caplog: pytest.LogCaptureFixture
) -> None:
    old = scene.begin()
    scene.hit(old, signal.SIGKILL)
    watch(scene.agent(side), lambda: len(scene.started()) == 2, "another sentinel")
    assert (
        f"agent in the {side}: The sentinel (process {old}) is gone"
        in (scene.run / "sentinel.out").read_text()
    )
    assert not caplog.records, "a log may lie on a disk that hangs"


def test_a_number_that_is_a_strangers_by_now_is_not_signalled(scene: Scene, side: str) -> None:
    old = scene.begin()
    scene.hit(old, signal.SIGKILL)
    until(lambda: not scene.lives(old), "it to be gone")
    with subprocess.Popen(["sleep", "60"]) as stranger:
        start = start_of(stranger.pid)
        assert start is not None
        scene.tell(sentinel={"pid": stranger.pid, "start": start - 1, "nonce": "x"})
        stranger.send_signal(signal.SIGSTOP)
        watch(scene.agent(side), lambda: len(scene.started()) == 2, "another sentinel")
        assert stranger.poll() is None
        stranger.kill()


def test_a_page_of_another_start_time_is_no_evidence(scene: Scene, side: str) -> None:
    old = scene.begin()
    scene.hit(old, signal.SIGSTOP)
    page = read_page(scene.run / "sentinel.page")
    assert page is not None
    SentinelPage(scene.run / "sentinel.page", 1, page.start - 1, page.nonce)
    watch_in_vain(scene.agent(side))
    assert scene.lives(old)


def test_of_two_agents_that_act_at_once_one_sentinel_comes(scene: Scene) -> None:
    old = scene.begin()
    agents = [scene.agent(side) for side in SIDES]
    for agent in agents:
        agent.look(time.monotonic_ns())
    scene.hit(old, signal.SIGKILL)
    until(lambda: not scene.lives(old), "it to be gone")
    both_ns = time.monotonic_ns()
    for later_ns in (0, 2 * AFTER_MS * NS_PER_MS):
        for agent in agents:
            agent.look(both_ns + later_ns)
    for side in SIDES:
        assert (scene.run / f"agent-budget-{side}.json").exists(), "both have acted"
    new = scene.next_after(1)
    for agent in agents:
        watch_on(agent)
    assert scene.lives(new)
    assert len(scene.started()) == 2


@pytest.mark.parametrize(("gone", "starts"), [(True, 2), (False, 1)])
def test_where_the_policy_replaces_a_gateway_alone_the_core_acts_when_both_are_gone(
    scene: Scene, *, gone: bool, starts: int
) -> None:
    old = scene.begin()
    scene.tell(sentinel_lost=False, gateway_lost=True)
    start = start_of(os.getpid())
    assert start is not None
    page = bytes(32) + os.getpid().to_bytes(8, "little") + (start - gone).to_bytes(8, "little")
    (scene.run / "gateway.page").write_bytes(page)
    scene.hit(old, signal.SIGKILL)
    until(lambda: not scene.lives(old), "it to be gone")
    agent = scene.agent("core")
    watch_in_vain(agent, looks=8)
    until(lambda: len(scene.started()) == starts, "what is to come")


def test_without_a_word_of_the_sentinel_nothing_is_done(tmp_path: Path, side: str) -> None:
    for text in ("", "[]", '{"version": 1}', '{"sentinel": 5, "budget": {}}'):
        (tmp_path / "agents.json").write_text(text)
        SIDES[side].Agent(tmp_path / "agents.json", 0).look(time.monotonic_ns())
    SIDES[side].Agent(tmp_path / "nothing", 0).look(time.monotonic_ns())


@pytest.mark.parametrize("name", ["agent", "agent_table", "sentinel_seen"])
def test_both_islands_keep_the_same_agent(name: str) -> None:
    """They share no code, because each must be able to die alone; so this compares them word by word."""

    def words(room: ModuleType, name: str) -> str:
        text = Path(str(room.__file__)).with_name(f"{name}.py").read_text("utf-8")
        return re.sub(
            r"core\.guarded|hardcore\.crisis|\"core\"|\"gateway\"|The core's|The gateway's", "…", text
        )

    assert words(core.guarded.agent, name) == words(hardcore.crisis.agent, name)
