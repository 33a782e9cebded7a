"""The commands of the core's command line: serve a ledger, prove it, hold its lock, and what the guard's court needs.

Each is an adapter: it reads the environment, says what is wrong with it in one sentence, and hands over to the room that
does the work. What a served core does from its first to its last moment stands in `lifetime.py`.
"""

import asyncio
import functools
import logging
import os
import signal
import sqlite3
import sys
from dataclasses import replace
from pathlib import Path
from typing import Final, NoReturn

import click
import msgspec
import uvloop

from core import departure
from core.collecting import collect_from_now_on
from core.departure import Departure, ExitCode
from core.guarded.environment import GuardedEnvironment
from core.guarded.life import take_instruments
from core.guarded.recorder import RecorderUnusable
from core.journal.as_it_stands import open_as_it_stands
from core.journal.rebuilding import Rebuilding
from core.journal.store import LEDGER_FILE, Server, StoreError, StoreFault, close_writing, has_ledger, writing
from core.journal.stores.sqlite import has_reset_race
from core.journal.verify import GivenUp
from core.journal.verify import verify as verify_book
from core.keeping.commands import backup, log, restore
from core.lifetime import Life, said
from core.lock_holder import SECONDS_MAX, hold_lock
from core.quick_verdict import verify_quickly
from core.rulings import RULES, Rulings
from core.saying import Log
from core.settings import STORE, Settings
from core.trying.commands import rehearse_restore, try_cases

PORT_DEFAULT: Final = 3001
_LOG: Final = Log()

logger = logging.getLogger("core")


@click.group()
def cli() -> None:
    """The ledger core. It runs alone on loopback, or under a guard that says so in the environment."""
    logging.basicConfig(level=logging.INFO, handlers=[_LOG])
    logging.getLogger("uvicorn.error").setLevel(
        logging.WARNING
    )  # its "started" and "finished" are ours to say
    os.umask(0o077)  # the book, its log and every socket are for their owner alone


@cli.command()
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--port", type=click.IntRange(0, 65_535), default=PORT_DEFAULT, show_default=True)
@click.option("--store", help="A PostgreSQL database instead of a file, as postgresql://USER@HOST/DATABASE.")
def serve(data: Path, port: int, store: str | None) -> None:
    """Serve the ledger of a data folder."""
    environment = GuardedEnvironment.read(os.environ, os.getpid())
    settings = Settings.read(os.environ if store is None else {**os.environ, STORE: store}, data)
    if (
        store is not None
        and isinstance(settings, Settings)
        and settings.store
        and settings.store.has_password
    ):
        settings = [
            f"A command line is read by everybody on this machine: give a password in {STORE} or ~/.pgpass."
        ]
    if isinstance(settings, Settings) and settings.store is not None and (data / LEDGER_FILE).is_file():
        settings = [
            f"{data} holds a ledger in a file, which does not move into a server by itself: choose another folder."
        ]
    faults = [*_faults(environment), *_faults(settings)]
    if isinstance(environment, list) or isinstance(settings, list):
        sys.exit(said(departure.config_invalid(" ".join(faults))))
    instruments = take_instruments(environment)
    if isinstance(instruments, RecorderUnusable):
        sys.exit(said(departure.config_invalid(instruments.reason)))
    # Under a guard the log is a file that programs read; a core that runs alone tells a person at a terminal.
    _LOG.count_on(instruments.recorder, as_json=environment.guarded)
    if environment.guarded:
        # The guard's terminal and process group are not ours to obey; it sends TERM when it means us.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    if environment.limit_ms is not None:
        settings = replace(settings, command_deadline_ms=environment.limit_ms)
    life = Life(data.absolute(), port, environment, settings, instruments)
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        left = runner.run(life.run())
    if left is not None:
        instruments.recorder.last_words(left.word, left.sentence)
        if environment.guarded:
            logger.critical("%s", left.sentence)
            sys.exit(left.code.value)
        sys.exit(said(left))


