"""Lines of the control socket as values: what is asked, what is answered, what is fed. Pure.

One JSON object a line. The shapes are `docs/wires.md` sections 6 and 7; a line that is not one of them is
answered with a code, never with a closed connection and silence.
"""

import json
from collections.abc import Mapping
from enum import StrEnum
from typing import TypeGuard

import msgspec

LINE_BYTES_MAX = 1 << 20
REASON_CHARACTERS_MAX = 500
ID_CHARACTERS_MAX = 64
#: A command's name is this much of the hash of its key, in hexadecimal digits (docs/wires.md section 3).
NAME_DIGITS = 32
COMPONENT_CHARACTERS_MAX = 24


class Ask(StrEnum):
    """What a client of the control socket may ask."""

    STATUS = "status"
    RESTART = "restart"
    RESUME = "resume"
    DOWN = "down"
    DRILL = "drill"
    POLICY = "policy"
    POLICY_RELOAD = "policy-reload"
    SAFE_MODE = "safe-mode"
    HISTORY = "history"
    CURVE = "curve"
    ALERTS_TEST = "alerts-test"
    ALERTS_MUTE = "alerts-mute"
    ATTACH = "attach"
    QUARANTINE = "quarantine"
    RULE_ADD = "rule-add"
    RULE_REMOVE = "rule-remove"
    INVESTIGATE = "investigate"
    SUBSCRIBE = "subscribe"


#: Faults that this version can break the core with.
DRILLS = (
    *("crash", "segv", "exit", "freeze", "block", "spin", "gil", "deadlock", "slow-tx"),
    *("oom", "dblock", "diskfull", "gc", "spare", "poison", "sentinel", "gateway", "leak", "stall"),
)

#: Drills of which nothing may come to the core that serves: it is made to look ill, or another is hit.
PEACEFUL = frozenset({"gc", "spare", "sentinel"})
#: So long nothing may come of one: some collections over millions of objects, and the calm after them.
PEACE_S = 12.0

#: A leak of which nothing else was said, and the fastest.
LEAK_S, LEAK_MB_PER_S = 120, 8
LEAK_MB_PER_S_MAX = 1024


class Request(msgspec.Struct, frozen=True):
    """One line from a client. `rule`: as it came, and `id` a rule's; `audited`: whoever asks keeps a record of it itself.

    `component`: of a restart or a drill, the part that is meant alone; `on`: of the safe mode; `channel`: a number, or
    None for all; `seconds`: how long alerts are muted, 0 for no longer, or a core leaks `mb_per_s`.
    """

    ask: Ask
    reason: str = ""
    hard: bool = False
    fault: str = ""
    yes: bool = False
    accept_ledger: bool = False
    image: bool = False
    pid: int = 0
    rule: object = None
    id: str = ""
    audited: bool = False
    component: str = ""
    on: bool = False
    channel: int | None = None
    seconds: int = 0
    mb_per_s: int = 0


class BadRequest(msgspec.Struct, frozen=True):
    """A line that can't be understood, and why."""

    code: str
    error: str


def read_object(line: bytes) -> dict[str, object] | BadRequest:
    """Return the JSON object of a line."""
    try:
        value = json.loads(line)
        if b"\\ud" in line.lower():  # half a character can be said in JSON, and written down by nobody
            value = json.loads(json.dumps(value, ensure_ascii=False).encode("utf-8", "replace"))
    except (ValueError, RecursionError):
        return BadRequest("bad-json", "the line is not JSON")
    return value if isinstance(value, dict) else BadRequest("bad-json", "the line is not an object")


def _counts(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def read_request(line: bytes) -> Request | BadRequest:
    """Return what a client asks."""
    value = read_object(line)
    if isinstance(value, BadRequest):
        return value
    verb = value.get("verb")
    if not isinstance(verb, str) or verb not in set(Ask):
        return BadRequest("unknown-verb", f"{str(verb)[:40]!r} is not something the guard can be asked")
    reason, fault, pid = value.get("reason", ""), value.get("fault", ""), value.get("pid", 0)
    rule_id, component, channel = value.get("id", ""), value.get("component", ""), value.get("channel")
    texts = all(isinstance(one, str) for one in (reason, fault, rule_id, component))
    if not texts or not _counts(pid) or not (channel is None or _counts(channel)):
        return BadRequest(
            "bad-field", "reason, fault, component and id are text, pid and channel are numbers"
        )
    if verb == Ask.SAFE_MODE and not isinstance(value.get("on"), bool):
        return BadRequest("bad-field", "on says whether the safe mode is to be on: true or false")
    seconds, mb_per_s = value.get("seconds", 0), value.get("mb_per_s", 0)
    if not _counts(seconds) or not _counts(mb_per_s):
        return BadRequest("bad-field", "seconds and mb_per_s are numbers, 0 or more")
    if verb == Ask.DRILL and fault not in DRILLS:
        return BadRequest("unknown-drill", f"the drills are: {', '.join(DRILLS)}")
    return Request(
        Ask(verb),
        reason=str(reason)[:REASON_CHARACTERS_MAX],
        hard=value.get("hard") is True,
        fault=str(fault),
        yes=value.get("yes") is True,
        accept_ledger=value.get("accept_ledger") is True,
        image=value.get("image") is True,
        pid=pid,
        rule=value.get("rule"),
        id=str(rule_id)[:ID_CHARACTERS_MAX],
        audited=value.get("audited") is True,
        component=str(component)[:COMPONENT_CHARACTERS_MAX],
        on=value.get("on") is True,
        channel=channel,
        seconds=seconds,
        mb_per_s=mb_per_s,
    )


def write_line(value: Mapping[str, object]) -> bytes:
    """Return an object as one line."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return text.encode("utf-8", "replace") + b"\n"
