import json
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, StrEnum
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hardcore.model.actions import Action
from hardcore.model.codec import DEPTH_MAX, Codec, Undecodable, UnencodableError
from hardcore.model.observations import Exit, Observation
from hardcore.model.recorder import CommandNote, SlotStage
from hardcore.recovery.flight import CODEC


class Tone(StrEnum):
    LOW = "low"
    HIGH = "high"


class Place(Enum):
    HERE = 1


@dataclass(frozen=True, slots=True)
class Note:
    tone: Tone
    text: str = ""
    secret: bytes = b""


@dataclass(slots=True)
class Sheet:
    notes: deque[Note] = field(default_factory=lambda: deque(maxlen=3))
    marks: Mapping[Place, frozenset[int]] = field(default_factory=dict)
    best: Note | None = None
    pace: float = 1.0
    made: list[Note] = field(init=False)

    def __post_init__(self) -> None:
        self.made = []


OURS = Codec([Tone, Place, Note, Sheet])
PLAIN = Codec(CODEC.classes)  # nothing is left blank
EVERY_WORD = [*get_args(Observation), *get_args(Action)]


def through(codec: Codec, value: Any) -> Any:
    """As a file would bring it back."""
    return codec.decode(json.loads(json.dumps(codec.encode(value))))


@pytest.mark.parametrize("word", EVERY_WORD, ids=lambda word: word.__name__)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_every_fact_and_every_order_comes_back_as_it_was(word: type, data: st.DataObject) -> None:
    value = data.draw(st.from_type(word))
    assert through(PLAIN, value) == value


def test_collections_come_back_as_what_they_were() -> None:
    sheet = Sheet(
        deque([Note(Tone.LOW)], 3), {Place.HERE: frozenset({1, 2})}, Note(Tone.HIGH, "x", b"\x00\xff")
    )
    sheet.made.append(Note(Tone.LOW))
    back = through(OURS, sheet)
    assert back == sheet
    assert back.notes.maxlen == 3
    assert type(back.made) is list


def test_what_is_at_its_default_is_not_said() -> None:
    assert OURS.encode(Note(Tone.LOW)) == {"Note": {"tone": {"$enum": "Tone.LOW"}}}


def test_a_blank_field_is_never_written() -> None:
    discreet = Codec([Tone, Note], {Note: {"secret": b""}})
    assert "secret" not in json.dumps(discreet.encode(Note(Tone.LOW, secret=b"pin 1234")))


def test_the_recording_of_a_guard_says_nothing_that_clients_wrote() -> None:
    note = CommandNote(
        SlotStage.DECIDING, "c", "k", "transaction", "t", ("a",), 1, payload=b"rent", payload_bytes=4
    )
    told = json.dumps(CODEC.encode(note))
    assert b"rent".hex() not in told
    assert '"payload_bytes": 4' in told


@pytest.mark.parametrize("value", [object(), Exit(1), {"a": lambda: 1}, float("nan"), 1j, Note])
def test_what_nobody_has_named_is_not_written(value: object) -> None:
    with pytest.raises(UnencodableError):
        OURS.encode(value)


BAD = {
    "a class that is not ours": {"Exit": {}},
    "a module": {"os.system": {"command": "true"}},
    "a field it has not": {"Note": {"tone": {"$enum": "Tone.LOW"}, "volume": 1}},
    "a field it needs": {"Note": {}},
    "a wrong type": {"Note": {"tone": "low"}},
    "another enum": {"Note": {"tone": {"$enum": "Place.HERE"}}},
    "a word that is not there": {"$enum": "Tone.MIDDLE"},
    "a class as a word": {"$enum": "Note.LOW"},
    "a class without fields": {"Note": []},
    "bytes that are none": {"$bytes": "zz"},
    "bytes of a number": {"$bytes": 4},
    "a queue that is too full": {"$deque": [1, 2], "$max": 1},
    "a queue with a strange most": {"$deque": [], "$max": "x"},
    "a map of no pairs": {"$map": [[1, 2, 3]]},
    "a map of numbers": {"$map": [1]},
    "a map with a list as a key": {"$map": [[{"$list": []}, 1]]},
    "a set of sets": {"$set": [{"$set": []}]},
    "a tag that is none": {"$eval": ["1"]},
    "a tag without parts": {"$list": 3},
    "two things at once": {"$list": [], "Note": {}},
    "nothing": {},
    "inside": [[{"Exit": {}}]],
    "a bool for a number": {"Sheet": {"pace": True, "made": {"$list": []}}},
    "a tuple for a list": {"Sheet": {"made": []}},
    "a wrong part": {"Sheet": {"made": {"$list": [1]}}},
}


@pytest.mark.parametrize("raw", BAD.values(), ids=BAD)
def test_what_no_guard_has_written_is_named_and_never_raised(raw: Any) -> None:
    found = OURS.decode(raw)
    assert isinstance(found, Undecodable)
    assert found.reason


def test_a_value_nested_without_end_is_refused() -> None:
    raw: Any = 1
    for _ in range(DEPTH_MAX + 2):
        raw = [raw]
    assert OURS.decode(raw) == Undecodable("nested too deeply")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(
                ["$enum", "$list", "$map", "$deque", "$max", "$bytes", "$set", "Note", "Sheet", "tone"]
            ),
            inner,
            max_size=3,
        )
    ),
    max_leaves=20,
)


@given(JSON)
def test_whatever_the_json_nothing_raises(raw: Any) -> None:
    OURS.decode(raw)


def test_another_field_is_another_shape() -> None:
    assert OURS.shape == Codec([Sheet, Note, Place, Tone]).shape
    assert OURS.shape != Codec([Tone, Place, Note]).shape


def test_two_classes_of_one_name_are_told_apart() -> None:
    @dataclass(frozen=True, slots=True)
    class Exit:  # the name of one of the guard's words
        why: str

    both = Codec([Exit, *(cls for cls in CODEC.classes if cls.__name__ == "Exit")])
    assert through(both, Exit("x")) == Exit("x")
