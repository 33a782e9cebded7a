"""One incident as values: what the guard's facts say, read without trusting a byte of them.

The facts come from a file that a full disk, a dying guard or somebody's editor may have had a hand in, so
reading is total: what is absent or of the wrong kind becomes "nothing known" and never a surprise further
on. A schema library that refuses the whole file for one bad field was not chosen: in a post-mortem half a
story beats none.
"""

import re
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

TEXT_MAX = 4_096
ITEMS_MAX = 2_000
OUTCOMES = frozenset({"recovered", "manual", "safe_mode", "assist", "open", "abandoned"})
_MOMENT = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d{1,9})?(?:Z|[+-]\d\d:\d\d)", re.ASCII)
GRADES = frozenset({"certain", "likely", "unknown"})
#: What a command has to do in a throw-away core to be convicted.
REPRODUCED = frozenset({"died", "hung", "grew"})


class Step(msgspec.Struct, frozen=True):
    """One moment of the timeline; `offset_ms` counts from the fault."""

    step: str
    at: str | None
    offset_ms: float | None


class Exit(msgspec.Struct, frozen=True):
    """How a process ended; both None: nobody could read its status."""

    code: int | None = None
    signal: int | None = None


class Words(msgspec.Struct, frozen=True):
    """A short code and the sentence to it: last words of a core, or one line of evidence."""

    code: str
    text: str


class Command(msgspec.Struct, frozen=True):
    """A command in flight when the core was lost."""

    command_id: str
    kind: str
    stage: str
    transaction_id: str
    account_ids: tuple[str, ...]
    key_hash: str
    age_ms: float | None


class Request(msgspec.Struct, frozen=True):
    """What became of one request that met the outage."""

    method: str
    path: str
    key_hash: str
    outcome: str
    status: int | None
    held_ms: float | None


class Proof(msgspec.Struct, frozen=True):
    """What the next core proved before it served. `witness_seq` None: nobody had seen a last commit."""

    kind: str
    tail: int | None
    seq: int | None
    epoch: int | None
    witness_seq: int | None


class Audit(msgspec.Struct, frozen=True):
    """What the proof of the whole ledger said, which the next core made while it served.

    Whole up to number `seq`, or `fault` says why not.
    """

    ok: bool
    seq: int | None
    fault: str


class Trial(msgspec.Struct, frozen=True):
    """What came of one suspect in a throw-away core (docs/wires.md, section 12). `letter`: empty if it was cleared.

    What is known of the command beyond its name is told where whoever wrote the facts knew it.
    """

    name: str
    command_id: str
    ordeal: str
    letter: str
    took_ms: float | None
    why: str
    fingerprint: str = ""
    kind: str = ""
    account_ids: tuple[str, ...] = ()
    transaction_id: str = ""

    @property
    def reproduced(self) -> bool:
        """Whether it did it again, which alone convicts."""
        return self.ordeal in REPRODUCED


class Versions(msgspec.Struct, frozen=True):
    """What ran: the name of the core's code, the hash of the policy, the schema of the store. None: not on record."""

    build: str | None = None
    policy: str | None = None
    schema: int | None = None


class Death(msgspec.Struct, frozen=True):
    """One death inside the incident."""

    at: str | None
    diagnosis: str
    exit: Exit


class Money(msgspec.Struct, frozen=True):
    """The verdict on the money. A number stands only where a recorded proof gives it; None: not known."""

    lost: int | None
    doubled: int | None
    verified: bool


class Incident(msgspec.Struct, frozen=True):
    """The story of one outage. Times are RFC 3339 texts, None where nobody recorded them."""

    id: str
    opened_at: str | None
    closed_at: str | None
    outcome: str
    diagnosis: str
    grade: str
    evidence: tuple[Words, ...]
    planned: bool
    reason: str | None
    drill: str | None
    timeline: tuple[Step, ...]
    detected_ms: float | None
    outage_ms: float | None
    pid: int | None
    epoch: int | None
    next_epoch: int | None
    exit: Exit
    last_words: Words | None
    in_flight: tuple[Command, ...]
    suspects: tuple[str, ...]
    requests: tuple[Request, ...]
    proof: Proof | None
    audit: Audit | None
    deaths: tuple[Death, ...]
    waits_for: str | None
    served_again_at: str | None
    blamed: tuple[str, ...] = ()  # ids of the commands that the evidence names
    left_open: str | None = None  # the incident in whose middle this one, a guard's end, came
    trials: tuple[Trial, ...] = ()
    versions: Versions = Versions()


#: Stages in which the core was at work on a command; QUEUED only waited for its turn.
_AT_WORK = ("DECIDING", "WRITING", "COMMITTED", "ANSWERING")
#: Stages in which it stands in the ledger.
_COMMITTED = ("COMMITTED", "ANSWERING")
#: What the same witness says again with another measure is one line: the last one.
_MEASURE = re.compile(r"\d+(?:\.\d+)?(?= (?:ms|s|MiB|commands|probes)\b)")


