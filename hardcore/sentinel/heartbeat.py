"""What a guarded process says on its notify socket: the bytes of one datagram as a value.

Pure. The lines are those of `docs/wires.md` section 2; a key that this version does not know is another
program's own business and is passed over. A datagram that says one of *our* keys wrongly is malformed as
a whole: half of a READY would let a core serve whose proof nobody has read. Whoever may write to the
socket may write anything, so every length and number is bounded and nothing raises.
"""

import re

import msgspec

from hardcore.model.observations import StoreFault

#: Longer datagrams are not read to their end, and half a message is none.
NOTICE_BYTES_MAX = 4096
LINES_MAX = 64
STATUS_CHARACTERS_MAX = 200
SENTENCE_CHARACTERS_MAX = 400
#: The version of a core's control socket that this guard speaks.
CONTROL_VERSION = 2
_NUMBER_MAX = 2**63 - 1
_NUMBER = re.compile(r"[0-9]{1,19}")
_HASH = re.compile(r"[0-9a-f]{64}")
_BUILD = re.compile(r"[0-9a-f]{16}")
_CASE = re.compile(r"[0-9a-f]{32}")
_PROOFS = ("witness", "chain", "none")
_NUMBERS = {
    "X_EPOCH": "epoch",
    "X_SEQ": "seq",
    "X_TAIL": "tail",
    "EXTEND_TIMEOUT_USEC": "extend_usec",
    "X_TERM": "term_pid",
    "X_VERIFIED": "verified_seq",
    "X_CONTROL": "control",
    "X_SCHEMA": "schema",
}
_FLAGS = {
    "READY": ("1", "ready"),
    "WATCHDOG": ("1", "watchdog"),
    "STOPPING": ("1", "stopping"),
    "X_FENCE": ("BLOCKED", "fence_blocked"),
    "X_SPARE": ("1", "spare"),
    "X_MIGRATES": ("1", "migrates"),
}
#: What a spare says of itself, and nobody else may.
_OF_A_SPARE = ("X_BUILD", "X_CONTROL", "X_SCHEMA")
_OURS = frozenset(
    {*_NUMBERS, *_FLAGS, "X_BUILD", "X_CASE", "X_HASH", "X_PROOF", "X_STORE", "X_UNSOUND", "STATUS"}
)


class SpareNotice(msgspec.Struct, frozen=True):
    """A spare waits: the code that it runs, the version of its control socket, the store's schema as it read it.

    `migrates`: taking over would bring the store up to a newer schema.
    """

    build: str
    control: int
    schema: int
    migrates: bool = False


class Notice(msgspec.Struct, frozen=True):
    """What one datagram says. None: it says nothing about that.

    A notice with `ready` has `epoch`, `seq`, `hash` (64 hex digits), `proof` (`witness`, `chain`, or
    `none` of one that serves reads only) and `tail` (events checked) all set for a ledger, or none of `seq`,
    `hash`, `proof`, `tail` for another kind of guest. `extend_usec`: microseconds. `term_pid`: sender of a TERM,
    0 when unknown. `store`: what it says of its store. `verified_seq`: the whole ledger is proven up to there;
    `unsound`: a sentence that says why it is not. `cases`: the names of suspects whose cases it has filed. One with `spare` has no epoch and is not `ready`.
    """

    ready: bool = False
    epoch: int | None = None
    seq: int | None = None
    hash: str | None = None
    proof: str | None = None
    tail: int | None = None
    watchdog: bool = False
    stopping: bool = False
    extend_usec: int | None = None
    fence_blocked: bool = False
    term_pid: int | None = None
    store: StoreFault | None = None
    verified_seq: int | None = None
    unsound: str | None = None
    status: str | None = None
    spare: SpareNotice | None = None
    cases: tuple[str, ...] = ()


class MalformedNotice(msgspec.Struct, frozen=True):
    """A datagram that means nothing to us, and why."""

    reason: str


