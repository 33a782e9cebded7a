"""All that the manager remembers, as one value.

It is data and nothing else: whoever writes it down and gives it to another manager has the same manager, which is
what `hardcore replay` does. What a manager is *given* (the policy, ids, chance) is kept apart: it is not remembered.
State spread over the objects that use it was not chosen: nobody could say then what a successor has to know.
"""

from collections import deque
from collections.abc import Callable

import msgspec

from hardcore.model.actions import Action
from hardcore.model.observations import CoreObservation, CoreReady
from hardcore.model.phases import HAState, Phase, StartCause, Wanted
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import GREEN, Diagnosis, Testimony, Verdict
from hardcore.recovery import plan
from hardcore.recovery.audit import Audit
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S, Budget
from hardcore.recovery.calm import Calm
from hardcore.recovery.court import Court
from hardcore.recovery.curiosity import Curiosity
from hardcore.recovery.deadline import Deadline
from hardcore.recovery.drill import PendingDrill
from hardcore.recovery.foresight import Foresight
from hardcore.recovery.policy import Policy
from hardcore.recovery.reading import StateChange, Transition
from hardcore.recovery.repair import Repair
from hardcore.recovery.safety import Safety, safety
from hardcore.recovery.spare import Behind, Spare, spare
from hardcore.recovery.store import StoreKnowledge
from hardcore.recovery.story import Story, Trouble
from hardcore.recovery.suspicion import Growth
from hardcore.recovery.troubles import Troubles
from hardcore.recovery.worry import Worry
from hardcore.sentinel.verdict import Bench
from hardcore.sentinel.witnesses.own_stall import LATE_INTERVALS

TRANSITIONS_MAX = 1024
#: Changes of the state that are remembered.
HISTORY_MAX = 256
#: So much of what a core says while it is drained is kept: the newest.
LATER_MAX = 16
#: Deaths whose pages may still come: the present core's, and that of one left behind.
FALLS_MAX = 4
#: So many deaths in a row that a command was finished near make it likely.
NEAR_DEATHS = 3


class Given(msgspec.Struct, frozen=True):
    """What a manager is given: `new_id` gives incident ids, `jitter` numbers from 0 to 1."""

    policy: Policy
    new_id: Callable[[], str]
    jitter: Callable[[], float]


class Switching(msgspec.Struct):
    """A switch that was asked for and that has not been done. Times are monotonic.

    `build`: the code that lay on the disk then; `updates`: it is not what serves, or spares have died of it, so only a
    spare can show that it starts. `born`: the last life that had begun by then. `give_up_ns`: until when a spare is waited
    for, from when one may be kept; `again_ns`: when a core that could not be drained is asked again.
    """

    trouble: Trouble
    reason: str
    build: str
    born: int
    updates: bool = False
    give_up_ns: int | None = None
    drains: int = 0
    again_ns: int | None = None
    # No person asked for it: it waits for a calm moment until then, and after that until what grows has no room left.
    ours: bool = False
    patience_ns: int = 0
    limit_ns: int | None = None


class Fall(msgspec.Struct, frozen=True):
    """A death as it was first told, or ordered. `booting`: before it served; `early`: in its probation, or just after a
    suspect was cleared. `judged`: what its page says of nobody at work was heard.
    """

    life: int
    at_ns: int
    booting: bool = False
    early: bool = False
    judged: bool = False


