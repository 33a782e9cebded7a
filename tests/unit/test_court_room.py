"""The court's hands: the file before the word, every word once more to who joins, and nothing lost between two guards."""

import asyncio
import datetime as dt
import json
from collections.abc import Callable, Coroutine, Mapping
from pathlib import Path
from typing import Any

import pytest

from hardcore import quarantine_file
from hardcore.court_room import CourtRoom
from hardcore.court_words import suspect_lines, unruled
from hardcore.host import suspects
from hardcore.host.folders import Folders
from hardcore.model import trials
from hardcore.model.observations import Observation
from hardcore.model.trials import CourtMemory, Letter, Ordeal, Reason, Suspect, SuspectNote
from hardcore.quarantine_file import Aside
from hardcore.recovery.letters import letter
from hardcore.rule_book import Doors

NAME, OTHER = "a" * 32, "b" * 32
LETTER = Letter("letter-1", NAME, Reason.CRASHED_CORE, False, ("incident",), 1, digest="ab" * 32)


class Room:
    """A court room whose hands work at once, with what it has told and published, in the order of both."""

    def __init__(self, folders: Folders) -> None:
        self.folders = folders
        self.halted = asyncio.Event()
        self.told: list[Observation] = []
        self.published: list[dict[str, object]] = []
        self.on_disk: list[list[str]] = []  # the rules' ids on the disk when each line was published
        self.noted: list[dict[str, object]] = []
        self.begun: list[asyncio.Task[Any]] = []
        doors = Doors(self.told.append, self._publish, list, self._calm, self._add_trials)
        self.court = CourtRoom(folders, 1, self, doors)

    def _publish(self, line: Mapping[str, object]) -> None:
        self.published.append(dict(line))
        self.on_disk.append([rule["id"] for rule in quarantine_file.read(self.folders).rules])

    async def _calm(self) -> None:
        """No switch is under way."""

    async def _add_trials(self, order: trials.AddTrials) -> None:
        del order

    def begin(self, work: Coroutine[Any, Any, Any]) -> None:
        self.begun.append(asyncio.get_running_loop().create_task(work))

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        return work(*args)

    def note(self, kind: str, **particulars: object) -> None:
        self.noted.append({"kind": kind, **particulars})

    async def done(self) -> None:
        while waiting := [task for task in self.begun if not task.done()]:
            await asyncio.gather(*waiting)

    @property
    def verdicts(self) -> list[tuple[object, object, object]]:
        lines = [line for line in self.published if line["type"] == "verdict"]
        return [(line["name"], line["outcome"], line["letter"]) for line in lines]


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    made = Folders(tmp_path, tmp_path / "run")
    for folder in (made.run, made.state, made.cases, made.logs):
        folder.mkdir()
    return made


def at_work(folders: Folders, work: Callable[[Room], None]) -> Room:
    async def run() -> Room:
        room = Room(folders)
        work(room)
        await room.done()
        return room

    return asyncio.run(run())


def spooled(folders: Folders) -> list[dict[str, Any]]:
    return [json.loads(path.read_text("utf-8")) for path in folders.spool.glob("*.json")]


def case_of(folders: Folders, name: str) -> Path:
    path = folders.cases / f"{name}.json"
    request = {"method": "POST", "path": "/x", "headers": [], "body": ""}
    case = {"name": name, "request": request}
    path.write_text(
        json.dumps({"version": 1, "name": name, "source": "s", "key": "k", "digest": "ab" * 32, "case": case})
    )
    return path


def test_nobody_hears_of_a_letter_before_its_rule_lies_on_the_disk(folders: Folders) -> None:
    case = case_of(folders, NAME)
    room = at_work(folders, lambda room: room.court.carry_out(trials.SetAside(LETTER)))
    assert room.verdicts == [(NAME, "convicted", "letter-1")]
    assert room.on_disk == [["letter-1"]] * len(room.published)
    (message,) = spooled(folders)
    assert (message["type"], message["id"], message["idempotency_key"]) == ("letter", "letter-1", "k")
    assert message["case"]["request"]["method"] == "POST"
    assert not case.exists(), "the letter has it now"
    assert not room.court.rules.aside.unsent


