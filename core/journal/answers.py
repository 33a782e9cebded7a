"""What is asked of the writer, and what it answers: values, with the HTTP status each of them has.

The status stands here and not in `web/` because the row of a key keeps the whole answer, status included, and
the recorder speaks of it too. A refusal is kept as its parts, so that a replay can tell it in the language of
whoever asks again; a success is kept as the very bytes that were sent.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Final, assert_never

import msgspec

from core.ledger.commands import Command
from core.ledger.reasons import Rejection, Slug


class Order(msgspec.Struct, frozen=True):
    """A command for the writer.

    `fingerprint` tells one wish from another under the same key; `digest` tells the very request, so that a
    look-up, which does not bring the wish along, can still name it. `name` (32 hex) is what a guard calls it: the hash
    of its key, or what it was given in a key's place; empty: nobody can name it.
    """

    command: Command
    key: str | None
    fingerprint: bytes
    digest: bytes
    command_id: str
    transaction_id: str
    account_ids: tuple[str, ...]
    slot: int
    name: str = ""


class Orders(msgspec.Struct, frozen=True):
    """Commands that were sent together and have nothing else to do with each other: each has its key and its answer.

    One piece of work with one slot. All of them are in one transaction of the store; a no to one is a no to it alone.
    """

    orders: tuple[Order, ...]
    slot: int
    key: None = None
    name: str = ""


class LookUp(msgspec.Struct, frozen=True):
    """The question what became of a key, or (with a `digest`) of one request under it.

    It stands in the same line as the commands, because "not done" must be true of every command that came
    before the question, and is checked against the epoch like a write.
    """

    key: str
    slot: int
    digest: bytes | None = None


class Exercise(msgspec.Struct, frozen=True):
    """A drill in a command's place: `run` happens where a command would be decided, and nothing is booked.

    None: it does nothing itself, and meets what every command would meet. `name` as of an order.
    """

    slot: int
    transaction_id: str
    account_id: str
    run: Callable[[], object] | None
    key: None = None
    name: str = ""


class Touch(msgspec.Struct, frozen=True):
    """The question whether the store takes writes: a write without effect, committed like any other."""

    slot: int
    key: None = None


Work = Order | Orders | LookUp | Exercise | Touch


def orders_of(works: Iterable[Work]) -> Iterator[Order]:
    """Return all commands in these works, in their order."""
    for work in works:
        if isinstance(work, Order):
            yield work
        elif isinstance(work, Orders):
            yield from work.orders


def keys_of(works: Iterable[Work]) -> Iterator[str]:
    """Return the keys that these works carry or ask for."""
    for work in works:
        for key in [one.key for one in work.orders] if isinstance(work, Orders) else [work.key]:
            if key is not None:
                yield key


class Commit(msgspec.Struct, frozen=True):
    """Where an event stands in the book: its number and its hash (32 bytes)."""

    seq: int
    hash: bytes


class Done(msgspec.Struct, frozen=True):
    """The command was carried out: the JSON of its answer. `commit`: what was booked for it in this life."""

    status: int
    body: bytes
    replayed: bool = False
    commit: Commit | None = None


class Refused(msgspec.Struct, frozen=True):
    """The book said no."""

    rejection: Rejection
    replayed: bool = False


class KeyTaken(msgspec.Struct, frozen=True):
    """The key belongs to another wish; to a look-up: to another request, whatever that one wished."""


class KeyUnknown(msgspec.Struct, frozen=True):
    """No command under this key has been carried out or refused."""


class DecisionFailed(msgspec.Struct, frozen=True):
    """Our own bug while deciding this one command; nothing was written for it. `text` is for the log."""

    text: str


class StoreBusy(msgspec.Struct, frozen=True):
    """Somebody else held the store's lock for too long: the command was not begun."""


class OutcomeUnknown(msgspec.Struct, frozen=True):
    """The store raised inside the transaction: whether the command was carried out, nobody can say yet."""


