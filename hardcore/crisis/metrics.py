"""The numbers of the doors as a text: OpenMetrics 1.0 for whoever asks for it, else Prometheus' text format 0.0.4.

What is known comes in as one value (`Moment`) and goes out as families of samples, which two printers write down: the
formats differ in the names of counters and in the end of the text, and in nothing that is worth two lists. A number
that nobody knows at this moment is not there; a monitor then shows a gap, and no zero that nobody has measured. A
client library was not chosen: it keeps counts of its own process, and these are the guard's.
"""

from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from typing import Any, Final

import msgspec

from hardcore.model.phases import HAState

PREFIX: Final = "hardcore_"
OPENMETRICS: Final = b"application/openmetrics-text; version=1.0.0; charset=utf-8"
PLAIN_TEXT: Final = b"text/plain; version=0.0.4; charset=utf-8"
#: Samples of one family: what comes from a file may not make a text without end.
SAMPLES_MAX: Final = 256
LABEL_CHARACTERS_MAX: Final = 64
_MS_PER_S: Final = 1000

Labels = tuple[tuple[str, str], ...]


class Kind(StrEnum):
    """What a family is."""

    GAUGE = "gauge"
    COUNTER = "counter"
    HISTOGRAM = "histogram"
    INFO = "info"


class Sample(msgspec.Struct, frozen=True):
    """One line: what is added to the family's name, its labels, its value."""

    value: float
    labels: Labels = ()
    suffix: str = ""


class Family(msgspec.Struct, frozen=True):
    """Everything of one name. `name` is without the prefix, and a counter's without `_total`."""

    name: str
    kind: Kind
    text: str
    samples: tuple[Sample, ...]
    unit: str = ""


class Moment(msgspec.Struct, frozen=True):
    """What the gateway knows now. `status` and `counters` are the guard's last word; empty where it is too old.

    `up`: requests go to a core. `silence_s`: since when the guard said nothing; None: it was never heard.
    """

    version: str
    up: bool
    state: str
    epoch: int | None
    silence_s: float | None
    held: int
    websockets: int
    connections: int
    settled: Mapping[str, int] = msgspec.field(default_factory=dict)
    status: Mapping[str, Any] = msgspec.field(default_factory=dict)
    counters: Mapping[str, Any] = msgspec.field(default_factory=dict)


def text(moment: Moment, *, openmetrics: bool) -> bytes:
    """Every number of a moment, in one of the two formats."""
    lines: list[str] = []
    found = families(moment)
    names = {family.name for family in found if family.kind is not Kind.COUNTER}
    for family in found:
        lines += _printed(family, openmetrics=openmetrics, taken=family.name in names)
    if openmetrics:
        lines.append("# EOF")
    return ("\n".join(lines) + "\n").encode()


def wants_openmetrics(accept: str) -> bool:
    """Whether an `Accept` header is best answered in OpenMetrics. It is what we speak unless other text is preferred."""
    ours, plain = 0.0, 0.0
    for part in accept.lower().split(",")[:SAMPLES_MAX]:
        kind, *parameters = (piece.strip() for piece in part.split(";"))
        weight = _weight(parameters)
        if kind == "application/openmetrics-text":
            ours = max(ours, weight)
        elif kind in {"text/plain", "text/html", "text/*"}:
            plain = max(plain, weight)
    return ours >= plain


def _weight(parameters: Iterable[str]) -> float:
    for one in parameters:
        if one.startswith("q="):
            try:
                return float(one[2:])
            except ValueError:
                return 0.0
    return 1.0


# ---- what there is -------------------------------------------------------------------------------------


def families(moment: Moment) -> list[Family]:
    """Every family that has anything to say now."""
    found = [*_of_the_gateway(moment), *_of_the_core(moment), *_of_the_guard(moment), *_of_the_past(moment)]
    return [family for family in found if family.samples]


