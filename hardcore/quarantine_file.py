"""What is set aside and which rules are in force: `state/quarantine.json`, of which the guard is the one writer.

The file is the truth for three processes (this guard, its core, the gateway), so it is made whole from one value and
put there by one rename. Whoever is to be told of a rule is told when it lies there, never before. A letter's rule keeps
what its message to the investigators needs until that is written: so a guard that dies between the two is followed by
one that writes it. Not chosen: a rule that the guard sends in words; a core that starts later would not know it.
"""

import errno
import json
import re
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec
from msgspec import structs

from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.model.trials import Letter, Reason, SuspectNote

VERSION: Final = 1
FILE_BYTES_MAX: Final = 8 << 20
#: Beyond, a rule of a person is refused, and of the letters the oldest rule goes: ten letters a minute for hours.
RULES_MAX: Final = 2000
SUSPECTS_MAX: Final = 4096
SOURCES_MAX: Final = 256
RELEASED_MAX: Final = 256
#: Commands that are armed at one time.
ARMED_MAX: Final = 64
#: Under this name a file that can't be read is kept, for a person.
DAMAGED: Final = "quarantine.damaged.json"
#: Rules that stand for a letter; the others are made by people.
LETTER_TYPES: Final = frozenset({"letter", "parked"})
#: Beside a letter's rule, until its message is written; nobody else reads it.
UNSENT: Final = "unsent"

_KIND = re.compile(r"[a-z][a-z0-9_.:-]{0,31}")
_HEX = {"name": re.compile(r"[0-9a-f]{32}"), "digest": re.compile(r"[0-9a-f]{64}")}
_ID = re.compile(r"[\x21-\x7e]{1,64}")
_ACCOUNT_CHARACTERS_MAX = 256
_ACCOUNTS_MAX = 16
_A_MINUTE_MAX = 1_000_000
_BODY_BYTES_MAX = 1 << 30
_DEADLINE_MS_MAX = 86_400_000
_SEQ_MAX = 2**63 - 1

Rule = Mapping[str, Any]


class Aside(msgspec.Struct, frozen=True):
    """Everything that the file says, as one value."""

    serial: int = 0
    rules: tuple[Rule, ...] = ()
    suspects: tuple[SuspectNote, ...] = ()
    sources: tuple[tuple[str, str], ...] = ()  # who changes nothing, and until when (RFC 3339)
    released: tuple[str, ...] = ()  # letters whose rules a person took away last: no memory brings them back

    @property
    def unsent(self) -> tuple[Rule, ...]:
        """The letters' rules whose messages have not been written."""
        return tuple(rule for rule in self.rules if UNSENT in rule)

    @property
    def letters(self) -> int:
        """How many commands and events are set aside now."""
        return sum(rule.get("type") in LETTER_TYPES for rule in self.rules)

    def rule(self, rule_id: str) -> Rule | None:
        """Return a rule by its id."""
        return next((rule for rule in self.rules if rule["id"] == rule_id), None)


def read(folders: Folders) -> Aside:
    """Return what the file says; nothing where there is none that can be read."""
    return _aside(files.read_json(folders.quarantine, FILE_BYTES_MAX)) or Aside()


def take_in(folders: Folders) -> tuple[Aside, str]:
    """Return what the file says, and what is wrong with it; a damaged one is kept under another name.

    A file whose end is missing is no file without rules: whoever goes on from it has to say so, and its serial must be
    one that no earlier file had, or nobody would read the next. Blocks on the disk.
    """
    path = folders.quarantine
    found = _aside(files.read_json(path, FILE_BYTES_MAX))
    if found is not None or not path.exists():
        return found or Aside(), ""
    kept = path.with_name(DAMAGED)
    try:
        path.replace(kept)
    except OSError as error:
        return Aside(
            int(time.time())
        ), f"The file of rules is damaged and stays where it is ({error.strerror})."
    return Aside(int(time.time())), f"The file of rules is damaged. It is kept as {kept.name}."


def _aside(said: Mapping[str, Any]) -> Aside | None:
    """Return what the object of a file says; None: it is none that was written by a guard."""
    serial, rules = said.get("serial"), said.get("rules")
    if said.get("version") != VERSION or not isinstance(serial, int) or not isinstance(rules, list):
        return None
    sources, released = said.get("sources"), said.get("released")
    return Aside(
        serial,
        tuple(rule for rule in rules if isinstance(rule, dict) and _is_id(rule.get("id"))),
        (),  # who is suspect is said anew by each guard
        tuple(
            (str(one["source"]), str(one["until"]))
            for one in (sources if isinstance(sources, list) else [])
            if isinstance(one, dict) and "source" in one and "until" in one
        ),
        tuple(one for one in released if _is_id(one)) if isinstance(released, list) else (),
    )


