"""What crosses to and from a court: cases as they lie on the disk, the docket that is made of them, its lines.

A case is the whole request of somebody else, so it is read as an attacker's: no link is followed, nothing larger than
the maximum is read, and its own name must be the one it lies under. Its headers have lost whatever is secret before it
was filed. What a court says is read in the same way: it has just run what may have killed a core. Wrong words are
values, and nothing raises.
"""

import json
import os
import re
import stat
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import msgspec

from hardcore.model.trials import Ordeal, Tried

VERSION: Final = 1
#: A request of 1 MiB in base64, and the words around it.
CASE_BYTES_MAX: Final = 4 << 20
#: Cases of one docket, and what they may weigh together: what does not fit comes before the next court.
CASES_MAX: Final = 256
DOCKET_BYTES_MAX: Final = 16 << 20
#: A copy of a larger ledger is not made for a trial.
COPY_BYTES_MAX: Final = 2 << 30
#: One line of a court; an answer in it is cut by whoever says it.
LINE_BYTES_MAX: Final = 1 << 20
#: The name under which the log itself is tried.
LOG_NAME: Final = "0" * 32
TEXT_CHARACTERS_MAX: Final = 200
ACCOUNTS_MAX: Final = 16
#: What stands in a case that is copied into a letter for the investigators.
_SECRETS: Final = frozenset({"cookie", "authorization", "proxy-authorization"})

_NAME = re.compile(r"[0-9a-f]{32}")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_NUMBER_MAX: Final = 2**63 - 1


class Case(msgspec.Struct, frozen=True):
    """One case as it was filed. `case`: what a docket has of it; `key`: the client's own, None if it sent none."""

    name: str
    source: str
    key: str | None
    digest: str
    case: Mapping[str, Any]
    size_bytes: int


class Unknown(msgspec.Struct, frozen=True):
    """There is no such case, or none that can be used; `why` is a sentence."""

    why: str


class Said(msgspec.Struct, frozen=True):
    """A line of a court that is no verdict: how far it is. `over`: it has done its work."""

    over: bool = False


class Heard(msgspec.Struct, frozen=True):
    """A verdict of a court. `line`: as it said it, for the letter that may come of it."""

    tried: Tried
    line: Mapping[str, Any] = msgspec.field(default_factory=dict)


def is_name(text: object) -> bool:
    """Tell whether this may be the name of a suspect."""
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


