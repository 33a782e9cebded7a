r"""The life of one request as a table, what may be done with it after a death, and who may wait.

Two promises are kept here. A request that was answered 503 never runs for the first time afterwards: the
only way from HELD to the core is PASS, and an answer ends the life. And nobody is told "not done" about a
request that the core may have seen, unless a later core has looked it up (LOST -> ASKED -> ABSENT).
The table is total; a pair that cannot happen says NEVER, so a hole is a bug and not a default.
Spreading these rules over the connection code was tried in a sketch: every new case broke an old one.

    ARRIVED --PASS--> FORWARDED --ANSWER--> ANSWERED        LOST --REPEAT--> FORWARDED
       |  \              |  ^ |  \--BEGUN--> ANSWERING         \--ASK--> ASKED --FOUND, ABSENT--> ANSWERED
       |   KEEP     NOT_RUN |  \--LOST--> LOST                           ^ |
       |     \--> HELD <-/ PASS    HELD --ASK (a suspect, or BARRED)----/ |   LOST <--NOT_YET-- ASKED (of the same core)
       |           ^--CLEARED-- ON_TRIAL <--SUSPECTED (absent)-----------/
       \--BARRED (HELD, ASKED)--> ANSWERED   ON_TRIAL --CONVICTED, HELD_BACK, DROPPED, LIMIT--> ANSWERED

A suspect reaches a core by one way only: ON_TRIAL, CLEARED, HELD, PASS. Deaths of a core change nothing for it.
What a rule names and has a key waits for a core like any other and is refused once that does not have it: what is done
is told again, whatever the rules.
Whoever takes a promise for an answer is kept when his time is over (PROMISE): HELD or ON_TRIAL -> KEEPING, LOST or
ASKED -> KEEPING_LOST, and from there only an answer. What is promised runs outside of this table (`receipts`).
"""

from enum import Enum, auto
from typing import assert_never

import msgspec

from hardcore.crisis.feed import Verdict
from hardcore.crisis.problems import Problem
from hardcore.settings import Limits

#: Times a safe request is sent to a core: one that kills whoever reads it must not do so for ever.
SENDS_MAX = 3


class Life(Enum):
    """Where a request is between its head and its answer."""

    ARRIVED = auto()  # read, nothing decided
    HELD = auto()  # waits; no core has seen a byte of it
    FORWARDED = auto()  # a core has it, or may have it
    ANSWERING = auto()  # the first bytes of its answer have left
    LOST = auto()  # the core that had it is gone; waits for the release
    ASKED = auto()  # the new core is being asked whether it is in the ledger
    ON_TRIAL = auto()  # a suspect that the ledger does not have; waits for its verdict
    KEEPING = (
        auto()
    )  # no core has seen it, or a later one does not have it; a promise to run it later is being stored
    KEEPING_LOST = auto()  # the same of one that a core may have seen
    ANSWERED = auto()  # over: the client has its answer
    GONE = auto()  # over: the client left


class Trigger(Enum):
    """What can happen to a request."""

    PASS = auto()  # a released core takes requests
    KEEP = auto()  # no core takes requests, and there is room to wait
    TURN_AWAY = auto()  # no core is coming, no room, or the gateway leaves
    NOT_RUN = auto()  # the core never took it, or says it did not run it; it can be sent again
    NOT_RUN_SPENT = auto()  # the same, but its body is gone
    BEGUN = auto()  # a safe answer grows too long to keep whole
    ANSWER = auto()  # the answer is whole
    GARBLED = auto()  # the answer cannot be read
    CORE_LOST = auto()  # no answer will come; it can be repeated or looked up later
    CORE_LOST_FOR_GOOD = auto()  # no answer will come, and nothing can be learned
    REPEAT = auto()  # released: send it again
    ASK = auto()  # released: only look it up
    FOUND = auto()  # the ledger has it
    ABSENT = auto()  # the ledger does not have it, and never will
    SUSPECTED = auto()  # the same, and it may be what the core died of
    LET_GO = auto()  # the same, but no core was ever given it, and what it was asked about for counts no more
    NOT_YET = auto()  # the core that had it does not know of it: it may still be running it
    CLEARED = auto()  # its trial: it does no harm
    CONVICTED = auto()  # its trial: it did it again
    HELD_BACK = auto()  # its trial: nobody can say, and it is kept for a person
    DROPPED = auto()  # nothing more is expected of it, and nothing will run it
    BARRED = auto()  # a rule of the quarantine names it
    FAULT = auto()  # the rest of its body is too long, broken, or does not come
    LIMIT = auto()  # its time is over
    PROMISE = auto()  # the same, and its client takes a promise
    KEPT = auto()  # the promise is on the disk
    NOT_KEPT = auto()  # it is not, and never will be
    DOUBTFUL = auto()  # the disk does not say
    CLIENT_LEFT = auto()


