"""The court: one case after another, in cores that are thrown away, and for each of them what became of it.

A core lives on while cases survive it, so that an innocent costs some milliseconds. What happens in a core in which others
were tried before convicts nobody: one of them may have left it so (a poison that strikes a moment later, a lock that is never
let go, memory), so the case is tried once more in a core of its own. Nor does a death that somebody else brought, or the
store: it is tried once more, and if it is the same then, nobody could try it. Not chosen: a fresh copy for each case; what
came before it is in the ledger for a real core too.
"""

import time
import uuid
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final, assert_never

import msgspec

from core.settings import Settings
from core.trying.asking import Lost, Reply, asking_for, sent_of
from core.trying.copying import Copy
from core.trying.docket import KEY_HEADER, Case, Docket, Events, Request, Row, Unusable
from core.trying.forking import WRITTEN_BYTES_MAX, Bounds, fork, term_held_back
from core.trying.life import Birth, live
from core.trying.log import SLICE_EVENTS, Span, killer_in, named, rebuild
from core.trying.rows import GONE
from core.trying.verdicts import CONVICTS, WHY_CHARACTERS_MAX, Ordeal, Verdict, ended, untried, whose_of
from core.trying.watch import Ending, How, Ward

START_MS_MAX: Final = 30_000  # without a word, of a copy whose tail is proven
TRIES: Final = 2  # of one case: the second in a core of its own
_FOUND, _NOT_FOUND, _NOT_NOW = 200, 404, 503


class _Attempt(msgspec.Struct, frozen=True):
    """One try: its verdict, and whether it counts only if it comes out again."""

    verdict: Verdict
    again: bool = False


