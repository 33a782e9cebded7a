"""`failover_policy.json`: what is done on which diagnosis, and every number of the watch.

The file is read whole or refused whole, with the line and the reason of everything that is wrong; a bad
file never replaces a good one. A word that could not be done on a diagnosis is refused there, with the reason, so that
nobody believes in what is not there; to take it in its nearest sense was tried, and nobody read the note beside it.
"""

import dataclasses
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import msgspec

from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.channels import Channel, read_channels
from hardcore.recovery.located import Broken, Located, Path, nearest, parse
from hardcore.settings import Fault, Limits, read, setting

VERSION = 1
POLICY_BYTES_MAX = 256 << 10
#: A name or a reason is shown up to this many characters.
WORDS_MAX = 200


class Word(StrEnum):
    """The words a policy may use for what is done."""

    SEND_ALERT = "SEND_ALERT"
    SNAPSHOT = "SNAPSHOT"
    REBOOT_PROCESS = "REBOOT_PROCESS"
    PLANNED_SWITCH = "PLANNED_SWITCH"
    RESTART_COMPONENT = "RESTART_COMPONENT"
    DEGRADE = "DEGRADE"
    SAFE_MODE_ENTER = "SAFE_MODE_ENTER"
    AWAIT_OPERATOR = "AWAIT_OPERATOR"
    SHUTDOWN = "SHUTDOWN"
    NONE = "NONE"


_RESTART = frozenset({Word.SEND_ALERT, Word.SNAPSHOT, Word.REBOOT_PROCESS})
_WAIT = frozenset({Word.SEND_ALERT, Word.SNAPSHOT, Word.AWAIT_OPERATOR})
_TELL = frozenset({Word.SEND_ALERT})
_READ = frozenset({Word.SEND_ALERT, Word.SNAPSHOT, Word.SAFE_MODE_ENTER})
_SWITCH = frozenset({Word.SEND_ALERT, Word.PLANNED_SWITCH})

#: What is done on a diagnosis that the policy does not list. Total: a new diagnosis needs a line here.
DEFAULT_ACTIONS: Mapping[Diagnosis, frozenset[Word]] = {
    Diagnosis.CRASHED: _RESTART,
    Diagnosis.EXITED: _RESTART,
    Diagnosis.KILLED_FROM_OUTSIDE: _RESTART,
    Diagnosis.STOPPED_FROM_OUTSIDE: frozenset({Word.NONE}),
    Diagnosis.OUT_OF_MEMORY: _RESTART,
    Diagnosis.FENCED: frozenset({Word.SNAPSHOT, Word.REBOOT_PROCESS}),
    Diagnosis.COMMIT_FAILED: _RESTART,
    Diagnosis.FROZEN: _RESTART,
    Diagnosis.LOOP_BLOCKED: _RESTART,
    Diagnosis.SPINNING: _RESTART,
    Diagnosis.GIL_HELD: _RESTART,
    Diagnosis.DEADLOCK: _RESTART,
    Diagnosis.TRANSACTION_TIMEOUT: _RESTART,
    Diagnosis.NO_PROGRESS: _RESTART,
    Diagnosis.DB_LOCKED: frozenset({Word.SEND_ALERT, Word.SNAPSHOT, Word.DEGRADE}),
    Diagnosis.STORE_AWAY: frozenset({Word.SEND_ALERT, Word.SNAPSHOT}),
    Diagnosis.DISK_FULL: _READ,
    Diagnosis.DISK_READ_ONLY: _READ,
    Diagnosis.DISK_STALLED: _READ,
    Diagnosis.STORE_CORRUPT: _READ | {Word.AWAIT_OPERATOR},
    Diagnosis.COMPONENT_STALLED: _SWITCH | {Word.RESTART_COMPONENT},
    Diagnosis.MEMORY_PRESSURE: _SWITCH,
    Diagnosis.LEAK: _SWITCH,
    Diagnosis.FD_EXHAUSTION: _SWITCH,
    Diagnosis.STARTUP_FAILED: _RESTART,
    Diagnosis.CRASH_LOOP: _WAIT,
    Diagnosis.CONFIG_INVALID: _WAIT,
    Diagnosis.STARVED: frozenset({Word.NONE}),
    Diagnosis.SLEPT: frozenset({Word.NONE}),
    Diagnosis.SENTINEL_LOST: _RESTART,
    Diagnosis.GATEWAY_LOST: _RESTART,
    Diagnosis.SPARE_LOST: _TELL,
    Diagnosis.OPERATOR: frozenset({Word.REBOOT_PROCESS}),
    Diagnosis.PLANNED_SWITCH: frozenset({Word.SEND_ALERT, Word.REBOOT_PROCESS}),
}

