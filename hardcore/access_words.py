"""`hardcore passwd` and `hardcore token`: who may come in, said by whoever owns the data.

They write one small file, which a running gateway takes within a second; nothing has to be started anew. A password is never
an argument, because everybody on the machine can read those: it is typed, or read from standard input. There is no first
password that somebody else could know.
"""

import secrets
import sys
import time
from collections.abc import Callable
from typing import Final

import click

from frontend.catalogue_access import access_text
from hardcore.access import files, passwords
from hardcore.access.people import (
    OWNER,
    PEOPLE_MAX,
    TOKEN_PREFIX,
    TOKENS_MAX,
    Invitation,
    People,
    Person,
    Scope,
    Token,
    digest_of,
    is_name,
)
from hardcore.asked import Asked, is_kept, operator, status_of
from hardcore.host import clock
from hardcore.host.folders import Unusable, prepare_data

LINK_HOURS: Final = 24
_SECRET_BYTES: Final = 32


@click.command()
@click.argument("name", default=OWNER, required=False)
@click.option("--stdin", is_flag=True, help="Read the password from standard input: its first line.")
@click.option(
    "--link", is_flag=True, help="Print a link with which the password is chosen in a browser, once."
)
@click.option("--remove", is_flag=True, help="Take somebody's password away, and with it the way in.")
@click.option("--list", "listing", is_flag=True, help="Show who may come in.")
@operator
def passwd(asked: Asked, name: str, *, stdin: bool, link: bool, remove: bool, listing: bool) -> None:
    """Set a password: of whoever looks after the server, or of a member of the household.

    \b
    hardcore passwd              the owner's; from then on one has to sign in
    hardcore passwd mina         of somebody who uses the ledger and does not look after the server
    hardcore passwd mina --link  let her choose it herself
    hardcore passwd --list
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    people = _people(asked)
    if listing:
        _list(asked, people)
        return
    if not is_name(name):
        asked.fail(access_text("name_bad", asked.lang), 2)
    if remove:
        _remove(asked, people, name)
    elif name != OWNER and people.person(OWNER) is None:
        asked.fail(access_text("owner_first", asked.lang, command=asked.command))
    elif link:
        _invite(asked, name)
    else:
        _set(asked, people, name, _typed(asked, stdin=stdin))


@click.group()
def token() -> None:
    """Let programs in: each with a token of its own, which can be taken back."""


@token.command("add")
@click.argument("name")
@click.option(
    "--scope",
    type=click.Choice([str(one) for one in Scope]),
    default=str(Scope.WRITE),
    show_default=True,
    help="read only looks; write changes the ledger; admin also looks after the server.",
)
@operator
def add(asked: Asked, name: str, scope: str) -> None:
    """Make a token. It is shown once."""
    people = _people(asked)
    if not is_name(name):
        asked.fail(access_text("name_bad", asked.lang), 2)
    if people.person(OWNER) is None:
        asked.fail(access_text("owner_first", asked.lang, command=asked.command))
    if any(one.name == name for one in people.tokens):
        asked.fail(access_text("token_there", asked.lang, name=name))
    if len(people.tokens) >= TOKENS_MAX:
        asked.fail(access_text("many", asked.lang))
    secret = TOKEN_PREFIX + secrets.token_urlsafe(_SECRET_BYTES)
    made = Token(name, digest_of(secret), Scope(scope), clock.wall(clock.now_ns()))
    _keep(asked, lambda now: now.with_token(made))
    _say(asked, "token_made", name=name)
    if not asked.json:
        click.echo(secret)
        _say(asked, "token_use", url=status_of(asked).get("url") or "http://127.0.0.1:3000")
    asked.tell({"ok": True, "name": name, "scope": scope, "token": secret})


@token.command("list")
@operator
def list_tokens(asked: Asked) -> None:
    """Show which tokens there are; not the tokens themselves."""
    tokens = _people(asked).tokens
    for one in tokens:
        _say(asked, "token", name=one.name, scope=_scope(asked, one.scope), made_at=one.made_at)
    if not tokens:
        _say(asked, "no_tokens")
    asked.tell({"tokens": [{"name": one.name, "scope": one.scope, "made_at": one.made_at} for one in tokens]})


@token.command("remove")
@click.argument("name")
@operator
def remove_token(asked: Asked, name: str) -> None:
    """Take a token back. Whoever uses it is refused from the next request on."""
    people = _people(asked)
    if not any(one.name == name for one in people.tokens):
        asked.fail(access_text("unknown", asked.lang, name=name))
    _keep(asked, lambda now: now.without_token(name))
    _say(asked, "removed", name=name)
    asked.tell({"ok": True, "name": name})


def _people(asked: Asked) -> People:
    made = prepare_data(asked.data)
    if isinstance(made, Unusable):
        asked.fail(made.reason)
    people = files.read_people(asked.folders.state)
    if isinstance(people, files.Unreadable):
        path = asked.folders.state / files.PEOPLE
        asked.fail(access_text("unreadable", asked.lang, path=path, why=people.why))
    return people


def _typed(asked: Asked, *, stdin: bool) -> str:
    """A password from whoever sits there, twice; or from standard input."""
    if stdin or not sys.stdin.isatty():
        # As a browser sends it, whatever this terminal's own encoding is.
        return sys.stdin.buffer.readline().decode("utf-8", "surrogateescape").rstrip("\r\n")
    first: str = click.prompt(access_text("type_it", asked.lang), hide_input=True, err=True)
    if click.prompt(access_text("type_again", asked.lang), hide_input=True, err=True) != first:
        asked.fail(access_text("differ", asked.lang))
    return first


def _set(asked: Asked, people: People, name: str, password: str) -> None:
    if not passwords.is_usable(password):
        asked.fail(access_text("short", asked.lang))
    if people.person(name) is None and len(people.people) >= PEOPLE_MAX:
        asked.fail(access_text("many", asked.lang))
    person = Person(name, passwords.kept(password))
    _keep(asked, lambda now: now.with_person(person))
    _say(asked, "set", name=name)
    asked.tell({"ok": True, "name": name})


def _remove(asked: Asked, people: People, name: str) -> None:
    invited = any(one.name == name for one in people.invitations)
    if people.person(name) is None and not invited:
        asked.fail(access_text("unknown", asked.lang, name=name))
    others = [one.name for one in people.people if one.name != name]
    others += [one.name for one in people.invitations if one.name != name]
    others += [one.name for one in people.tokens]
    if name == OWNER and others:
        asked.fail(access_text("others_first", asked.lang, names=", ".join(dict.fromkeys(others))))
    if name == OWNER and files.read_doorway(asked.folders.state).open and is_kept(asked.folders):
        asked.fail(access_text("door_open", asked.lang))
    _keep(asked, lambda now: now.without_person(name))
    _say(asked, "removed", name=name)
    asked.tell({"ok": True, "name": name})


def _invite(asked: Asked, name: str) -> None:
    secret = secrets.token_urlsafe(_SECRET_BYTES)
    until_s = int(time.time()) + LINK_HOURS * 3600
    invitation = Invitation(name, digest_of(secret), until_s)
    _keep(asked, lambda now: now.with_invitation(invitation))
    url = f"{status_of(asked).get('url') or 'http://127.0.0.1:3000'}/__hc/invited?key={secret}"
    _say(asked, "link", hours=LINK_HOURS)
    if not asked.json:
        click.echo(url)
    asked.tell({"ok": True, "name": name, "url": url})


def _list(asked: Asked, people: People) -> None:
    for one in people.people:
        _say(asked, "person", name=one.name, scope=_scope(asked, one.scope))
    for invited in people.invitations:
        _say(asked, "invited", name=invited.name)
    if not people.people:
        _say(asked, "nobody")
    asked.tell({"people": [{"name": one.name, "scope": one.scope} for one in people.people]})


def _scope(asked: Asked, scope: Scope) -> str:
    return access_text(f"scope_{scope}", asked.lang)


def _keep(asked: Asked, change: Callable[[People], People]) -> None:
    try:
        files.change_people(asked.folders.state, change)
    except OSError as error:
        asked.fail(str(error))


def _say(asked: Asked, key: str, **values: object) -> None:
    if not asked.json:
        click.echo(access_text(key, asked.lang, **values))
