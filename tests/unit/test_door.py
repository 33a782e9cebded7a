"""The door alone, before a house that is played: what is asked again, because answering took its time."""

import asyncio
import json
import signal
import subprocess
import tempfile
from collections.abc import Callable, Coroutine, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from hardcore import standing
from hardcore.chronicle import Chronicle
from hardcore.control.protocol import Ask, Request
from hardcore.court_room import CourtRoom
from hardcore.door import Door
from hardcore.host import build, files, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.host.processes import Identity
from hardcore.investigating import Investigators
from hardcore.model import observations as seen
from hardcore.model.phases import Phase, Wanted
from hardcore.model.recorder import ComponentBeat
from hardcore.model.trials import AddTrials
from hardcore.model.verdicts import Diagnosis
from hardcore.outbox import Outbox
from hardcore.policy_desk import PolicyDesk
from hardcore.recovery.policy import Policy
from hardcore.recovery.reading import Reading
from hardcore.rule_book import Doors
from tests.unit.recovery.play import Play
from tests.waiting import WAIT_S


async def calm() -> None:
    """No switch is under way."""


async def nothing_more(order: AddTrials) -> None:
    """No incident is written here."""
    del order


@dataclass
class House:
    """A house with one core, in which something happens while a drill is prepared."""

    folders: Folders
    moment: Reading
    core: Life
    meanwhile: Callable[["House"], None] = lambda _house: None
    policy: Policy = field(default_factory=Policy)
    listen_fd: int = -1
    url: str = "http://127.0.0.1:1/"
    generation: int = 1
    adopted: bool = False
    told: list[seen.Observation] = field(default_factory=list)
    others: dict[int, Life] = field(default_factory=dict)
    published: list[dict[str, object]] = field(default_factory=list)
    halted: asyncio.Event = field(default_factory=asyncio.Event)
    under_way: list["asyncio.Task[object]"] = field(default_factory=list)
    noted: list[tuple[str, dict[str, object]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        def note(kind: str, **particulars: object) -> None:
            self.noted.append((kind, particulars))

        self.note = note
        doors = Doors(self.feed, lambda line: self.published.append(dict(line)), list, calm, nothing_more)
        self.court = CourtRoom(self.folders, self.generation, self, doors)
        self.investigators = Investigators(self.folders, self)
        self.outbox = Outbox(self.folders, self, lambda line: self.published.append(dict(line)))
        self.chronicle = Chronicle(self.folders, self, lambda _kind, _fields: None)

    def adopt(self, policy: Policy) -> None:
        self.policy = policy

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        self.under_way.append(asyncio.get_running_loop().create_task(work))

    def feed(self, fact: seen.Observation) -> None:
        self.told.append(fact)

    def curve(self) -> list[dict[str, Any]]:
        return [{"resource": "memory"}]

    def reading(self) -> Reading:
        return self.moment

    def life(self) -> Life | None:
        return self.core

    def numbered(self, number: int) -> Life | None:
        return self.others.get(number)

    def gateway_told(self) -> Mapping[str, object]:
        return {"overdue": 0}

    def drill_gateway(self) -> str | None:
        return None

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        return work(*args)

    async def confine(self, life: Life) -> str | None:
        del life
        self.meanwhile(self)
        return None

    async def hold_lock(self, seconds: int) -> str | None:
        del seconds
        self.meanwhile(self)
        return None


@pytest.fixture
def house(tmp_path: Path) -> House:
    folders = Folders(tmp_path, tmp_path / "run")
    folders.run.mkdir()
    return House(folders, Play().begin().running().manager.reading(), Life(1, "0" * 16, folders))


def alerts_of(house: House) -> list[tuple[object, object]]:
    """What whoever runs the server was told: stage and diagnosis."""
    return [
        (told["stage"], told["diagnosis"])
        for kind, told in house.noted
        if kind == "alert" and "stage" in told
    ]


def door_of(house: House) -> Door:
    return Door(house, PolicyDesk(house, house.adopt))


def ask(house: House, request: Request) -> dict[str, Any]:
    async def answered() -> dict[str, Any]:
        answer = await door_of(house).answer(request)
        await asyncio.gather(*house.under_way)
        house.under_way.clear()
        return dict(answer[0])

    return asyncio.run(answered())


def another_core_serves(house: House) -> None:
    house.core = Life(2, "1" * 16, house.folders)


def the_core_is_gone(house: House) -> None:
    house.moment = structs.replace(house.moment, phase=Phase.BACKOFF)


@pytest.mark.parametrize("fault", ["oom", "dblock"])
@pytest.mark.parametrize("meanwhile", [another_core_serves, the_core_is_gone])
def test_a_core_that_went_while_its_drill_was_prepared_is_not_broken_nor_is_another(
    house: House, fault: str, meanwhile: Callable[[House], None]
) -> None:
    house.meanwhile = meanwhile
    assert ask(house, Request(Ask.DRILL, fault=fault))["ok"] is False
    assert house.told == []


def test_a_drill_is_noted_on_the_core_that_was_told(house: House) -> None:
    assert ask(house, Request(Ask.DRILL, fault="crash"))["code"] == "core-refused", "nobody listens here"
    assert [(fact.life, fact.fault) for fact in house.told if isinstance(fact, seen.DrillStarted)] == [
        (1, "crash"),
        (1, ""),
    ]


def test_a_ledger_that_nothing_is_the_matter_with_is_not_accepted(house: House) -> None:
    assert ask(house, Request(Ask.RESUME, accept_ledger=True))["code"] == "not-in-question"
    assert house.told == []
    house.moment = structs.replace(house.moment, safe=Diagnosis.STORE_CORRUPT, in_question=True)
    assert ask(house, Request(Ask.RESUME, accept_ledger=True))["ok"] is True


def test_a_restart_names_the_code_that_lies_on_the_disk(house: House) -> None:
    assert ask(house, Request(Ask.RESTART))["ok"] is True
    assert [fact.build for fact in house.told if isinstance(fact, seen.OperatorAsked)] == [build.build_id()]


def test_a_hard_restart_asks_for_no_code(house: House) -> None:
    assert ask(house, Request(Ask.RESTART, hard=True))["ok"] is True
    assert [fact.build for fact in house.told if isinstance(fact, seen.OperatorAsked)] == [""]


@pytest.mark.parametrize("updates", [False, True])
def test_who_asks_for_a_restart_is_told_whether_a_spare_with_the_new_code_is_waited_for(
    house: House, *, updates: bool
) -> None:
    house.moment = structs.replace(house.moment, switch_waits=True, switch_updates=updates)
    answer = ask(house, Request(Ask.RESTART))
    assert (answer["waits"], answer["updates"]) == (True, updates)


def test_a_hard_restart_waits_for_no_spare_whatever_another_wish_waits_for(house: House) -> None:
    house.moment = structs.replace(house.moment, switch_waits=True, switch_updates=True)
    answer = ask(house, Request(Ask.RESTART, hard=True))
    assert (answer["waits"], answer["updates"]) == (False, False)


@pytest.mark.parametrize(
    ("answer", "serves"),
    [(b'{"ok":true,"build":"abc"}\n', "abc"), (b'{"ok":true}\n', ""), (b"", ""), (b"?\n", "")],
)
def test_a_restart_names_the_code_that_serves_as_the_core_says_it(
    house: House, answer: bytes, serves: str
) -> None:
    async def say(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        assert json.loads(await reader.readline())["verb"] == "status"
        writer.write(answer)
        writer.close()

    async def restarted() -> None:
        with tempfile.TemporaryDirectory(prefix="door-") as base:  # short, for the socket in it
            house.core = Life(1, "0" * 16, Folders(house.folders.data, Path(base)))
            house.folders = house.core.folders
            async with await asyncio.start_unix_server(say, house.folders.core_control("0" * 16)):
                await door_of(house).answer(Request(Ask.RESTART))

    asyncio.run(restarted())
    assert [fact.serves for fact in house.told if isinstance(fact, seen.OperatorAsked)] == [serves]


@pytest.mark.parametrize("ready", [False, True])
def test_a_drill_of_a_spare_that_is_not_there_is_refused(house: House, *, ready: bool) -> None:
    house.moment = structs.replace(house.moment, spare=2 if ready else 0, spare_ready=ready)
    assert ask(house, Request(Ask.DRILL, fault="spare"))["code"] == "no-spare"
    assert house.told == []


def test_a_drill_of_the_spare_ends_it_and_counts_on_nothing(house: House) -> None:
    process = subprocess.Popen(["sleep", "60"], start_new_session=True)
    handle = processes.find(Identity(process.pid, processes.start_of(process.pid) or 0))
    assert handle is not None
    house.others[2] = Life(2, "2" * 16, house.folders, handle=handle)
    house.moment = structs.replace(house.moment, spare=2, spare_ready=True)
    assert ask(house, Request(Ask.DRILL, fault="spare"))["ok"] is True
    assert process.wait(10) == -signal.SIGKILL
    handle.close()
    assert [(fact.fault, fact.life) for fact in house.told if isinstance(fact, seen.DrillStarted)] == [
        ("spare", 2)
    ]


@pytest.mark.parametrize("part", ["", "nobody"])
def test_a_part_that_the_core_has_not_is_not_made_to_stand_still(house: House, part: str) -> None:
    house.moment = structs.replace(house.moment, components=(ComponentBeat("importer", 0, 0, 0, 0),))
    answer = ask(house, Request(Ask.DRILL, fault="stall", component=part))
    assert (answer["code"], answer["values"]) == (
        "component-unknown",
        {"component": part, "names": "importer"},
    )
    assert house.told == []


def test_a_leak_is_asked_for_in_numbers_and_given_back_when_its_time_is_over(house: House) -> None:
    orders: list[dict[str, object]] = []

    async def hear(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        orders.append(json.loads(await reader.readline()))
        writer.write(b'{"ok":true}\n')
        writer.close()

    async def leaked() -> None:
        with tempfile.TemporaryDirectory(prefix="door-") as base:  # short, for the socket in it
            house.core = Life(1, "0" * 16, Folders(house.folders.data, Path(base)))
            house.folders = house.core.folders
            async with await asyncio.start_unix_server(hear, house.folders.core_control("0" * 16)):
                await door_of(house).answer(Request(Ask.DRILL, fault="leak", seconds=1, mb_per_s=5))
                async with asyncio.timeout(WAIT_S):
                    while len(orders) < 2:  # noqa: ASYNC110  # a clock decides, not an event of ours
                        await asyncio.sleep(0.01)

    asyncio.run(leaked())
    assert [(one["fault"], one["mb_per_s"]) for one in orders] == [("leak", 5), ("leak", 0)]
    assert [fact.fault for fact in house.told if isinstance(fact, seen.DrillStarted)] == ["leak"]


def test_the_gateways_witness_is_taken_in(house: House) -> None:
    door_of(house).listen({"type": "witness", "epoch": 3, "seq": 12, "hash": "ab" * 32})
    told = [fact.witness for fact in house.told if isinstance(fact, seen.GatewayWitnessed)]
    assert [(one.seq, one.epoch, one.hash) for one in told] == [(12, 3, "ab" * 32)]


@pytest.mark.parametrize(
    "line",
    [
        {"epoch": 3, "seq": 12},
        {"epoch": 3, "seq": "12", "hash": "ab" * 32},
        {"epoch": 3, "seq": 12, "hash": "ab"},
        {"epoch": None, "seq": 12, "hash": "AB" * 32},
    ],
)
def test_a_witness_that_makes_no_sense_is_dropped(house: House, line: dict[str, object]) -> None:
    door_of(house).listen({"type": "witness", **line})
    assert house.told == []


def test_a_wish_for_reads_only_is_on_disk_before_anybody_is_told(house: House) -> None:
    house.folders.state.mkdir()
    stored: list[object] = []

    def told(fact: seen.Observation) -> None:
        assert isinstance(fact, seen.OperatorAsked)
        stored.append(standing.wanted(house.folders))

    house.feed = told  # type: ignore[method-assign]
    answer = ask(house, Request(Ask.SAFE_MODE, on=True, reason="audit"))
    assert (answer["ok"], answer["changed"]) == (True, True)
    assert stored[0] is Wanted.SAFE
    assert standing.safe_reason(house.folders) == "audit"
    assert ask(house, Request(Ask.SAFE_MODE, on=False))["ok"] is True
    assert standing.wanted(house.folders) is Wanted.UP


def test_who_asks_for_the_safe_mode_again_without_a_reason_takes_no_reason_back(house: House) -> None:
    house.folders.state.mkdir()
    for reason in ("spring cleaning", ""):
        assert ask(house, Request(Ask.SAFE_MODE, on=True, reason=reason))["ok"] is True
    assert standing.safe_reason(house.folders) == "spring cleaning"


def test_a_wish_that_can_not_be_written_is_refused_and_nobody_is_told(house: House) -> None:
    assert ask(house, Request(Ask.SAFE_MODE, on=True))["code"] == "wish-not-stored", (
        "there is no state folder"
    )
    assert house.told == []


def test_what_is_being_stopped_is_asked_for_no_safe_mode(house: House) -> None:
    house.folders.state.mkdir()
    standing.store_wanted(house.folders, Wanted.DOWN)
    house.moment = structs.replace(house.moment, wanted=Wanted.DOWN)
    for on in (True, False):
        assert ask(house, Request(Ask.SAFE_MODE, on=on))["code"] == "stopping"
    assert standing.wanted(house.folders) is Wanted.DOWN
    assert house.told == []


def test_reading_only_that_nobody_asked_for_is_not_ended_by_the_safe_modes_switch(house: House) -> None:
    house.folders.state.mkdir()
    house.moment = structs.replace(house.moment, safe=Diagnosis.DISK_FULL)
    assert ask(house, Request(Ask.SAFE_MODE, on=False))["code"] == "safe-by-policy"
    assert house.told == []


def test_a_part_is_started_anew_by_its_name_alone(house: House) -> None:
    beats = (ComponentBeat("importer", 1, 0, 10, 0),)
    house.moment = structs.replace(house.moment, components=beats)
    assert ask(house, Request(Ask.RESTART, component="importer"))["ok"] is True
    (told,) = [fact for fact in house.told if isinstance(fact, seen.OperatorAsked)]
    assert (told.verb, told.component) == (seen.Verb.RESTART_COMPONENT, "importer")
    assert ask(house, Request(Ask.RESTART, component="engine"))["code"] == "component-unknown"
    house.moment = structs.replace(house.moment, phase=Phase.BACKOFF)
    assert ask(house, Request(Ask.RESTART, component="importer"))["code"] == "no-component"
    assert len(house.told) == 1


def test_who_asks_for_the_history_is_told_it(house: House) -> None:
    house.folders.state.mkdir()
    told = {"at": "t", "before": "STARTING", "after": "OPERATIONAL", "phase": "RUNNING", "reason": "r"}
    files.write_json(house.folders.history, {"changes": [told]})
    house.chronicle = Chronicle(house.folders, house, lambda _kind, _fields: None)
    assert ask(house, Request(Ask.HISTORY))["changes"] == [told]


def test_a_status_says_what_is_wrong_with_the_policy_file(house: House) -> None:
    files.write_whole(house.folders.policy, b"{", durable=False)
    answer = ask(house, Request(Ask.POLICY_RELOAD))
    assert answer["code"] == "policy-faults"
    assert answer["values"]["faults"][0]["line"] == 1
    assert [diagnosis for _stage, diagnosis in alerts_of(house)] == [Diagnosis.CONFIG_INVALID]
