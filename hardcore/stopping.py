"""`hardcore down`: have everything stopped and kept stopped, also where the guard can't hear it.

A guard that hears stops everything itself. One that does not answer is not taken for one that is not there: it holds its
lock. What is wanted is written down for whoever comes next, and it is looked at as an agent would look; only where its
own beats and the kernel agree that it stands still is it ended, and the launcher brings one that stops everything. Where
there is none, nobody guards what is left, and it is ended here. Not chosen: to have the agents act while nothing is
wanted; whoever starts something then had better be the person.
"""

import os

import click

from frontend.catalogue import refused_words, text
from frontend.catalogue_operator import operator_text
from hardcore import standing
from hardcore.asked import WAIT_S, Asked, is_held, operator, until
from hardcore.control import client
from hardcore.crisis import sentinel_seen
from hardcore.crisis.agent_table import ALONE_TIMES, LOOK_NS, Finding, Seen, Table
from hardcore.crisis.sentinel_seen import Held, Orders
from hardcore.host import clock, leftovers
from hardcore.host.files import take_lock
from hardcore.host.folders import Folders
from hardcore.model.phases import Wanted
from hardcore.up import held

NS_PER_S = 1_000_000_000
#: A guard that is only late is looked at and asked again so many times.
TRIES_MAX = 3
#: Longer than an agent's evidence takes; and how long one that was ended may take to be gone.
EVIDENCE_NS, GONE_NS = 2 * NS_PER_S, 2 * NS_PER_S


@click.command()
@operator
def down(asked: Asked) -> None:
    """Stop everything and keep it stopped until the next `up`."""
    folders = asked.folders
    watched = is_held(folders)
    if watched:
        _have_it_stopped(asked)
    elif _is_laid_out(folders):
        _store(asked)
    try:
        ended = _end_what_is_left(folders)
    except OSError as error:  # its run folder can't be made, or its lock
        asked.fail(text("down_not_stored", asked.lang, why=error.strerror))
    if ended is None:
        asked.fail(text("silent", asked.lang))
    noted = "nothing_running" if _is_laid_out(folders) else "nothing_there"
    asked.say("stopped" if watched or ended else noted)
    asked.tell({"ok": True, "was_running": watched or ended > 0})


def _have_it_stopped(asked: Asked) -> None:
    """Have the sentinel stop everything, or the one after it, and wait until nobody keeps anything running."""
    folders = asked.folders
    if not _hears(asked):
        _store(asked)
        if not asked.json:
            click.echo(operator_text("down_unheard", asked.lang))
        if not any(_gone_or_heard(asked) for _ in range(TRIES_MAX)):
            asked.fail(operator_text("down_noted", asked.lang))
    # A sentinel that dies in the middle of it is followed by one that goes on, as long as there is a launcher.
    until(lambda: not is_held(folders) and not held(folders.launcher_lock))
    if is_held(folders):
        asked.fail(text("still_stopping", asked.lang, seconds=int(WAIT_S)))


def _hears(asked: Asked) -> bool:
    """Tell the sentinel; return whether it has heard. Ends with a sentence when the answer is no."""
    try:
        answer = client.ask(asked.folders.control, {"verb": "down"})
    except client.Unreachable:
        return False
    if answer.get("ok") is False:
        asked.fail(text("refused", asked.lang, why=refused_words(answer, asked.lang)))
    asked.say("stopping")
    return True


def _store(asked: Asked) -> None:
    """Write down that everything should stay off."""
    try:
        standing.store_wanted(asked.folders, Wanted.DOWN)
    except OSError as error:
        asked.fail(text("down_not_stored", asked.lang, why=error.strerror))


def _gone_or_heard(asked: Asked) -> bool:
    """Look at the sentinel until it is gone or nothing proves that it stands still; then whether it hears."""
    orders = sentinel_seen.read_orders(asked.folders.agents)
    if orders is not None:
        _look_on(orders)
    return not is_held(asked.folders) or _hears(asked)


def _look_on(orders: Orders) -> None:
    """Look at the sentinel that has left this word, and end it as soon as it is proven to stand still."""
    try:
        sentinel = Held(orders.pid, orders.start)
    except OSError:
        return  # nobody can tell who that is
    table = Table()
    over_ns = clock.now_ns() + ALONE_TIMES * orders.stale_ns + EVIDENCE_NS
    try:
        while not sentinel.gone and clock.now_ns() < over_ns:
            seen = Seen(
                clock.now_ns(),
                gone=False,
                beats=sentinel_seen.beats(orders),
                body=sentinel_seen.body(orders.pid),
            )
            if table.judge(seen, orders.stale_ns, orders.after_ns) is Finding.FROZEN:
                sentinel.end()
                sentinel.ends_within(GONE_NS)
                return
            sentinel.ends_within(LOOK_NS)
    finally:
        sentinel.let_go()


def _is_laid_out(folders: Folders) -> bool:
    return os.path.isdir(folders.state)  # noqa: PTH112  # pathlib's raises for a name that is too long


def _end_what_is_left(folders: Folders) -> int | None:
    """End what a guard that was killed has left, as long as everything should be off; return how many processes.

    None: a sentinel lives that can't be reached. One whose run folder was removed makes way within moments.
    """
    if not _is_laid_out(folders) or standing.wanted(folders) is not Wanted.DOWN:
        return 0
    folders.run.mkdir(mode=0o700, exist_ok=True)  # somebody may have removed it under the living
    lock = take_lock(folders.run / "sentinel.lock")
    if lock is None:
        return 0  # a sentinel has just begun: it reads what is wanted and ends them itself
    try:
        if not until(lambda: not held(folders.guard_lock)):
            return None
        return leftovers.end_leftovers(
            folders, standing.policy_in_force(folders).policy.stop_timeout_ms / 1000
        )
    finally:
        os.close(lock)
