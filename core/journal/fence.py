"""The fence: the first write of every core, by which it becomes the only one that may commit.

One transaction raises the epoch by exactly one, by compare-and-set, and looks at the schema while it holds
the lock. From its COMMIT on, every older core that thaws finds a higher epoch inside its own transaction and
leaves. The fence is flushed to the disk like any commit, so it also makes the last frames of the dead
predecessor durable before anybody is told "already done". A lease with a time in it was not chosen: a frozen
holder can't know that its time is over (8 of 8 double spends); a number in the same transaction can't be late.
"""

from collections.abc import Callable

import msgspec
from sqlalchemy import Connection, insert, select, update
from sqlalchemy.exc import DBAPIError

from core.journal import schema
from core.journal.chain import GENESIS
from core.journal.store import StoreError, begin_fence, commit, store_error, tables_of


class Raised(msgspec.Struct, frozen=True):
    """The epoch is ours."""

    epoch: int


class Fenced(msgspec.Struct, frozen=True):
    """Another core has raised the epoch: it stands at `actual`, past the expected one."""

    actual: int


class StoreWentBack(msgspec.Struct, frozen=True):
    """The store stands at an epoch before the expected one: it is not the store the predecessor wrote."""

    actual: int
    expected: int


class NotOurs(msgspec.Struct, frozen=True):
    """The file is no ledger that this version knows: `found` is its schema version, None if it has none."""

    found: int | None


class NotKept(msgspec.Struct, frozen=True):
    """The ledger is of an older `version` and could not be copied before it is changed."""

    version: int
    error: StoreError


FenceOutcome = Raised | Fenced | StoreWentBack | NotOurs | NotKept | StoreError

#: Brings a ledger of this version and epoch to the present one, in the transaction that is open on its connection.
BringUp = Callable[[Connection, int, int], StoreError | None]


def fence(connection: Connection, expected: int | None, bring_up: BringUp) -> FenceOutcome:
    """Raise the epoch from `expected` (None: from whatever stands in the store) and return what came of it.

    An empty file becomes a new ledger, unless a predecessor is expected to have written one; a ledger of an
    older version is given to `bring_up`, and no older program will open it again. On anything but
    `Raised` nothing has been changed; after an error of COMMIT itself that is not known, and no core may
    serve from this store before another fence has succeeded.
    """
    try:
        begin_fence(connection)
    except DBAPIError as error:
        return store_error(error)
    try:
        outcome = _compare_and_set(connection, expected, bring_up)
        if isinstance(outcome, Raised):
            commit(connection)
        else:
            connection.exec_driver_sql("ROLLBACK").close()
    except DBAPIError as error:
        return store_error(error)
    return outcome


def _compare_and_set(connection: Connection, expected: int | None, bring_up: BringUp) -> FenceOutcome:
    names = tables_of(connection)
    if "meta" not in names:
        if names:
            return NotOurs(None)
        if expected:
            return StoreWentBack(0, expected)
        _found(connection)
    row = connection.execute(select(schema.meta.c.schema_version, schema.meta.c.epoch)).one_or_none()
    if row is None or not schema.oldest_of(connection) <= row.schema_version <= schema.SCHEMA_VERSION:
        return NotOurs(row.schema_version if row else None)
    if expected is not None and row.epoch != expected:
        return Fenced(row.epoch) if row.epoch > expected else StoreWentBack(row.epoch, expected)
    if row.schema_version < schema.SCHEMA_VERSION:
        error = bring_up(connection, row.schema_version, row.epoch)
        if error is not None:
            return NotKept(row.schema_version, error)
    raised = connection.execute(
        update(schema.meta).where(schema.meta.c.epoch == row.epoch).values(epoch=row.epoch + 1)
    )
    assert raised.rowcount == 1, "the epoch changed under an exclusive lock"
    return Raised(row.epoch + 1)


def _found(connection: Connection) -> None:
    schema.lay_out(connection)
    connection.execute(
        insert(schema.meta).values(
            id=1, schema_version=schema.SCHEMA_VERSION, epoch=0, head_seq=0, head_hash=GENESIS
        )
    )
