"""One declaration for each setting: name, unit (the last part of the name), type, default, bounds, text.

A settings class is a frozen dataclass whose fields are made by `setting(...)`. `read` turns a mapping
into one, or gives back *all* that is wrong with it. Nothing here reads a file or the environment: what
comes in is a value, what goes out is frozen.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar, get_type_hints

import msgspec

T = TypeVar("T")


class Fault(msgspec.Struct, frozen=True):
    """One thing that is wrong: the setting's name and a sentence."""

    name: str
    reason: str


def setting(
    default: object, text: str, *, low: int = 0, high: int = 0, words: tuple[str, ...] = ()
) -> Any:  # Any: dataclasses.field's own type, so that the annotation beside it is what counts
    """Declare a setting. Numbers carry bounds (both inclusive), texts (and lists of them) the words they may be."""
    return field(default=default, metadata={"text": text, "low": low, "high": high, "words": words})


def _judge(name: str, kind: object, meta: Mapping[str, Any], value: object) -> Fault | None:
    if kind is bool:
        return None if isinstance(value, bool) else Fault(name, f"must be true or false, not {value!r}")
    if kind is int:
        if isinstance(value, bool) or not isinstance(value, int):
            return Fault(name, f"must be a whole number, not {value!r}")
        low, high = meta["low"], meta["high"]
        return None if low <= value <= high else Fault(name, f"must be {low} to {high}, not {value}")
    if kind == tuple[str, ...]:
        known = isinstance(value, list) and value and all(word in meta["words"] for word in value)
        return None if known else Fault(name, f"must be a list of {', '.join(meta['words'])}, not {value!r}")
    assert kind is str, f"a setting of type {kind} has no rule"
    if value not in meta["words"]:
        return Fault(name, f"must be one of {', '.join(meta['words'])}, not {value!r}")
    return None


def read(cls: type[T], values: Mapping[str, object]) -> T | list[Fault]:
    """Return the settings of class `cls` with `values` over its defaults, or every fault found."""
    assert dataclasses.is_dataclass(cls)
    kinds = get_type_hints(cls)
    known = {f.name: f for f in dataclasses.fields(cls) if "text" in f.metadata}
    faults = [Fault(name, "is not a setting of this version") for name in values if name not in known]
    for name, value in values.items():
        if name in known and (fault := _judge(name, kinds[name], known[name].metadata, value)):
            faults.append(fault)
    lists = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
    return faults or cls(**{**values, **lists})


@dataclass(frozen=True, slots=True)
class Limits:
    """What the gateway holds, for how long, and how much of it."""

    hold_ms: int = setting(10_000, "how long a request waits for a core", low=0, high=600_000)
    navigation_hold_ms: int = setting(400, "how long a page waits for a core", low=0, high=60_000)
    hold_requests_max: int = setting(1024, "requests held at a time", low=1, high=100_000)
    hold_bytes_max: int = setting(64 << 20, "bytes of bodies held at a time", low=1 << 10, high=1 << 34)
    hold_per_browser_max: int = setting(3, "requests held for one browser", low=1, high=1000)
    replay_body_bytes_max: int = setting(
        1 << 20, "a larger body is streamed and never replayed", low=0, high=1 << 30
    )
    body_bytes_max: int = setting(32 << 20, "a larger body is refused with 413", low=1, high=1 << 34)
    header_bytes_max: int = setting(32 << 10, "longer headers are refused with 431", low=512, high=1 << 20)
    header_timeout_ms: int = setting(10_000, "a head must have arrived by then", low=10, high=600_000)
    upstream_deadline_ms: int = setting(30_000, "the core must have answered by then", low=10, high=3_600_000)
    feed_silence_ms: int = setting(
        10_000, "without the sentinel's feed for so long: not alive", low=100, high=600_000
    )
    connections_max: int = setting(2048, "client connections at a time", low=1, high=100_000)
    sockets_max: int = setting(1024, "WebSockets at a time", low=1, high=10_000)
    overlay_after_ms: int = setting(
        400, "a page covers itself when an outage lasts this long", low=0, high=60_000
    )
    longer_than_ms: int = setting(
        30_000, "an outage is called long after this, while too few are known", low=0, high=3_600_000
    )
    keepalive_ms: int = setting(
        75_000, "an idle client connection is closed after this", low=10, high=3_600_000
    )
    session_idle_ms: int = setting(
        1_800_000,
        "who was signed in and did nothing for so long signs in again",
        low=1_000,
        high=2_592_000_000,
    )
    session_longest_ms: int = setting(
        43_200_000, "a session lasts no longer, used or not", low=1_000, high=2_592_000_000
    )
    drain_ms: int = setting(5_000, "how long a leaving gateway finishes what it has", low=0, high=600_000)
    receipts_max: int = setting(1000, "requests promised to run later, at a time", low=0, high=100_000)
    receipts_per_browser_max: int = setting(100, "of them, promised to one browser", low=0, high=100_000)
    receipt_bytes_max: int = setting(64 << 20, "bytes kept of all of them", low=0, high=1 << 34)
    receipt_ask_after_ms: int = setting(
        900_000, "a promise older than this runs only when a person says so", low=0, high=86_400_000
    )
    receipt_keep_ms: int = setting(
        86_400_000, "what became of one is told for so long", low=1_000, high=31_536_000_000
    )