class Court(msgspec.Struct):
    """One court in its folder, in which the process stands. `tell` is given each line that is to be said."""

    docket: Docket
    data: Path
    folder: Path
    rulings: Path
    copy: Copy
    memory_bytes: int
    settings: Settings
    tell: Callable[[dict[str, Any] | Verdict], None]
    _ward: Ward | None = None
    _born: int = 0
    _rows: str = msgspec.field(default_factory=lambda: f"/{uuid.uuid4().hex}")
    _run: set[str] = set()  # keys that are in the copy because of us

    def sit(self) -> None:
        """Try every case and say what became of it."""
        try:
            for case in self.docket.cases:
                self.tell({"type": "begun", "name": case.name})
                self.tell(self._try(case))
        finally:
            self.end()

    def end(self) -> None:
        """End whatever was started."""
        if self._ward is not None:
            self._ward.end()
            self._ward = None

    def _try(self, case: Case) -> Verdict:
        tried = case.tried
        begun_ns = time.monotonic_ns()
        match tried:
            case Events(after):
                verdict = self._try_log(case.name, Span(after, self.copy.seq))
            case Request() | Row():
                verdict = self._try_command(case.name, tried)
            case Unusable(why):
                verdict = untried(case.name, why)
            case _:
                assert_never(tried)
        return msgspec.structs.replace(verdict, ms=(time.monotonic_ns() - begun_ns) // 1_000_000)

    def _try_command(self, name: str, tried: Request | Row) -> Verdict:
        first = self._attempt(name, tried)
        if not first.again:
            return first.verdict
        self.tell({"type": "begun", "name": name})
        second = self._attempt(name, tried)  # in a core of its own: the one before is dead
        if not second.again:
            return second.verdict
        return untried(name, second.verdict.why or "it came out differently each time")

    def _attempt(self, name: str, tried: Request | Row) -> _Attempt:
        ward = self._core()
        if isinstance(ward, str):
            return _Attempt(untried(name, ward))
        alone = ward.tried == 0
        known = self._is_known(ward, tried.key) if tried.key is not None else False
        if isinstance(known, str):
            return _Attempt(untried(name, known), again=self._ward is None)
        if known and tried.key not in self._run:
            return _Attempt(Verdict(name, Ordeal.COMMITTED))
        if known and isinstance(tried, Row):
            return _Attempt(Verdict(name, Ordeal.SURVIVED))  # it is booked, in the copy, by an attempt before
        sent = self._sent(tried, renamed=known)
        ward.tried += 1
        if tried.key is not None:
            self._run.add(tried.key)
        found = ward.reply(self._socket(), sent, self.docket.limit_ms)
        if isinstance(found, Ending):
            self._ward = None
        return self._judged(name, found, ward.told, alone=alone)

    def _sent(self, tried: Request | Row, *, renamed: bool) -> bytes:
        """Return what the core is asked. `renamed`: an attempt before it got as far as the copy, under its own key."""
        if isinstance(tried, Row):
            return sent_of(Request("POST", f"{self._rows}/{tried.import_id}/{tried.ordinal}"))
        if not renamed:
            return sent_of(tried)
        headers = [(name, value) for name, value in tried.headers if name.lower() != KEY_HEADER]
        headers.append((KEY_HEADER, uuid.uuid4().hex))
        return sent_of(msgspec.structs.replace(tried, headers=headers))

    def _is_known(self, ward: Ward, key: str) -> bool | str:
        """Return whether a key is in the copy; a sentence where that can't be known."""
        found = ward.reply(self._socket(), asking_for(key), self.docket.limit_ms)
        if isinstance(found, Ending):
            self._ward = None
            return f"its key could not be looked up: {found.how.value}"
        if isinstance(found, Reply) and found.status in {_FOUND, _NOT_FOUND}:
            return found.status == _FOUND
        return "its key could not be looked up"

    def _judged(
        self, name: str, found: Reply | Lost | Ending, told: dict[str, Any], *, alone: bool
    ) -> _Attempt:
        whose = whose_of(told)
        match found:
            case Lost():
                return _Attempt(untried(name, "its answer was cut"))
            case Reply(status=status, answer=answer):
                if status == GONE:
                    return _Attempt(untried(name, "the row is not there any more"))
                if status == _NOT_NOW or found.draining:
                    return _Attempt(
                        untried(name, f"the throw-away core answered {status}: it could not do it now")
                    )
                return _Attempt(Verdict(name, Ordeal.SURVIVED, status=status, answer=answer, **whose))
            case Ending():
                verdict = ended(name, found)
                again = verdict.ordeal is Ordeal.UNTRIED or not alone
                return _Attempt(
                    msgspec.structs.replace(verdict, **whose), again=again and found.how is not How.SLOW
                )
            case _:
                assert_never(found)

    def _socket(self) -> str:
        return f"{self._born}.sock"

    def _core(self) -> Ward | str:
        """Return a core that answers, started if there is none; a sentence where there can't be one."""
        if self._ward is not None:
            return self._ward
        why = ""
        for _ in range(TRIES):
            ward = self._begin(self._live)
            word = ward.word(START_MS_MAX)
            if not isinstance(word, Ending) and "ready" in word:
                return ward
            self.end()
            why = _unstarted(word)
        return why

    def _live(self, words: Any) -> None:
        birth = Birth(self.folder, Path(self._socket()), self.data, self._rows, self.rulings, self.settings)
        live(birth, words)

    def _begin(self, work: Callable[[Any], None]) -> Ward:
        self._born += 1
        stacks = self.folder / f"{self._born}.stacks"
        cpu_s = (self.docket.limit_ms // 1000 + 10) * (len(self.docket.cases) + 1)
        bounds = Bounds(self.memory_bytes, cpu_s, self.copy.size_bytes + WRITTEN_BYTES_MAX)
        with term_held_back():  # a core that nobody knows of could not be ended
            self._ward = Ward(fork(work, stacks, bounds), stacks, self.memory_bytes)
        return self._ward

    def _try_log(self, name: str, span: Span) -> Verdict:
        self.end()
        found = self._rebuilt(span)
        if not isinstance(found, _Stopped):
            return self._opened(name)
        verdict = ended(name, found.ending)
        if verdict.ordeal not in CONVICTS:
            return verdict
        near = Span(found.reached, min(found.reached + SLICE_EVENTS, span.until))
        seq = killer_in(near if near != span and self._kills(near) else span, self._kills)
        if seq is None:
            return msgspec.structs.replace(verdict, why="no single event does it by itself")
        of = named(self.folder, seq)
        return msgspec.structs.replace(
            verdict, seq=seq, kind=of.kind, transaction_id=of.transaction_id, account_ids=of.account_ids
        )

    def _opened(self, name: str) -> Verdict:
        """Say what becomes of a core that opens the copy whole, where no event by itself has hurt it."""
        ward = self._core()
        if isinstance(ward, Ward):
            return Verdict(name, Ordeal.SURVIVED)
        return untried(name, ward)

    def _kills(self, span: Span) -> bool:
        found = self._rebuilt(span)
        return isinstance(found, _Stopped) and ended("", found.ending).ordeal in CONVICTS

    def _rebuilt(self, span: Span) -> "_Stopped | None":
        """Have a span rebuilt in a process of its own; None: that went well."""
        stopped = None
        for _ in range(TRIES):
            stopped = self._rebuild(span)
            if stopped is None or ended("", stopped.ending).ordeal is not Ordeal.UNTRIED:
                break
        return stopped

    def _rebuild(self, span: Span) -> "_Stopped | None":
        ward = self._begin(partial(rebuild, self.folder, self.rulings, span))
        reached = span.after
        try:
            while True:
                word = ward.word(self.docket.limit_ms)
                if isinstance(word, Ending):
                    return _Stopped(word, reached)
                if "over" in word:
                    return None
                reached = int(word.get("rebuilt", reached))
        finally:
            self.end()


class _Stopped(msgspec.Struct, frozen=True):
    """A rebuilding that was not brought to its end. `reached`: the last event of which it was told."""

    ending: Ending
    reached: int


def _unstarted(word: dict[str, Any] | Ending) -> str:
    if isinstance(word, Ending):
        how = word.how.value if word.signal is None else f"signal {word.signal}"
        at = f" at {word.frame}" if word.frame else ""
        return f"no throw-away core could be started: {how}{at}"
    said = str(word.get("left") or word.get("fault") or "it said nothing of why")
    return f"no throw-away core could be started: {said[:WHY_CHARACTERS_MAX]}"