class Deed(Enum):
    """What the gateway does about it."""

    SEND = auto()
    WAIT = auto()
    REMEMBER = auto()  # wait as a lost one, with a limit of its own
    ASK_LATER = auto()  # the same, and ask again after a pause
    LOOK_UP = auto()
    TRY = auto()  # file its case, and wait for the verdict
    FREE = auto()  # wait as one that no core has seen
    BEGIN = auto()  # start to pass the answer on
    PASS_ON = auto()  # pass the whole answer on
    FINISH = auto()  # end the answer that was begun
    SAY_NOT_DONE = auto()
    SAY_ABSENT = auto()  # not done, and it was looked up
    SAY_UNTRIED = auto()  # the same, and its trial is not over or was none
    SAY_SET_ASIDE = auto()
    SAY_UNKNOWN = auto()
    SAY_GARBLED = auto()
    SAY_LATE = auto()
    SAY_FAULT = auto()
    SAY_STORED = auto()
    STORE = auto()
    SAY_PROMISED = auto()
    SAY_PROMISE_UNKNOWN = auto()
    CUT = auto()  # half an answer has left: only the connection's end is true now
    DROP_UNSENT = auto()  # the client left; no core has seen its request
    DROP_SENT = auto()  # the client left; a core may have seen it
    NOTHING = auto()
    NEVER = auto()  # cannot happen: our own bug


def _row(life: Life, ways: dict[Trigger, tuple[Life, Deed]]) -> dict[tuple[Life, Trigger], tuple[Life, Deed]]:
    return {(life, trigger): ways.get(trigger, (life, Deed.NEVER)) for trigger in Trigger}


def _over(life: Life) -> dict[tuple[Life, Trigger], tuple[Life, Deed]]:
    """After the end everything comes too late, and is allowed to: connections end in any order."""
    return {(life, trigger): (life, Deed.NOTHING) for trigger in Trigger}


