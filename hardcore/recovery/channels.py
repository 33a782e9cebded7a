"""Who is told, and when: the channels of the policy, and the manners of telling.

A channel is an address and the patience of whoever reads it: the first message of a kind at once, then at most one in
`min_interval_s`, nothing while muted, in quiet hours only what waits for a person, and one closing message for what was
told. What is held back and still goes on when nothing holds it any more is told then, and an end that leaves a person
with something to do is told although its beginning was not. All of it is functions of what was told before, kept per channel, so that a slow channel does not silence a quick
one. The floor lies on the kind of trouble (its fingerprint) and an end does not lift it: whoever is restarted every
minute would otherwise be two messages a minute. Secrets may stand in the address, because the services hand them out
like that; `masked` is what may be shown, and nothing else of it ever is.
"""

import re
from collections.abc import Mapping
from enum import StrEnum
from ipaddress import ip_address
from typing import Final, assert_never
from urllib.parse import SplitResult, parse_qs, urlsplit

import msgspec
from msgspec import structs

from hardcore.settings import Fault

CHANNELS_MAX: Final = 8
URL_CHARS_MAX: Final = 2048
NAME_CHARS_MAX: Final = 60
INTERVAL_S_MAX: Final = 604_800
#: Fingerprints and incidents that a channel remembers; the oldest are forgotten.
REMEMBERED_MAX: Final = 256
DAY_MIN: Final = 1440
LANGUAGES: Final = ("ko", "en")

#: Ends after which not everything is as it was: whoever was told of a better one, or of none, has to know.
BAD_ENDS: Final = frozenset({"manual", "assist", "safe_mode"})

_FIELDS: Final = frozenset({"kind", "url", "min_interval_s", "name", "lang", "quiet_hours", "secret_file"})
_QUIET = re.compile(r"([01]\d|2[0-3]):([0-5]\d)-([01]\d|2[0-3]):([0-5]\d)")
_SCHEME = re.compile(r"[a-z][a-z0-9+.-]{0,30}://.", re.IGNORECASE)
#: As every server takes it: letters of ASCII only, and none of the signs that would make it two.
_ADDRESS = re.compile(r"[A-Za-z0-9.!#$%&'*+/=?^_`{|}~-]{1,64}@[A-Za-z0-9.-]{1,255}")
_LABEL = re.compile(r"[A-Za-z0-9_]([A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?")
_WORD = re.compile(r"[a-z_]{1,20}")


class Kind(StrEnum):
    """By which way a channel is reached."""

    WEBHOOK = "webhook"
    NTFY = "ntfy"
    SMTP = "smtp"
    APPRISE = "apprise"


class Held(StrEnum):
    """Why somebody was not told."""

    FLOOR = "floor"  # of this kind was told lately, or this outage was told already
    MUTED = "muted"
    QUIET = "quiet"  # quiet hours
    UNTOLD = "untold"  # the end of something that was not told


class Stage(StrEnum):
    """What an alert is about: the stages of `model.actions.AlertStage`, and a person's own try."""

    OPENED = "opened"
    CLOSED = "closed"
    WAITS = "waits"
    OVERDUE = "overdue"
    FORECAST = "forecast"
    TEST = "test"


class Quiet(msgspec.Struct, frozen=True):
    """Hours of the local day in minutes since midnight, the end not included; it may go over midnight."""

    start_min: int
    end_min: int

    def covers(self, minute: int) -> bool:
        """Tell whether this minute of the day is quiet."""
        if self.start_min <= self.end_min:
            return self.start_min <= minute < self.end_min
        return minute >= self.start_min or minute < self.end_min

    def __str__(self) -> str:
        return "-".join(f"{at // 60:02}:{at % 60:02}" for at in (self.start_min, self.end_min))


class Channel(msgspec.Struct, frozen=True):
    """One way to somebody. `number` counts from 1 in the file's order; `secret_file` holds its secret.

    A variable of the environment was not chosen for that: whoever starts the guard anew would have to carry it along.
    """

    number: int
    kind: Kind
    url: str
    name: str
    min_interval_s: int = 1800
    lang: tuple[str, ...] = LANGUAGES
    quiet: Quiet | None = None
    secret_file: str = ""

    @property
    def place(self) -> str:
        """Scheme and host of its address: all of it that is ever shown."""
        return masked(self.url)

    def __repr__(self) -> str:
        # A channel in a traceback or an assertion must not carry its address along.
        return f"Channel({self.number}, {self.kind}, {self.place!r}, {self.name!r})"