def read_notice(datagram: bytes) -> Notice | MalformedNotice:
    """Return what a datagram says. Read with a buffer one byte larger than `NOTICE_BYTES_MAX`."""
    if len(datagram) > NOTICE_BYTES_MAX:
        return MalformedNotice(f"longer than {NOTICE_BYTES_MAX} bytes")
    try:
        text = datagram.decode()
    except UnicodeDecodeError:
        return MalformedNotice("not UTF-8")
    lines = text.split("\n")
    if len(lines) > LINES_MAX:
        return MalformedNotice(f"more than {LINES_MAX} lines")
    said: dict[str, str] = {}
    for line in lines:
        key, equals, value = line.partition("=")
        if line and not equals:
            return MalformedNotice("a line without an equals sign")
        if key in _OURS and said.setdefault(key, value) != value:
            return MalformedNotice(f"{key} said twice, differently")
    return _judge(said)


def _judge(said: dict[str, str]) -> Notice | MalformedNotice:
    flags: dict[str, bool] = {}
    for key, (only, name) in _FLAGS.items():
        if said.get(key, only) != only:
            return MalformedNotice(f"{key} is not {only}")
        flags[name] = key in said
    numbers: dict[str, int | None] = {}
    for key, name in _NUMBERS.items():
        numbers[name] = _number(said[key]) if key in said else None
        if key in said and numbers[name] is None:
            return MalformedNotice(f"{key} is not a number")
    digest, proof = said.get("X_HASH"), said.get("X_PROOF")
    if digest is not None and not _HASH.fullmatch(digest):
        return MalformedNotice("X_HASH is not a hash")
    if proof is not None and proof not in _PROOFS:
        return MalformedNotice("X_PROOF is not a kind of proof")
    given = sum(part is not None for part in (digest, proof, numbers["seq"], numbers["tail"]))
    if given not in {0, 4} or (given and (numbers["epoch"] is None or not flags["ready"])):
        return MalformedNotice("a part of a proof")
    spare = _spare(said, flags, numbers)
    if isinstance(spare, MalformedNotice):
        return spare
    store = said.get("X_STORE")
    if store is not None and store not in set(StoreFault):
        return MalformedNotice("X_STORE is not a state of a store")
    unsound = _words(said.get("X_UNSOUND"), SENTENCE_CHARACTERS_MAX)
    if unsound == "" or (unsound is not None and numbers["verified_seq"] is not None):
        return MalformedNotice("X_UNSOUND says nothing, or the opposite of X_VERIFIED")
    cases = tuple(said["X_CASE"].split(" ")) if "X_CASE" in said else ()
    if not all(map(_CASE.fullmatch, cases)):
        return MalformedNotice("X_CASE is not names")
    return Notice(
        ready=flags["ready"],
        epoch=numbers["epoch"],
        seq=numbers["seq"],
        hash=digest,
        proof=proof,
        tail=numbers["tail"],
        watchdog=flags["watchdog"],
        stopping=flags["stopping"],
        extend_usec=numbers["extend_usec"],
        fence_blocked=flags["fence_blocked"],
        term_pid=numbers["term_pid"],
        store=None if store is None else StoreFault(store),
        verified_seq=numbers["verified_seq"],
        unsound=unsound,
        status=_words(said.get("STATUS"), STATUS_CHARACTERS_MAX),
        spare=spare,
        cases=cases,
    )


def _spare(
    said: dict[str, str], flags: dict[str, bool], numbers: dict[str, int | None]
) -> SpareNotice | MalformedNotice | None:
    if not flags["spare"]:
        stray = flags["migrates"] or any(key in said for key in _OF_A_SPARE)
        return MalformedNotice("a part of a spare's word") if stray else None
    build, control, schema = said.get("X_BUILD", ""), numbers["control"], numbers["schema"]
    if not _BUILD.fullmatch(build) or control is None or schema is None:
        return MalformedNotice("a spare that does not say what it is")
    if flags["ready"] or numbers["epoch"] is not None:
        return MalformedNotice("a spare has no epoch")
    return SpareNotice(build, control, schema, flags["migrates"])


def _number(text: str) -> int | None:
    return int(text) if _NUMBER.fullmatch(text) and int(text) <= _NUMBER_MAX else None


def _words(text: str | None, characters_max: int) -> str | None:
    """Return a line for people without anything that could move a terminal's cursor."""
    return None if text is None else "".join(c for c in text if c.isprintable())[:characters_max]
