"""`hardcore dlq`: requests that were set aside, with the same powers as the dashboard.

Everything is asked of an investigator; this room only counts, asks the person, shows progress and prints. One letter is named by
its number or a beginning of it; many are meant by `--all`, narrowed by `--where name=value`, counted and confirmed.
"""

import re
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from decimal import Decimal, InvalidOperation
from typing import Any, Final, NoReturn, TextIO

import click

from frontend.catalogue_letters import refusal, told, word
from hardcore.asked import Asked, keep, operator, options
from hardcore.investigator_line import Answer, Interrupted, Line, Unreachable, investigator
from hardcore.lines import wrapped
from postmortem.cli import terminal_look
from postmortem.dead_letters.as_terminal import print_letter, print_list
from postmortem.dead_letters.ordeals import answered, read_dry_run, was_refused, went_well
from postmortem.reports.visible import visible

LISTED: Final = 50
BULK_MAX: Final = 500
PROGRESS_S: Final = 0.25
#: A request that is larger than this is none that the ledger takes.
BODY_CHARACTERS_MAX: Final = 1 << 20
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_FULL: Final = 36
_WHERE: Final = frozenset({"state", "reason", "account"})
#: How often another investigator is looked for while many are done, and the pause before each time.
RECONNECTS_MAX: Final = 20
RECONNECT_S: Final = 1.0

_where = click.option("--where", multiple=True, metavar="NAME=VALUE", help="state, reason or account.")
_all = click.option("--all", "everything", is_flag=True, help="Every letter that --where lets through.")
_yes = click.option("--yes", is_flag=True, help="Don't ask; for scripts.")
_letter = click.argument("letter", required=False, default="")


@click.group(invoke_without_command=True)
@options
@click.pass_context
def dlq(context: click.Context, /, **given: object) -> None:
    """Requests that were set aside: list, show, dry-run, retry, correct, requeue, hold, discard, undo."""
    keep(context, given)
    if context.invoked_subcommand is None:
        context.invoke(dlq_list, data=None, as_json=False, lang=None, where=())


@dlq.command("list")
@_where
@operator
def dlq_list(asked: Asked, where: Sequence[str]) -> None:
    """List them, newest first. Works with everything stopped."""
    narrowed = _narrowed(asked, where)
    with _line(asked) as line:
        found = _done(asked, line.get("letters", limit=BULK_MAX if asked.json else LISTED, **narrowed))
    asked.tell(found["items"])
    if asked.json:
        return
    if not found["items"]:
        click.echo(word("none_fits" if narrowed else "none", asked.lang))
    print_list(found["items"], found["total"], asked.lang, sys.stdout.write, terminal_look())


@dlq.command("show")
@click.argument("letter")
@operator
def dlq_show(asked: Asked, letter: str) -> None:
    """Tell one: why it is here, what it says, and what became of it. Works with everything stopped."""
    with _line(asked) as line:
        found = _done(asked, line.get(f"letters/{_number(asked, line, letter)}"))
    asked.tell(found)
    if not asked.json:
        print_letter(found, asked.lang, sys.stdout.write, terminal_look())


@dlq.command("dry-run")
@_letter
@_all
@_where
@_yes
@operator
def dlq_dry_run(asked: Asked, letter: str, where: Sequence[str], *, everything: bool, yes: bool) -> None:
    """Run it in a throw-away core on a copy of the ledger. Exit code 0: that went well; 2: the ledger refused it."""
    if everything:
        _many(asked, "dry-run", where, yes=yes)
    found = _one(asked, letter, "dry-run", {})
    dry_run = read_dry_run(found["dry_run"])
    if was_refused(dry_run):
        _say(asked, word("dry_refused", asked.lang, status=visible(answered(dry_run))))
        _say(asked, word("next_refused", asked.lang))
        sys.exit(2)
    ordeal = dry_run.ordeal
    _say(asked, word("tried", asked.lang, ordeal=told("ordeal", ordeal, asked.lang)))
    if dry_run.why:
        _say(asked, word("why", asked.lang, why=visible(dry_run.why)))
    sys.exit(0 if went_well(dry_run) else 1)


@dlq.command("retry")
@_letter
@_all
@_where
@_yes
@click.option("--anyway", is_flag=True, help="Without a dry run that went well: it may kill the core again.")
@operator
def dlq_retry(
    asked: Asked, letter: str, where: Sequence[str], *, everything: bool, yes: bool, anyway: bool
) -> None:
    """Run it once more, under its own key. Exit code 0: a core has it in the ledger."""
    if everything:
        _many(asked, "retry", where, yes=yes)
    found = _one(asked, letter, "retry", {"anyway": anyway})
    _say_state(asked, found)
    if found["state"] != "RESOLVED":
        _say_why_not(asked, found)


