"""The dock: suspects between their look-up and their verdict, and what this gateway can say about them.

Who waits here waits for a trial that others hold; a core that dies meanwhile changes nothing for him. What was in a
core's hands when its client was sent away is kept for a moment too, because the guard may only then say that it was
what the core died of, and nobody else has its bytes: it is filed and tried, and never run again. Waiting for the
verdict in the list of lost requests was not chosen: each release would ask the ledger once more about all of them.
"""

from collections.abc import Callable
from typing import Final

from hardcore.crisis.barrier import Barrier, source_named, source_of
from hardcore.crisis.cases import Cases, Draft, shown
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.feed import SuspectsHeard, Teller, Verdict, VerdictHeard, case_line, settled_line
from hardcore.crisis.heads import Header
from hardcore.crisis.holding import Life, Trigger, after_verdict
from hardcore.crisis.outlook import Outlook
from hardcore.crisis.quarantine import SetAside
from hardcore.crisis.receipts import Wish

#: Requests without a client that are remembered, their bytes, and for how long.
GONE_MAX: Final = 256
GONE_BYTES_MAX: Final = 16 << 20
GONE_MS: Final = 60_000


def draft_of(exchange: Exchange) -> Draft | None:
    """A request as its case; None if its bytes are not here any more, or it has no name."""
    name, head = exchange.name, exchange.head
    if name is None or not exchange.whole or exchange.streamed or exchange.spent:
        return None
    named: tuple[Header, ...] = () if head.key is not None else ((b"X-Request-Name", name.encode()),)
    language = head.accept_language.encode("latin-1")
    kept = tuple(pair for pair in head.headers if pair[0].lower() != b"accept-language")
    told: tuple[Header, ...] = ((b"Accept-Language", language),) if language else ()
    return Draft(
        name=name,
        source=source_of(exchange),
        key=None if head.key is None else head.key.decode("ascii"),
        digest=exchange.digest_hex(),
        method=head.method,
        target=head.target.decode("latin-1"),
        headers=shown((*kept, *told, *named)),
        body=tuple(exchange.body),
        body_bytes=exchange.received_bytes,
    )


class Departed:
    """Requests that a core may have and whose client waits no longer, for a moment: any of them may be named yet."""

    def __init__(self, now_ns: Callable[[], int]) -> None:
        self._now_ns = now_ns
        self._drafts: dict[str, tuple[Draft, int]] = {}  # and when, the oldest first

    def put(self, draft: Draft) -> None:
        """Remember one more."""
        self._drafts.pop(draft.name, None)
        self._drafts[draft.name] = (draft, self._now_ns())
        self._forget(0)

    def take(self, name: str) -> Draft | None:
        """The one of this name, which is forgotten here."""
        found = self._drafts.pop(name, None)
        return None if found is None else found[0]

    def upkeep(self) -> None:
        """Now and then: let go of what nobody asked for."""
        if self._drafts:
            self._forget(self._now_ns() - GONE_MS * 1_000_000)

    def _forget(self, before_ns: int) -> None:
        size = sum(draft.body_bytes for draft, _ in self._drafts.values())
        for name, (draft, at_ns) in list(self._drafts.items()):
            if at_ns >= before_ns and len(self._drafts) <= GONE_MAX and size <= GONE_BYTES_MAX:
                return
            del self._drafts[name]
            size -= draft.body_bytes


