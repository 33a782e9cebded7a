import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardcore.model import observations as seen
from hardcore.model.phases import Wanted
from hardcore.model.recorder import CommandNote, SlotStage, Threads
from hardcore.recovery import flight
from hardcore.recovery.failover import FailoverManager
from hardcore.recovery.flight import NOTES_MAX, RECORDING_BYTES_MAX, STRETCH_NS, Tape
from hardcore.recovery.policy import Policy
from hardcore.replay import Replayed, replay, replay_incident
from hardcore.snapshot.writer import RECORDING

S = 1_000_000_000
PROOF = seen.Proof("chain", 3, 7, "ab" * 32)


def told(facts: list[seen.Observation], policy: Policy | None = None) -> Tape:
    """A tape of a manager that heard these, with a deadline asked for after each."""
    numbers = itertools.count(1)
    tape = Tape(lambda: f"incident-{next(numbers)}", lambda: 0.25)
    manager = FailoverManager(policy or Policy(), Wanted.UP, tape.new_id, tape.jitter)
    for fact in facts:
        for heard in (fact, fact.at_ns + 1):
            tape.hear(heard, manager)
            if isinstance(heard, int):
                manager.handle_deadline(heard)
            else:
                manager.receive(heard)
            manager.take_transitions()
            tape.ordered(manager.take_actions())
    return tape


def life(number: int, at_ns: int) -> list[seen.Observation]:
    """A core that begins, serves, and crashes two seconds later."""
    return [
        seen.CoreSpawned(at_ns, number, 100 + number),
        seen.CoreReady(at_ns + S, number, number, PROOF),
        seen.CoreExited(at_ns + 3 * S, number, seen.Exit(signal=11), None),
    ]


def story(deaths: int = 3, apart_ns: int = 20 * S) -> list[seen.Observation]:
    facts: list[seen.Observation] = [seen.SentinelBegan(S)]
    for number in range(1, deaths + 1):
        facts += life(number, 2 * S + number * apart_ns)
    return facts


DATA = told(story()).cut().write()
LINES = DATA.splitlines(keepends=True)


def test_the_same_facts_give_the_same_orders() -> None:
    found = replay(DATA)
    assert isinstance(found, Replayed)
    assert found.same
    assert found.first_difference is None
    assert found.facts == 2 * len(story())
    assert found.orders > 6


def test_a_tape_goes_on_from_what_was_remembered_in_its_middle() -> None:
    facts = story(deaths=8, apart_ns=STRETCH_NS)
    tape = told(facts)
    found = replay(tape.cut().write())
    assert isinstance(found, Replayed)
    assert found.same
    assert found.facts < 2 * len(facts)  # what is older than two stretches is let go


def test_under_load_a_tape_holds_a_bounded_number_of_commands() -> None:
    note = CommandNote(SlotStage.QUEUED, "c", "k", "transaction", "", (), 1)
    facts = [seen.SentinelBegan(S)]
    looks = [seen.Sampled(S + n, 0, None, Threads(), None, (note,) * 256) for n in range(1, 200)]
    recording = told([*facts, *looks]).cut()
    held = sum(stretch.notes for stretch in recording.stretches)
    assert held <= 2 * (NOTES_MAX + 256)
    assert len(recording.write()) <= RECORDING_BYTES_MAX


def test_a_recording_that_grew_too_long_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    recording = told(story(deaths=2)).cut()
    monkeypatch.setattr(flight, "RECORDING_BYTES_MAX", len(recording.write()) - 500)
    found = replay(recording.write())
    assert isinstance(found, Replayed)
    assert found.same
    assert found.cut_short


def test_a_state_that_nobody_can_write_down_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FailoverManager, "state", lambda _: {"phase": object()})
    found = replay(told(story(deaths=1)).cut().write())
    assert isinstance(found, str)
    assert "object" in found


def _changed(number: int, change: Callable[[dict[str, Any]], object]) -> bytes:
    line = json.loads(LINES[number])
    change(line)
    return b"".join([*LINES[:number], json.dumps(line).encode() + b"\n", *LINES[number + 1 :]])


def _first_with(word: bytes) -> int:
    return next(number for number, line in enumerate(LINES) if number and word in line)


def test_a_changed_order_is_named_with_its_line() -> None:
    number = _first_with(b'"Release"')
    found = replay(_changed(number, lambda line: line["orders"][0]["Release"].update(life=9)))
    assert isinstance(found, Replayed)
    assert not found.same
    assert found.first_difference is not None
    assert found.first_difference.line == number + 1
    assert found.first_difference.fact == "CoreReady"
    assert found.first_difference.recorded != found.first_difference.given


def test_a_changed_fact_shows_in_the_orders() -> None:
    number = _first_with(b'"CoreExited"')
    changed = _changed(number, lambda line: line["fact"]["CoreExited"]["exit"].update(Exit={"code": 78}))
    found = replay(changed)
    assert isinstance(found, Replayed)
    assert not found.same


FACT = _first_with(b'"CoreReady"')
BROKEN = {
    "nothing": b"",
    "no JSON": b"hello\n",
    "a list": b"[]\n",
    "half a line": DATA[:-5],
    "half the lines": b"".join(LINES[: len(LINES) // 2]),
    "another count": _changed(len(LINES) - 1, lambda line: line.update(end=1)),
    "more after its end": DATA + LINES[1],
    "another version": _changed(0, lambda line: line.update(version=2)),
    "another policy": _changed(0, lambda line: line["policy"]["Policy"].update(confirm_hang_ms=9)),
    "no state": _changed(0, lambda line: line.pop("state")),
    "a state of something else": _changed(0, lambda line: line.update(state={"$map": [["phase", 1]]})),
    "a state that is a number": _changed(0, lambda line: line["state"]["$map"][0].__setitem__(1, 5)),
    "a state with a strange key": _changed(0, lambda line: line["state"]["$map"].append([[1], 5])),
    "a fact that is none": _changed(FACT, lambda line: line.update(fact={"Exit": {}})),
    "a fact nobody knows": _changed(FACT, lambda line: line.update(fact={"CoreSang": {}})),
    "a line without a fact": _changed(FACT, lambda line: line.pop("fact")),
    "a number that is a word": _changed(FACT, lambda line: line["fact"]["CoreReady"].update(at_ns="soon")),
    "too long": b" " * (RECORDING_BYTES_MAX + 1),
    "nested without end": b"[" * 100_000 + b"\n",
}


@pytest.mark.parametrize("data", BROKEN.values(), ids=BROKEN)
def test_a_recording_that_was_broken_is_named_and_never_raises(data: bytes) -> None:
    found = replay(data)
    assert isinstance(found, str)
    assert found.endswith(".")
    assert found.isprintable()


@settings(max_examples=150, deadline=None)
@given(st.integers(0, len(DATA) - 1), st.binary(min_size=1, max_size=3))
def test_whatever_stands_in_a_recording_nothing_raises(at: int, noise: bytes) -> None:
    replay(DATA[:at] + noise + DATA[at + len(noise) :])


def test_an_incident_without_a_recording_says_so(tmp_path: Path) -> None:
    found = replay_incident(tmp_path)
    assert isinstance(found, str)
    assert RECORDING in found


def test_the_recording_in_a_folder_is_read(tmp_path: Path) -> None:
    (tmp_path / RECORDING).write_bytes(DATA)
    found = replay_incident(tmp_path)
    assert isinstance(found, Replayed)
    assert found.same