def from_facts(incident_id: str, raw: object) -> Incident:
    """Return the incident that a closed (or half-written) `incident.json` tells of."""
    facts = mapping(raw)
    core = mapping(facts.get("core"))
    outcome, grade = text(facts.get("outcome")), text(facts.get("grade"))
    return Incident(
        id=incident_id,
        opened_at=moment(facts.get("opened_at")),
        closed_at=moment(facts.get("closed_at")),
        outcome=outcome if outcome in OUTCOMES else "open",
        diagnosis=text(facts.get("diagnosis")) or "UNKNOWN",
        grade=grade if grade in GRADES else "unknown",
        evidence=_evidence(mappings(facts.get("evidence"))),
        planned=facts.get("planned") is True,
        reason=optional_text(facts.get("reason")),
        drill=optional_text(facts.get("drill")),
        timeline=tuple(_step(line) for line in mappings(facts.get("timeline"))),
        detected_ms=duration(facts.get("detected_ms")),
        outage_ms=duration(facts.get("outage_ms")),
        pid=number(core.get("pid")),
        epoch=number(core.get("epoch")),
        next_epoch=number(facts.get("next_epoch")),
        exit=_exit(core.get("exit")),
        last_words=_words(facts.get("last_words")),
        in_flight=tuple(_command(line) for line in mappings(facts.get("in_flight"))),
        suspects=texts(facts.get("suspects")),
        requests=tuple(_request(line) for line in mappings(facts.get("requests"))),
        proof=_proof(facts.get("proof")),
        audit=_audit(facts.get("audit")),
        deaths=tuple(_death(line) for line in mappings(facts.get("deaths"))),
        waits_for=optional_text(facts.get("waits_for")),
        served_again_at=moment(facts.get("served_again_at")),
        blamed=texts(facts.get("blamed")),
        left_open=optional_text(facts.get("left_open")),
        trials=tuple(_trial(line) for line in mappings(facts.get("trials"))),
        versions=Versions(
            build=optional_text(facts.get("build")),
            policy=optional_text(facts.get("policy_sha256")),
            schema=number(facts.get("schema")),
        ),
    )


def still_open(incident_id: str, opened_at: str | None, page: object) -> Incident:
    """Return an incident without facts: it goes on, or its guard died. `page` is its `recorder.json`."""
    recorder = mapping(page)
    beats = mapping(recorder.get("beats"))
    facts = {
        "opened_at": opened_at,
        "core": {"pid": recorder.get("pid"), "epoch": beats.get("epoch")},
        "last_words": recorder.get("last_words"),
        "in_flight": recorder.get("in_flight"),
    }
    return from_facts(incident_id, facts)


def ending(outcome: str, closed_at: str | None, served_again_at: str | None) -> str:
    """Return what came of it, in one word: its outcome, or what the outcome alone does not say.

    `untold`: its guard died before it was over. `taken_over`: so it was, and a core served again later. `served`:
    recovery had stopped, and a core served again later.
    """
    if outcome == "manual" and served_again_at is not None:
        return "served"
    if outcome == "abandoned":
        return "untold" if served_again_at is None else "taken_over"
    return "untold" if outcome == "open" and closed_at is not None else outcome


def waits_for(incident: Incident) -> str | None:
    """Return the diagnosis that has to be cleared away by a person before another try makes sense."""
    if incident.outcome != "manual" or incident.served_again_at is not None:
        return None
    return incident.waits_for or incident.diagnosis


def went_on(incident: Incident) -> bool:
    """Tell whether the core served all through a closed incident, so that it has neither an outage nor a new proof."""
    ended = incident.deaths or incident.exit != Exit() or incident.outage_ms is not None or incident.left_open
    told = (
        incident.closed_at is not None
        and incident.outcome not in {"open", "abandoned"}
        and bool(incident.timeline)
    )
    return told and not ended and not any(step.step == "spawned" for step in incident.timeline)


def was_committed(incident: Incident, request: Request) -> bool:
    """Tell whether a request that was run once more had been committed before the core was lost."""
    hashes = {one.key_hash for one in incident.in_flight if one.key_hash and one.stage in _COMMITTED}
    return request.outcome == "replayed" and request.key_hash in hashes


def money(incident: Incident) -> Money:
    """Return what the recorded proof says about the money, and nothing that it does not say.

    A proof with a witness found every commit up to the last that was seen, with the same hash: nothing that
    was acknowledged is lost. From there to the head it also found each key with exactly one event, and keys
    are unique in the store: nothing that carries a key is there twice. Where all of the ledger was looked at
    later and is not whole, none of that is claimed.
    """
    proof, audit = incident.proof, incident.audit
    if proof is None or proof.seq is None or (audit is not None and not audit.ok):
        return Money(None, None, verified=False)
    seen = proof.kind == "witness" and proof.witness_seq is not None and proof.seq >= proof.witness_seq
    return Money(0 if seen else None, 0 if seen else None, verified=True)


def deciding(incident: Incident) -> tuple[Command, ...]:
    """Return the commands that were being decided or written when the core was lost: those that can have done it."""
    return tuple(one for one in incident.in_flight if one.stage in {"DECIDING", "WRITING"})