@dlq.command("correct")
@click.argument("letter")
@click.option(
    "--file", "changed", type=click.File(encoding="utf-8"), required=True, help="JSON; - for stdin."
)
@operator
def dlq_correct(asked: Asked, letter: str, changed: TextIO) -> None:
    """Send changed contents as a new request; the old one is discarded with the link. Exit code 0: it is booked."""
    try:
        body = changed.read(BODY_CHARACTERS_MAX)
    except (OSError, ValueError):
        asked.fail(refusal("correction_unreadable", asked.lang, {}))
    found = _one(asked, letter, "correct", {"body": body})
    _say_state(asked, found)
    if not found["corrected_by"]:
        _say_why_not(asked, found)
    _say(asked, word("corrected", asked.lang, key=found["corrected_by"]))


@dlq.command("requeue")
@_letter
@_all
@_where
@_yes
@operator
def dlq_requeue(asked: Asked, letter: str, where: Sequence[str], *, everything: bool, yes: bool) -> None:
    """Try it and run it after those that wait already."""
    if everything:
        _many(asked, "requeue", where, yes=yes)
    _one(asked, letter, "requeue", {})
    _say(asked, word("queued", asked.lang))


@dlq.command("hold")
@_letter
@_all
@_where
@_yes
@operator
def dlq_hold(asked: Asked, letter: str, where: Sequence[str], *, everything: bool, yes: bool) -> None:
    """Leave it out of everything that is done to many, until you decide."""
    if everything:
        _many(asked, "hold", where, yes=yes)
    _say_state(asked, _one(asked, letter, "hold", {}))


@dlq.command("discard")
@_letter
@_all
@_where
@_yes
@click.option("--reason", default="", help="Why; it stays on record.")
@operator
def dlq_discard(
    asked: Asked, letter: str, where: Sequence[str], *, everything: bool, yes: bool, reason: str
) -> None:
    """Mark it as not to be run. It stays on record, and goes on being refused."""
    if not reason.strip():
        asked.fail(refusal("reason_needed", asked.lang, {}), 2)
    if everything:
        _many(asked, "discard", where, yes=yes, reason=reason)
    _say_state(asked, _one(asked, letter, "discard", {"reason": reason}))


@dlq.command("undo")
@click.argument("letter")
@operator
def dlq_undo(asked: Asked, letter: str) -> None:
    """Take a discard back, within half a minute."""
    _say_state(asked, _one(asked, letter, "undo-discard", {}))


@contextmanager
def _line(asked: Asked) -> Iterator[Line]:
    """A line to an investigator; ends with a sentence where there is none."""
    if not asked.folders.state.is_dir():
        asked.fail(word("no_data", asked.lang, path=asked.data))
    try:
        with investigator(asked.folders, asked.lang) as line:
            yield line
    except Interrupted:
        asked.fail(word("interrupted", asked.lang))
    except (Unreachable, OSError) as error:
        asked.fail(word("no_investigator", asked.lang, why=error))


def _done(asked: Asked, answer: Answer) -> dict[str, Any]:
    """What was answered; ends with its sentence where it is a no."""
    if not answer.ok:
        asked.fail(visible(str(answer.told.get("detail") or answer.status)))
    return answer.told


def _number(asked: Asked, line: Line, letter: str) -> str:
    """The whole number of a letter; its beginning is enough where it is one letter's alone."""
    if not letter:
        asked.fail(word("choose", asked.lang), 2)
    if not _ID.fullmatch(letter):
        asked.fail(refusal("letter_unknown", asked.lang, {}))
    if len(letter) >= _FULL or line.get(f"letters/{letter}").ok:
        return letter
    items = _done(asked, line.get("letters", limit=BULK_MAX))["items"]
    fitting = [str(one["id"]) for one in items if str(one["id"]).startswith(letter)]
    if len(fitting) != 1:
        asked.fail(refusal("letter_unknown", asked.lang, {}))
    return fitting[0]


def _one(asked: Asked, letter: str, verb: str, wish: Mapping[str, Any]) -> dict[str, Any]:
    with _line(asked) as line:
        found = _done(asked, line.post(f"letters/{_number(asked, line, letter)}/{verb}", wish))
    asked.tell(found)
    return found


