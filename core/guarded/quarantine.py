"""The rules in force: what the guard has set aside, limited or marked, as this core has read it.

The guard alone writes the file (`docs/wires.md` section 13), and the core reads it whole, when it opens its book and when
it is told to. Reading is total: a file that can't be understood leaves the rules before it in force, because a core that
forgot them would run the very command that killed the one before it; a single rule that says nothing is passed over and
counted. What is read is kept as the look-ups that are needed, so that no rule costs no work. Not chosen: to watch the file;
the guard knows when it has written it, and says so.
"""

import datetime as dt
import json
import os
import re
import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, TypeGuard

import msgspec

FILE_BYTES_MAX: Final = 8 << 20
VERSION: Final = 1
HELD: Final = frozenset({"UNPROVEN", "OPERATOR_HOLD"})  # nothing was reproduced: its name alone is refused

_ID: Final = re.compile(r"[\x21-\x7e]{1,64}")  # it goes into a header
_NAME: Final = re.compile(r"[0-9a-f]{32}")
_DIGEST: Final = re.compile(r"[0-9a-f]{64}")
_NUMBER_MAX: Final = 2**63 - 1
_TEXT_CHARACTERS_MAX: Final = 256
_NS_PER_S: Final = 1_000_000_000


class Limit(msgspec.Struct, frozen=True):
    """How much of a kind is taken: so many in a minute, bodies of so many bytes; None: as many as come."""

    rule: str
    per_minute: int | None
    body_bytes_max: int | None


class Parked(msgspec.Struct, frozen=True):
    """An event that is left out: the number of its letter, and the accounts that it is known to book on."""

    letter: str
    account_ids: tuple[str, ...]


class Rules(msgspec.Struct, frozen=True):
    """What is in force. Each look-up gives the id of its rule; a letter's is the letter's number.

    `names`, `digests` and `fingerprints` (hex) are refused. `parked`: events that are left out, by
    number; `marked`: the accounts they book on, on which nothing more is booked. `deadlines_ms`: how long a kind may be decided.
    `suspects`: names that wait for their trial. `sources`: who changes nothing, until when (wall time in ns since 1970).
    `passed_over`: rules that said nothing.
    """

    serial: int = 0
    names: Mapping[str, str] = {}
    digests: Mapping[str, str] = {}
    fingerprints: Mapping[str, str] = {}
    parked: Mapping[int, Parked] = {}
    marked: Mapping[str, str] = {}
    limits: Mapping[str, Limit] = {}
    deadlines_ms: Mapping[str, int] = {}
    suspects: frozenset[str] = frozenset()
    sources: Mapping[str, int] = {}
    count: int = 0
    passed_over: int = 0

    @property
    def refuse(self) -> bool:
        """Whether any single command may be refused by them."""
        return bool(self.names or self.digests or self.fingerprints or self.limits)


NO_RULES: Final = Rules()


class Unreadable(msgspec.Struct, frozen=True):
    """The file says nothing that can be used; `why` is a sentence."""

    why: str


class Quarantine:
    """The rules of one core. `rules` is one value, so any thread may look at it; `read` is called by one at a time."""

    def __init__(self, path: Path | None = None, *, parked_only: bool = False) -> None:
        """Begin without rules. `path`: the guard's file; None: nobody makes rules for this core.

        `parked_only`: it refuses nothing, and only leaves out of the log what is left out: a trial.
        """
        self.path = path
        self._parked_only = parked_only
        self.rules = NO_RULES

    def read(self) -> Unreadable | None:
        """Read the file anew and put its rules in force; where that can't be done those before it stay. Blocks."""
        if self.path is None:
            return None
        raw = read_small(self.path, FILE_BYTES_MAX)
        if raw is None:
            return None  # there is none: nothing was ever set aside, or its folder is gone and what was said counts
        found = raw if isinstance(raw, Unreadable) else read_rules(raw)
        if isinstance(found, Unreadable):
            return found
        self.rules = Rules(found.serial, parked=found.parked) if self._parked_only else found
        return None