@cli.command()
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.option("--quick", is_flag=True, help="Prove what came after the newest good checkpoint.")
def verify(data: Path, *, as_json: bool, quick: bool) -> None:
    """Prove the whole ledger of a data folder, reading only; a core may be at work meanwhile."""
    collect_from_now_on()
    settings = Settings.read(os.environ, data)
    if isinstance(settings, list):
        sys.exit(said(departure.config_invalid(" ".join(settings))))
    where = settings.ledger(data)
    if not has_ledger(where, settings.fence_busy_ms):
        sys.exit(
            said(departure.config_invalid(f"There is no ledger in {data}: name its folder with --data."))
        )
    readers = open_as_it_stands(where, 1, settings.fence_busy_ms)
    # What kills whoever rebuilds from it would kill this process too; no drill does.
    rulings = Rulings.beside((data / RULES).absolute())
    rulings.quarantine.read()
    if quick:
        sys.exit(
            verify_quickly(data, readers, settings, Rebuilding(rulings.quarantine), print, as_json=as_json)
        )
    verdict = verify_book(readers, settings.read_ms_max, lambda: False, Rebuilding(rulings.quarantine))
    assert not isinstance(verdict, GivenUp), "nobody asks this process to leave"
    if isinstance(verdict, StoreError):
        sys.exit(said(_unread(verdict)))
    if as_json:
        print(msgspec.json.encode(verdict).decode())
    elif verdict.ok:
        print(
            f"The ledger is whole: {verdict.events} events, head {verdict.head}, all currencies add up to zero,"
            f" balances attested up to event {verdict.attested}."
        )
        if verdict.parked:
            print(f"Left out, because they are set aside: events {', '.join(map(str, verdict.parked))}.")
    if verdict.ok:
        return
    sys.exit(ExitCode.STORE_CORRUPT if as_json else said(departure.corrupt(verdict.reason or "")))


def _unread(error: StoreError) -> Departure:
    """Say why a ledger can't be read: one whose server is away may well be whole."""
    match error.fault:
        case StoreFault.AWAY:
            return departure.away(error.text)
        case StoreFault.UNFIT:
            return departure.unfit(error.text)
        case _:
            return departure.corrupt(f"it can't be read ({error.text})")


@cli.command("look-at-store")
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
def look_at_store(data: Path) -> None:
    """Print what the ledger lies in: the version of its server, if that can be reached and keeps what it acknowledges; of a
    file that of SQLite, and `race` where it is one with the fault of the log's reset.
    """
    settings = Settings.read(os.environ, data)
    if isinstance(settings, list):
        sys.exit(said(departure.config_invalid(" ".join(settings))))
    where = settings.ledger(data)
    connection = writing(where).connect(settings.fence_busy_ms) if isinstance(where, Server) else None
    if isinstance(connection, StoreError):
        sys.exit(said(_unread(connection)))
    if connection is not None:
        print(connection.exec_driver_sql("SHOW server_version").scalar_one())
        close_writing(connection)
    else:
        version = sqlite3.sqlite_version
        print(f"sqlite {version}{' race' if has_reset_race(sqlite3.sqlite_version_info) else ''}")


@cli.command("hold-lock")
@click.option("--data", type=click.Path(path_type=Path), envvar="HARDCORE_DATA", required=True)
@click.option("--seconds", type=click.IntRange(1, SECONDS_MAX), default=10, show_default=True)
def hold_ledger(data: Path, seconds: int) -> NoReturn:
    """Hold the ledger's write lock for a while, changing nothing: a drill's other half."""
    settings = Settings.read(os.environ, data)
    if isinstance(settings, list):
        sys.exit(said(departure.config_invalid(" ".join(settings))))
    left = hold_lock(data, seconds, settings.fence_busy_ms, functools.partial(print, flush=True))
    os._exit(ExitCode.ASKED if left is None else said(left))


cli.add_command(try_cases)
cli.add_command(rehearse_restore)
cli.add_command(backup)
cli.add_command(log)
cli.add_command(restore)


def _faults(read: object) -> list[str]:
    return read if isinstance(read, list) else []
