"""What pages are told while it happens: over their own socket, in-band over the ledger's, or when they ask.

Nothing is said before something is known: a gateway that has just begun lets pages wait for their first word
until the feed has spoken, or has been silent for too long. A change costs one encoding for each number of waiting
requests, mostly one in all, and one write for each page. What is told is folded in `face`; here is who listens,
and when it is time. Pages asking again and again was not chosen as the way (it is the fallback): a page would
learn of its server's death a second late.
"""

import asyncio
import hashlib
import json
from collections.abc import Callable, Mapping
from email.utils import formatdate

from msgspec import structs

from hardcore.crisis import face
from hardcore.crisis.browser_socket import BrowserSocket
from hardcore.crisis.face import Outage, Pace, Shown
from hardcore.crisis.heads import AnswerHead, Header, RequestHead, browser_of
from hardcore.crisis.history import History
from hardcore.crisis.lifeline import RESTARTED
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.messages import Message, frame_of
from hardcore.crisis.mishap import contained
from hardcore.crisis.pages import Answer
from hardcore.crisis.receipts import Receipt
from hardcore.crisis.receipts_desk import Promises
from hardcore.crisis.receipts_pages import frame_fields
from hardcore.crisis.standing import Standing
from hardcore.host import clock

LIVE_PATH = b"/__hc/live"
#: How many requests of somebody wait, how many of them are promised, and how many wait for a trial.
Held = tuple[int, int, int]
_NONE: Held = (0, 0, 0)
#: A page has nothing to say here.
SAID_BYTES_MAX = 4096


class _Listener:
    """The party of a page's own socket: it only listens."""

    def __init__(self, socket: BrowserSocket) -> None:
        self._socket = socket

    def said(self, message: Message) -> None:
        """Whatever it is, nobody asked."""

    def left(self, code: int | None) -> None:
        """Nothing hangs on it."""

    def leaves(self) -> None:
        """The gateway leaves."""
        self._socket.close(RESTARTED, "service restart")