def at_work(incident: Incident) -> tuple[Command, ...]:
    """Return the commands in flight, those that the core was at work on before those that waited."""
    return tuple(sorted(incident.in_flight, key=lambda one: one.stage not in _AT_WORK))


def unique(items: Iterable[str]) -> tuple[str, ...]:
    """Return the non-empty items once each, in order."""
    return tuple(dict.fromkeys(item for item in items if item))


def mapping(raw: object) -> Mapping[str, Any]:
    """Return `raw` if it is a JSON object, else an empty one."""
    return raw if isinstance(raw, dict) else {}


def mappings(raw: object) -> list[Mapping[str, Any]]:
    """Return the objects of a JSON list, at most ITEMS_MAX."""
    return [item for item in raw[:ITEMS_MAX] if isinstance(item, dict)] if isinstance(raw, list) else []


def text(raw: object) -> str:
    """Return `raw` if it is a text, cut at TEXT_MAX, else an empty one."""
    return raw[:TEXT_MAX] if isinstance(raw, str) else ""


def optional_text(raw: object) -> str | None:
    """Return `raw` if it is a text with something in it."""
    return text(raw) or None


def moment(raw: object) -> str | None:
    """Return `raw` if it is a time in RFC 3339."""
    return raw if isinstance(raw, str) and _MOMENT.fullmatch(raw) else None


def texts(raw: object) -> tuple[str, ...]:
    """Return the texts of a JSON list, at most ITEMS_MAX."""
    return (
        tuple(text(item) for item in raw[:ITEMS_MAX] if isinstance(item, str))
        if isinstance(raw, list)
        else ()
    )


def duration(raw: object) -> float | None:
    """Return `raw` if it is a number that a clock may give; a whole one stays whole."""
    if isinstance(raw, bool) or not isinstance(raw, int | float) or not abs(raw) < 1 << 63:
        return None
    return raw


def number(raw: object) -> int | None:
    """Return `raw` as a whole number if it is one that a counter may give."""
    known = duration(raw)
    return None if known is None else int(known)


def _evidence(lines: Iterable[Mapping[str, Any]]) -> tuple[Words, ...]:
    """Return what was held against the core: a witness that says that all is well is no evidence.

    What the operator said is the reason of it all and no judgement.
    """
    told: dict[tuple[str, str], Words] = {}
    for line in lines:
        one = Words(text(line.get("kind")), text(line.get("text")))
        if line.get("colour") != "green" or one.code == "operator":
            told[one.code, _MEASURE.sub("#", one.text)] = one
    return tuple(told.values())


def _step(raw: Mapping[str, Any]) -> Step:
    return Step(text(raw.get("step")), moment(raw.get("at")), duration(raw.get("offset_ms")))


def _exit(raw: object) -> Exit:
    ended = mapping(raw)
    return Exit(number(ended.get("code")), number(ended.get("signal")))


def _words(raw: object) -> Words | None:
    words = mapping(raw)
    return Words(text(words.get("code")), text(words.get("text"))) if words else None


def _command(raw: Mapping[str, Any]) -> Command:
    return Command(
        command_id=text(raw.get("command_id")),
        kind=text(raw.get("kind")),
        stage=text(raw.get("stage")),
        transaction_id=text(raw.get("transaction_id")),
        account_ids=texts(raw.get("account_ids")),
        key_hash=text(raw.get("key_hash")),
        age_ms=duration(raw.get("age_ms")),
    )


def _request(raw: Mapping[str, Any]) -> Request:
    return Request(
        method=text(raw.get("method")),
        path=text(raw.get("path")),
        key_hash=text(raw.get("key_hash")),
        outcome=text(raw.get("outcome")) or "unknown",
        status=number(raw.get("status")),
        held_ms=duration(raw.get("held_ms")),
    )


def _proof(raw: object) -> Proof | None:
    proof = mapping(raw)
    if not proof:
        return None
    return Proof(
        kind=text(proof.get("kind")),
        tail=number(proof.get("tail")),
        seq=number(proof.get("seq")),
        epoch=number(proof.get("epoch")),
        witness_seq=number(proof.get("witness_seq")),
    )


def _audit(raw: object) -> Audit | None:
    told = mapping(raw)
    return Audit(told.get("ok") is True, number(told.get("seq")), text(told.get("fault"))) if told else None


def _trial(raw: Mapping[str, Any]) -> Trial:
    return Trial(
        name=text(raw.get("name")),
        command_id=text(raw.get("command_id")),
        ordeal=text(raw.get("ordeal")) or "untried",
        letter=text(raw.get("letter")),
        took_ms=duration(raw.get("took_ms")),
        why=text(raw.get("why")),
        fingerprint=text(raw.get("fingerprint")),
        kind=text(raw.get("kind")),
        account_ids=texts(raw.get("account_ids")),
        transaction_id=text(raw.get("transaction_id")),
    )


def _death(raw: Mapping[str, Any]) -> Death:
    return Death(moment(raw.get("at")), text(raw.get("diagnosis")) or "UNKNOWN", _exit(raw.get("exit")))
