"""The barrier: goes by the rules of the quarantine before a core sees a request, and counts how often each refused.

The rules are read once before anything is served, so that a gateway that dies does not open the fence, and then on a
thread each time the guard says that there are others. Between a verdict and the rules that follow from it the verdict
itself counts. Counts are written at most once in HITS_MS, on the same thread; they are for people, so what a death of
this process loses of them is let go. A request costs nothing here while there is no rule.
"""

import asyncio
import datetime as dt
import hashlib
import logging
import math
import time
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from hardcore.crisis.exchange import Exchange
from hardcore.crisis.feed import Verdict, VerdictHeard
from hardcore.crisis.heads import browser_of
from hardcore.crisis.quarantine import (
    FILE_BYTES_MAX,
    Refusal,
    Rules,
    SetAside,
    Stopped,
    is_rule_id,
    read_rules,
)
from hardcore.host.files import read_json, write_json

_LOG = logging.getLogger(__name__)

#: Counts are written at most this often.
HITS_MS: Final = 2_000
#: Rules whose counts are remembered; the longest unused go first.
COUNTED_MAX: Final = 10_000
#: Verdicts remembered.
VERDICTS_MAX: Final = 4_096
_SETS_ASIDE: Final = frozenset({Verdict.CONVICTED, Verdict.HELD})


def source_of(exchange: Exchange) -> str:
    """Who sends a request, as a letter names it: never the cookie itself, which opens what is its browser's."""
    return source_named(_browser(exchange), exchange.client.address)


def source_named(browser: bytes | None, address: str) -> str:
    """The same, from the cookie that tells browsers apart, or from where somebody sits."""
    return f"peer:{address}" if browser is None else f"browser:{hashlib.sha256(browser).hexdigest()[:16]}"


def _browser(exchange: Exchange) -> bytes | None:
    return exchange.browser if exchange.browser is not None else browser_of(exchange.head.cookie)