def read_case(folder: Path, name: str) -> Case | Unknown:
    """Return the case of a suspect. Blocks on the disk."""
    if not is_name(name):
        return Unknown("that is no name of a suspect")
    try:
        fd = os.open(folder / f"{name}.json", os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(fd, "rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                return Unknown("its request is no file")
            raw = file.read(CASE_BYTES_MAX + 1)
    except FileNotFoundError:
        return Unknown("its request is not known")
    except OSError as error:
        return Unknown(f"its request can't be read: {error.strerror}")
    return Unknown("its request is too large") if len(raw) > CASE_BYTES_MAX else _case(raw, name)


def _case(raw: bytes, name: str) -> Case | Unknown:
    try:
        said = json.loads(raw)
    except (ValueError, RecursionError):
        return Unknown("its request can't be understood")
    match said:
        case {"version": 1, "name": str(own), "digest": str(digest), "case": {"name": str(inner)} as case}:
            if own != name or inner != name or (digest and not _DIGEST.fullmatch(digest)):
                return Unknown("its request is another's")
        case _:
            return Unknown("its request can't be understood")
    request = case.get("request")
    if not isinstance(request, dict) and not isinstance(case.get("row"), dict):
        return Unknown("its request can't be understood")
    if isinstance(request, dict):
        case = {**case, "request": {**request, "headers": _without_secrets(request.get("headers"))}}
    key = said.get("key")
    return Case(
        name, _text(said.get("source")), key if isinstance(key, str) else None, digest, case, len(raw)
    )


def _without_secrets(headers: object) -> list[list[str]]:
    """Return the headers but for those that are nobody's business: they were left out before, and once more here."""
    pairs = headers if isinstance(headers, list) else []
    return [
        [pair[0], pair[1]]
        for pair in pairs
        if isinstance(pair, list)
        and len(pair) == 2
        and all(isinstance(one, str) for one in pair)
        and pair[0].lower() not in _SECRETS
    ]


def sweep(folder: Path, wanted: Collection[str], older_s: float) -> None:
    """Remove the cases of nobody who is wanted, once they are old. Blocks on the disk."""
    before = time.time() - older_s
    with suppress(OSError):  # what can't be removed now is removed by the next guard
        for entry in list(os.scandir(folder)):
            if (
                entry.name.removesuffix(".json") not in wanted
                and entry.stat(follow_symlinks=False).st_mtime < before
            ):
                Path(entry.path).unlink()


def filed(folder: Path) -> frozenset[str]:
    """Return whose cases lie on the disk. Blocks."""
    try:
        found = (entry.name.removesuffix(".json") for entry in os.scandir(folder))
        return frozenset(name for name in found if is_name(name))
    except OSError:
        return frozenset()


def cut(cases: Sequence[Case]) -> list[list[Case]]:
    """Return the cases in as many dockets as their sizes need, in their order."""
    dockets: list[list[Case]] = []
    weight = 0
    for case in cases:
        full = not dockets or len(dockets[-1]) >= CASES_MAX or weight + case.size_bytes > DOCKET_BYTES_MAX
        if full:
            dockets.append([])
            weight = 0
        dockets[-1].append(case)
        weight += case.size_bytes
    return dockets


def of_log(after_seq: int) -> Mapping[str, Any]:
    """Return the case in which the log itself is on trial, from behind `after_seq` on."""
    return {"name": LOG_NAME, "events": {"after": after_seq}}


def docket(cases: Iterable[Mapping[str, Any]], limit_ms: int, memory_bytes: int) -> bytes:
    """Return the docket as its file's bytes. `memory_bytes` 0: without a bound."""
    told = {
        "version": VERSION,
        "limit_ms": limit_ms,
        "memory_bytes": memory_bytes or None,
        "copy_bytes_max": COPY_BYTES_MAX,
        "cases": list(cases),
    }
    return json.dumps(told, ensure_ascii=False).encode("utf-8", "backslashreplace")


def read_line(line: bytes, names: frozenset[str], at_ns: int) -> Heard | Said | Unknown:
    """Return what a court says in a line. `names`: whom it was asked about."""
    try:
        said = json.loads(line)
    except (ValueError, RecursionError):
        return Unknown("a line that is not JSON")
    match said:
        case {"type": "copied"} | {"type": "begun"}:
            return Said()
        case {"type": "over"}:
            return Said(over=True)
        case {"type": "tried", "name": str(name), "ordeal": str(ordeal)} if name in names:
            if ordeal not in set(Ordeal):
                return Unknown("an ordeal that there is not")
            return Heard(_tried(said, name, Ordeal(ordeal), at_ns), said)
        case _:
            return Unknown("a line that says nothing")


def _tried(said: Mapping[str, Any], name: str, ordeal: Ordeal, at_ns: int) -> Tried:
    accounts, ended = said.get("account_ids"), said.get("exit")
    how = ended if isinstance(ended, dict) else {}
    fingerprint = said.get("fingerprint")
    return Tried(
        at_ns,
        name,
        ordeal,
        took_ms=_number(said.get("ms")) or 0,
        fingerprint=fingerprint if isinstance(fingerprint, str) and _DIGEST.fullmatch(fingerprint) else "",
        kind=_text(said.get("kind")),
        account_ids=tuple(_text(one) for one in accounts[:ACCOUNTS_MAX])
        if isinstance(accounts, list)
        else (),
        transaction_id=_text(said.get("transaction_id")),
        signal=_number(how.get("signal")),
        code=_number(how.get("code")),
        frame=_text(said.get("frame")),
        seq=_number(said.get("seq")),
        why=_text(said.get("why")),
    )


def _number(value: object) -> int | None:
    whole = isinstance(value, int) and not isinstance(value, bool)
    return value if whole and isinstance(value, int) and abs(value) <= _NUMBER_MAX else None


def _text(value: object) -> str:
    """Return somebody else's words as one bounded line that moves no cursor."""
    shown = value[: 2 * TEXT_CHARACTERS_MAX] if isinstance(value, str) else ""
    return "".join(c if c.isprintable() else " " for c in shown)[:TEXT_CHARACTERS_MAX]
