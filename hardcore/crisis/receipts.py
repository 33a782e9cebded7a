"""Receipts: promises to run a request later, exactly once; what may be promised, and what becomes of it. Pure.

A promise is the one exception to "after a 503 a request never runs for the first time", so everything about it is
decided here, on values: who may have one, whose turn it is, and what a look-up or an answer means for it. A receipt
is open until its outcome is a fact; what was refused, cancelled or done never runs again. Letting a receipt run
whenever a core comes was not chosen: after a quarter of an hour the world has moved on, and a person is asked.
"""

import json
from collections import Counter
from collections.abc import Collection, Iterator
from enum import Enum, StrEnum, auto
from typing import assert_never

import msgspec
from msgspec import structs

from hardcore.settings import Limits

#: Answers of a core to one wish that say neither yes nor no; after so many a person is asked.
ODD_ANSWERS_MAX = 3
#: Receipts that run at a time.
RUNNING_MAX = 4
#: Settled receipts that are kept, the newest.
SETTLED_MAX = 1000
#: Statuses of a 4xx that are no answer to the wish: it came at a bad moment.
_LATER = frozenset({408, 425, 429})
#: Statuses of a 4xx that may say more of the moment (a login, a core that does not know the path) than of the wish.
_OF_THE_MOMENT = frozenset({401, 403, 404, 405, 407, 409, 421})
#: What a form's body is. The ledger may keep it as several commands, under keys made from its own.
_FORM = b"application/x-www-form-urlencoded"


class Outcome(StrEnum):
    """What became of it, in the words of the wire."""

    WAITING = "waiting"
    ASK = "ask"  # it waits for a person's word
    SET_ASIDE = "set_aside"  # it may have brought a core down: nothing sends it
    DONE = "done"
    ALREADY_DONE = "already_done"
    NOT_DONE = "not_done"  # and it never will be
    REFUSED = "refused"
    UNKNOWN = "unknown"


#: Outcomes that may still change. Any other is for ever.
OPEN = frozenset({Outcome.WAITING, Outcome.ASK, Outcome.SET_ASIDE})


class Moment(msgspec.Struct, frozen=True):
    """A time as three clocks tell it: `awake_ns` (monotonic) means something within one `boot` only."""

    boot: str
    awake_ns: int
    wall_ns: int


class Wish(msgspec.Struct, frozen=True):
    """The request that is promised, without its body. `digest` names it in a look-up, in hex; `key_hash` is how a
    suspect is named; `browser` is the cookie of whoever was promised it; `back` is the page to lead back to.
    `size_bytes` counts all that is kept of it.
    """

    key: str
    key_hash: str
    digest: str
    browser: bytes | None
    method: str
    target: bytes
    host: bytes
    headers: tuple[tuple[bytes, bytes], ...]
    size_bytes: int
    back: str = "/"

    @property
    def in_parts(self) -> bool:
        """Whether it may be several commands: then nothing under its own key does not say that nothing was done."""
        return any(n.lower() == b"content-type" and v.lower().startswith(_FORM) for n, v in self.headers)


class Receipt(msgspec.Struct, frozen=True):
    """One promise. `number` is its place in the order; `since` is where its age begins; `changed` is the moment
    of its last outcome; `answer` is the ledger's own, as far as it was one in JSON. `sent_epoch` is the last core
    that was, or may have been, given it; 0: none was.
    """

    number: int
    wish: Wish
    kept: Moment
    since: Moment
    changed: Moment
    outcome: Outcome = Outcome.WAITING
    status: int | None = None
    answer: object = None
    seen: bool = False
    sent_epoch: int = 0

    @property
    def open(self) -> bool:
        """Whether its outcome may still change."""
        return self.outcome in OPEN