class Course(msgspec.Struct):
    """The state of one manager. Times are monotonic."""

    given: Given
    wanted: Wanted
    budget: Budget
    deadline: Deadline
    bench: Bench
    worry: Worry
    safety: Safety
    troubles: Troubles
    spare: Spare
    court: Court
    phase: Phase = Phase.STOPPED
    since_ns: int = 0
    delay_ns: int = 0
    cause: StartCause = StartCause.FIRST
    stage_max: int = 0
    born: int = 0  # lives that were given a number, cores and spares
    # The present life.
    life: int = 0
    reader: Diagnosis | None = None  # it was started to serve reads only, because of this
    epoch: int | None = None  # what it serves under
    promoted: bool = False  # it was a spare
    there: bool = False  # its process exists, as far as anybody said
    challenge: Witness | None = None  # what it has to prove its ledger against
    blame: Diagnosis = Diagnosis.OPERATOR  # what its end is called
    unseen: bool = False  # nobody could say how it ended
    heard_ns: int = 0  # its loop's last beat that was seen
    looked_ns: int = 0  # when one was looked for
    outlasted_ns: int | None = None  # when the time of its probation was over, whatever it looked like then
    term_sent: bool = False
    verdict: Verdict = GREEN
    growth: Growth = msgspec.field(default_factory=Growth)
    curiosity: Curiosity = msgspec.field(default_factory=Curiosity)
    pressed_ns: int | None = None  # since when it has held more memory than it may; 0: that was told
    pressed_looked_ns: int = 0  # when that was last looked at
    awaits: CoreReady | None = None  # it is ready, and is to say first that it reads only
    ask_again_ns: int | None = None  # when it is told so again
    repair: Repair = msgspec.field(default_factory=Repair)
    # What outlives it.
    behind: Behind | None = None  # a core that lives on behind the fence
    switching: Switching | None = None
    falls: tuple[Fall, ...] = ()  # the last deaths
    near: tuple[
        frozenset[str], ...
    ] = ()  # what was finished shortly before the last deaths that nobody was at work in
    pause_until_ns: int | None = (
        None  # a start waits for the log's trial; without it, it would have waited so long
    )
    later: tuple[CoreObservation, ...] = ()  # what a core that is drained said, for when it serves again
    consent: bool = True  # a person asked for what comes next, whatever the mode
    left: bool = False  # a core that is gone is not replaced, because of the mode
    shut: bool = False  # the policy shut the service down: only a person starts it again
    offered: Trouble | None = (
        None  # what another core would help against, where the mode leaves that to a person
    )
    relieved_ns: tuple[int, ...] = ()  # when the last switches were done that no person asked for
    relief_pause_ns: int = 0  # after one that could not be done: how long none is tried
    relief_after_ns: int = 0  # and until when
    calm: Calm = msgspec.field(default_factory=Calm)
    state: HAState = HAState.STARTING  # as it was last told
    history: tuple[StateChange, ...] = ()
    needs_ns: int | None = None  # since when a person is needed
    overdue: bool = False  # nobody came in time, and what the policy says about that was done
    why: str = ""  # what this step began with
    switch_fault: str = ""  # why the last one that was asked for was given up
    start_fault: str = ""  # what the core said last that died before it served; of the last death
    store: StoreKnowledge = msgspec.field(default_factory=StoreKnowledge)
    audit: Audit = msgspec.field(default_factory=Audit)
    foresight: Foresight = msgspec.field(default_factory=Foresight)
    drill: PendingDrill = msgspec.field(default_factory=PendingDrill)
    story: Story | None = None
    held_ns: int | None = None  # since when the gateway has been holding
    tries: int = 0  # cores in a row that proved nothing
    hopeless: Diagnosis | None = None  # why another try makes no sense
    reader_tried: bool = False  # no core that may write has been started since the last reader
    holder: Testimony | None = None  # who was last found to hold the store's lock
    trying: Diagnosis | None = None  # the next core finds out whether this reason is over
    # What one step tells the next on the way.
    pending: Trouble | None = None
    troubled: Diagnosis | None = None
    worth_a_look: bool = False
    image_asked: bool = False
    skip_evidence: bool = False
    actions: list[Action] = msgspec.field(default_factory=list)
    transitions: deque[Transition] = msgspec.field(default_factory=lambda: deque(maxlen=TRANSITIONS_MAX))

    @property
    def policy(self) -> Policy:
        """The policy in force."""
        return self.given.policy


def course(given: Given, wanted: Wanted, deaths_ns: tuple[int, ...]) -> Course:
    """Return the state of a manager that has heard nothing yet; `deaths_ns` count on its budget."""
    policy = given.policy
    return Course(
        given,
        wanted,
        Budget(policy.max_restart_count, policy.restart_window_sec * NS_PER_S, deaths_ns),
        Deadline(int(policy.health_check_interval_ms * NS_PER_MS * LATE_INTERVALS)),
        Bench(plan.patience(policy)),
        Worry(policy.degraded_after_ms, policy.clean_after_ms),
        safety(
            policy.safe_retry_ms,
            policy.disk_floor_mb,
            policy.disk_slow_ms,
            policy.slow_retry_sec,
            held=wanted is Wanted.SAFE,
        ),
        Troubles(policy.clean_after_ms * NS_PER_MS),
        spare(policy),
        Court(plan.rules(policy)),
    )