def _many(asked: Asked, verb: str, where: Sequence[str], *, yes: bool, reason: str = "") -> None:
    """Count, ask, and do it to many; ends with the exit code."""
    narrowed = {"state": "QUARANTINED", **_narrowed(asked, where)}
    with _line(asked) as line:
        found = _done(asked, line.get("letters", limit=BULK_MAX, **narrowed))
        if not found["items"]:
            asked.fail(refusal("nothing_matches", asked.lang, {}))
        if not yes:
            _confirm(asked, verb, found)
        wish = {"verb": verb, "where": narrowed, "reason": reason}
        begun = _done(asked, line.post("letters/bulk", wish))
        try:
            bulk = _followed(asked, line, begun)
        except Interrupted:
            bulk = begun
    if not bulk["ended"]:
        bulk = _followed_on(asked, begun)
    asked.tell(bulk)
    _say(asked, word("progress", asked.lang, **{key: bulk[key] for key in ("total", "done", "failed")}))
    _say(asked, word(f"ended_{bulk['ended']}", asked.lang))
    if bulk["failed"]:
        _say(asked, word("failed_told", asked.lang))
    sys.exit(0 if bulk["ended"] == "done" and not bulk["failed"] else 1)


def _confirm(asked: Asked, verb: str, found: Mapping[str, Any]) -> None:
    if asked.json or not sys.stdin.isatty():
        asked.fail(word("needs_yes", asked.lang), 2)
    items = found["items"]
    accounts = {account for one in items for account in one["accounts"]}
    if found["total"] > BULK_MAX:
        click.echo(wrapped(word("capped", asked.lang, max=BULK_MAX)))
    sums = ", ".join(total_of(items)) or word("no_sums", asked.lang)
    question = word("ask", asked.lang, verb=verb, count=len(items), accounts=len(accounts), sums=sums)
    if not click.confirm(wrapped(question)):
        asked.fail(word("kept", asked.lang))


def total_of(items: Sequence[Mapping[str, Any]]) -> list[str]:
    """The sums of many letters, one text for each currency."""
    totals: dict[str, Decimal] = {}
    for text in (text for one in items for text in one["sums"]):
        amount, _, currency = text.partition(" ")
        try:
            totals[currency] = totals.get(currency, Decimal(0)) + Decimal(amount)
        except InvalidOperation:
            continue
    return [f"{total:,f} {currency}".strip() for currency, total in sorted(totals.items())]


def _followed(asked: Asked, line: Line, bulk: dict[str, Any]) -> dict[str, Any]:
    """Show how far many are until they have ended; Ctrl-C ends them and loses nothing."""
    shown = sys.stderr.isatty() and not asked.json
    while not bulk["ended"]:
        try:
            time.sleep(PROGRESS_S)
            bulk = _done(asked, line.get(f"bulk/{bulk['id']}"))
        except KeyboardInterrupt:
            bulk = _done(asked, line.post(f"bulk/{bulk['id']}/cancel", {}))
        if shown:
            counted = {key: bulk[key] for key in ("total", "done", "failed")}
            click.echo(f"\r{word('progress', asked.lang, **counted)} ", nl=False, err=True)
    if shown:
        click.echo("\r\x1b[K", nl=False, err=True)
    return bulk


def _followed_on(asked: Asked, bulk: dict[str, Any]) -> dict[str, Any]:
    """Go on showing many after their investigator died: they are on disk, and the next one finishes them."""
    for _ in range(RECONNECTS_MAX):
        time.sleep(RECONNECT_S)
        try:
            with investigator(asked.folders, asked.lang) as line:
                return _followed(asked, line, bulk)
        except (Unreachable, OSError):
            continue  # the guard starts the next one
    return asked.fail(word("goes_on", asked.lang, id=bulk["id"]))


def _narrowed(asked: Asked, where: Sequence[str]) -> dict[str, str]:
    found = {}
    for given in where:
        name, sign, value = given.partition("=")
        if not sign or name not in _WHERE or not value:
            asked.fail(word("bad_where", asked.lang, given=given), 2)
        found[name] = value
    return found


def _say(asked: Asked, words: str) -> None:
    if not asked.json:
        click.echo(wrapped(words))


def _say_why_not(asked: Asked, found: Mapping[str, Any]) -> NoReturn:
    """Say why the last try was not done, and end."""
    last = found["history"][-1] if found["history"] else {"detail": ""}
    _say(asked, word("not_so", asked.lang))
    _say(asked, word("why", asked.lang, why=visible(last["detail"])))
    sys.exit(1)


def _say_state(asked: Asked, found: Mapping[str, Any]) -> None:
    _say(asked, word("is_now", asked.lang, id=found["id"], state=told("state", found["state"], asked.lang)))