class Live:
    """Who listens, and what they are told."""

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        limits: GatewayLimits,
        history: History,
        waiting: Callable[[], Mapping[bytes, int]],
        on_trial: Callable[[], Mapping[bytes, int]],
        now_ns: Callable[[], int],
        promises: Promises,
        *,
        demo: bool,
    ) -> None:
        self._loop = loop
        self._beat_ms = limits.live_beat_ms
        self._pace = Pace(limits.longer_than_ms, limits.longer_floor_ms, limits.doubt_told_ms)
        self._history = history
        self._in_hand = waiting  # how many requests wait here, by browser
        self._on_trial = on_trial
        self._promises = promises
        self._now_ns = now_ns
        self._hello = _frame(
            {"v": 1, "type": "hello", "overlay_after_ms": limits.overlay_after_ms, "demo": demo}
        )
        self._audience: set[BrowserSocket] = set()
        self._pages: set[BrowserSocket] = set()  # those of them that are ours alone: they hear of receipts
        self._known = Standing()
        self._outage: Outage | None = face.follow(None, self._known, self._known, (), now_ns())
        self._shown: Shown | None = None  # what everybody was told last, its time left out
        self._since: tuple[int | None, str | None] = (None, None)  # the begin, and how it is told
        self._held: Mapping[bytes, Held] = {}  # and of whose requests
        self._proof_due = True  # whether the ledger is whole is not known yet of the core that serves
        self._askers: list[Callable[[], None]] = []  # wait for the first word
        self._timer: asyncio.TimerHandle | None = None
        self._set_timer()  # the feed may never speak

    # -- who listens -----------------------------------------------------------------------------------

    def join(self, socket: BrowserSocket) -> None:
        """A page's own socket: it is told everything, from how things stand."""
        socket.accept(_first_offered(socket.head), bytes_max=SAID_BYTES_MAX)
        socket.party = _Listener(socket)
        socket.send(self._hello)
        self._tell_state(beat=False)  # so that everybody knows what this page is told
        if self._shown is not None:
            socket.send(_frame(self._fields(self._show(), self._of(socket.browser, self._waiting()))))
        if socket.browser is not None:
            for receipt in self._promises.untold(socket.browser):
                socket.send(_frame(frame_fields(receipt)))
        self._pages.add(socket)
        socket.gone.append(self._pages.discard)
        self.add(socket)

    def promised(self, receipt: Receipt) -> None:
        """A promise was given, or something became of it."""
        mine = [one for one in self._pages if one.browser is not None and one.browser == receipt.wish.browser]
        if mine:
            told = _frame(frame_fields(receipt))
            for socket in mine:
                socket.send(told)

    def add(self, socket: BrowserSocket) -> None:
        """One more that is told of changes."""
        self._audience.add(socket)
        socket.gone.append(self._audience.discard)

    def when_known(self, then: Callable[[], None]) -> None:
        """Do `then` as soon as there is something to say."""
        if self._shown is not None:
            then()
        else:
            self._askers.append(then)

    # -- what changes ----------------------------------------------------------------------------------

    def look(self, was: Standing, known: Standing) -> None:
        """Something was learned about the core."""
        now_ns = self._now_ns()
        before = self._outage
        self._known = known
        self._outage = face.follow(before, was, known, self._history.samples, now_ns)
        if before is not None and self._outage is None and self._alarmed:
            self._back(before, now_ns)
        self._tell_proof()
        self._tell_state(beat=False)

    @property
    def _alarmed(self) -> bool:
        """Whether everybody was told of an outage."""
        return self._shown is not None and self._shown.text is not None

    def _back(self, outage: Outage, now_ns: int) -> None:
        """A core serves again."""
        assert self._known.serving is not None, "a core that serves was named"
        over = face.finished(outage, self._known.serving.epoch, now_ns)
        if over is not None:
            self._history.add(over)
        self._proof_due = self._known.sound is None
        told = {
            "v": 1,
            "type": "back",
            "outage_ms": face.length_ms(outage, now_ns),
            "verified": self._known.sound,
            "planned": outage.planned,
        }
        self._tell(lambda _: told)

    def _tell_proof(self) -> None:
        if self._proof_due and self._outage is None and self._known.sound is not None:
            self._proof_due = False
            if self._shown is not None:
                self._tell(lambda _: {"v": 1, "type": "verified", "ok": self._known.sound})

    def upkeep(self) -> None:
        """Now and then: tell those whose waiting requests became more or fewer."""
        if not self._alarmed or not self._audience:
            return
        now, told = self._waiting(), self._held
        if now != told:
            changed = {browser for browser in {*now, *told} if now.get(browser) != told.get(browser)}
            self._held = now
            shown = self._show()
            self._tell(lambda held: self._fields(shown, held), only=changed)

    def _tell_state(self, *, beat: bool) -> None:
        shown = self._show()
        lasting = structs.replace(shown, elapsed_ms=0)
        # What a new gateway has not heard yet is no news: neither that a core serves nor that none does.
        known = self._shown is not None or self._outage is None or shown.text is not None
        news = known and (beat or lasting != self._shown)
        if news:
            self._shown = lasting
            self._held = self._waiting()
            self._tell(lambda held: self._fields(shown, held))
            askers, self._askers = self._askers, []
            for then in askers:
                contained("answering who asked early", then)
        if news or self._outage is None or self._timer is None:
            self._set_timer()

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._outage is not None:
            due_ms = face.due_ms(self._outage, self._pace, self._now_ns())
            if due_ms is None or due_ms > self._beat_ms:
                self._timer = self._loop.call_later(self._beat_ms / 1000, self._beat)
            else:
                self._timer = self._loop.call_later(due_ms / 1000, self._change)

    def _beat(self) -> None:
        self._timer = None
        self._tell_state(beat=self._alarmed)

    def _change(self) -> None:
        # A loop that counts whole milliseconds may ring before the change is due. That is no news: it is set again.
        self._timer = None
        self._tell_state(beat=False)

    def close(self) -> None:
        """The gateway ends."""
        if self._timer is not None:
            self._timer.cancel()

    # -- what is said ----------------------------------------------------------------------------------

    def _waiting(self) -> Mapping[bytes, Held]:
        """Whose requests wait: in hand (also for a trial), and promised."""
        in_hand, promised, tried = self._in_hand(), self._promises.waiting(), self._on_trial()
        return {
            browser: (
                in_hand.get(browser, 0) + promised.get(browser, 0),
                promised.get(browser, 0),
                tried.get(browser, 0),
            )
            for browser in {*in_hand, *promised}
        }

    def _of(self, browser: bytes | None, waiting: Mapping[bytes, Held]) -> Held:
        return waiting.get(browser, _NONE) if browser is not None else _NONE

    def _show(self) -> Shown:
        samples = len(self._history.samples)
        return face.show(self._outage, self._known, samples, self._pace, self._now_ns())

    def _fields(self, shown: Shown, held: Held) -> dict[str, object]:
        if shown.began_ns != self._since[0]:  # told the same way each time, also when the wall clock is set
            self._since = (shown.began_ns, None if shown.began_ns is None else clock.wall(shown.began_ns))
        return {**face.fields(shown, held[0], self._since[1]), "promised": held[1], "trial": held[2]}

    def _tell(self, said: Callable[[Held], Mapping[str, object]], only: set[bytes] | None = None) -> None:
        """Say to everybody what `said` makes of the number of requests that wait for him."""
        made: dict[Held, bytes] = {}
        for socket in list(self._audience):
            browser = socket.browser
            if only is not None and browser not in only:
                continue
            held = self._of(browser, self._held)
            if held not in made:
                made[held] = _frame(said(held))
            socket.send(made[held])

    def status(self, head: RequestHead) -> Answer:
        """The state for whoever asks. Its tag leaves out what only the clock changes: a page counts by itself."""
        told = self._fields(self._show(), self._of(browser_of(head.cookie), self._waiting()))
        body = _json(told)
        digest = hashlib.sha256(_json(told | {"elapsed_ms": 0})).hexdigest()[:16]
        tag = f'W/"{digest}"'.encode()
        headers: tuple[Header, ...] = (
            (b"Date", formatdate(usegmt=True).encode()),
            (b"Cache-Control", b"no-store"),
            (b"ETag", tag),
            (b"X-Content-Type-Options", b"nosniff"),
        )
        asked = (value for name, value in head.headers if name.lower() == b"if-none-match")
        if any(tag in value for value in asked):
            return Answer(AnswerHead(304, b"Not Modified", headers, 0), b"")
        return Answer(
            AnswerHead(200, b"OK", ((b"Content-Type", b"application/json"), *headers), len(body)), body
        )


def _first_offered(head: RequestHead) -> str | None:
    """A page that offers subprotocols closes a socket on which none was chosen."""
    return next(iter(head.handshake.protocols), None) if head.handshake is not None else None


def _json(said: Mapping[str, object]) -> bytes:
    return json.dumps(said, ensure_ascii=False, separators=(",", ":")).encode()


def _frame(said: Mapping[str, object]) -> bytes:
    return frame_of(Message(text=True, data=_json(said)))
