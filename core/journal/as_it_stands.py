"""Reading a ledger as it stands: one of an older version too, which nobody may or can bring up at this moment.

For whoever only looks: the proof of a copy that was kept, the trial of a log. The version is asked once, with a
connection of its own; a core that serves asks while it opens its book and takes the same views.
"""

from sqlalchemy import Engine
from sqlalchemy.exc import DBAPIError

from core.journal import queries, schema
from core.journal.store import Whereabouts, open_reading, snapshot


def open_as_it_stands(where: Whereabouts, connections_max: int, busy_timeout_ms: int) -> Engine:
    """Return an engine that only reads, to whose connections an older ledger looks like one of this version.

    Where the version can't be read it is opened as it is: the first question will say what is wrong with it.
    """
    readers = open_reading(where, connections_max, busy_timeout_ms)
    try:
        with snapshot(readers, busy_timeout_ms) as connection:
            version: int = queries.head(connection).schema_version
    except DBAPIError:
        return readers
    if version == schema.SCHEMA_VERSION:
        return readers
    readers.dispose()
    return open_reading(where, connections_max, busy_timeout_ms, first=schema.views_over(version))