#: A store that may be damaged is never put back to work by a policy.
NEVER_REBOOT = frozenset({Diagnosis.STORE_CORRUPT})

#: Diagnoses of a core whose loop stands still or answers nobody: it can obey no order.
HUNG = frozenset(
    {
        Diagnosis.FROZEN,
        Diagnosis.LOOP_BLOCKED,
        Diagnosis.SPINNING,
        Diagnosis.GIL_HELD,
        Diagnosis.DEADLOCK,
        Diagnosis.NO_PROGRESS,
    }
)
#: Diagnoses of a core that lives.
LIVING = HUNG | {
    Diagnosis.TRANSACTION_TIMEOUT,
    Diagnosis.DB_LOCKED,
    Diagnosis.DISK_FULL,
    Diagnosis.DISK_READ_ONLY,
    Diagnosis.DISK_STALLED,
    Diagnosis.STORE_CORRUPT,
    Diagnosis.COMPONENT_STALLED,
}
#: Diagnoses of a core that is gone, or never came: there is nothing left to keep.
_GONE = frozenset(
    {
        Diagnosis.CRASHED,
        Diagnosis.EXITED,
        Diagnosis.KILLED_FROM_OUTSIDE,
        Diagnosis.STOPPED_FROM_OUTSIDE,
        Diagnosis.OUT_OF_MEMORY,
        Diagnosis.FENCED,
        Diagnosis.COMMIT_FAILED,
        Diagnosis.STARTUP_FAILED,
        Diagnosis.CRASH_LOOP,
        Diagnosis.CONFIG_INVALID,
        Diagnosis.SENTINEL_LOST,
        Diagnosis.STORE_AWAY,
    }
)
#: Forecasts: nothing has happened yet.
FORECAST = frozenset({Diagnosis.MEMORY_PRESSURE, Diagnosis.LEAK, Diagnosis.FD_EXHAUSTION})
#: A core that answers and is worth another one in a quiet moment.
_SWITCHABLE = FORECAST | {Diagnosis.COMPONENT_STALLED}
_BESIDE = frozenset({Diagnosis.GATEWAY_LOST, Diagnosis.SPARE_LOST})
#: Only shown, whatever they are given.
_ONLY_SHOWN = frozenset({Diagnosis.STARVED, Diagnosis.SLEPT})
#: What is done on them is no policy's: a person asked for it, or what was found has to be ended.
_DECIDED = frozenset({Diagnosis.OPERATOR, Diagnosis.SENTINEL_LOST, Diagnosis.STORE_AWAY})
#: Words that can't be done on some diagnoses, and why.
_UNDOABLE: tuple[tuple[frozenset[Word], frozenset[Diagnosis], str], ...] = (
    (
        frozenset({Word.SAFE_MODE_ENTER}),
        HUNG,
        "a core that hangs can't be told to read only: REBOOT_PROCESS ends it, AWAIT_OPERATOR leaves it",
    ),
    (
        frozenset({Word.SHUTDOWN}),
        LIVING,
        "SHUTDOWN keeps a dead core down and ends no living one: REBOOT_PROCESS ends it, AWAIT_OPERATOR leaves it",
    ),
    (frozenset({Word.DEGRADE}), _GONE, "there is no core left that DEGRADE could keep"),
    (frozenset(Word) - {Word.NONE}, _ONLY_SHOWN, "it is only shown, and nothing is ever done for it: NONE"),
    (
        frozenset({Word.AWAIT_OPERATOR, Word.SHUTDOWN, Word.SAFE_MODE_ENTER}),
        _DECIDED,
        "another core is started in any case",
    ),
    (
        frozenset({Word.REBOOT_PROCESS}),
        frozenset({Diagnosis.CRASH_LOOP}),
        "a spent budget is tried again after slow_retry_sec, and no sooner",
    ),
    (
        frozenset({Word.RESTART_COMPONENT}),
        frozenset(Diagnosis) - {Diagnosis.COMPONENT_STALLED} - _ONLY_SHOWN,
        "only a part that stands still while the others go on can be started anew alone",
    ),
    (
        frozenset({Word.PLANNED_SWITCH}),
        frozenset(Diagnosis) - _SWITCHABLE - _ONLY_SHOWN,
        "a switch in a quiet moment is for a core that still answers: REBOOT_PROCESS",
    ),
    (
        frozenset(Word) - {Word.SEND_ALERT, Word.SNAPSHOT, Word.PLANNED_SWITCH, Word.NONE},
        FORECAST,
        "nothing has happened yet: PLANNED_SWITCH replaces the core in a quiet moment, SEND_ALERT tells you",
    ),
    (
        frozenset({Word.DEGRADE, Word.SAFE_MODE_ENTER, Word.SHUTDOWN}),
        _BESIDE,
        "the core that serves has nothing to do with it",
    ),
    (
        frozenset({Word.AWAIT_OPERATOR}),
        _BESIDE - {Diagnosis.GATEWAY_LOST},
        "the core that serves has nothing to do with it",
    ),
)