def _of_the_gateway(moment: Moment) -> list[Family]:
    states = tuple(Sample(moment.state == state, (("state", str(state)),)) for state in HAState)
    build = (Sample(1, (("version", moment.version),), "_info"),)
    return [
        Family("build", Kind.INFO, "The software that answers here.", build),
        _gauge("core_up", "Whether requests go to a core now.", moment.up),
        Family("core_state", Kind.GAUGE, "The state for people: the one that holds is 1.", states),
        _gauge("core_epoch", "Number of the core that may commit.", moment.epoch),
        _gauge("held_requests", "Requests that wait for a core.", moment.held),
        _counts("held_requests", "Requests that met an outage, by outcome.", "outcome", moment.settled),
        _gauge("gateway_websockets", "WebSockets of pages that are open.", moment.websockets),
        _gauge("gateway_connections", "Client connections that are open.", moment.connections),
        _gauge("sentinel_silence_seconds", "Since the sentinel was last heard.", moment.silence_s, "seconds"),
    ]


def _of_the_core(moment: Moment) -> list[Family]:
    core = _object(moment.status.get("core"))
    started = _number(moment.counters.get("core_started_s"))
    age, seq = _number(core.get("heartbeat_age_ms")), _number(core.get("last_seq"))
    memory = _number(core.get("rss_bytes"))
    return [
        _gauge("core_start_time_seconds", "When the serving core began, since 1970.", started, "seconds"),
        _gauge("core_heartbeat_age_seconds", "Age of the core's last beat.", _seconds(age), "seconds"),
        _gauge("core_resident_memory_bytes", "Memory that the core has in use.", memory, "bytes"),
        _gauge("core_threads", "Threads of the core.", _number(core.get("threads"))),
        _gauge("core_open_fds", "Descriptors that the core has open.", _number(core.get("fds"))),
        _gauge("ledger_last_seq", "Sequence of the last event in the ledger.", seq),
        _counter(
            "ledger_events", "Events in the ledger.", seq
        ),  # the chain has no gaps: the last is the count
    ]


def _of_the_guard(moment: Moment) -> list[Family]:
    status, counters = moment.status, moment.counters
    budget, spare = _object(status.get("budget")), status.get("spare")
    ready = (_object(spare).get("ready") is True) if "spare" in status else None
    evidence = _number(counters.get("snapshot_bytes"))
    letters, due = _numbers(counters.get("letters")), _numbers(counters.get("forecasts"))
    sentinel = _object(status.get("sentinel"))
    forecasts = tuple(Sample(s, (("resource", _label(name)),)) for name, s in due.items())
    return [
        _gauge("spare_ready", "Whether a spare core can take over at once.", ready),
        _gauge("restart_budget_used", "Deaths in the present window.", _number(budget.get("used"))),
        _gauge("restart_budget_limit", "Deaths that are allowed in it.", _number(budget.get("limit"))),
        _gauge(
            "sentinel_resident_memory_bytes",
            "Memory of the sentinel.",
            _number(sentinel.get("rss_bytes")),
            "bytes",
        ),
        Family("dead_letters", Kind.GAUGE, "Letters set aside now, by reason.", _by("reason", letters)),
        _gauge("snapshot_bytes", "Evidence of the last incident on the disk.", evidence, "bytes"),
        Family(
            "forecast_due_seconds",
            Kind.GAUGE,
            "Until a resource runs out, if it goes on so.",
            forecasts,
            "seconds",
        ),
    ]


def _of_the_past(moment: Moment) -> list[Family]:
    counters = moment.counters
    incidents = tuple(
        Sample(count, (("diagnosis", _label(diagnosis)), ("outcome", _label(outcome))), "_total")
        for diagnosis, outcomes in _objects(counters.get("incidents"))
        for outcome, count in _numbers(outcomes).items()
    )
    passed = {name: ms / _MS_PER_S for name, ms in _numbers(counters.get("state_ms")).items()}
    stages = _objects(counters.get("stage_ms"))
    restarts = _numbers(counters.get("restarts"))
    return [
        _counts("core_restarts", "New cores that have served after an incident.", "diagnosis", restarts),
        Family("incidents", Kind.COUNTER, "Incidents that are closed.", incidents[:SAMPLES_MAX]),
        _histogram(
            "detection_seconds", "From a fault to its detection.", [("", counters.get("detection_ms"))]
        ),
        _histogram(
            "recovery_seconds", "From a fault to the first answer.", [("", counters.get("recovery_ms"))]
        ),
        _histogram("recovery_stage_seconds", "What each step of a recovery took.", stages),
        _counter(
            "sentinel_late_ticks",
            "Looks of the sentinel that came late.",
            _number(counters.get("late_ticks")),
        ),
        _counter(
            "false_suspicions",
            "Suspicions that went away by themselves.",
            _number(counters.get("false_suspicions")),
        ),
        _counts("state_seconds", "Time spent in each state.", "state", passed, "seconds"),
    ]


