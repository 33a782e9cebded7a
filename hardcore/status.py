"""The status of everything as one object: from the running guard, or from its files when it is gone."""

from typing import Any

from hardcore import chronicle, quarantine_file
from hardcore.host import clock, files, wish
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.model.forecasts import Forecast
from hardcore.model.phases import SERVING, Phase, Wanted
from hardcore.model.recorder import ComponentBeat
from hardcore.model.verdicts import Colour
from hardcore.recovery.policy import Policy
from hardcore.recovery.reading import Reading

_MS = 1_000_000
#: Changes of the state that a status tells, the newest last; all of them come with the verb `history`.
HISTORY_SHOWN_MAX = 20
#: Phases in which the present life is a successor that does not serve yet.
_BEGINNING = frozenset({Phase.STARTING, Phase.SWITCHING, Phase.PROVING})


def _shape() -> dict[str, Any]:
    """Return the shape that is always there; objects are never null except `spare`."""
    return {
        "state": "UNKNOWN",
        "phase": None,
        "since": None,
        "mode": "act",
        "wanted": "UP",
        "safe": None,
        "safe_by": None,  # who has it read only: operator, policy
        "safe_reason": "",  # the operator's
        "needs_since": None,  # since when a person is needed
        "policy_fault": "",  # why the policy file is not what is gone by
        "components": [],
        "forecasts": [],
        "history": [],
        "url": None,
        "launcher": {"pid": None},
        "sentinel": {
            "pid": None,
            "tick_ms": None,
            "late_ticks": None,
            "cpu_percent": None,
            "rss_bytes": None,
            "adopted": False,
        },
        "gateway": {
            "pid": None,
            "websockets": 0,
            "held_requests": 0,
            "heartbeat_age_ms": None,
            "overdue": 0,  # answered 504 by the present gateway
            "refused_paths": [],  # that have killed two of them
            "refused_requests": 0,
            "incident": None,  # its own, while one is open
            "last_incident": None,  # its own that this guard closed last
            "awaits_operator": False,
        },
        "core": {
            "pid": None,
            "old_pid": None,
            "epoch": None,
            "ready": False,
            "heartbeat_age_ms": None,
            "loop_lag_ms": None,
            "last_seq": None,
            "in_flight": 0,
            "cpu_percent": None,
            "rss_bytes": None,
            "threads": None,
            "fds": None,
        },
        "spare": None,
        "spare_off": "",  # why none is kept
        "spare_lack": None,  # the same as a word
        "switch_waits": False,
        "switch_fault": "",
        "start_fault": "",  # what a core said last that could not start, while none serves
        "budget": {"used": 0, "limit": None, "window_s": None},
        "incident": None,
        "last_incident": None,
        "dead_letters": 0,  # in force: whose commands and events are set aside now
        "ledger_verified_at": None,
        "backup": {
            "name": None,
            "made_at": None,
            "count": 0,
        },  # the newest that was proven; looked up by whoever asks
    }


def whole(told: dict[str, Any]) -> dict[str, Any]:
    """Return what a guard told, with the shape's own values for what one of an older version does not know."""
    return {**_shape(), **told}


def running(reading: Reading, policy: Policy, safe_reason: str = "") -> dict[str, Any]:
    """Return the part of the status that follows from the manager's reading. `safe_reason` is the operator's."""
    status, now_ns = _shape(), clock.now_ns()
    status |= {
        "state": str(reading.state),
        "phase": str(reading.phase),
        "since": clock.wall(reading.since_ns),
        "mode": policy.mode,
        "wanted": str(reading.wanted),
        "safe": str(reading.safe) if reading.safe else None,
        "safe_by": reading.safe_by,
        "safe_reason": safe_reason if reading.wanted is Wanted.SAFE else "",
        "needs_since": None if reading.needs_ns is None else clock.wall(reading.needs_ns),
        "components": [_component(each, now_ns) for each in reading.components],
        "forecasts": [_forecast(each) for each in reading.forecasts],
        "spare_off": reading.spare_fault,
        "spare_lack": str(reading.spare_lack) if reading.spare_lack else None,
        "switch_waits": reading.switch_waits,
        "switch_fault": reading.switch_fault,
        "start_fault": reading.start_fault,
        "incident": reading.incident,
        "stage": reading.stage,
        "waits_for": reading.waits_for,
        "worries": [*_unsound(reading), *_locked(reading), *_worries(reading)],
    }
    status["sentinel"] |= {"tick_ms": policy.health_check_interval_ms, "late_ticks": reading.late_ticks}
    status["budget"] = {
        "used": reading.deaths,
        "limit": policy.max_restart_count,
        "window_s": policy.restart_window_sec,
    }
    return status