def masked(url: str) -> str:
    """Return the part of an address that is no secret: names in it, paths and questions may all be tokens."""
    try:
        parts = urlsplit(url)
        host = parts.hostname or ""
    except ValueError:
        return "…"
    # In Apprise's addresses the place of the host may be a token as well; a host has a dot, or is this machine.
    shown = host if "." in host or ":" in host or host == "localhost" else "…"
    return f"{parts.scheme}://{shown}/…" if shown != "…" else f"{parts.scheme}://…"


def read_channels(value: object) -> tuple[Channel, ...] | list[Fault]:
    """Return the channels of the policy's `alerts`, or everything that is wrong with it. No address is repeated."""
    if not isinstance(value, list):
        return [Fault("alerts", "must be a list of channels")]
    if len(value) > CHANNELS_MAX:
        return [Fault("alerts", f"at most {CHANNELS_MAX} channels")]
    read = [_read(number, one) for number, one in enumerate(value, 1)]
    faults = [fault for one in read if isinstance(one, list) for fault in one]
    return faults or tuple(one for one in read if isinstance(one, Channel))


def good_channels(value: object) -> tuple[Channel, ...]:
    """Return those channels that are right, under their numbers: one that is not silences no other."""
    listed = value[:CHANNELS_MAX] if isinstance(value, list) else []
    read = (_read(number, one) for number, one in enumerate(listed, 1))
    return tuple(one for one in read if isinstance(one, Channel))


def _read(number: int, value: object) -> Channel | list[Fault]:
    if not isinstance(value, dict):
        return [_wrong(number, "must be an object with kind and url")]
    faults = [_wrong(number, f"{_named(name)} is not known") for name in value if name not in _FIELDS]
    kind, url = value.get("kind"), value.get("url")
    if not isinstance(kind, str) or kind not in set(Kind):
        faults.append(_wrong(number, f"kind must be one of {', '.join(Kind)}"))
    elif not isinstance(url, str) or not url:
        faults.append(_wrong(number, "url is missing"))
    elif why := _bad_url(Kind(kind), url):
        faults.append(_wrong(number, why))
    faults += [_wrong(number, why) for why in _bad_particulars(value)]
    return faults or _channel(number, value)


def _channel(number: int, value: Mapping[str, object]) -> Channel:
    lang, quiet = value.get("lang"), value.get("quiet_hours")
    kind = Kind(str(value["kind"]))
    interval = value.get("min_interval_s", 1800)
    assert isinstance(interval, int), "it was judged"
    return Channel(
        number,
        kind,
        str(value["url"]),
        str(value.get("name", kind)),
        interval,
        (str(lang),) if lang is not None else LANGUAGES,
        _quiet(quiet) if isinstance(quiet, str) else None,
        str(value.get("secret_file", "")),
    )


def _named(name: object) -> str:
    """Return a field's name for a fault. What is no plain word may be an address that has slipped."""
    return repr(name) if isinstance(name, str) and _WORD.fullmatch(name) else "a field"


def _wrong(number: int, why: str) -> Fault:
    return Fault("alerts", f"channel {number}: {why}")


def _bad_particulars(value: Mapping[str, object]) -> list[str]:
    bad = []
    interval, name, quiet = (
        value.get("min_interval_s", 1800),
        value.get("name", "-"),
        value.get("quiet_hours"),
    )
    if isinstance(interval, bool) or not isinstance(interval, int) or not 0 <= interval <= INTERVAL_S_MAX:
        bad.append(f"min_interval_s must be 0 to {INTERVAL_S_MAX}")
    if not isinstance(name, str) or not 0 < len(name) <= NAME_CHARS_MAX or not name.isprintable():
        bad.append(f"name must be a text of at most {NAME_CHARS_MAX} characters")
    if value.get("lang", "ko") not in LANGUAGES:
        bad.append("lang must be ko or en; without it both are sent")
    if quiet is not None and (not isinstance(quiet, str) or _quiet(quiet) is None):
        bad.append('quiet_hours must look like "22:00-07:00"')
    path = value.get("secret_file", "/")
    if not isinstance(path, str) or not path.startswith("/") or not path.isprintable():
        bad.append("secret_file must be a whole path")
    return bad