#: Drills that may run while nobody watches: each is over by itself.
SCHEDULED_DRILLS = (
    "crash",
    "segv",
    "exit",
    "freeze",
    "block",
    "spin",
    "gil",
    "deadlock",
    "slow-tx",
    "poison",
)


@dataclass(frozen=True, slots=True)
class Policy:
    """The policy in force. Units stand at the end of each name."""

    version: int = setting(VERSION, "format of this file", low=VERSION, high=VERSION)
    mode: str = setting(
        "act",
        "what the guard may do: act; assist tells you and waits for your word; observe only records",
        words=("act", "assist", "observe"),
    )
    health_check_interval_ms: int = setting(100, "time between two looks at the core", low=10, high=10_000)
    health_check_timeout_ms: int = setting(300, "a beat older than this is late", low=30, high=600_000)
    failure_threshold: int = setting(3, "looks in a row that make a beat late", low=1, high=1000)
    confirm_deadlock_ms: int = setting(400, "a conclusive hang is acted on after this", low=40, high=600_000)
    confirm_hang_ms: int = setting(1500, "any other hang is acted on after this", low=40, high=3_600_000)
    gc_grace_ms: int = setting(
        5000, "patience with a hang while the core collects garbage", low=0, high=3_600_000
    )
    transaction_timeout_ms: int = setting(
        5000, "time a transaction may be decided, or go on without progress", low=100, high=3_600_000
    )
    probe_interval_ms: int = setting(
        1000, "time between two questions for the core's health", low=100, high=600_000
    )
    survey_interval_ms: int = setting(
        1000, "time between two looks at disk, conduct and memory counters", low=100, high=600_000
    )
    disk_floor_mb: int = setting(16, "less room than this on the ledger's disk is full", low=0, high=1 << 20)
    disk_slow_ms: int = setting(
        2000, "our own small write slower than this is a stalled disk", low=50, high=600_000
    )
    safe_retry_ms: int = setting(
        5000, "first try to leave reading only; doubles up to a minute", low=100, high=60_000
    )
    startup_timeout_ms: int = setting(20_000, "a core must be ready after this", low=100, high=3_600_000)
    probation_ms: int = setting(2000, "a core has proven itself after this", low=0, high=3_600_000)
    degraded_after_ms: int = setting(1000, "worry for so long is shown as DEGRADED", low=0, high=600_000)
    clean_after_ms: int = setting(10_000, "calm for so long ends DEGRADED", low=0, high=3_600_000)
    stop_timeout_ms: int = setting(5000, "a core asked to leave is killed after this", low=10, high=600_000)
    kill_timeout_ms: int = setting(500, "a killed core not gone by then is unkillable", low=10, high=600_000)
    restart_delay_ms: int = setting(0, "pause before a proven core is replaced", low=0, high=600_000)
    backoff_initial_ms: int = setting(500, "first pause after an unproven core", low=1, high=600_000)
    backoff_max_ms: int = setting(30_000, "longest such pause", low=1, high=3_600_000)
    max_restart_count: int = setting(5, "unplanned deaths allowed in a window", low=1, high=1000)
    restart_window_sec: int = setting(60, "length of that window", low=1, high=86_400)
    slow_retry_sec: int = setting(300, "a try this long after giving up; 0: never", low=0, high=86_400)
    drain_timeout_ms: int = setting(
        2000, "time to finish what is under way before a switch", low=10, high=600_000
    )
    spare: bool = setting(True, "keep a warm spare core that takes over at once")
    spare_memory_mb: int = setting(1024, "with less free memory no spare is kept", low=0, high=1 << 20)
    promote_timeout_ms: int = setting(
        3000, "a spare that has not taken over by then is ended", low=50, high=600_000
    )
    snapshot_budget_ms: int = setting(400, "time for the evidence before a kill", low=10, high=60_000)
    memory_image: str = setting(
        "never",
        "whether a core's memory is written out before it is killed (needs gdb)",
        words=("never", "on_request", "always"),
    )
    memory_image_budget_ms: int = setting(
        5000, "time for a memory image; the kill waits so long", low=100, high=600_000
    )
    memory_image_mb_max: int = setting(1024, "a larger memory is not written out", low=1, high=1 << 20)
    enable_state_recovery: bool = setting(
        True, "a start proves the ledger from its newest good checkpoint on; false: the whole chain"
    )
    checkpoint_interval_sec: int = setting(
        60, "time between two checkpoints while something is written", low=1, high=86_400
    )
    checkpoints_kept: int = setting(10, "checkpoints kept; the oldest go first", low=1, high=1000)
    checkpoint_age_hours: int = setting(24, "a checkpoint older than this is removed", low=1, high=8760)
    memory_limit_mb: int = setting(
        512,
        "memory a core may use: above 80 % of it a census is taken and the watch is worried",
        low=64,
        high=1 << 20,
    )
    trial_limit: int = setting(
        64,
        "suspects of one death that are tried; more are run, or after a second death left to a person",
        low=0,
        high=10_000,
    )
    max_convictions: int = setting(
        10, "convictions in 60 s of what one source sent; more stop that source", low=1, high=1000
    )
    source_stop_sec: int = setting(
        600, "a source that is stopped may change nothing for so long", low=1, high=86_400
    )
    drills: bool = setting(True, "whether `hardcore drill` may break the core")
    drill_every_hours: int = setting(0, "time between two drills on a schedule; 0: none", low=0, high=8760)
    drill_faults: tuple[str, ...] = setting(
        ("crash",), "what is drilled on a schedule, one after the other", words=SCHEDULED_DRILLS
    )
    drill_hour: int = setting(4, "the hour of the day (local time) of a drill on a schedule", low=0, high=23)
    forecast_horizon_sec: int = setting(
        1800, "what would run out within so long is told of before it does", low=10, high=604_800
    )
    forecast_warmup_sec: int = setting(
        900, "a core's growth is not looked at for so long after its start", low=0, high=86_400
    )
    forecast_confirm_sec: int = setting(
        300, "a forecast has to stand for so long before it is told", low=0, high=86_400
    )
    forecast_interval_sec: int = setting(
        60, "only the lowest value in so long counts: what garbage collection leaves", low=1, high=3600
    )
    forecast_switches_max: int = setting(
        3, "planned switches because of forecasts in a day; beyond them it is only told", low=0, high=100
    )
    threads_max: int = setting(256, "threads of a core; a forecast is made against it", low=16, high=65_536)
    await_operator_sec: int = setting(
        300, "how long a person is waited for before `on_await_timeout` is done", low=1, high=86_400
    )
    on_await_timeout: tuple[str, ...] = setting(
        (str(Word.SEND_ALERT),),
        "what is done when nobody has come",
        words=tuple(
            map(
                str,
                (Word.SEND_ALERT, Word.REBOOT_PROCESS, Word.SAFE_MODE_ENTER, Word.SHUTDOWN, Word.NONE),
            )
        ),
    )
    enable_leader_election: bool = setting(False, "several hosts (not in this version)")
    actions: Mapping[Diagnosis, frozenset[Word]] = field(default_factory=dict)
    gateway: Limits = field(default_factory=Limits)
    alerts: tuple[Channel, ...] = ()  # who is told; an address may hold a secret, so no recording carries it

    def words(self, diagnosis: Diagnosis) -> frozenset[Word]:
        """Return what is to be done on this diagnosis."""
        return self.actions.get(diagnosis, DEFAULT_ACTIONS[diagnosis])

    def asks(self, diagnosis: Diagnosis, word: Word) -> bool:
        """Return whether this policy has `word` done on `diagnosis`."""
        return word in self.words(diagnosis)


