"""Reading only: whether the core that serves may write, and when it is told to try again.

The core is told (`SetSafe`) or was started so; it may also have switched itself, because its store took a write no
longer. What it says of itself counts, not what it was told: an order may be lost, or carried out late. For a
disk's reasons a try to write is made by itself, at doubling pauses and only while the disk witness has nothing
against it; for a lock of somebody else's, when a look at the lock finds it free: a try ends the reading for some
seconds. For any other reason that the policy answers so a try is made after a minute and then at doubling pauses up to
`slow_retry_sec`, while nobody complains: such a try may cost a start. A damaged ledger alone waits for a person. A mode
that is left when the disk looks well again was not chosen: only a write that was taken proves that writes are taken.

A person may want reads only as well (`held`). That outlives every core, is left by that person alone, and while it
holds nothing is tried: a try is a moment in which a write is taken.
"""

from enum import StrEnum
from typing import assert_never

import msgspec

from hardcore.model.looks import DiskFacts
from hardcore.model.observations import SafeSwitched, StoreFault
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S

#: An order that was not answered within this is lost, or as good as refused.
ANSWER_NS = 5 * NS_PER_S
#: The pauses between two tries double up to this.
RETRY_NS_MAX = 60 * NS_PER_S
#: For reasons that say nothing of when they are over, the first pause is so long.
SLOW_TRY_NS = 60 * NS_PER_S
#: While the disk is not well, it is looked at again after this.
LOOK_AGAIN_NS = NS_PER_S

#: Reasons that end when somebody makes room.
DISK = frozenset({Diagnosis.DISK_FULL, Diagnosis.DISK_READ_ONLY, Diagnosis.DISK_STALLED})
#: Reasons that end without a word to the guard: it finds out by itself.
PASSING = DISK | {Diagnosis.DB_LOCKED, Diagnosis.STORE_AWAY}
#: What a person's own wish is called.
BY_OPERATOR = Diagnosis.OPERATOR
#: Reasons that say nothing of when they are over: a try is dear, and is made seldom.
SLOW = frozenset(Diagnosis) - PASSING - {Diagnosis.STORE_CORRUPT, BY_OPERATOR}
#: What a core's own word about its store means.
TOLD = {
    StoreFault.FULL: Diagnosis.DISK_FULL,
    StoreFault.READ_ONLY: Diagnosis.DISK_READ_ONLY,
}


class Mode(StrEnum):
    """Where the switch stands."""

    OFF = "off"
    ENTERING = "entering"  # told to read only, not answered yet
    ON = "on"
    LEAVING = "leaving"  # told to try to write, not answered yet


class Deed(StrEnum):
    """What has to be done now."""

    NOTHING = "nothing"
    ORDER_ON = "order-on"
    ORDER_OFF = "order-off"
    LOOK = "look"  # whether the lock is still held
    RENEW = "renew"  # the core was started to read only: another one has to try


