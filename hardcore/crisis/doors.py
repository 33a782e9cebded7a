"""The doors: what monitors ask of this machine, answered from memory in every phase.

Nobody is asked here and nothing is waited for: what the feed has said last is known, and how long ago it said so. What
the guard alone knows (its counts, the core's memory) comes with its standing once a second while somebody reads the
doors; a word that is older than a guard may be silent is not passed on as if it were of now. Details, and the numbers,
are for this machine alone: a reverse proxy that publishes a ledger must not publish how to watch it.
"""

import json
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Any, Final

import msgspec
from msgspec import structs

from hardcore import __version__
from hardcore.crisis import metrics, pages
from hardcore.crisis.census import is_near
from hardcore.crisis.feed import StandingHeard, Teller, asked_doors_line
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.problems import Problem
from hardcore.crisis.routing import Route
from hardcore.crisis.standing import Standing, alive, posture, ready
from hardcore.model.phases import Face, HAState

#: The routes that are doors.
DOOR_ROUTES: Final = frozenset({Route.LIVE, Route.READY, Route.STARTUP, Route.HEALTH, Route.METRICS})
#: The guard is told at most this often that somebody reads the doors; it remembers it for a minute.
ASK_EVERY_NS: Final = 10 * 1_000_000_000
#: The guard speaks of its standing every ten seconds at least: what is older than two of them is not of now.
FRESH_NS: Final = 21 * 1_000_000_000
_ALLOW: Final = (b"Allow", b"GET, HEAD, OPTIONS")
_AGAIN: Final = (b"Retry-After", b"1")
#: What the proof of the whole ledger says; None: it runs behind the serving.
_OF_A_PROOF: Final[Mapping[bool | None, str]] = {None: "warn", True: "pass", False: "fail"}


class Traffic(msgspec.Struct, frozen=True):
    """What goes on in this gateway at a moment; `settled`: requests that met an outage so far, by outcome."""

    held: int
    websockets: int
    connections: int
    settled: Mapping[str, int]


def grade(state: str, *, heard: bool, serving: bool) -> str:
    """What `/health` says in one word: pass, warn or fail. A state that this version does not know fails."""
    if not heard or not serving:
        return "fail"
    match state:
        case HAState.OPERATIONAL:
            return "pass"
        case HAState.DEGRADED | HAState.SAFE_MODE:
            return "warn"
        case _:
            return "fail"