def test_a_letter_that_is_said_again_is_told_again_and_written_once(folders: Folders) -> None:
    def twice(room: Room) -> None:
        room.court.carry_out(trials.SetAside(LETTER))
        room.court.carry_out(trials.SetAside(LETTER))

    room = at_work(folders, twice)
    assert set(room.verdicts) == {(NAME, "convicted", "letter-1")}
    assert len(room.court.rules.aside.rules) == 1
    assert len(spooled(folders)) == 1


def test_a_guard_that_died_before_it_wrote_a_letter_is_followed_by_one_that_does(folders: Folders) -> None:
    case_of(folders, NAME)
    aside = quarantine_file.set_aside(Aside(), LETTER, {"id": "letter-1", "name": NAME})
    quarantine_file.write(folders, aside)
    memory = CourtMemory((Suspect(NAME, "incident", filed=True), Suspect(OTHER, "incident")))
    taken: list[CourtMemory] = []

    def take_up(room: Room) -> None:
        taken.append(room.court.take_up(quarantine_file.read(folders), memory, {}))

    room = at_work(folders, take_up)
    assert [message["id"] for message in spooled(folders)] == ["letter-1"]
    assert [(one.ordeal, one.letter) for one in taken[0].suspects] == [(Ordeal.DIED, "letter-1"), (None, "")]
    (said,) = (line for line in room.court.greeting() if line["type"] == "verdict")
    assert (said["name"], said["outcome"]) == (NAME, "convicted"), "a gateway may wait for it still"
    at_work(folders, take_up)
    assert len(spooled(folders)) == 1, "and no third one writes it again"


def test_who_is_suspect_is_on_the_disk_before_a_core_is_released(folders: Folders) -> None:
    note = SuspectNote(NAME, ("assets:cash",))
    memory = CourtMemory((Suspect(NAME, "incident"),))

    async def run() -> None:
        room = Room(folders)
        room.court.carry_out(trials.KeepCourt((note,), memory))
        assert not room.court.is_written
        assert room.published[0]["keys"] == [NAME], "the gateway knows at once"
        await room.court.written()
        told = json.loads(folders.quarantine.read_text())
        assert told["suspects"] == [{"name": NAME, "account_ids": ["assets:cash"]}]
        await room.done()
        assert room.court.is_written

    asyncio.run(run())
    assert json.loads(folders.suspects.read_text())["memory"]


def test_a_convicted_name_is_shown_as_suspect_until_its_rule_lies_there(folders: Folders) -> None:
    note = SuspectNote(NAME, ("assets:cash",))
    convicted = CourtMemory((Suspect(NAME, "incident", ordeal=Ordeal.DIED, letter="letter-1"),))

    def on_disk() -> tuple[list[str], list[str]]:
        told = json.loads(folders.quarantine.read_text())
        return [one["name"] for one in told["suspects"]], [rule["id"] for rule in told["rules"]]

    async def run() -> None:
        room = Room(folders)
        room.court.carry_out(trials.KeepCourt((note,), CourtMemory((Suspect(NAME, "incident"),))))
        await room.done()
        room.court.carry_out(trials.KeepCourt((), convicted))
        await room.done()
        assert on_disk() == ([NAME], []), "its rule is yet to come"
        room.court.carry_out(trials.SetAside(LETTER))
        await room.done()
        assert on_disk() == ([], ["letter-1"])

    asyncio.run(run())


def test_who_is_acquitted_is_shown_no_longer(folders: Folders) -> None:
    note = SuspectNote(NAME, ("assets:cash",))
    acquitted = CourtMemory((Suspect(NAME, "incident", ordeal=Ordeal.SURVIVED),))

    async def run() -> None:
        room = Room(folders)
        room.court.carry_out(trials.KeepCourt((note,), CourtMemory((Suspect(NAME, "incident"),))))
        await room.done()
        room.court.carry_out(trials.KeepCourt((), acquitted))
        await room.done()

    asyncio.run(run())
    assert json.loads(folders.quarantine.read_text())["suspects"] == []