class Safety(msgspec.Struct):
    """The switch of the present core. Times are monotonic; `due_ns` is when `ring` wants to be called.

    `since_ns` is when the core last said which it is. `reason` is why it serves reads only, `goal` why it was told to
    and `asked` why it last was. `locked` outlives a core: a ledger that is known to be damaged is read only until the
    operator says `resume`, whichever core serves it. So does `held`: the operator wants reads only. `disk` is the
    newest look at the disk while this core serves.
    """

    retry_ns: int
    floor_bytes: int
    slow_ns: int
    slow_try_ns_max: int = 0  # 0: for a reason that does not pass by itself nothing is tried
    mode: Mode = Mode.OFF
    reason: Diagnosis | None = None
    goal: Diagnosis | None = None
    locked: bool = False
    held: bool = False
    due_ns: int | None = None
    asked: Diagnosis | None = None
    since_ns: int = 0
    disk: DiskFacts | None = None
    _started: bool = False
    _wait_ns: int = 0
    _looking: bool = False

    @property
    def on(self) -> bool:
        """Whether the core serves reads only, or was told to."""
        return self.mode is not Mode.OFF

    @property
    def trouble(self) -> Diagnosis | None:
        """Why the core serves reads only, if nobody wanted that."""
        return self.reason if self.reason is not BY_OPERATOR else None

    @property
    def troubled(self) -> bool:
        """Whether it serves reads only, or was told to, though nobody wanted that."""
        return self.on and self.goal is not BY_OPERATOR

    def begin(self, reason: Diagnosis | None, now_ns: int) -> Deed:
        """Another core serves; `reason`: it was started to read only, because of this. Return what has to be done."""
        self.leave()
        self.asked, self.since_ns = None, now_ns
        if reason is not None:
            self._started = True
            self._enter(reason, now_ns)
        return self._hold(now_ns) if self.held else Deed.NOTHING

    def want(self, now_ns: int, *, reads_only: bool) -> Deed:
        """The operator wants reads only until the opposite is said; or everything served again.

        What else speaks against that goes on to do so.
        """
        self.held = reads_only
        return self._hold(now_ns) if reads_only else self._release(now_ns)

    def enter(self, reason: Diagnosis, now_ns: int) -> Deed:
        """Have the core serve reads only. A damaged ledger overrules the other reasons, and stays."""
        damaged = reason is Diagnosis.STORE_CORRUPT
        self.locked = self.locked or damaged
        if self.goal is reason or (self.on and not damaged):
            return Deed.NOTHING
        if self._started:
            self._enter(reason, now_ns)
            return Deed.NOTHING
        self.goal = self.asked = reason
        self.mode, self.due_ns = Mode.ENTERING, now_ns + ANSWER_NS
        return Deed.ORDER_ON

    def told(self, fault: StoreFault, now_ns: int) -> None:
        """Take in what the core says of its store: it switches itself."""
        if fault is StoreFault.OK:
            if self.goal in DISK:
                self._left(now_ns)
        elif self.mode in {Mode.OFF, Mode.ENTERING} and not (self.locked or self.held):
            self._enter(TOLD[fault], now_ns)

    def switched(self, fact: SafeSwitched) -> None:
        """Take in the core's answer to an order; a late one is as true as one in time."""
        if fact.on and fact.done:
            if self.asked is not None and self.mode in {Mode.OFF, Mode.ENTERING}:
                self._enter(self.asked, fact.at_ns)
        elif fact.on:
            self.due_ns = fact.at_ns + ANSWER_NS if self.mode is Mode.ENTERING else self.due_ns
        elif fact.done:
            if self.mode is not Mode.ENTERING:
                self._left(fact.at_ns)
        elif self.mode is Mode.LEAVING:
            self._failed(fact.at_ns)

    def found(self, reason: Diagnosis, now_ns: int) -> bool:
        """Take in that the core was found to read only; return whether that is news.

        It is where an earlier guard has told it to, or its own word was heard by nobody.
        """
        if self.mode is not Mode.OFF:
            return False
        self.locked = self.locked or reason is Diagnosis.STORE_CORRUPT
        self._enter(reason, now_ns)
        return True

    def writes(self, now_ns: int) -> Deed:
        """Take in that the core was found to serve everything; return what has to be done if it is not to."""
        if self.mode is not Mode.ON or self._started:
            return Deed.NOTHING
        if self.locked or self.held:
            self.mode, self.due_ns = Mode.ENTERING, now_ns + ANSWER_NS
            return Deed.ORDER_ON
        self._left(now_ns)
        return Deed.NOTHING

    def ring(self, now_ns: int, *, quiet: bool) -> Deed:
        """Return what has to be done at this moment, if the time for something has come.

        `quiet`: nobody complains any more. Then a core that never answered need not read only, and is told so.
        """
        if self.due_ns is None or now_ns < self.due_ns:
            return Deed.NOTHING
        if self.mode is Mode.ENTERING:
            return self._ask_again(now_ns, quiet=quiet)
        if self.mode is Mode.LEAVING:
            self._failed(now_ns)
            return Deed.NOTHING
        if not (self._well() and (quiet or self.goal in PASSING)):
            self.due_ns = now_ns + LOOK_AGAIN_NS
            return Deed.NOTHING
        if self.goal is Diagnosis.DB_LOCKED and not self._looking:
            self._looking, self.due_ns = True, now_ns + ANSWER_NS
            return Deed.LOOK
        return self.try_to_write(now_ns)  # also if nobody could say who holds the lock

    def looked(self, *, held: bool, now_ns: int) -> Deed:
        """Take in whether somebody else holds the store's lock; return what has to be done, if that was asked."""
        if not self._looking:
            return Deed.NOTHING
        self._looking = False
        if held:
            self.due_ns = now_ns + LOOK_AGAIN_NS
            return Deed.NOTHING
        return self.try_to_write(now_ns)

    def try_to_write(self, now_ns: int) -> Deed:
        """Try to leave at once, whatever the disk looks like: its time has come, or the operator says so."""
        if self.mode is Mode.OFF or self.mode is Mode.LEAVING:
            return Deed.NOTHING
        if self.held and not self._started:
            return self._keep_to_the_operator(now_ns)
        self._looking = False
        first_ns, most_ns = self._pauses()
        self._wait_ns = min(2 * (self._wait_ns or first_ns), most_ns)
        if self._started:
            self.due_ns = None
            return Deed.RENEW
        self.mode, self.due_ns = Mode.LEAVING, now_ns + ANSWER_NS
        return Deed.ORDER_OFF

    def leave(self) -> None:
        """The core serves everything again, or is gone."""
        self.mode, self.reason, self.goal = Mode.OFF, None, None
        self.due_ns, self._started, self.disk, self._looking = None, False, None, False

    def forget(self) -> None:
        """The trouble is over: the next one begins with the first pause."""
        self._wait_ns = 0

    def _hold(self, now_ns: int) -> Deed:
        match self.mode:
            case Mode.OFF:
                self.goal = self.asked = BY_OPERATOR
            case Mode.LEAVING:
                self.asked = self.goal
            case Mode.ON:
                self._plan(now_ns)
                return Deed.NOTHING
            case Mode.ENTERING:
                return Deed.NOTHING
            case _:
                assert_never(self.mode)
        self.mode, self.due_ns = Mode.ENTERING, now_ns + ANSWER_NS
        return Deed.ORDER_ON

    def _release(self, now_ns: int) -> Deed:
        if self.mode is Mode.OFF or self.goal is not BY_OPERATOR:
            if self.mode is Mode.ON:
                self._plan(now_ns)
            return Deed.NOTHING
        if self.mode is Mode.ENTERING and self.reason is None:
            self._left(now_ns)
            self.asked = BY_OPERATOR
            return Deed.ORDER_OFF
        return self.try_to_write(now_ns)

    def _enter(self, reason: Diagnosis, now_ns: int) -> None:
        served_ns, slow = now_ns - self.since_ns, reason not in PASSING
        self.mode, self.reason, self.goal, self.since_ns = Mode.ON, reason, reason, now_ns
        first_ns, _ = self._pauses()
        anew = slow and not self._started and served_ns > self._wait_ns  # it has written for long meanwhile
        self._wait_ns = (
            first_ns if anew else max(self._wait_ns, first_ns) if slow else self._wait_ns or first_ns
        )
        self._plan(now_ns)

    def _left(self, now_ns: int) -> None:
        self.leave()
        self.since_ns = now_ns

    def _failed(self, now_ns: int) -> None:
        self.mode = Mode.ON
        self._plan(now_ns)

    def _keep_to_the_operator(self, now_ns: int) -> Deed:
        """What else spoke against writing is to be tried, and a person wants reads only: nothing is tried."""
        if self.goal is BY_OPERATOR or self.locked:
            return Deed.NOTHING
        self.goal = self.asked = BY_OPERATOR
        self.mode, self.due_ns = Mode.ENTERING, now_ns + ANSWER_NS
        return Deed.ORDER_ON

    def _slowly(self) -> bool:
        """Whether a reason that says nothing of its end is tried all the same."""
        return self.goal in SLOW and self.slow_try_ns_max > 0

    def _pauses(self) -> tuple[int, int]:
        """Return the first pause before a try and the longest one."""
        if self._slowly():
            return SLOW_TRY_NS, max(SLOW_TRY_NS, self.slow_try_ns_max)
        return self.retry_ns, RETRY_NS_MAX

    def _plan(self, now_ns: int) -> None:
        # Whoever was started to read only makes room for one that is told to. While a person wants reads only, what has
        # passed is let go of, and no write is tried.
        held = self.held and not self._started
        again = self.goal in PASSING or (not held and (self.goal is BY_OPERATOR or self._slowly()))
        self.due_ns = now_ns + self._wait_ns if again and not self.locked else None

    def _ask_again(self, now_ns: int, *, quiet: bool) -> Deed:
        if quiet and not (self.locked or self.held) and self.reason is None:
            self._left(now_ns)
            return Deed.ORDER_OFF
        self.due_ns = now_ns + ANSWER_NS
        return Deed.ORDER_ON

    def _well(self) -> bool:
        disk = self.disk
        if disk is None:
            return True
        slow = max(disk.write_ns or 0, disk.pending_ns) >= self.slow_ns
        return not (disk.read_only or disk.fault or slow or disk.free_bytes < self.floor_bytes)


def safety(
    retry_ms: int, floor_mb: int, slow_ms: int, slow_retry_s: int = 0, *, held: bool = False
) -> Safety:
    """Return the switch with the numbers of a policy. `held`: the operator wants reads only."""
    slowest_ns = slow_retry_s * NS_PER_S
    return Safety(retry_ms * NS_PER_MS, floor_mb << 20, slow_ms * NS_PER_MS, slowest_ns, held=held)