class PolicyFault(msgspec.Struct, frozen=True):
    """One thing wrong with a policy file: the line it stands in (0: the whole file) and why."""

    line: int
    name: str
    reason: str

    def __str__(self) -> str:
        where = f"line {self.line}: " if self.line else ""
        return f"{where}{self.name}: {self.reason}" if self.name else f"{where}{self.reason}"


def _shown(words: str) -> str:
    cut = words if len(words) <= WORDS_MAX else words[: WORDS_MAX - 1] + "…"
    return cut if cut.isprintable() else ascii(cut)[1:-1]


def _read_actions(value: object) -> dict[Diagnosis, frozenset[Word]] | list[Fault]:
    if not isinstance(value, dict):
        return [Fault("actions", "must be an object of diagnosis: [words]")]
    actions: dict[Diagnosis, frozenset[Word]] = {}
    faults: list[Fault] = []
    for name, words in value.items():
        if name not in Diagnosis.__members__:
            faults.append(Fault(str(name), "is not a diagnosis this guard knows"))
        elif not isinstance(words, list) or not words:
            faults.append(Fault(str(name), "must be a list of at least one word"))
        elif strange := [w for w in words if not isinstance(w, str) or w not in Word.__members__]:
            faults.append(Fault(str(name), f"{strange[0]!r} is not a word for an action"))
        else:
            actions[Diagnosis(name)] = frozenset(Word(w) for w in words)
    return faults or actions