def test_what_is_remembered_comes_back(folders: Folders) -> None:
    memory = CourtMemory((Suspect(NAME, "incident"),), settled_seq=3)
    room = at_work(folders, lambda room: room.court.carry_out(trials.KeepCourt((), memory)))
    assert room.published == [], "nobody is suspect who was not before"
    assert suspects.read(folders, dt.datetime.now(dt.UTC))[0] == memory


def test_a_suspect_without_a_case_is_not_tried_and_a_court_is_always_over(folders: Folders) -> None:
    room = at_work(folders, lambda room: room.court.carry_out(trials.Try((NAME,), 1000, 0)))
    first, last = room.told
    assert isinstance(first, trials.Tried)
    assert (first.name, first.ordeal, first.why) == (NAME, Ordeal.UNTRIED, "its request is not known")
    assert last == trials.TrialsOver(last.at_ns, "")


def test_a_court_that_is_ended_is_over(folders: Folders) -> None:
    def end(room: Room) -> None:
        room.court.carry_out(trials.TryLog(0, 1000, 0))
        room.court.carry_out(trials.EndTrials())

    async def run() -> Room:
        room = Room(folders)
        end(room)
        await room.court.stop()
        return room

    assert [type(fact) for fact in asyncio.run(run()).told] == [trials.TrialsOver]


@pytest.mark.parametrize(("run", "outcome"), [(True, "cleared"), (False, "dropped")])
def test_an_acquittal_disarms_its_drill_and_forgets_its_case(
    folders: Folders, run: bool, outcome: str
) -> None:  # pytest gives it
    case = case_of(folders, NAME)
    quarantine_file.arm(folders, NAME)
    room = at_work(folders, lambda room: room.court.carry_out(trials.Acquit(NAME, run=run)))
    assert room.verdicts == [(NAME, outcome, None)]
    assert not folders.armed.exists()
    assert not case.exists()


def test_a_disk_that_takes_no_write_lets_nobody_be_told(folders: Folders) -> None:
    folders.quarantine.mkdir()  # as if there were no room

    async def run() -> Room:
        room = Room(folders)
        room.court.carry_out(trials.SetAside(LETTER))
        await asyncio.sleep(0)
        room.halted.set()
        await room.done()
        return room

    assert asyncio.run(run()).published == []


def test_a_rule_taken_away_is_a_fact_and_one_that_is_not_there_is_none(folders: Folders) -> None:
    async def run() -> Room:
        room = Room(folders)
        room.court.carry_out(trials.SetAside(LETTER))
        await room.done()
        assert await room.court.rules.remove("nobody") == {"changed": False}
        assert await room.court.rules.remove("letter-1") == {"changed": True}
        return room

    room = asyncio.run(run())
    assert [fact.rule for fact in room.told if isinstance(fact, trials.RuleRemoved)] == ["letter-1"]
    assert quarantine_file.read(folders).rules == ()


def test_many_suspects_are_said_in_lines_that_a_gateway_reads() -> None:
    notes = [SuspectNote(f"{number:032x}", (f"account-{number}" * 20,)) for number in range(1200)]
    lines = suspect_lines(notes)
    assert [key for line in lines for key in line["keys"]] == [note.name for note in notes]  # type: ignore[attr-defined]
    accounts = {account for line in lines for account in line["account_ids"]}  # type: ignore[attr-defined]
    assert accounts == {account for note in notes for account in note.account_ids}
    assert max(len(json.dumps(line)) for line in lines) < 64 << 10


