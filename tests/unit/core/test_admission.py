"""Whether a command is tried at all: by its name, its bytes, its wish, and how many of its kind there were."""

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

import msgspec

from core.admission import WINDOW_NS, Admission, Wish
from core.guarded.quarantine import Quarantine
from core.journal.answers import Limited, SetAside

NAME, DIGEST, FINGERPRINT = "0a" * 16, b"\x0b" * 32, b"a wish"
WISH = Wish("entry.record", "0d" * 16, b"\x0e" * 32, b"another wish", 10)
LETTER = {
    "id": "L1",
    "type": "letter",
    "name": NAME,
    "digest": DIGEST.hex(),
    "fingerprint": sha256(FINGERPRINT).hexdigest(),
    "reason": "CRASHED_CORE",
}


def ruled(path: Path, *rules: Any) -> Quarantine:
    file = path / "quarantine.json"
    file.write_text(json.dumps({"version": 1, "serial": 1, "rules": rules}))
    made = Quarantine(file)
    assert made.read() is None
    return made


def limit(**named: Any) -> dict[str, Any]:
    return {
        "id": "R",
        "type": "limit",
        "kind": WISH.kind,
        "per_minute": None,
        "body_bytes_max": None,
        **named,
    }


def test_without_rules_everybody_comes_in() -> None:
    assert Admission(Quarantine()).refusal(msgspec.structs.replace(WISH, name=NAME), 0) is None


def test_a_letter_is_refused_however_it_comes(tmp_path: Path) -> None:
    door = Admission(ruled(tmp_path, LETTER))
    for wish in (
        msgspec.structs.replace(WISH, name=NAME),
        msgspec.structs.replace(WISH, digest=DIGEST),
        msgspec.structs.replace(WISH, fingerprint=FINGERPRINT, kind="import.row"),
    ):
        assert door.refusal(wish, 0) == SetAside("L1")
    assert door.refusal(WISH, 0) is None
    assert door.refusal(msgspec.structs.replace(WISH, name="", digest=b"", fingerprint=b""), 0) is None


def test_a_kind_is_limited_in_any_minute_and_not_from_one_full_minute_to_the_next(tmp_path: Path) -> None:
    door = Admission(ruled(tmp_path, limit(per_minute=2)))
    half = WINDOW_NS // 2
    assert [door.refusal(WISH, at) for at in (half, half + 1)] == [None, None]
    assert door.refusal(WISH, WINDOW_NS) == Limited("R", 30)
    assert door.refusal(msgspec.structs.replace(WISH, kind="account.open"), WINDOW_NS) is None
    assert door.refusal(WISH, WINDOW_NS + half) is None
    assert door.refusal(WISH, WINDOW_NS + half) == Limited("R", 1)


def test_what_was_refused_does_not_count(tmp_path: Path) -> None:
    door = Admission(ruled(tmp_path, limit(per_minute=1)))
    assert door.refusal(WISH, 0) is None
    assert all(isinstance(door.refusal(WISH, at), Limited) for at in range(1, 50))
    assert door.refusal(WISH, WINDOW_NS) is None


def test_a_limit_of_none_takes_none(tmp_path: Path) -> None:
    door = Admission(ruled(tmp_path, limit(per_minute=0)))
    assert door.refusal(WISH, 5) == Limited("R", 60)


def test_what_is_larger_than_a_rule_takes_is_never_taken(tmp_path: Path) -> None:
    door = Admission(ruled(tmp_path, limit(body_bytes_max=10)))
    assert door.refusal(WISH, 0) is None
    assert door.refusal(msgspec.structs.replace(WISH, body_bytes=11), 0) == Limited("R", None)


def test_what_was_counted_goes_on_counting_when_other_rules_change(tmp_path: Path) -> None:
    rules = ruled(tmp_path, limit(per_minute=1))
    door = Admission(rules)
    assert door.refusal(WISH, 0) is None
    ruled(tmp_path, limit(per_minute=1), LETTER)
    rules.read()
    assert isinstance(door.refusal(WISH, 1), Limited)