def _contradictions(policy: Policy) -> list[Fault]:
    """Return what is wrong between the numbers, though each alone is in its bounds."""
    faults = []
    if policy.health_check_timeout_ms < policy.health_check_interval_ms * policy.failure_threshold:
        faults.append(
            Fault(
                "health_check_timeout_ms", "must be at least health_check_interval_ms times failure_threshold"
            )
        )
    if policy.confirm_deadlock_ms <= policy.health_check_timeout_ms:
        faults.append(Fault("confirm_deadlock_ms", "must be more than health_check_timeout_ms"))
    if policy.confirm_hang_ms < policy.confirm_deadlock_ms:
        faults.append(Fault("confirm_hang_ms", "must not be less than confirm_deadlock_ms"))
    if policy.backoff_max_ms < policy.backoff_initial_ms:
        faults.append(Fault("backoff_max_ms", "must not be less than backoff_initial_ms"))
    if policy.transaction_timeout_ms <= policy.health_check_timeout_ms:
        faults.append(Fault("transaction_timeout_ms", "must be more than health_check_timeout_ms"))
    if policy.enable_leader_election:
        faults.append(Fault("enable_leader_election", "several hosts: not in this version"))
    faults += _contradictory_patience(policy)
    for diagnosis, words in policy.actions.items():
        faults.extend(_contradictory_words(diagnosis, words))
    return faults


def _contradictory_patience(policy: Policy) -> list[Fault]:
    """Return what is wrong between the words for when nobody has come."""
    asked, name = frozenset(policy.on_await_timeout), "on_await_timeout"
    faults = []
    if Word.NONE in asked and len(asked) > 1:
        faults.append(Fault(name, "NONE can't stand beside other words"))
    if len(asked & {Word.REBOOT_PROCESS, Word.SAFE_MODE_ENTER, Word.SHUTDOWN}) > 1:
        faults.append(Fault(name, "restart it, serve reads only, or stay down: only one of them"))
    return faults