def _quiet(text: str) -> Quiet | None:
    found = _QUIET.fullmatch(text)
    if found is None:
        return None
    hours = [int(part) for part in found.groups()]
    start, end = hours[0] * 60 + hours[1], hours[2] * 60 + hours[3]
    return Quiet(start, end) if start != end else None


def _bad_url(kind: Kind, url: str) -> str:
    """Return why this address can't be used for this kind; empty if it can. The reason never repeats it."""
    if len(url) > URL_CHARS_MAX or not url.isprintable() or " " in url:
        return f"url must be one line of at most {URL_CHARS_MAX} characters without spaces"
    if kind is Kind.APPRISE:
        return "" if _SCHEME.match(url) else "url must be an address as Apprise has it"
    try:
        parts = urlsplit(url)
        port = parts.port
    except ValueError:
        return "url can't be read as an address"
    if port == 0 or (parts.hostname and not _is_host(parts.hostname)):
        return "url names a host or a port that can't be reached"
    match kind:
        case Kind.WEBHOOK | Kind.NTFY:
            return _bad_http(kind, parts)
        case Kind.SMTP:
            return _bad_smtp(parts)
        case _:
            assert_never(kind)


def _is_host(host: str) -> bool:
    """Tell whether somebody can have this name or number."""
    try:
        return "%" not in str(ip_address(host))  # a scope is no part of an address that others know
    except ValueError:
        pass
    try:
        labels = host.encode("idna").decode("ascii").rstrip(".").split(".")
    except UnicodeError:  # an empty part, one that is too long, or letters that no name has
        return False
    return all(_LABEL.fullmatch(label) for label in labels)


def _bad_http(kind: Kind, parts: SplitResult) -> str:
    if parts.scheme not in {"http", "https"} or not parts.hostname:
        return "url must begin with https:// and a host"
    if parts.scheme == "http" and not is_loopback(parts.hostname):
        return "url must begin with https://: what is sent in the open can be read on the way"
    if parts.username is not None or parts.password is not None:
        return "url must not hold a user: secret_file is the place for a secret"
    if not (parts.path + parts.query).isascii():
        return "url must be of plain letters after its host: others are written as %XX"
    if kind is Kind.NTFY and not parts.path.strip("/"):
        return "url must end in the topic"
    return ""


def _bad_smtp(parts: SplitResult) -> str:
    if parts.scheme not in {"smtp", "smtps"} or not parts.hostname:
        return "url must look like smtps://user@host:465/?from=…&to=… (smtp:// with STARTTLS)"
    asked = parse_qs(parts.query)
    if strange := sorted(asked.keys() - {"from", "to"}):
        return f"url may say from and to, not {_named(strange[0])}"
    if not all(_ADDRESS.fullmatch(one) for name in ("from", "to") for one in asked.get(name, ["-"])):
        return "url must say from=… and to=…, each one mail address of plain letters"
    return ""


