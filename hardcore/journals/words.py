"""`hardcore journal import`: a plain-text journal of another program, into the running ledger.

The ledger's own API does the booking, in batches whose keys come from the journal's bytes and the place in it. So it may be
stopped, and the server may die: the same words go on where it was and book nothing twice. What is not taken is told with its line
and its reason, and the rest is booked.
"""

import http.client
import json
import sys
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import click

from frontend.catalogue_journals import journal_text
from hardcore.asked import Asked, operator, status_of
from hardcore.host.local_http import ask
from hardcore.journals.reading import FORMATS, Unread, format_of, read_journal
from hardcore.journals.wishes import KINDS, NotTaken, Wishes, wishes_of

BATCH: Final = 500
TOLD_MAX: Final = 20
PATIENCE_S: Final = 120.0
_DIGEST_CHARACTERS: Final = 32


@click.group()
def journal() -> None:
    """Bring in the plain-text journal of another program."""


@journal.command("import")
@click.argument("file", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--format", "form", type=click.Choice(FORMATS), help="Of the file; else its ending says it.")
@click.option(
    "--type",
    "types",
    multiple=True,
    metavar="NAME=KIND",
    help="The kind of accounts that begin with NAME: asset, liability, equity, income, expense.",
)
@click.option("--dry-run", is_flag=True, help="Read it and say what would be booked; book nothing.")
@operator
def import_journal(
    asked: Asked, file: Path, form: str | None, types: Sequence[str], *, dry_run: bool
) -> None:
    """Book the transactions of an hledger or Beancount journal.

    Accounts are opened on the way; what is exchanged goes through accounts of exchange. The same file again books nothing twice.

    \b
    hardcore journal import --dry-run books.journal
    hardcore journal import books.beancount
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    told = read_journal(file, form or format_of(file))
    if isinstance(told, Unread):
        asked.fail("\n".join(filter(None, (journal_text(told.why, asked.lang, file=file), told.said))))
    wishes = wishes_of(told, _kinds(asked, types))
    _say(asked, "read", transactions=len(wishes.transactions), accounts=len(wishes.accounts))
    booked = 0
    refused = list(wishes.not_taken)
    if not dry_run:
        if not status_of(asked)["url"]:
            asked.fail(journal_text("off", asked.lang))
        door = asked.folders.gateway
        mark = sha256(file.read_bytes()).hexdigest()[:_DIGEST_CHARACTERS]
        try:
            _open(door, wishes, mark)
            for count, not_booked in _book(door, wishes, mark):
                booked += count
                refused += not_booked
                _progress(asked, booked + len(refused), len(told))
        except (OSError, http.client.HTTPException):
            asked.fail(journal_text("broken", asked.lang))
        _progress(asked, 0, 0)
    _tell(asked, booked, refused, dry_run=dry_run)
    sys.exit(1 if refused else 0)


def _kinds(asked: Asked, types: Sequence[str]) -> dict[str, str]:
    kinds: dict[str, str] = {}
    for one in types:
        name, _, kind = one.partition("=")
        if not name or kind not in set(KINDS.values()):
            asked.fail(journal_text("bad_type", asked.lang, given=one), 2)
        kinds[name.casefold()] = kind
    return kinds


def _open(door: Path, wishes: Wishes, mark: str) -> None:
    """Open the accounts; one that is there already is fine, and a wrong one is told when something is booked on it."""
    for name, body in wishes.accounts.items():
        _post(door, "/api/ledger/accounts", body, f"journal-{mark}-{name}")


def _book(door: Path, wishes: Wishes, mark: str) -> Iterator[tuple[int, list[NotTaken]]]:
    """Book in batches; give for each how many are booked, and what was refused."""
    for at in range(0, len(wishes.transactions), BATCH):
        some = wishes.transactions[at : at + BATCH]
        body = {"atomic": False, "transactions": [one for _, one in some]}
        answer = _post(door, "/api/ledger/transactions/batch", body, f"journal-{mark}-{at}")
        if "results" not in answer:
            raise http.client.HTTPException(str(answer.get("detail", "")))
        refused = [
            NotTaken(some[one["index"]][0], "ledger", str(one["problem"].get("detail", "")))
            for one in answer["results"]
            if one["status"] >= http.HTTPStatus.BAD_REQUEST
        ]
        yield len(some) - len(refused), refused


def _post(door: Path, target: str, body: dict[str, Any], key: str) -> dict[str, Any]:
    headers = {"Content-Type": "application/json", "Idempotency-Key": key}
    answer = ask(door, "POST", target, json.dumps(body).encode(), headers, PATIENCE_S)
    if answer.status >= http.HTTPStatus.INTERNAL_SERVER_ERROR:
        raise http.client.HTTPException(str(answer.told.get("detail", "")))
    return answer.told


def _tell(asked: Asked, booked: int, refused: Sequence[NotTaken], *, dry_run: bool) -> None:
    asked.tell(
        {
            "ok": not refused,
            "booked": booked,
            "not_taken": [{"line": one.line, "why": one.why, "what": one.what} for one in refused],
        }
    )
    if not dry_run:
        _say(asked, "booked", count=booked)
    for one in refused[:TOLD_MAX]:
        why = one.what if one.why == "ledger" else journal_text(f"why_{one.why}", asked.lang, what=one.what)
        _say(asked, "not_taken", line=one.line, why=why)
    if len(refused) > TOLD_MAX:
        _say(asked, "more", count=len(refused) - TOLD_MAX)


def _say(asked: Asked, key: str, **values: object) -> None:
    if not asked.json:
        click.echo(journal_text(key, asked.lang, **values))


def _progress(asked: Asked, done: int, of: int) -> None:
    if asked.json or not sys.stderr.isatty():
        return
    click.echo(
        "\r\x1b[K" + (journal_text("progress", asked.lang, done=done, of=of) if of else ""),
        nl=False,
        err=True,
    )