def _contradictory_words(diagnosis: Diagnosis, words: frozenset[Word]) -> list[Fault]:
    faults = []
    if Word.NONE in words and len(words) > 1:
        faults.append(Fault(diagnosis, "NONE can't stand beside other words"))
    if Word.REBOOT_PROCESS in words and words & {Word.AWAIT_OPERATOR, Word.SAFE_MODE_ENTER}:
        faults.append(
            Fault(diagnosis, "restart it, or leave it to wait or to read only: only one of the two")
        )
    if {Word.SHUTDOWN, Word.SAFE_MODE_ENTER} <= words:
        faults.append(Fault(diagnosis, "stay down, or serve reads only: only one of the two"))
    if {Word.REBOOT_PROCESS, Word.SHUTDOWN} <= words:
        faults.append(Fault(diagnosis, "restart it, or stay down: only one of the two"))
    if diagnosis in NEVER_REBOOT and Word.REBOOT_PROCESS in words:
        faults.append(Fault(diagnosis, "a ledger that may be damaged is never restarted by itself"))
    faults += [
        Fault(diagnosis, why) for undoable, on, why in _UNDOABLE if diagnosis in on and undoable & words
    ]
    return faults


def read_policy(text: str) -> Policy | list[PolicyFault]:
    """Return the policy that `text` describes, or everything that is wrong with it, in line order."""
    found = parse(text)
    if isinstance(found, Broken):
        return [PolicyFault(found.line, _shown(found.name), _shown(found.reason))]
    values = dict(found.values)
    special = _read_special(values)
    plain = read(Policy, values)
    faults = [(group, fault) for group, read in special.items() if isinstance(read, list) for fault in read]
    if isinstance(plain, list):
        faults += [("", fault) for fault in plain]
    elif not faults:
        policy = dataclasses.replace(plain, **special)  # type: ignore[arg-type]  # faults are ruled out
        faults = [
            ("actions" if one.name in Diagnosis.__members__ else "", one) for one in _contradictions(policy)
        ]
        if not faults:
            return policy
    return _in_their_lines(found, faults)


def _read_special(values: dict[str, object]) -> dict[str, object]:
    """Take out of `values` what is no number or word of its own; each is its value, or a list of faults."""
    special: dict[str, object] = {}
    if "actions" in values:
        special["actions"] = _read_actions(values.pop("actions"))
    if "gateway" in values:
        held = values.pop("gateway")
        special["gateway"] = (
            read(Limits, held) if isinstance(held, dict) else [Fault("gateway", "must be an object")]
        )
    if "alerts" in values:
        special["alerts"] = read_channels(values.pop("alerts"))
    return special


def _in_their_lines(found: Located, faults: list[tuple[str, Fault]]) -> list[PolicyFault]:
    lines = found.lines()
    told = [
        PolicyFault(nearest(lines, _path(group, one)), _shown(one.name), _shown(one.reason))
        for group, one in faults
    ]
    return sorted(told, key=lambda fault: fault.line)


def _path(group: str, fault: Fault) -> Path:
    """Return the way to what is wrong; of a channel its number and its field stand in the reason."""
    if group == "alerts":
        named = re.match(r"channel (\d+): '?(\w*)", fault.reason)
        return ("alerts",) if named is None else ("alerts", int(named[1]) - 1, named[2])
    return (group, fault.name) if group and fault.name != group else (fault.name,)


def in_full(policy: Policy) -> dict[str, object]:
    """Return every number and every diagnosis' actions, as this policy has them, but no channel: those may hold secrets."""
    numbers = {f.name: getattr(policy, f.name) for f in dataclasses.fields(policy) if "text" in f.metadata}
    actions = {str(diagnosis): sorted(map(str, policy.words(diagnosis))) for diagnosis in Diagnosis}
    return {**numbers, "actions": actions, "gateway": dataclasses.asdict(policy.gateway)}


def shipped_text() -> str:
    """Return the policy file that a first start writes: every number with its default."""
    numbers = {
        f.name: f.default
        for f in dataclasses.fields(Policy)
        if "text" in f.metadata and "not in this version" not in f.metadata["text"]
    }
    return json.dumps({**numbers, "actions": {}, "alerts": []}, indent=2) + "\n"