def is_loopback(host: str) -> bool:
    """Tell whether this host is this machine, as far as its name says it."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


# ---- manners ----


class Moment(msgspec.Struct, frozen=True):
    """Now, by the wall: what was told outlives a boot. `minute` of the local day; `muted_until_ms` 0: not muted."""

    at_ms: int
    minute: int
    muted_until_ms: int = 0


class Memory(msgspec.Struct, frozen=True):
    """What one channel was told: when of which fingerprint, how many were left out since, and of which incidents."""

    told_ms: tuple[tuple[str, int], ...] = ()
    left_out: tuple[tuple[str, int], ...] = ()
    incidents: tuple[str, ...] = ()

    def count(self, mark: str) -> int:
        """Return how many alerts of this kind were left out since the last one that was told."""
        return dict(self.left_out).get(mark, 0)


class Occasion(msgspec.Struct, frozen=True):
    """What an alert is about, as far as the manners care."""

    stage: Stage
    fingerprint: str
    incident: str | None = None
    outcome: str = ""  # of an end

    @property
    def is_bad_end(self) -> bool:
        """Whether it is over and not well."""
        return self.stage is Stage.CLOSED and self.outcome in BAD_ENDS

    @property
    def mark(self) -> str:
        """What the floor lies on. Somebody who is waited for is another matter than what has begun."""
        if self.is_bad_end:
            return f"{self.outcome}:{self.fingerprint}"
        begun = self.stage in {Stage.OPENED, Stage.CLOSED}
        return self.fingerprint if begun else f"{self.stage}:{self.fingerprint}"


def held(channel: Channel, memory: Memory, what: Occasion, now: Moment) -> Held | None:
    """Return why this channel is not told of it now, or None: it is."""
    if what.stage is Stage.TEST:
        return None
    if now.at_ms < now.muted_until_ms:
        return Held.MUTED
    if what.stage is Stage.CLOSED and (_is_known(memory, what) or not what.is_bad_end):
        return None if _is_known(memory, what) else Held.UNTOLD
    if channel.quiet is not None and channel.quiet.covers(now.minute) and not _waits(what):
        return Held.QUIET
    if what.stage is Stage.OPENED and _is_known(memory, what):
        return Held.FLOOR
    last_ms = dict(memory.told_ms).get(what.mark)
    # A clock that was set back makes what was told lie ahead: then one message too many is the lesser evil.
    recent = last_ms is not None and 0 <= now.at_ms - last_ms < channel.min_interval_s * 1000
    return Held.FLOOR if recent else None


def lifts_ms(channel: Channel, memory: Memory, what: Occasion, now: Moment, why: Held) -> int | None:
    """Return when what holds this back is over, by the wall; None: it never tells anything new."""
    known = _is_known(memory, what)
    if (what.stage is Stage.OPENED and known) or (
        what.stage is Stage.CLOSED and not (known or what.is_bad_end)
    ):
        return None
    match why:
        case Held.MUTED:
            return now.muted_until_ms
        case Held.QUIET:
            end_min = channel.quiet.end_min if channel.quiet is not None else now.minute
            return now.at_ms + ((end_min - now.minute) % DAY_MIN) * 60_000
        case Held.FLOOR:
            return dict(memory.told_ms).get(what.mark, now.at_ms) + channel.min_interval_s * 1000
        case Held.UNTOLD:
            return None
        case _:
            assert_never(why)


def _is_known(memory: Memory, what: Occasion) -> bool:
    """Whether this channel was told of this incident."""
    return what.incident is not None and what.incident in memory.incidents


def _waits(what: Occasion) -> bool:
    """Whether nothing goes on without a person."""
    ended = what.is_bad_end and what.outcome != "safe_mode"
    return ended or what.stage in {Stage.WAITS, Stage.OVERDUE}


def after_held(memory: Memory, what: Occasion) -> Memory:
    """What a channel remembers once it was spared an alert. The end of what was not told is no loss to count."""
    if what.stage is Stage.CLOSED:
        return memory
    return structs.replace(memory, left_out=_put(memory.left_out, what.mark, memory.count(what.mark) + 1))


def after_told(memory: Memory, what: Occasion, at_ms: int) -> Memory:
    """What a channel remembers once it was told; an incident is forgotten with its closing message."""
    if what.stage is Stage.TEST:
        return memory
    others = tuple(one for one in memory.incidents if one != what.incident)
    if what.stage is Stage.CLOSED:
        alone = what.is_bad_end and not _is_known(memory, what)
        told_ms = _put(memory.told_ms, what.mark, at_ms) if alone else memory.told_ms
        return structs.replace(memory, told_ms=told_ms, incidents=others)
    known = (*others, what.incident) if what.incident is not None else others
    return Memory(
        _put(memory.told_ms, what.mark, at_ms),
        tuple(one for one in memory.left_out if one[0] != what.mark),
        known[-REMEMBERED_MAX:],
    )


def _put(pairs: tuple[tuple[str, int], ...], name: str, value: int) -> tuple[tuple[str, int], ...]:
    return (*(one for one in pairs if one[0] != name), (name, value))[-REMEMBERED_MAX:]


def as_shown(channel: Channel) -> dict[str, object]:
    """Return what status and policy may show of a channel: never its address, never where its secret is."""
    return {
        "number": channel.number,
        "kind": str(channel.kind),
        "name": channel.name,
        "place": channel.place,
        "min_interval_s": channel.min_interval_s,
        "lang": list(channel.lang),
        "quiet_hours": str(channel.quiet) if channel.quiet else None,
        "secret": bool(channel.secret_file),
    }