def test_a_letter_without_a_rule_is_set_aside_by_the_next_guard(folders: Folders) -> None:
    case_of(folders, NAME)
    convicted = Suspect(NAME, "incident", ordeal=Ordeal.DIED, letter="letter-1")
    parked = Suspect(OTHER, "incident", ordeal=Ordeal.DIED, letter="letter-2", seq=77)
    memory = CourtMemory((convicted, parked, Suspect("c" * 32, "incident")))
    assert unruled(memory, Aside()) == (convicted, parked)

    def take_up(room: Room) -> None:
        aside = quarantine_file.read(folders)
        letters = tuple(map(letter, unruled(memory, aside)))
        room.court.take_up(aside, memory, {}, letters)

    room = at_work(folders, take_up)
    rules = quarantine_file.read(folders).rules
    assert [(rule["id"], rule["type"], rule.get("seq")) for rule in rules] == [
        ("letter-1", "letter", None),
        ("letter-2", "parked", 77),
    ]
    assert (NAME, "convicted", "letter-1") in room.verdicts
    assert len(spooled(folders)) == 2
    at_work(folders, take_up)
    assert len(spooled(folders)) == 2, "once is enough"


def test_a_rule_that_a_person_took_away_is_brought_back_by_no_memory(folders: Folders) -> None:
    memory = CourtMemory((Suspect(NAME, "incident", ordeal=Ordeal.DIED, letter="letter-1"),))

    async def run() -> Room:
        room = Room(folders)
        room.court.carry_out(trials.SetAside(LETTER))
        await room.done()
        assert await room.court.rules.remove("letter-1") == {"changed": True}
        room.published.clear()
        room.court.carry_out(trials.SetAside(LETTER, again=True))
        await room.done()
        return room

    room = asyncio.run(run())
    assert room.verdicts == []
    aside = quarantine_file.read(folders)
    assert (aside.rules, aside.released, unruled(memory, aside)) == ((), ("letter-1",), ())


def test_two_who_set_one_letter_aside_at_once_write_it_once(folders: Folders) -> None:
    class Slow(Room):
        async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
            await asyncio.sleep(0)
            return work(*args)

    async def run() -> Room:
        room = Slow(folders)
        for again in (False, False, True):
            room.court.carry_out(trials.SetAside(LETTER, again=again))
        await room.done()
        return room

    room = asyncio.run(run())
    assert set(room.verdicts) == {(NAME, "convicted", "letter-1")}
    assert len(spooled(folders)) == 1
    assert not room.court.rules.aside.unsent


def test_who_changes_a_rule_is_told_of_a_full_disk_while_a_letter_waits_for_it(folders: Folders) -> None:
    folders.quarantine.mkdir()  # as if there were no room

    async def run() -> object:
        room = Room(folders)
        room.court.carry_out(trials.SetAside(LETTER))
        await asyncio.sleep(0)
        wish = {"type": "fingerprint", "fingerprint": "ab" * 32}
        said = await asyncio.wait_for(room.court.rules.add(wish), 30)
        room.halted.set()
        await room.done()
        return said

    assert asyncio.run(run()) == "The rule can't be written. Make room in the data folder and try again."


def test_a_letter_whose_disk_has_room_again_is_set_aside(folders: Folders) -> None:
    folders.quarantine.mkdir()

    async def run() -> Room:
        room = Room(folders)
        room.court.carry_out(trials.SetAside(LETTER))
        await asyncio.sleep(0)
        assert room.noted, "it has been tried"
        folders.quarantine.rmdir()
        await room.done()
        return room

    assert asyncio.run(run()).verdicts == [(NAME, "convicted", "letter-1")]


def test_a_case_that_an_earlier_guard_was_told_of_counts_as_filed(folders: Folders) -> None:
    case_of(folders, NAME)
    case_of(folders, "c" * 32)
    memory = CourtMemory((Suspect(NAME, "incident"), Suspect(OTHER, "incident")))
    kept = trials.KeepCourt((SuspectNote(NAME, ()), SuspectNote(OTHER, ())), memory)

    def twice(room: Room) -> None:
        room.court.carry_out(kept)
        room.court.carry_out(kept)

    room = at_work(folders, twice)
    assert [fact.name for fact in room.told if isinstance(fact, trials.CaseFiled)] == [NAME]