class Leaving(msgspec.Struct, frozen=True):
    """This core is leaving: the command was not begun."""


class ReadOnly(msgspec.Struct, frozen=True):
    """This core serves reads only, because of the diagnosis `reason`: the command was not done."""

    reason: str


class SetAside(msgspec.Struct, frozen=True):
    """The guard has set it aside under the number `letter`, or (`account`) an event of an account that it would book on.

    Nothing was done, and nothing is kept under its key: once the rule is taken away it may run.
    """

    letter: str
    account: str | None = None


class Limited(msgspec.Struct, frozen=True):
    """A rule takes no more of its kind for `again_s` seconds; None: it is larger than the rule ever takes.

    Nothing was done, as of what is set aside.
    """

    rule: str
    again_s: int | None


class Each(msgspec.Struct, frozen=True):
    """The answers to commands that were sent together, in their order."""

    answers: tuple["Answer", ...]


Answer = (
    Done
    | Each
    | Refused
    | KeyTaken
    | KeyUnknown
    | DecisionFailed
    | StoreBusy
    | OutcomeUnknown
    | Leaving
    | ReadOnly
    | SetAside
    | Limited
)

CREATED: Final = 201
OK: Final = 200


class KeyRow(msgspec.Struct, frozen=True):
    """What the store keeps under a key."""

    fingerprint: bytes
    seq: int | None
    status: int
    reply: bytes
    digest: bytes


def status_of(slug: Slug) -> int:
    """Return the HTTP status of a refusal."""
    match slug:
        case (
            Slug.ENTRY_NOT_FOUND
            | Slug.TRANSACTION_NOT_FOUND
            | Slug.PENDING_NOT_FOUND
            | Slug.RECURRING_NOT_FOUND
        ):
            return 404
        case Slug.ACCOUNT_CHANGED:
            return 412
        case Slug.ACCOUNT_EXISTS | Slug.ENTRY_REVERSED | Slug.ENTRY_CHANGED | Slug.ALREADY_IMPORTED:
            return 409
        case (
            Slug.TRANSACTION_REVERSED
            | Slug.TRANSACTION_PENDING
            | Slug.TRANSACTION_OF_ENTRY
            | Slug.ALREADY_A_REVERSAL
            | Slug.PENDING_POSTED
            | Slug.PENDING_VOIDED
            | Slug.PENDING_EXPIRED
            | Slug.NOT_YET_EXPIRED
            | Slug.ACCOUNT_HAS_PENDING
            | Slug.RECURRING_ENDED
        ):
            return 409
        case _:
            return 422


def keep(answer: Done | Refused, order: Order, seq: int | None) -> KeyRow:
    """Return the row that keeps the answer to this order under its key."""
    match answer:
        case Done(status, body):
            return KeyRow(order.fingerprint, seq, status, body, order.digest)
        case Refused(rejection):
            reply = msgspec.json.encode(rejection)
            return KeyRow(order.fingerprint, seq, status_of(rejection.slug), reply, order.digest)
        case _:
            assert_never(answer)


def replay(row: KeyRow) -> Done | Refused:
    """Return the answer that a row keeps, marked as given before."""
    if row.seq is None:
        return Refused(msgspec.json.decode(row.reply, type=Rejection), replayed=True)
    return Done(row.status, row.reply, replayed=True)


def repeated(row: KeyRow, fingerprint: bytes) -> Done | Refused | KeyTaken:
    """Return the answer to a wish under a key that has one already."""
    return replay(row) if row.fingerprint == fingerprint else KeyTaken()


def found(row: KeyRow | None, digest: bytes | None) -> Done | Refused | KeyTaken | KeyUnknown:
    """Return the answer to a look-up. Another request's answer is never told for the one that is meant."""
    if row is None:
        return KeyUnknown()
    return replay(row) if digest in {None, row.digest} else KeyTaken()
