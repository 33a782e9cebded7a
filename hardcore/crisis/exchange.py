"""One request and what is known about it, from its head to its answer.

The only mutable thing that the client's side and the core's side share. The client connection fills it,
the desk moves it along the table in `holding`; neither keeps a second copy of where it stands.
"""

from typing import Protocol

from hardcore.crisis.alarm import Alarm
from hardcore.crisis.heads import AnswerHead, RequestDigest, RequestHead
from hardcore.crisis.holding import Life, Plea
from hardcore.crisis.problems import Problem
from hardcore.crisis.quarantine import Refusal
from hardcore.crisis.recording import NOBODYS, Place
from hardcore.crisis.upstream import UpstreamConnection
from hardcore.crisis.visitors import THE_OWNER

#: Pieces of a body kept apart.
PIECES_MAX = 256


class Client(Protocol):
    """What the desk may do with the connection a request came from. All of it is safe after its end."""

    limit: Alarm
    address: str  # where the client sits

    def answer(self, head: AnswerHead, body: bytes, *, close: bool = False) -> None:
        """Give a whole answer."""

    def begin(self, head: AnswerHead, first: bytes) -> None:
        """Begin an answer whose rest is still coming."""

    def more(self, data: bytes) -> None:
        """Give a piece of the answer that was begun."""

    def end(self) -> None:
        """The answer that was begun is whole."""

    def cut(self) -> None:
        """End the connection in the middle of an answer."""

    def flow(self) -> None:
        """Look again whether the request's body may be read on."""


class Exchange:
    """One request. Times are monotonic nanoseconds, 0 for never."""

    __slots__ = (
        "answer_status",
        "arrived_ns",
        "barred",
        "body",
        "browser",
        "called",
        "cleared",
        "client",
        "closes",
        "dial",
        "digest",
        "digested",
        "fault",
        "flowing",
        "head",
        "in_room",
        "kept_bytes",
        "life",
        "lost_epoch",
        "lost_ns",
        "made_name",
        "met_outage",
        "place",
        "received_bytes",
        "refusal",
        "rests",
        "sends",
        "spent",
        "stalled",
        "started",
        "streamed",
        "upstream",
        "visitor",
        "waiting_ns",
        "whole",
    )

    def __init__(
        self, client: Client, head: RequestHead, arrived_ns: int, place: Place = NOBODYS.no_place
    ) -> None:
        self.client = client
        self.head = head
        self.arrived_ns = arrived_ns
        self.place = place  # on the gateway's own page
        self.body: list[bytes] = []
        self.received_bytes = 0  # of the body, in all
        self.kept_bytes = 0  # of the body, set aside in the waiting room's count
        self.whole = False  # the body has arrived to its end
        self.streamed = False  # the body is not kept
        self.spent = False  # a part of a streamed body has gone to a core
        self.flowing = False  # a streamed body may be read on
        self.called = False  # its body was called for (Expect: 100-continue)
        self.closes = False  # the connection ends with the answer that was begun
        self.started = False  # the desk has it
        self.visitor = THE_OWNER  # who asks, once the gate has let it in
        self.digest: RequestDigest | None = None  # of a streamed body, as far as a core was given it
        self.digested = ""  # the name of its bytes, once it was asked for: a whole body is read for it
        self.fault: Problem | None = None
        self.life = Life.ARRIVED
        self.upstream: UpstreamConnection | None = None
        self.dial: object = None  # marks the dial whose connection this request waits for
        self.sends = 0  # how often a core was given it
        self.browser: bytes | None = None
        self.in_room = False
        self.waiting_ns = 0
        self.lost_ns = 0
        self.lost_epoch = 0
        self.rests = False  # the core that had it did not know of it, and is asked again after a pause
        self.met_outage = False
        self.answer_status = 0
        self.stalled = False  # its client does not take its answer as fast as it comes
        self.refusal: Refusal | None = None  # why it must not reach a core
        self.barred = False  # there was such a reason once
        self.cleared = False  # its trial has shown that it does no harm
        self.made_name = ""  # what a core was told to call it, where it has no key

    @property
    def name(self) -> str | None:
        """What it is called if it is suspected; None: no core was told a name."""
        return self.head.key_hash or self.made_name or None

    def digest_hex(self) -> str:
        """The name of its bytes. The key alone may be another one's, whose answer is not this one's."""
        if self.digest is not None:
            return self.digest.hex()
        if self.digested:
            return self.digested
        digest = RequestDigest(self.head)
        for data in self.body:
            digest.add(data)
        if self.whole and not self.streamed:
            self.digested = digest.hex()
        return digest.hex()

    @property
    def askable(self) -> bool:
        """Whether the ledger can be asked what became of it."""
        return self.head.key is not None and not self.head.safe and self.whole and not self.streamed

    def keep(self, data: bytes) -> None:
        """Keep a piece of the body. Thousands of tiny ones would take far more memory than their bytes."""
        self.body.append(data)
        if len(self.body) >= PIECES_MAX:
            self.body = [b"".join(self.body)]

    def plea(self) -> Plea:
        """What decides about it after a death."""
        return Plea(
            safe=self.head.safe,
            key_hash=self.head.key_hash,
            body_kept=not self.spent,
            sent_whole=self.whole,
            sends=self.sends,
        )