class Doors:
    """Answers the five paths of monitors."""

    def __init__(
        self,
        standing: Callable[[], Standing],
        traffic: Callable[[], Traffic],
        teller: Teller,
        silence_ms: int,
        now_ns: Callable[[], int],
    ) -> None:
        self._standing = standing
        self._traffic = traffic
        self._teller = teller
        self._silence_ms = silence_ms
        self._now_ns = now_ns
        self._born_ns = now_ns()
        self._told: StandingHeard | None = None
        self._told_ns = 0
        self._asked_ns: int | None = None
        self._begun = False  # the first start is over: it served once, or it waits for a person

    def hear(self, told: StandingHeard) -> None:
        """The guard said how everything stands."""
        self._told, self._told_ns = told, self._now_ns()

    def look(self) -> None:
        """Something was learned: whether the first start is over holds for good, whatever comes after."""
        standing = self._standing()
        over = ready(standing) or standing.state == HAState.MANUAL_INTERVENTION
        self._begun = self._begun or over

    def answer(self, head: RequestHead, way: Route, address: str) -> pages.Answer:
        """The answer of one of the doors to a client at `address`."""
        if head.method == "OPTIONS":
            return pages.whole(HTTPStatus.NO_CONTENT, b"text/plain", b"", [_ALLOW])
        if head.method not in {"GET", "HEAD"}:
            return _only_reads(head)
        near = is_near(address) and not head.forwarded
        standing = self._standing()
        match way:
            case Route.LIVE:
                return pages.live(heard=self._is_heard(standing), young=self._is_young(standing))
            case Route.READY:
                return pages.ready(standing.state, serving=ready(standing))
            case Route.STARTUP:
                self.look()
                return _json(200 if self._begun else 503, {"started": self._begun})
            case Route.HEALTH:
                return self._health(standing, near=near)
            case Route.METRICS if near:
                return self._metrics(head, standing)
            case Route.METRICS:
                return pages.problem(Problem.NOT_FOUND, head.accept_language)
            case _:
                raise AssertionError(f"{way} is no door")

    def _is_heard(self, standing: Standing) -> bool:
        return alive(standing, self._now_ns(), self._silence_ms)

    def _is_young(self, standing: Standing) -> bool:
        """Whether we have heard nobody yet, and have not had the same time for it."""
        return not standing.heard_ns and self._now_ns() - self._born_ns <= self._silence_ms * 1_000_000

    def _health(self, standing: Standing, *, near: bool) -> pages.Answer:
        heard = self._is_heard(standing)
        word = grade(standing.state, heard=heard, serving=ready(standing))
        checks: dict[str, object] = {}
        if near:
            self._ask()
            checks = self._checks(standing, heard=heard)
        told = {"status": word, "state": standing.state or "UNKNOWN", "checks": checks}
        return _json(503 if word == "fail" else 200, told)

    def _checks(self, standing: Standing, *, heard: bool) -> dict[str, object]:
        """What stands behind the word, part by part. What the guard has not said lately is not there."""
        traffic, status = self._traffic(), self._fresh().status
        parts: dict[str, object] = {
            "sentinel": {"status": "pass" if heard else "fail", "silence_ms": self._silent_ms(standing)},
            "core": {
                "status": "pass" if posture(standing) is Face.FORWARD else "fail",
                "phase": standing.phase or None,
                "epoch": standing.serving.epoch if standing.serving else None,
                "safe": standing.safe,
                **_some(
                    status.get("core"), "pid", "heartbeat_age_ms", "rss_bytes", "threads", "fds", "last_seq"
                ),
            },
            "gateway": {
                "status": "pass",
                "connections": traffic.connections,
                "websockets": traffic.websockets,
                "held_requests": traffic.held,
            },
            "ledger": {
                "status": _OF_A_PROOF[standing.sound],
                "verified_at": status.get("ledger_verified_at"),
            },
        }
        if (spare := status.get("spare")) is not None:
            parts["spare"] = {"status": "pass", **_some(spare, "pid", "ready")}
        if status:
            parts["budget"] = {"status": "pass", **_some(status.get("budget"), "used", "limit", "window_s")}
        return parts

    def _silent_ms(self, standing: Standing) -> int | None:
        return (self._now_ns() - standing.heard_ns) // 1_000_000 if standing.heard_ns else None

    def _metrics(self, head: RequestHead, standing: Standing) -> pages.Answer:
        self._ask()
        traffic, told = self._traffic(), self._fresh()
        silent_ms = self._silent_ms(standing)
        moment = metrics.Moment(
            version=__version__,
            up=posture(standing) is Face.FORWARD,
            state=standing.state,
            epoch=standing.serving.epoch if standing.serving else None,
            silence_s=None if silent_ms is None else silent_ms / 1000,
            held=traffic.held,
            websockets=traffic.websockets,
            connections=traffic.connections,
            settled=traffic.settled,
            status=told.status,
            counters=told.counters,
        )
        accept = b",".join(value for name, value in head.headers if name.lower() == b"accept")
        openmetrics = metrics.wants_openmetrics(accept.decode("latin-1"))
        kind = metrics.OPENMETRICS if openmetrics else metrics.PLAIN_TEXT
        body = metrics.text(moment, openmetrics=openmetrics)
        return pages.whole(HTTPStatus.OK, kind, body, [(b"Vary", b"Accept")])

    def _fresh(self) -> StandingHeard:
        """What the guard said last; of what is too old its counts alone, because those do not go back."""
        told = self._told
        if told is None:
            return StandingHeard(0, {}, {})
        if self._now_ns() - self._told_ns <= FRESH_NS:
            return told
        kept = {name: told.counters[name] for name in LASTING if name in told.counters}
        return StandingHeard(told.generation, {}, kept)

    def _ask(self) -> None:
        """Have the guard say how everything stands once a second for the next minute."""
        now_ns = self._now_ns()
        if self._asked_ns is None or now_ns - self._asked_ns >= ASK_EVERY_NS:
            self._asked_ns = now_ns if self._teller.say(asked_doors_line()) else None


#: Counts that only grow: true as far as they go, however old they are.
LASTING: Final = frozenset(
    {
        "restarts",
        "incidents",
        "detection_ms",
        "recovery_ms",
        "stage_ms",
        "late_ticks",
        "false_suspicions",
        "state_ms",
        "snapshot_bytes",
    }
)


def _json(status: int, told: Mapping[str, object]) -> pages.Answer:
    extra = [] if status == HTTPStatus.OK else [_AGAIN]
    return pages.whole(status, b"application/json", json.dumps(told).encode(), extra)


def _only_reads(head: RequestHead) -> pages.Answer:
    """The refusal of what would change something; it names the methods of a door, and not those of the ledger."""
    answer = pages.problem(Problem.METHOD_NOT_ALLOWED, head.accept_language)
    headers = tuple(_ALLOW if name == b"Allow" else (name, value) for name, value in answer.head.headers)
    return structs.replace(answer, head=structs.replace(answer.head, headers=headers))


def _some(told: object, *names: str) -> dict[str, Any]:
    """The named fields of what the guard said, as far as they are there."""
    return {name: told[name] for name in names if name in told} if isinstance(told, dict) else {}