def age_ms(since: Moment, now: Moment) -> int:
    """How old something is: awake time, so that a night's sleep makes nothing old; over a reboot the wall clock's."""
    passed_ns = now.awake_ns - since.awake_ns if now.boot == since.boot else now.wall_ns - since.wall_ns
    return max(0, passed_ns // 1_000_000)


def is_old(since: Moment, now: Moment, limit_ms: int) -> bool:
    """Whether a person has to be asked first. A wall clock that ran backwards over a reboot proves no youth."""
    backwards = now.boot != since.boot and now.wall_ns < since.wall_ns
    return backwards or age_ms(since, now) >= limit_ms


# -- what a core's word means ------------------------------------------------------------------------------


class Sign(Enum):
    """What a look-up tells."""

    FOUND = auto()  # this very request is in the ledger, or refused for good
    ABSENT = auto()  # nothing is there under its key
    TAKEN = auto()  # something is there under its key: only the request itself is told what
    SILENT = auto()  # nothing was learned


class Turn(Enum):
    """What to do with a receipt whose turn it is, where its outcome is not known yet."""

    SEND = auto()
    WAIT = auto()
    ASK = auto()
    SET_ASIDE = auto()
    TRY = auto()  # it is a suspect: it waits for its verdict


class Settled(msgspec.Struct, frozen=True):
    """An outcome that is a fact."""

    outcome: Outcome
    status: int | None = None
    answer: object = None


class Case(msgspec.Struct, frozen=True):
    """What decides after a look-up that found nothing. `sendable`: the core is not running it; `weary`: it was sent
    and answered, and no answer settled it; `aside`: its trial has set it aside; `dropped`: nobody could try it.
    """

    old: bool
    suspected: bool
    sendable: bool
    weary: bool = False
    aside: bool = False
    dropped: bool = False


def after_look_up(sign: Sign, case: Case) -> Turn:
    """What a look-up that did not find the request itself leads to."""
    match sign:
        case Sign.FOUND:
            raise AssertionError("what was found has an outcome")
        case Sign.SILENT:
            return Turn.WAIT
        case Sign.ABSENT if case.aside:
            return Turn.SET_ASIDE
        case Sign.ABSENT if case.suspected:
            return Turn.TRY
        case _ if case.weary or (sign is Sign.ABSENT and (case.old or case.dropped)):
            return Turn.ASK
        case Sign.TAKEN | Sign.ABSENT:
            # TAKEN: its key is in the ledger, so it is told what stands there, and nothing is done anew.
            return Turn.SEND if case.sendable else Turn.WAIT
        case _:
            assert_never(sign)


def after_withdrawal(sign: Sign, *, in_parts: bool, certain: bool) -> Settled | None:
    """What a wish is that nobody wants any more, once it was looked up and not found; None: that can't be said yet.
    `in_parts`: some of it may be done; `certain`: no core can be running it.
    """
    match sign:
        case Sign.FOUND:
            raise AssertionError("what was found has an outcome")
        case Sign.ABSENT if certain:
            return Settled(Outcome.UNKNOWN if in_parts else Outcome.NOT_DONE)
        case Sign.TAKEN:
            return Settled(Outcome.UNKNOWN)
        case Sign.ABSENT | Sign.SILENT:
            return None
        case _:
            assert_never(sign)


def found(status: int, answer: object, *, sent: bool) -> Settled:
    """The outcome of a request that is in the ledger. `sent`: it was this gateway that had sent it."""
    if status >= 400:
        return Settled(Outcome.REFUSED, status, answer)
    return Settled(Outcome.DONE if sent else Outcome.ALREADY_DONE, status, answer)


def read_look_up(status: int, body: bytes) -> Settled | Sign:
    """What the core says of a key. Only the answers of the contract are believed; FOUND comes as its facts."""
    fields = object_in(body)
    if status == 404 and fields.get("outcome") == "not_done":
        return Sign.ABSENT
    if status != 200:
        return Sign.SILENT
    kept = fields.get("status")
    if fields.get("outcome") == "done" and isinstance(kept, int) and 200 <= kept <= 599:
        return found(kept, fields.get("answer"), sent=False)
    return Sign.TAKEN if fields.get("outcome") == "unknown" else Sign.SILENT


class Reply(Enum):
    """What a core's answer to the request itself says, where it settles nothing."""

    LATER = auto()  # not done, and it may be sent again
    DOUBTFUL = auto()  # it may be done: only a later core can say
    CHECK = auto()  # the ledger is asked whether this was meant for the wish
    ODD = auto()  # none of these


def read_answer(status: int, body: bytes, *, committed: bool) -> Settled | Reply:
    """What the core says to the request itself. `committed`: the answer names its commit."""
    said = object_in(body).get("outcome")
    if status < 300 or (status < 400 and committed):
        return Settled(Outcome.DONE, status, value_in(body))
    if status < 400 or status in _OF_THE_MOMENT:
        return Reply.CHECK
    if status in _LATER or (status >= 500 and said == "not_done"):
        return Reply.LATER
    if status < 500:
        return Settled(Outcome.REFUSED, status, value_in(body))
    return Reply.DOUBTFUL if said == "unknown" else Reply.ODD


def value_in(body: bytes) -> object:
    """The JSON of an answer; None if it is none."""
    try:
        return json.loads(body)
    except (ValueError, RecursionError):
        return None


def object_in(body: bytes) -> dict[str, object]:
    """The JSON object of an answer; empty if it is none."""
    value = value_in(body)
    return value if isinstance(value, dict) else {}


# -- a person's word ---------------------------------------------------------------------------------------


class Word(StrEnum):
    """What a person may say of a receipt."""

    RUN = "run"
    CANCEL = "cancel"
    SEEN = "seen"


#: Those that wait for a person.
ASKED = frozenset({Outcome.ASK, Outcome.SET_ASIDE})


def after_word(receipt: Receipt, word: Word, now: Moment) -> Receipt | None:
    """The receipt as it is then; None where the word does not fit, or where the ledger has to be asked first."""
    match word:
        case Word.RUN if receipt.outcome is Outcome.ASK:
            return structs.replace(
                receipt, outcome=Outcome.WAITING, status=None, answer=None, since=now, changed=now
            )
        case Word.SEEN if not receipt.open:
            return structs.replace(receipt, seen=True)
        case _:
            return None


def settle(receipt: Receipt, fact: Settled, now: Moment) -> Receipt:
    """The receipt with the outcome that is a fact now. What was only needed to send it is let go of."""
    assert receipt.open, "what is settled stays as it is"
    wish = structs.replace(receipt.wish, headers=())
    return structs.replace(
        receipt, wish=wish, outcome=fact.outcome, status=fact.status, answer=fact.answer, changed=now
    )


def set_aside(receipt: Receipt, letter: str, now: Moment) -> Receipt:
    """The receipt of a wish that its trial has set aside: with what whoever waits for an answer is told."""
    answer = {"type": "/problems/set-aside", "status": 422, "outcome": "not_done", "letter": letter}
    return structs.replace(receipt, outcome=Outcome.SET_ASIDE, status=422, answer=answer, changed=now)


def letter_of(receipt: Receipt) -> str | None:
    """The number under which it is set aside; None if it is not, or if that was not told."""
    if receipt.outcome is not Outcome.SET_ASIDE or not isinstance(receipt.answer, dict):
        return None
    letter = receipt.answer.get("letter")
    return letter if isinstance(letter, str) and letter else None


# -- all of them -------------------------------------------------------------------------------------------


class Book:
    """All receipts of this household, in the order in which they were given."""

    def __init__(self, limits: Limits, receipts: Collection[Receipt] = ()) -> None:
        self._limits = limits
        self._by_key = {one.wish.key: one for one in sorted(receipts, key=lambda one: one.number)}
        self._coming: dict[str, Wish] = {}  # being stored

    def get(self, key: str) -> Receipt | None:
        """The receipt under a key."""
        return self._by_key.get(key)

    def __len__(self) -> int:
        """How many keys have a receipt."""
        return len(self._by_key)

    def open(self) -> list[Receipt]:
        """Those that may still change."""
        return [one for one in self._by_key.values() if one.open]

    def coming(self, key: str) -> Wish | None:
        """The wish that is being stored under a key."""
        return self._coming.get(key)

    def admits(self, wish: Wish) -> bool:
        """Whether there is room for one more promise."""
        known = [one.wish for one in self.open()] + list(self._coming.values())
        mine = sum(1 for one in known if one.browser == wish.browser) if wish.browser is not None else 0
        kept_bytes = sum(one.size_bytes for one in known)
        return (
            len(known) < self._limits.receipts_max
            and mine < self._limits.receipts_per_browser_max
            and kept_bytes + wish.size_bytes <= self._limits.receipt_bytes_max
        )

    def expect(self, wish: Wish) -> None:
        """A wish is being stored: its room is taken."""
        assert wish.key not in self._by_key, "a key has one receipt"
        self._coming[wish.key] = wish

    def expected_no_more(self, key: str) -> None:
        """It was stored, or was not."""
        self._coming.pop(key, None)

    def put(self, receipt: Receipt) -> None:
        """A receipt is new, or has changed."""
        self._by_key[receipt.wish.key] = receipt

    def remove(self, key: str) -> None:
        """A receipt is forgotten."""
        self._by_key.pop(key, None)

    def waiting(self) -> Counter[bytes]:
        """How many receipts of each browser wait."""
        return Counter(
            one.wish.browser
            for one in self._by_key.values()
            if one.outcome is Outcome.WAITING and one.wish.browser is not None
        )

    def untold(self, browser: bytes) -> list[Receipt]:
        """What a page of this browser has to hear of when it opens."""
        return [
            one for one in self._by_key.values() if one.wish.browser == browser and (one.open or not one.seen)
        ]

    def turns(self, running: Collection[str], resting: Collection[str]) -> Iterator[Receipt]:
        """Whose turn it is: of each browser the oldest that waits, unless that one runs or rests. One that waits
        for a person lets the next ones pass.
        """
        room = RUNNING_MAX - len(running)
        lanes: set[bytes | str] = set()
        for one in self._by_key.values():
            lane = one.wish.browser or one.wish.key  # whoever has no cookie of ours waits for nobody
            if one.outcome is not Outcome.WAITING or lane in lanes:
                continue
            lanes.add(lane)
            if one.wish.key not in running and one.wish.key not in resting and room > 0:
                room -= 1
                yield one

    def stale(self, now: Moment, limit_ms: int) -> tuple[list[Receipt], list[Receipt]]:
        """Those that a person was asked about for too long; and settled ones that are too old, or too many, to keep."""
        unanswered = [
            one for one in self.open() if one.outcome is not Outcome.WAITING and _stale(one, now, limit_ms)
        ]
        settled = [one for one in self._by_key.values() if not one.open]
        settled.sort(key=lambda one: one.changed.wall_ns)
        over = len(settled) - SETTLED_MAX
        return unanswered, [
            one for place, one in enumerate(settled) if place < over or _stale(one, now, limit_ms)
        ]


def learn(book: Book, receipt: Receipt) -> bool:
    """Take in a receipt as it stands in the file; returns whether it is news. A fact is never forgotten for it."""
    known = book.get(receipt.wish.key)
    if known is not None and (receipt == known or (receipt.open and not known.open)):
        return False
    book.put(receipt)
    return (
        known is None
        or known.outcome is not receipt.outcome
        or known.changed != receipt.changed
        or known.seen is not receipt.seen
    )


def _stale(receipt: Receipt, now: Moment, limit_ms: int) -> bool:
    """By the wall clock, also over a sleep: these are days."""
    return now.wall_ns - receipt.changed.wall_ns >= limit_ms * 1_000_000
