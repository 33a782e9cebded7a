"""Who may come in, as it is kept: one owner, members of the household, tokens for programs. Pure.

A password is kept as what it takes to recognise it (`passwords`), a token as its digest: whoever reads the file can come
in as nobody. A token is long and random, so a plain digest is enough for it; it is found by that, in one look. Roles that
can be made up were not chosen: a household has somebody who looks after the server, and everybody else.
"""

import hashlib
import re
from enum import StrEnum
from typing import Final

import msgspec
from msgspec import structs

OWNER: Final = "owner"
#: What somebody may be called: it stands in a header, in a log and on a page.
_NAME: Final = re.compile(r"[a-z0-9][a-z0-9._-]{0,31}")
TOKEN_PREFIX: Final = "fst_"  # noqa: S105  # what every one begins with, so that a leaked one is found
TOKENS_MAX: Final = 64
PEOPLE_MAX: Final = 64


class Scope(StrEnum):
    """What may be done: `READ` only looks, `WRITE` changes the book, `ADMIN` also looks after the server."""

    READ = "read"
    WRITE = "write"
    ADMIN = "admin"


class Person(msgspec.Struct, frozen=True):
    """Somebody with a password. `secret` is what it takes to recognise it."""

    name: str
    secret: str

    @property
    def scope(self) -> Scope:
        """What he or she may do."""
        return Scope.ADMIN if self.name == OWNER else Scope.WRITE

    @property
    def mark(self) -> str:
        """A name for this password: a session that was begun under another one is over."""
        return hashlib.sha256(self.secret.encode()).hexdigest()[:16]


class Token(msgspec.Struct, frozen=True):
    """What a program comes in with. `digest`: SHA-256 of it, in hex; `made_at`: RFC 3339, for people."""

    name: str
    digest: str
    scope: Scope
    made_at: str


class Invitation(msgspec.Struct, frozen=True):
    """A link with which somebody may set a password once. `until_s`: Unix time, in seconds."""

    name: str
    digest: str
    until_s: int


class People(msgspec.Struct, frozen=True):
    """Everybody who may come in. Nobody at all: no password is set, and whoever reaches the server is the owner."""

    people: tuple[Person, ...] = ()
    tokens: tuple[Token, ...] = ()
    invitations: tuple[Invitation, ...] = ()

    @property
    def closed(self) -> bool:
        """Whether one has to sign in."""
        return bool(self.people)

    def person(self, name: str) -> Person | None:
        """Somebody by name."""
        return next((one for one in self.people if one.name == name), None)

    def token(self, secret: str) -> Token | None:
        """The token that this is."""
        digest = digest_of(secret)
        return next((one for one in self.tokens if one.digest == digest), None)

    def invitation(self, secret: str, now_s: float) -> Invitation | None:
        """The invitation that this is, while it holds."""
        digest = digest_of(secret)
        return next((one for one in self.invitations if one.digest == digest and now_s < one.until_s), None)

    def with_person(self, person: Person) -> "People":
        """The same, and one with this password; whatever invited him or her is used up."""
        others = tuple(one for one in self.people if one.name != person.name)
        open_ones = tuple(one for one in self.invitations if one.name != person.name)
        return structs.replace(self, people=(*others, person), invitations=open_ones)

    def without_person(self, name: str) -> "People":
        """The same without somebody, and without a link that would let him or her in again."""
        return structs.replace(
            self,
            people=tuple(one for one in self.people if one.name != name),
            invitations=tuple(one for one in self.invitations if one.name != name),
        )

    def with_token(self, token: Token) -> "People":
        """The same, and one token more."""
        return structs.replace(self, tokens=(*self.tokens, token))

    def without_token(self, name: str) -> "People":
        """The same without a token."""
        return structs.replace(self, tokens=tuple(one for one in self.tokens if one.name != name))

    def with_invitation(self, invitation: Invitation) -> "People":
        """The same, and a link for somebody; an older one for the same name holds no more."""
        others = tuple(one for one in self.invitations if one.name != invitation.name)
        return structs.replace(self, invitations=(*others, invitation))


def is_name(text: str) -> bool:
    """Whether somebody, or a token, may be called so."""
    return _NAME.fullmatch(text) is not None


def digest_of(secret: str) -> str:
    """What is kept of a secret that nobody could guess."""
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).hexdigest()