def _gauge(name: str, meaning: str, value: float | None, unit: str = "") -> Family:
    return Family(name, Kind.GAUGE, meaning, () if value is None else (Sample(value),), unit)


def _counter(name: str, meaning: str, value: float | None) -> Family:
    return Family(name, Kind.COUNTER, meaning, () if value is None else (Sample(value, (), "_total"),))


def _counts(name: str, meaning: str, label: str, counts: Mapping[str, float], unit: str = "") -> Family:
    return Family(name, Kind.COUNTER, meaning, _by(label, counts, "_total"), unit)


def _by(label: str, counts: Mapping[str, float], suffix: str = "") -> tuple[Sample, ...]:
    return tuple(Sample(count, ((label, _label(name)),), suffix) for name, count in counts.items())[
        :SAMPLES_MAX
    ]


def _histogram(name: str, meaning: str, rows: Iterable[tuple[str, object]]) -> Family:
    """A family of distributions in seconds, out of `{"bounds", "counts", "sum", "count"}` in milliseconds."""
    samples: list[Sample] = []
    for stage, told in rows:
        labels = (("stage", _label(stage)),) if stage else ()
        samples += _distribution(_object(told), labels)
    return Family(name, Kind.HISTOGRAM, meaning, tuple(samples), "seconds")


def _distribution(told: Mapping[str, Any], labels: Labels) -> list[Sample]:
    bounds, counts = told.get("bounds"), told.get("counts")
    total, over = _number(told.get("sum")), _number(told.get("count"))
    if not isinstance(bounds, list) or not isinstance(counts, list) or total is None or over is None:
        return []
    found, so_far = [], 0.0
    for bound, count in zip([*bounds, None], counts, strict=False):
        so_far += _number(count) or 0
        limit = "+Inf" if bound is None else repr(bound / _MS_PER_S)
        found.append(Sample(so_far, (*labels, ("le", limit)), "_bucket"))
    return [*found, Sample(total / _MS_PER_S, labels, "_sum"), Sample(over, labels, "_count")]


# ---- what comes from elsewhere, with care --------------------------------------------------------------


def _number(value: object) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) else None


def _seconds(ms: float | None) -> float | None:
    return None if ms is None else ms / _MS_PER_S


def _object(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _objects(value: object) -> Sequence[tuple[str, Mapping[str, Any]]]:
    return [(name, each) for name, each in _object(value).items() if isinstance(each, dict)][:SAMPLES_MAX]


def _numbers(value: object) -> dict[str, float]:
    found = {name: _number(each) for name, each in _object(value).items()}
    return {name: each for name, each in found.items() if each is not None}


def _label(name: str) -> str:
    return name[:LABEL_CHARACTERS_MAX]


# ---- on paper ------------------------------------------------------------------------------------------


def _printed(family: Family, *, openmetrics: bool, taken: bool) -> list[str]:
    """The lines of one family. `taken`: another has its name in OpenMetrics, where a counter's is without `_total`."""
    name, kind = PREFIX + family.name, str(family.kind)
    named = name
    if openmetrics and family.kind is Kind.COUNTER and taken:
        named, kind = (
            f"{name}_total",
            "unknown",
        )  # the two names are promised: so the second has no type there
    elif not openmetrics:
        named = name + {Kind.COUNTER: "_total", Kind.INFO: "_info"}.get(family.kind, "")
        kind = "gauge" if family.kind is Kind.INFO else kind
    head = [f"# HELP {named} {_escaped(family.text)}", f"# TYPE {named} {kind}"]
    if openmetrics and family.unit:
        head.append(f"# UNIT {named} {family.unit}")
    return head + [
        f"{name}{each.suffix}{_labels(each.labels)} {_value(each.value)}" for each in family.samples
    ]


def _labels(labels: Sequence[tuple[str, str]]) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels) + "}"


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")


def _value(value: float) -> str:
    whole = float(value)
    return str(int(whole)) if whole.is_integer() else repr(whole)