TABLE: dict[tuple[Life, Trigger], tuple[Life, Deed]] = {
    **_row(
        Life.ARRIVED,
        {
            Trigger.PASS: (Life.FORWARDED, Deed.SEND),
            Trigger.KEEP: (Life.HELD, Deed.WAIT),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.SAY_NOT_DONE),
            Trigger.BARRED: (Life.ANSWERED, Deed.SAY_SET_ASIDE),
            Trigger.FAULT: (Life.ANSWERED, Deed.SAY_FAULT),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_UNSENT),
        },
    ),
    **_row(
        Life.HELD,
        {
            Trigger.PASS: (Life.FORWARDED, Deed.SEND),
            Trigger.ASK: (Life.ASKED, Deed.LOOK_UP),
            Trigger.BARRED: (Life.ANSWERED, Deed.SAY_SET_ASIDE),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.SAY_NOT_DONE),
            Trigger.FAULT: (Life.ANSWERED, Deed.SAY_FAULT),
            Trigger.LIMIT: (Life.ANSWERED, Deed.SAY_NOT_DONE),
            Trigger.PROMISE: (Life.KEEPING, Deed.STORE),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_UNSENT),
        },
    ),
    **_row(
        Life.FORWARDED,
        {
            Trigger.NOT_RUN: (Life.HELD, Deed.WAIT),
            Trigger.NOT_RUN_SPENT: (Life.ANSWERED, Deed.SAY_NOT_DONE),
            Trigger.BEGUN: (Life.ANSWERING, Deed.BEGIN),
            Trigger.ANSWER: (Life.ANSWERED, Deed.PASS_ON),
            Trigger.GARBLED: (Life.ANSWERED, Deed.SAY_GARBLED),
            Trigger.CORE_LOST: (Life.LOST, Deed.REMEMBER),
            Trigger.CORE_LOST_FOR_GOOD: (Life.ANSWERED, Deed.SAY_UNKNOWN),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.SAY_UNKNOWN),
            Trigger.FAULT: (Life.ANSWERED, Deed.SAY_FAULT),
            Trigger.LIMIT: (Life.ANSWERED, Deed.SAY_LATE),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_SENT),
        },
    ),
    **_row(
        Life.ANSWERING,
        {
            Trigger.ANSWER: (Life.ANSWERED, Deed.FINISH),
            Trigger.GARBLED: (Life.ANSWERED, Deed.CUT),
            Trigger.FAULT: (Life.ANSWERED, Deed.CUT),
            Trigger.CORE_LOST: (Life.ANSWERED, Deed.CUT),
            Trigger.CORE_LOST_FOR_GOOD: (Life.ANSWERED, Deed.CUT),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.CUT),
            Trigger.LIMIT: (Life.ANSWERED, Deed.CUT),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_SENT),
        },
    ),
    **_row(
        Life.LOST,
        {
            Trigger.REPEAT: (Life.FORWARDED, Deed.SEND),
            Trigger.ASK: (Life.ASKED, Deed.LOOK_UP),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.SAY_UNKNOWN),
            Trigger.LIMIT: (Life.ANSWERED, Deed.SAY_UNKNOWN),
            Trigger.PROMISE: (Life.KEEPING_LOST, Deed.STORE),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_SENT),
        },
    ),
    **_row(
        Life.ASKED,
        {
            Trigger.FOUND: (Life.ANSWERED, Deed.SAY_STORED),
            Trigger.ABSENT: (Life.ANSWERED, Deed.SAY_ABSENT),
            Trigger.SUSPECTED: (Life.ON_TRIAL, Deed.TRY),
            Trigger.LET_GO: (Life.HELD, Deed.FREE),
            Trigger.BARRED: (Life.ANSWERED, Deed.SAY_SET_ASIDE),
            Trigger.NOT_YET: (Life.LOST, Deed.ASK_LATER),
            Trigger.GARBLED: (Life.ANSWERED, Deed.SAY_UNKNOWN),
            Trigger.CORE_LOST: (Life.LOST, Deed.REMEMBER),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.SAY_UNKNOWN),
            Trigger.LIMIT: (Life.ANSWERED, Deed.SAY_UNKNOWN),
            Trigger.PROMISE: (Life.KEEPING_LOST, Deed.STORE),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_SENT),
        },
    ),
    **_row(
        Life.ON_TRIAL,
        {
            Trigger.CLEARED: (Life.HELD, Deed.FREE),
            Trigger.CONVICTED: (Life.ANSWERED, Deed.SAY_SET_ASIDE),
            Trigger.HELD_BACK: (Life.ANSWERED, Deed.SAY_SET_ASIDE),
            Trigger.DROPPED: (Life.ANSWERED, Deed.SAY_UNTRIED),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.SAY_UNTRIED),
            Trigger.LIMIT: (Life.ANSWERED, Deed.SAY_UNTRIED),
            Trigger.PROMISE: (Life.KEEPING, Deed.STORE),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_SENT),
        },
    ),
    **_row(
        Life.KEEPING,
        {
            Trigger.KEPT: (Life.ANSWERED, Deed.SAY_PROMISED),
            Trigger.NOT_KEPT: (Life.ANSWERED, Deed.SAY_NOT_DONE),
            Trigger.DOUBTFUL: (Life.ANSWERED, Deed.SAY_PROMISE_UNKNOWN),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.SAY_PROMISE_UNKNOWN),
            Trigger.LIMIT: (Life.ANSWERED, Deed.SAY_PROMISE_UNKNOWN),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_SENT),
        },
    ),
    **_row(
        Life.KEEPING_LOST,
        {
            Trigger.KEPT: (Life.ANSWERED, Deed.SAY_PROMISED),
            Trigger.NOT_KEPT: (Life.ANSWERED, Deed.SAY_UNKNOWN),
            Trigger.DOUBTFUL: (Life.ANSWERED, Deed.SAY_PROMISE_UNKNOWN),
            Trigger.TURN_AWAY: (Life.ANSWERED, Deed.SAY_PROMISE_UNKNOWN),
            Trigger.LIMIT: (Life.ANSWERED, Deed.SAY_PROMISE_UNKNOWN),
            Trigger.CLIENT_LEFT: (Life.GONE, Deed.DROP_SENT),
        },
    ),
    **_over(Life.ANSWERED),
    **_over(Life.GONE),
}