def _component(each: ComponentBeat, now_ns: int) -> dict[str, Any]:
    """Return one part of the core: since when it has work and how old its last sign is, both None while it has none."""
    works = each.since_ns > 0
    return {
        "name": each.name,
        "works_ms": (now_ns - each.since_ns) // _MS if works else None,
        "beat_age_ms": (now_ns - each.beat_ns) // _MS if works and each.beat_ns else None,
        "limit_ms": each.limit_ns // _MS,
        "done": each.done,
    }


def _forecast(each: Forecast) -> dict[str, Any]:
    """Return what will run out, with the wall's times at which it does."""
    return {
        "resource": str(each.resource),
        "level": each.level,
        "limit": each.limit,
        "per_hour": each.per_hour,
        "since": clock.wall(each.since_ns),
        "due": clock.wall(each.due_ns),
        "due_late": clock.wall(each.due_late_ns),
        "why": each.why,
    }


def _worries(reading: Reading) -> list[str]:
    """Return what is not well: a witness that says that all is well is no worry, whatever the others say."""
    return [t.why for t in reading.verdict.testimonies if t.colour is not Colour.GREEN]


def _locked(reading: Reading) -> list[str]:
    """Return who keeps the core that is to write from beginning."""
    return [reading.locked_by] if reading.locked_by else []


def _unsound(reading: Reading) -> list[str]:
    return [reading.audit.fault] if reading.audit and not reading.audit.ok else []


def spare(life: Life | None, reading: Reading, on_disk: str) -> dict[str, Any] | None:
    """Return the `spare` object. `build_fits`: it runs the code that lies on the disk; None: not known yet."""
    if life is None or life.handle is None or not life.handle.signal(0):
        return None
    fits = reading.spare_build == on_disk if reading.spare_build and on_disk else None
    return {"pid": life.handle.pid, "ready": reading.spare_ready, "build_fits": fits}


def core(
    life: Life | None,
    reading: Reading,
    *,
    proved_seq: int | None,
    cpu_percent: float | None,
    behind: Life | None = None,
) -> dict[str, Any]:
    """Return the `core` object. A core that is being ended, or lives on `behind` the fence, is `old_pid`.

    One that is being started is neither. `proved_seq`: the head that it told when it was ready; what it
    commits since stands on its page.
    """
    told = dict(_shape()["core"])
    if behind is not None and behind.handle is not None and behind.handle.signal(0):
        told["old_pid"] = behind.handle.pid
    if life is None or life.handle is None:
        return told
    serving = reading.phase in SERVING
    old = not serving and reading.phase not in _BEGINNING and life.handle.signal(0)
    told["pid"] = life.handle.pid if serving else None
    told["old_pid"] = life.handle.pid if old else told["old_pid"]
    told |= {"epoch": reading.epoch, "ready": serving}
    beats = life.reader.beats() if life.reader else None
    if beats is not None:
        now_ns = clock.now_ns()
        told |= {
            "heartbeat_age_ms": (now_ns - beats.loop_ns) // _MS if beats.loop_ns else None,
            "in_flight": beats.waiting,
            "loop_lag_ms": beats.loop_lag_ns // _MS,
        }
        witness = life.reader.witness() if life.reader else None
        told["last_seq"] = witness.seq if witness else proved_seq
    if life.sample is not None:
        told |= {
            "cpu_percent": cpu_percent,
            "rss_bytes": life.sample.rss_bytes,
            "threads": life.sample.threads,
            "fds": life.fds,
        }
    return told


def from_files(folders: Folders) -> dict[str, Any]:
    """Return the status as the files tell it when no sentinel answers: the same shape, state UNKNOWN."""
    status = _shape()
    status["wanted"] = str(wish.read(folders).wanted)
    status["history"] = list(chronicle.read(folders))[-HISTORY_SHOWN_MAX:]
    told = files.read_json(folders.sentinel)
    status["url"] = told.get("url")
    status["last_incident"] = last_incident(folders)
    status["dead_letters"] = quarantine_file.read(folders).letters
    return status


def last_incident(folders: Folders) -> str | None:
    """Return the id of the newest closed incident on disk; ids sort by time."""
    try:
        closed = [facts.parent.name for facts in folders.incidents.glob("[!.]*/incident.json")]
    except OSError:  # the folder's name is too long, or it is none: nothing is known
        return None
    return max(closed, default=None)