def write(folders: Folders, aside: Aside, *, durable: bool = True) -> None:
    """Put the file there, whole, and never one that is too long to be read. Blocks on the disk; raises OSError."""
    raw = _printed(in_full(aside))
    if len(raw) > FILE_BYTES_MAX:  # who is suspect counts more than whose accounts wait for that
        brief = tuple(SuspectNote(one.name, ()) for one in aside.suspects)
        raw = _printed(in_full(structs.replace(aside, suspects=brief)))
    if len(raw) > FILE_BYTES_MAX:
        raise OSError(errno.EFBIG, "the file of rules is too long")
    files.write_whole(folders.quarantine, raw, durable=durable)


def _printed(told: Mapping[str, Any]) -> bytes:
    return json.dumps(told, ensure_ascii=False, indent=1).encode("utf-8", "backslashreplace") + b"\n"


def in_full(aside: Aside) -> dict[str, Any]:
    """Return the file's object."""
    return {
        "version": VERSION,
        "serial": aside.serial,
        "rules": [dict(rule) for rule in aside.rules],
        "suspects": [{"name": one.name, "account_ids": list(one.account_ids)} for one in aside.suspects],
        "sources": [{"source": source, "until": until} for source, until in aside.sources],
        "released": list(aside.released),
    }


def shown(aside: Aside) -> dict[str, Any]:
    """Return the file's object without what is nobody's business."""
    told = in_full(aside)
    del told["released"]
    return {**told, "rules": [{k: v for k, v in rule.items() if k != UNSENT} for rule in told["rules"]]}


# ---- from one value to the next; each has a serial of its own ----


def set_aside(before: Aside, letter: Letter, unsent: Mapping[str, Any]) -> Aside:
    """Return what it says once this letter's rule is there, too; the oldest letter goes where there are too many."""
    rule = {**_rule_of(letter), UNSENT: dict(unsent)}
    kept = [one for one in before.rules if one["id"] != letter.id]
    while len(kept) >= RULES_MAX:
        oldest = next((one for one in kept if one.get("type") in LETTER_TYPES), kept[0])
        kept.remove(oldest)
    return structs.replace(before, serial=before.serial + 1, rules=(*kept, rule))


def _rule_of(letter: Letter) -> dict[str, Any]:
    if letter.seq is not None:
        return {
            "id": letter.id,
            "type": "parked",
            "seq": letter.seq,
            "account_ids": list(letter.account_ids),
        }
    return {
        "id": letter.id,
        "type": "letter",
        "name": letter.name,
        "digest": letter.digest or None,
        "fingerprint": letter.fingerprint or None,
        "reason": str(letter.reason),
        "account_ids": list(letter.account_ids),
    }


def sent(before: Aside, letter: str) -> Aside:
    """Return what it says once a letter's message is written; whoever follows the rules sees no change in it."""
    rules = tuple(
        {k: v for k, v in rule.items() if k != UNSENT} if rule["id"] == letter else rule
        for rule in before.rules
    )
    return structs.replace(before, rules=rules)


def with_rule(before: Aside, rule: Rule) -> Aside:
    """Return what it says with one rule more."""
    released = tuple(one for one in before.released if one != rule["id"])
    rules = (*before.rules, rule)
    return structs.replace(before, serial=before.serial + 1, rules=rules, released=released)


def without_rule(before: Aside, rule_id: str) -> Aside:
    """Return what it says with one rule less."""
    rules = tuple(rule for rule in before.rules if rule["id"] != rule_id)
    released = (*before.released, rule_id)[-RELEASED_MAX:]
    return structs.replace(before, serial=before.serial + 1, rules=rules, released=released)


def with_suspects(before: Aside, suspects: Sequence[SuspectNote]) -> Aside:
    """Return what it says while these are suspect."""
    return structs.replace(before, serial=before.serial + 1, suspects=tuple(suspects[:SUSPECTS_MAX]))


def with_source(before: Aside, source: str, until: str, now: str) -> Aside:
    """Return what it says while this source changes nothing; those whose time is over go."""
    kept = tuple((one, end) for one, end in before.sources if one != source and end > now)
    sources = (*kept, (source, until))[-SOURCES_MAX:]
    return structs.replace(before, serial=before.serial + 1, sources=sources)


# ---- the rules that people make ----


