"""One throw-away core's life: the same book, writer, service and application as any core's, on a copy.

What is left out is what a trial must not do: there is no guard to speak to, nothing is proven behind, no import of the household
is gone on with, no ballast is laid. Before a command is given to the writer the core says whose it is, so that its death
leaves the fingerprint behind. What the store or the disk does to it ends it with that word, because no command is guilty
of it. Not chosen: a service of the trial's own beside the real one; what it did not do alike would be tried by nobody.
"""

import asyncio
import os
import socket
from collections.abc import Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, NoReturn

import msgspec
import uvloop
from starlette.routing import Route

from core import departure
from core.admission import Wish
from core.departure import Departure
from core.guarded.beacon import Beacon
from core.guarded.recorder import NoRecorder, Recorder
from core.imports.desk import Desk
from core.journal.answers import Answer, Order
from core.journal.store import LEDGER_FILE, WritingEngine, open_reading
from core.journal.writer import Writer
from core.ledger.commands import Command, accounts_of, fingerprint_of, transaction_of
from core.listening import LedgerServer, bind_unix
from core.opening import OpenBook, Telling, Terms, open_book
from core.rulings import Rulings
from core.service import Service
from core.settings import Settings
from core.trying.forking import say
from core.trying.rows import booking
from core.web.app import lay_out, make_app


class Birth(msgspec.Struct, frozen=True):
    """What a throw-away core is told. `data`: the real data folder, of which it reads files of imports and no more.

    `socket`: in the folder, in which it stands, so that its path is short. `rows`: a path that nobody can guess, on which
    it is asked to book a row.
    """

    folder: Path
    socket: Path
    data: Path
    rows: str
    rulings: Path
    settings: Settings


def live(birth: Birth, words: socket.socket) -> None:
    """Be a core until somebody ends this process."""
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(_live(birth, words))


async def _live(birth: Birth, words: socket.socket) -> None:
    loop = asyncio.get_running_loop()

    leave = partial(leave_with, words)
    recorder = NoRecorder()
    rulings = Rulings.of_a_trial(birth.rulings)
    rulings.read()
    settings = birth.settings
    book = open_copy(birth.folder, settings, rulings, recorder)
    if isinstance(book, Departure):
        leave(book)
    writer = Writer(
        book.journal,
        recorder,
        loop,
        on_shut=lambda error: leave(departure.no_room(error.text)),
        on_failed=lambda text: leave(departure.commit_failed(text)),
        on_fenced=lambda actual: leave(departure.fenced(book.epoch, actual)),
        on_bug=lambda error: leave(departure.bug(repr(error))),
    )
    writer.start()
    readers = open_reading(birth.folder / LEDGER_FILE, settings.readers + 1, settings.write_busy_ms)
    service = TriedService(writer, readers, recorder, settings, book.epoch, rulings=rulings, words=words)
    desk = Desk(service, recorder, birth.folder)
    await desk.start()  # no import lies in this folder: nothing is gone on with
    app = lay_out()
    app.router.routes.append(
        Route(f"{birth.rows}/{{id}}/{{ordinal:int}}", booking(birth.data), methods=["POST"])
    )
    bound = bind_unix(birth.socket)
    assert not isinstance(bound, str), bound
    await LedgerServer(make_app(service, desk, app)).start(bound)
    say(words, ready=book.proof.head_seq)
    await loop.create_future()  # somebody ends it


def open_copy(folder: Path, settings: Settings, rulings: Rulings, recorder: Recorder) -> OpenBook | Departure:
    """Open the copy in a folder as a start opens its ledger: fence, schema, proof. Blocks."""
    engine = WritingEngine(folder / LEDGER_FILE, lasting=False)
    terms = Terms(None, (), None, shared=True)
    return open_book(folder, terms, settings, Telling(recorder, Beacon(None)), engine=engine, rulings=rulings)


def leave_with(words: socket.socket, left: Departure) -> NoReturn:
    """Say why this core leaves, and end the process with the code that says the same."""
    say(words, left=left.sentence)
    os._exit(left.code.value)


class TriedService(Service):
    """A service that says of each command whose it is before it does it."""

    def __init__(self, *parts: Any, words: socket.socket, **named: Any) -> None:
        super().__init__(*parts, **named)
        self._words = words

    async def carry_out(
        self,
        command: Command,
        key: str | None,
        digest: bytes,
        command_id: str,
        slot: int,
        *,
        kind: str = "",
        name: str = "",
        body_bytes: int = 0,
    ) -> Answer:
        """Say whose it is and do it."""
        self._tell(kind, fingerprint_of(command), accounts_of(command), transaction_of(command))
        return await super().carry_out(
            command, key, digest, command_id, slot, kind=kind, name=name, body_bytes=body_bytes
        )

    async def carry_out_each(
        self, orders: Sequence[Order], slot: int, wish: Wish | None = None
    ) -> Sequence[Answer] | None:
        """Say whose they are and do them."""
        if wish is None:
            return None  # one by one, each by its own name
        accounts = tuple(dict.fromkeys(name for order in orders for name in order.account_ids))
        self._tell(wish.kind, wish.fingerprint, accounts, orders[0].transaction_id if orders else "")
        return await super().carry_out_each(orders, slot, wish)

    async def exercise(
        self, key: str, digest: bytes, command_id: str, account_id: str, slot: int
    ) -> Answer | None:
        """Say whose it is and do it."""
        self._tell("drill", key.encode(), (account_id,), "")
        return await super().exercise(key, digest, command_id, account_id, slot)

    def _tell(self, kind: str, wish: bytes, account_ids: tuple[str, ...], transaction_id: str) -> None:
        say(
            self._words,
            fingerprint=sha256(wish).hexdigest(),
            kind=kind,
            account_ids=account_ids,
            transaction_id=transaction_id,
        )