def read_small(path: Path, bytes_max: int) -> bytes | Unreadable | None:
    """Return what stands in a file of at most `bytes_max` bytes; None: there is no such file. Waits for no writer."""
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except FileNotFoundError:
        return None
    except OSError as error:
        return Unreadable(f"{path.name} can't be opened: {error.strerror}.")
    try:
        with os.fdopen(fd, "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                return Unreadable(f"{path.name} is no file.")
            raw = file.read(bytes_max + 1)
    except OSError as error:
        return Unreadable(f"{path.name} can't be read: {error.strerror}.")
    return raw if len(raw) <= bytes_max else Unreadable(f"{path.name} is longer than {bytes_max} bytes.")


def read_rules(raw: bytes) -> Rules | Unreadable:
    """Return the rules in the bytes of a file; never raises."""
    try:
        said = json.loads(raw)
    except (ValueError, RecursionError):
        return Unreadable("The file of rules is not JSON.")
    if not isinstance(said, dict) or said.get("version") != VERSION:
        return Unreadable(f"The file of rules is not of version {VERSION}.")
    rules, suspects, serial = said.get("rules", []), said.get("suspects", []), said.get("serial", 0)
    if not isinstance(rules, list) or not isinstance(suspects, list) or not _is_number(serial, 0):
        return Unreadable("The file of rules has no list of rules, or none of suspects, or no serial.")
    found = _Found()
    for rule in rules:
        found.take(rule)
    names = (one.get("name") for one in suspects if isinstance(one, dict))
    return found.made(
        serial, frozenset(str(name) for name in names if _matches(_NAME, name)), _stopped(said.get("sources"))
    )


def _stopped(sources: object) -> dict[str, int]:
    """Return who is stopped and until when; what says no time is passed over."""
    found: dict[str, int] = {}
    for one in sources if isinstance(sources, list) else ():
        source, until = (one.get("source"), one.get("until")) if isinstance(one, dict) else (None, None)
        if not _is_text(source) or not _is_text(until):
            continue
        try:
            moment = dt.datetime.fromisoformat(until)
            found[source] = int(moment.timestamp()) * _NS_PER_S if moment.tzinfo is not None else 0
        except (ValueError, OverflowError):
            continue
    return found


class _Found(msgspec.Struct):
    """The rules so far."""

    names: dict[str, str] = {}
    digests: dict[str, str] = {}
    fingerprints: dict[str, str] = {}
    parked: dict[int, Parked] = {}
    marked: dict[str, str] = {}
    limits: dict[str, Limit] = {}
    deadlines_ms: dict[str, int] = {}
    count: int = 0
    passed_over: int = 0

    def take(self, rule: object) -> None:
        """Take one rule in, or pass it over."""
        takes = _TYPES.get(str(rule.get("type"))) if isinstance(rule, dict) else None
        if takes is not None and isinstance(rule, dict) and _matches(_ID, rule.get("id")):
            taken = takes(self, rule["id"], rule)
        else:
            taken = False
        self.count += taken
        self.passed_over += not taken

    def letter(self, letter: str, rule: Mapping[str, Any]) -> bool:
        """A request that is set aside: by its name, and where it was convicted by its digest and its wish."""
        if not _matches(_NAME, rule.get("name")):
            return False
        self.names[rule["name"]] = letter
        if rule.get("reason") not in HELD:
            for text, into in (
                (rule.get("digest"), self.digests),
                (rule.get("fingerprint"), self.fingerprints),
            ):
                if _matches(_DIGEST, text):
                    into[str(text)] = letter
        return True

    def event(self, letter: str, rule: Mapping[str, Any]) -> bool:
        """An event that is left out, and its accounts."""
        seq, accounts = rule.get("seq"), rule.get("account_ids", [])
        if not _is_number(seq, 1) or not isinstance(accounts, list) or not all(map(_is_text, accounts)):
            return False
        self.parked[seq] = Parked(letter, tuple(accounts))
        self.marked.update(dict.fromkeys(accounts, letter))
        return True

    def wish(self, rule_id: str, rule: Mapping[str, Any]) -> bool:
        """A wish that is refused under any key."""
        if not _matches(_DIGEST, rule.get("fingerprint")):
            return False
        self.fingerprints[rule["fingerprint"]] = rule_id
        return True

    def limit(self, rule_id: str, rule: Mapping[str, Any]) -> bool:
        """How much of a kind is taken. Of several for one kind the last counts."""
        kind, often, large = rule.get("kind"), rule.get("per_minute"), rule.get("body_bytes_max")
        if not _is_text(kind) or not all(one is None or _is_number(one, 0) for one in (often, large)):
            return False
        self.limits[kind] = Limit(rule_id, often, large)
        return True

    def deadline(self, _rule_id: str, rule: Mapping[str, Any]) -> bool:
        """How long a kind may be decided."""
        if not _is_text(rule.get("kind")) or not _is_number(rule.get("limit_ms"), 1):
            return False
        self.deadlines_ms[rule["kind"]] = min(rule["limit_ms"], _DAY_MS)
        return True

    def made(self, serial: int, suspects: frozenset[str], sources: Mapping[str, int]) -> Rules:
        """Return what was found."""
        return Rules(
            serial,
            self.names,
            self.digests,
            self.fingerprints,
            self.parked,
            self.marked,
            self.limits,
            self.deadlines_ms,
            suspects,
            sources,
            self.count,
            self.passed_over,
        )


_DAY_MS: Final = 86_400_000  # a limit of more is none
_TYPES: Final[Mapping[str, Callable[[_Found, str, Mapping[str, Any]], bool]]] = MappingProxyType(
    {
        "letter": _Found.letter,
        "parked": _Found.event,
        "fingerprint": _Found.wish,
        "limit": _Found.limit,
        "deadline": _Found.deadline,
    }
)


def _matches(pattern: re.Pattern[str], text: object) -> bool:
    return isinstance(text, str) and pattern.fullmatch(text) is not None


def _is_text(value: object) -> TypeGuard[str]:
    return isinstance(value, str) and 0 < len(value) <= _TEXT_CHARACTERS_MAX


def _is_number(value: object, least: int) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and least <= value <= _NUMBER_MAX