def judge(wish: object, new_id: str) -> Rule | str:
    """Return a wished-for rule as it will stand in the file, or one sentence that says what is wrong with it."""
    if not isinstance(wish, dict):
        return "The rule must be an object."
    if _is_id(wish.get("id")):
        new_id = wish["id"]  # who asks twice for one rule gets one
    match wish.get("type"):
        case "fingerprint":
            if not _hex(wish.get("fingerprint"), "digest"):
                return "A fingerprint has 64 hexadecimal digits."
            return {"id": new_id, "type": "fingerprint", "fingerprint": wish["fingerprint"]}
        case "limit":
            return _limit(wish, new_id)
        case "deadline":
            if not _is_kind(wish.get("kind")):
                return "A deadline names a kind of command, such as transaction.post."
            if not _within(wish.get("limit_ms"), 1, _DEADLINE_MS_MAX):
                return f"limit_ms is a whole number from 1 to {_DEADLINE_MS_MAX}."
            return {"id": new_id, "type": "deadline", "kind": wish["kind"], "limit_ms": wish["limit_ms"]}
        case "letter" | "parked":
            return _put_back(wish)
        case _:
            return "The type of a rule is fingerprint, limit, deadline, letter or parked."


def _limit(wish: Mapping[str, Any], new_id: str) -> Rule | str:
    often, large = wish.get("per_minute"), wish.get("body_bytes_max")
    if not _is_kind(wish.get("kind")):
        return "A limit names a kind of command, such as transaction.post."
    if often is None and large is None:
        return "A limit needs per_minute, body_bytes_max, or both."
    if often is not None and not _within(often, 0, _A_MINUTE_MAX):
        return f"per_minute is a whole number from 0 to {_A_MINUTE_MAX}, or null."
    if large is not None and not _within(large, 0, _BODY_BYTES_MAX):
        return f"body_bytes_max is a whole number from 0 to {_BODY_BYTES_MAX}, or null."
    return {
        "id": new_id,
        "type": "limit",
        "kind": wish["kind"],
        "per_minute": often,
        "body_bytes_max": large,
    }


def _put_back(wish: Mapping[str, Any]) -> Rule | str:
    """Judge a letter's rule that is put back: a retry had taken it away."""
    parked, accounts = wish["type"] == "parked", wish.get("account_ids")
    if not _is_id(wish.get("id")):
        return "The rule of a letter bears the letter's number as its id."
    if not isinstance(accounts, list) or len(accounts) > _ACCOUNTS_MAX or not all(map(_is_account, accounts)):
        return f"account_ids is a list of at most {_ACCOUNTS_MAX} accounts."
    if parked:
        if not _within(wish.get("seq"), 1, _SEQ_MAX):
            return "seq is the number of the event."
        return {"id": wish["id"], "type": "parked", "seq": wish["seq"], "account_ids": accounts}
    if not _hex(wish.get("name"), "name"):
        return "The name of a letter has 32 hexadecimal digits."
    if any(wish.get(one) is not None and not _hex(wish[one], "digest") for one in ("digest", "fingerprint")):
        return "The digest and the fingerprint have 64 hexadecimal digits each, or are null."
    if wish.get("reason") not in set(Reason):
        return "The reason is none that a letter can have."
    kept = {one: wish.get(one) for one in ("id", "name", "digest", "fingerprint", "reason")}
    return {"type": "letter", **kept, "account_ids": accounts}


def _hex(value: object, what: str) -> bool:
    return isinstance(value, str) and _HEX[what].fullmatch(value) is not None


def _is_id(value: object) -> bool:
    return isinstance(value, str) and _ID.fullmatch(value) is not None


def _is_kind(value: object) -> bool:
    return isinstance(value, str) and _KIND.fullmatch(value) is not None


def _is_account(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value) <= _ACCOUNT_CHARACTERS_MAX and value.isprintable()


def _within(value: object, low: int, high: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high


# ---- the drill that is armed ----


def arm(folders: Folders, name: str, at: str = "decide") -> None:
    """Let whoever executes the command of this name die of it, beside those that are armed for the same moment.

    Where there are too many, the oldest can't kill any more. One at a time; blocks on the disk; raises OSError.
    """
    said = files.read_json(folders.armed)
    names = [one for one in armed_names(folders) if one != name] if said.get("at") == at else []
    _arm(folders, [*names, name][-ARMED_MAX:], at)


def armed_names(folders: Folders) -> list[str]:
    """Return the names of the commands that are armed."""
    said = files.read_json(folders.armed)
    names = said.get("names", [said.get("name")])
    return [one for one in names if _hex(one, "name")] if isinstance(names, list) else []


def disarm(folders: Folders, name: str) -> bool:
    """Let this command kill nobody any more; return whether it was armed. One at a time; raises OSError."""
    names = armed_names(folders)
    if name not in names:
        return False
    rest = [one for one in names if one != name]
    if rest:
        _arm(folders, rest, str(files.read_json(folders.armed).get("at")))
        return True
    folders.armed.unlink(missing_ok=True)
    files.sync_folder(folders.armed.parent)
    return True


def _arm(folders: Folders, names: Sequence[str], at: str) -> None:
    which = {"name": names[0]} if len(names) == 1 else {"names": list(names)}
    files.write_json(folders.armed, {"version": 1, "fault": "poison", **which, "at": at, "seq": None})