class Dock:
    """`step` moves a request along its table."""

    def __init__(
        self,
        outlook: Outlook,
        barrier: Barrier,
        cases: Callable[[Callable[[str], None]], Cases],
        teller: Teller,
        now_ns: Callable[[], int],
        step: Callable[[Exchange, Trigger], None],
    ) -> None:
        self.cases = cases(lambda name: teller.say_or_keep(case_line(name)))
        self._outlook = outlook
        self._barrier = barrier
        self.current = barrier.current  # until the rules that were told of are read
        self._teller = teller
        self._step = step
        self._waiting: dict[str, dict[Exchange, None]] = {}
        self.departed = Departed(now_ns)

    def suspects(self, exchange: Exchange) -> bool:
        """Whether a request may only be looked up now."""
        suspects = self._outlook.standing.suspects
        return bool(suspects) and not exchange.head.safe and exchange.name in suspects

    def accuses(self, exchange: Exchange) -> bool:
        """Whether a request that the ledger does not have waits for a verdict, or has one that it has not heard."""
        name = exchange.name
        judged = name is not None and not exchange.cleared and self._barrier.verdict(name) is not None
        return judged or self.suspects(exchange)

    # -- what is promised ------------------------------------------------------------------------------

    def letter(self, wish: Wish) -> str | None:
        """The letter under which a promised wish is set aside now."""
        return self._barrier.letter(wish.key_hash) or self._barrier.rules.digests.get(wish.digest)

    def dropped(self, name: str) -> bool:
        """Whether nobody could try it, as far as this gateway heard."""
        said = self._barrier.verdict(name)
        return said is not None and said.outcome is Verdict.DROPPED

    def try_promised(self, wish: Wish, body: bytes) -> None:
        """A promised wish is a suspect, and the ledger does not have it: file its case, if nobody has."""
        if not self.cases.has(wish.key_hash):
            self.cases.file(
                Draft(
                    name=wish.key_hash,
                    source=source_named(wish.browser, "unknown"),
                    key=wish.key,
                    digest=wish.digest,
                    method=wish.method,
                    target=wish.target.decode("latin-1"),
                    headers=shown(wish.headers),
                    body=(body,),
                    body_bytes=len(body),
                )
            )

    # -- who waits -------------------------------------------------------------------------------------

    def waiting(self) -> list[Exchange]:
        """Who waits for his verdict."""
        return [one for together in self._waiting.values() for one in together]

    def enter(self, exchange: Exchange) -> None:
        """The ledger does not have it: file its case, and wait. Its verdict may have come while it was looked up."""
        name = exchange.name
        assert name is not None, "a suspect has a name"
        self._waiting.setdefault(name, {})[exchange] = None
        if self.suspects(exchange):
            draft = draft_of(exchange)
            if draft is not None:
                self.cases.file(draft)
        elif (verdict := self._barrier.verdict(name)) is not None:
            self._judge(exchange, verdict)

    def leave(self, exchange: Exchange) -> None:
        """It waits no longer."""
        if not self._waiting:
            return
        name = exchange.name
        if name is not None and (together := self._waiting.get(name)) is not None:
            together.pop(exchange, None)
            if not together:
                del self._waiting[name]

    def _judge(self, exchange: Exchange, verdict: VerdictHeard) -> None:
        trigger = after_verdict(verdict.outcome, sendable=not exchange.spent)
        exchange.refusal = SetAside(verdict.letter or "")
        exchange.cleared = trigger is Trigger.CLEARED
        self._step(exchange, trigger)

    def settled(self, exchange: Exchange) -> None:
        """The ledger has it."""
        name = exchange.name
        if name is not None and self.suspects(exchange):
            self.departed.take(name)
            self._teller.say_or_keep(settled_line((name,)))
            self._outlook.unsuspected((name,))

    # -- the feed --------------------------------------------------------------------------------------

    def suspected(self, heard: SuspectsHeard) -> None:
        """There are suspects: whose client was sent away is filed now."""
        self._barrier.suspected(heard.keys)
        self.cases.tell(heard.keys)
        for name in heard.keys:
            if (draft := self.departed.take(name)) is not None:
                self.cases.file(draft)

    def judged(self, verdict: VerdictHeard) -> None:
        """A trial is over: whoever waited for it goes his way."""
        self._barrier.heard(verdict)
        self.departed.take(verdict.name)
        for exchange in list(self._waiting.get(verdict.name, ())):
            if exchange.life is Life.ON_TRIAL:
                self._judge(exchange, verdict)
        if verdict.outcome.ends_case:
            self.cases.remove(verdict.name)
        else:
            self.cases.hand_over(verdict.name)

    # -- whose client is gone --------------------------------------------------------------------------

    def keep(self, exchange: Exchange) -> None:
        """A core may have it, and its client waits no longer: it may be named a suspect any moment."""
        draft = None if exchange.head.safe else draft_of(exchange)
        if draft is None or not draft.files:
            return
        if self.suspects(exchange):
            self.cases.file(draft)
        else:
            self.departed.put(draft)