#: Lives in which a request waits in the gateway.
WAITING = frozenset({Life.HELD, Life.LOST, Life.ASKED, Life.ON_TRIAL})
OVER = frozenset({Life.ANSWERED, Life.GONE})


class Plea(msgspec.Struct, frozen=True):
    """What decides about a request whose core is gone. `sends` counts how often a core was given it."""

    safe: bool
    key_hash: str | None
    body_kept: bool
    sent_whole: bool
    sends: int


def after_death(plea: Plea) -> Trigger:
    """Whether anything can still be learned or repeated, at the moment the death is known."""
    if plea.safe:
        again = plea.body_kept and plea.sends < SENDS_MAX
        return Trigger.CORE_LOST if again else Trigger.CORE_LOST_FOR_GOOD
    return Trigger.CORE_LOST if plea.key_hash and plea.sent_whole else Trigger.CORE_LOST_FOR_GOOD


def after_release(plea: Plea, *, suspected: bool, newer: bool) -> Trigger:
    """Whether a lost request is sent again or only looked up. An unsafe one is repeated once in its life, and only
    to a `newer` core: the one that hung up on it may still be running it, and can only be asked.
    """
    if plea.safe or (newer and plea.body_kept and not suspected and plea.sends < 2):
        return Trigger.REPEAT
    return Trigger.ASK


def after_verdict(outcome: Verdict, *, sendable: bool) -> Trigger:
    """What a verdict means for whoever waits for it. `sendable`: its body is still here."""
    match outcome:
        case Verdict.CLEARED:
            return Trigger.CLEARED if sendable else Trigger.DROPPED
        case Verdict.CONVICTED:
            return Trigger.CONVICTED
        case Verdict.HELD:
            return Trigger.HELD_BACK
        case Verdict.DROPPED:
            return Trigger.DROPPED
        case _:
            assert_never(outcome)


def hold_limit_ms(limits: Limits, *, navigation: bool) -> int:
    """How long a request may wait that no core has seen."""
    return min(limits.navigation_hold_ms, limits.hold_ms) if navigation else limits.hold_ms


class WaitingRoom(msgspec.Struct):
    """Counts who waits and how many bytes are kept for them. Bytes are asked for before they are read."""

    limits: Limits
    held: int = 0
    kept_bytes: int = 0
    _by_browser: dict[bytes, int] = msgspec.field(default_factory=dict)

    def enter(self, browser: bytes | None) -> Problem | None:
        """Let one more request wait, or say why not."""
        if self.held >= self.limits.hold_requests_max:
            return Problem.TOO_BUSY
        if browser is not None:
            mine = self._by_browser.get(browser, 0)
            if mine >= self.limits.hold_per_browser_max:
                return Problem.TOO_BUSY
            self._by_browser[browser] = mine + 1
        self.held += 1
        return None

    def leave(self, browser: bytes | None) -> None:
        """One who was let in waits no longer."""
        self.held -= 1
        assert self.held >= 0, "somebody left who never entered"
        if browser is not None:
            mine = self._by_browser.pop(browser) - 1
            if mine:
                self._by_browser[browser] = mine

    def take_bytes(self, count: int) -> bool:
        """Set `count` bytes aside for a body; False if there is no room for them."""
        if self.kept_bytes + count > self.limits.hold_bytes_max:
            return False
        self.kept_bytes += count
        return True

    def give_bytes(self, count: int) -> None:
        """Give bytes back."""
        self.kept_bytes -= count
        assert self.kept_bytes >= 0, "more bytes were given back than taken"