class Barrier:
    """`renewed` is called when other rules are in force. Without a folder there are none."""

    def __init__(self, loop: asyncio.AbstractEventLoop, folder: Path | None) -> None:
        self.renewed: Callable[[], None] = lambda: None
        self.rules = Rules()
        self._loop = loop
        self._folder = folder
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="quarantine") if folder is not None else None
        self._reading: asyncio.Task[None] | None = None
        self._again = False
        self._verdicts: dict[str, VerdictHeard] = {}
        self._fresh: dict[str, str] = {}  # letters of verdicts whose rules were not read yet, by name
        self._hits: dict[str, tuple[int, str]] = {}
        self._told_hits: asyncio.Task[None] | None = None
        self._hits_due = False
        if folder is not None:
            # Not on a thread: nothing is served yet, and what is served before would pass without a rule.
            self._took(_read(folder / "quarantine.json"))
            self._hits = _read_hits(folder / "rule_hits.json")

    # -- the rules -------------------------------------------------------------------------------------

    def look(self) -> None:
        """The guard has written other rules."""
        if self._folder is None or self._thread is None:
            return
        if self._reading is not None:
            self._again = True  # what is being read may be older than what was told now
            return
        self._reading = self._loop.create_task(self._look(self._folder / "quarantine.json", self._thread))

    async def current(self) -> None:
        """Wait until what the guard has said of its rules is read: what nobody waits for may wait for that."""
        if self._reading is not None:
            await asyncio.wait({self._reading})

    async def _look(self, path: Path, thread: ThreadPoolExecutor) -> None:
        self._again = True
        while self._again:
            self._again = False
            known = list(self._fresh)  # the guard writes a rule before it says its verdict
            if self._took(await self._loop.run_in_executor(thread, _read, path)):
                for name in known:
                    self._fresh.pop(name, None)
                self._let_go()
        self._reading = None
        self.renewed()

    def _let_go(self) -> None:
        """Forget the verdicts whose rule is gone: a person has let run what they name."""
        gone = [
            said.name
            for said in self._verdicts.values()
            if said.outcome in _SETS_ASIDE
            and said.name not in self.rules.names
            and said.name not in self._fresh
        ]
        for name in gone:
            del self._verdicts[name]

    def _took(self, read: Rules | str | None) -> bool:
        if isinstance(read, str):
            _LOG.error("the rules of the quarantine could not be read, those before stay: %s", read)
        if not isinstance(read, Rules):
            return False
        self.rules = read
        return True

    def heard(self, verdict: VerdictHeard) -> None:
        """What came of a suspect's trial."""
        self._verdicts.pop(verdict.name, None)
        self._verdicts[verdict.name] = verdict
        self._fresh.pop(verdict.name, None)
        if verdict.outcome in _SETS_ASIDE:
            self._fresh[verdict.name] = verdict.letter or ""
            self.look()
        for memory in (self._verdicts, self._fresh):
            if len(memory) > VERDICTS_MAX:
                memory.pop(next(iter(memory)))

    def suspected(self, names: Collection[str]) -> None:
        """These are suspects (again): what was said of them before counts no more."""
        for name in names:
            self._verdicts.pop(name, None)
            self._fresh.pop(name, None)

    def verdict(self, name: str) -> VerdictHeard | None:
        """The last verdict on a name, as far as this gateway heard it."""
        return self._verdicts.get(name)

    def letter(self, name: str) -> str | None:
        """The letter under which a name is set aside: by a rule, or by a verdict whose rule is still to be read."""
        return self._fresh.get(name, self.rules.names.get(name))

    def bars(self, exchange: Exchange) -> bool:
        """Whether a request must not reach a core; why is written down with it."""
        exchange.refusal = self._refusal(exchange)
        exchange.barred |= exchange.refusal is not None
        return exchange.refusal is not None

    def _refusal(self, exchange: Exchange) -> Refusal | None:
        rules = self.rules
        if exchange.head.safe or not (rules.names or rules.digests or rules.sources or self._fresh):
            return None
        browser = _browser(exchange) if rules.sources else None
        # An address is nobody: all programs of this machine have one, and all who come through a proxy.
        if browser is not None:
            until = rules.sources.get(source_named(browser, ""), 0.0) - time.time()
            if until > 0:
                return Stopped(max(1, math.ceil(until)))
        name = exchange.name
        letter = self.letter(name) if name is not None else None
        if letter is None and rules.digests and exchange.whole and not exchange.streamed:
            letter = rules.digests.get(exchange.digest_hex())
        return None if letter is None else SetAside(letter)

    # -- how often -------------------------------------------------------------------------------------

    def hit(self, rule: str) -> None:
        """A rule has refused something, here or in the core."""
        if self._folder is None or not is_rule_id(rule):
            return
        count, _ = self._hits.pop(rule, (0, ""))
        now = dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._hits[rule] = (count + 1, now)
        if len(self._hits) > COUNTED_MAX:
            self._hits.pop(next(iter(self._hits)))
        self._hits_due = True
        if self._told_hits is None:
            self._told_hits = self._loop.create_task(self._write_hits(self._folder / "rule_hits.json"))

    async def _write_hits(self, path: Path) -> None:
        while self._hits_due:
            self._hits_due = False
            await self._written(path)
            await asyncio.sleep(HITS_MS / 1000)
        self._told_hits = None

    async def _written(self, path: Path) -> None:
        assert self._thread is not None
        told = {"hits": {rule: {"count": n, "last_at": at} for rule, (n, at) in self._hits.items()}}
        try:
            await self._loop.run_in_executor(self._thread, write_json, path, told)
        except OSError as error:
            self._hits_due = True
            _LOG.warning("how often rules refused could not be written: %s", error.strerror)

    async def finish(self) -> None:
        """Write what is not written."""
        if self._thread is None or self._folder is None:
            return
        if self._told_hits is not None:
            self._told_hits.cancel()
        if self._hits_due:
            await self._written(self._folder / "rule_hits.json")
        self._thread.shutdown(wait=False)


def _read(path: Path) -> Rules | str | None:
    """The rules as they lie there; None: there is no file, and so no news."""
    try:
        with path.open("rb") as file:
            data = file.read(FILE_BYTES_MAX + 1)
    except FileNotFoundError:
        return None
    except OSError as error:
        return str(error.strerror)
    return read_rules(data)


def _read_hits(path: Path) -> dict[str, tuple[int, str]]:
    kept: Mapping[str, Any] = read_json(path)  # Any: as JSON gives it
    rows = kept.get("hits")
    found: dict[str, tuple[int, str]] = {}
    for rule, row in list(rows.items())[:COUNTED_MAX] if isinstance(rows, dict) else ():
        count, last_at = (row.get("count"), row.get("last_at")) if isinstance(row, dict) else (None, None)
        if is_rule_id(rule) and isinstance(count, int) and count >= 0 and isinstance(last_at, str):
            found[rule] = (count, last_at[:40])
    return found
