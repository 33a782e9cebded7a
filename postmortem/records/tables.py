"""The tables of `hardcore.db`, and how an older file becomes one of today.

Each list that is shown has an index in its own order, newest first, so that a page costs the same with ten incidents
and with ten thousand; what only a detail shows is one JSON text in its row. Numbers that are counted over many
incidents (a group's) are counted when an incident is written, not when a page is drawn. An object mapper was not
chosen: what is read are frozen values (`views`), and nobody changes a row by changing an object.
"""

from typing import Final

from sqlalchemy import (
    Boolean,
    Column,
    Connection,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    false,
)

#: The version of the tables below. A file of a higher one is left alone: an older program must not write it.
SCHEMA: Final = 4

METADATA: Final = MetaData()

#: Words of the archive's own: the secret of its forms.
WORDS: Final = Table(
    "words", METADATA, Column("name", String, primary_key=True), Column("value", Text, nullable=False)
)

INCIDENTS: Final = Table(
    "incidents",
    METADATA,
    Column("id", String, primary_key=True),
    Column("opened_at", String, nullable=False),
    Column("closed_at", String),
    Column("diagnosis", String, nullable=False),
    Column("grade", String, nullable=False),
    Column("summary", Text, nullable=False),  # JSON: by language
    Column("outcome", String, nullable=False),
    Column("outage_ms", Float),
    Column("detected_ms", Float),
    Column("fingerprint", String, nullable=False),
    Column("account_ids", Text, nullable=False),  # JSON: a list
    Column("planned", Boolean, nullable=False),
    Column("drill", String),
    Column("back", Boolean, nullable=False),  # its group had been called fixed before it
    Column("digest", String, nullable=False),  # of all the above: equal ones are not written again
    Column("mark", String, nullable=False),  # of its folder, when it was read last
    Column("base", String, nullable=False, server_default=""),  # its group before people put groups together
    Column("apart", Boolean, nullable=False, server_default=false()),  # a person took it out of its group
    Column("note", Text, nullable=False, server_default=""),
    Index("incidents_in_order", "opened_at", "id"),
    Index("incidents_of_group", "fingerprint", "opened_at"),
    Index("incidents_by_diagnosis", "diagnosis", "opened_at"),
    Index("incidents_by_outcome", "outcome", "opened_at"),
    # Holds all that the trends ask for, so that ten thousand of them are read without their rows.
    Index("incidents_in_weeks", "planned", "drill", "opened_at", "diagnosis", "outage_ms"),
)

INCIDENT_ACCOUNTS: Final = Table(
    "incident_accounts",
    METADATA,
    Column("account", String, primary_key=True),
    Column("incident", ForeignKey("incidents.id", ondelete="CASCADE"), primary_key=True),
    Index("accounts_of_incident", "incident"),
)

GROUPS: Final = Table(
    "groups",
    METADATA,
    Column("fingerprint", String, primary_key=True),
    Column("title", Text, nullable=False),  # JSON: by language
    Column("diagnosis", String, nullable=False),
    Column("standing", String, nullable=False),
    Column("count", Integer, nullable=False),
    Column("first_at", String, nullable=False),
    Column("last_at", String, nullable=False),
    Column("median_outage_ms", Float),
    Column("account_ids", Text, nullable=False),
    Column("fixed_in", String),
    Column("fixed_at", String),
    Column("why", Text, nullable=False),
    Column("newest", String, nullable=False),
    Index("groups_in_order", "last_at", "fingerprint"),
)

#: Groups that a person put into another one; their later deaths go there too.
MERGES: Final = Table(
    "merges",
    METADATA,
    Column("fingerprint", String, primary_key=True),
    Column("into", String, nullable=False),
    Index("merges_of_group", "into"),
)

LETTERS: Final = Table(
    "letters",
    METADATA,
    Column("id", String, primary_key=True),
    Column("rule", String, nullable=False),  # the id under which the guard refuses it: its newest attempt's
    Column(
        "rule_absent", Boolean, nullable=False
    ),  # it was taken away for a retry and is not known to be back
    Column("state", String, nullable=False),
    Column("reason", String, nullable=False),
    Column("name", String, nullable=False, unique=True),
    Column("command_id", String, nullable=False),
    Column("idempotency_key", String),
    Column("kind", String, nullable=False),
    Column("source", String, nullable=False),
    Column("account_ids", Text, nullable=False),
    Column("transaction_id", String, nullable=False),
    Column("fingerprint", String),
    Column("digest", String),
    Column("incident_ids", Text, nullable=False),
    Column("deaths", Integer, nullable=False),
    Column("quarantined_at", String, nullable=False),
    Column("settled_at", String),
    Column("method", String, nullable=False),
    Column("path", Text, nullable=False),
    Column("case", Text),  # JSON: the docket's case, without headers that say who somebody is
    Column("seq", Integer),
    Column("dry_run", Text),
    Column("note", Text, nullable=False),
    Column("discarded_because", Text),
    Column("sums", Text, nullable=False),
    Column("corrected_by", String),  # the key of the request that was sent instead
    Column("correction", String),  # that key, while it is not known what became of it
    Column("was_held", Boolean, nullable=False, server_default="0"),  # before it was discarded
    Index("letters_in_order", "quarantined_at", "id"),
    Index("letters_by_state", "state", "quarantined_at", "id"),
    Index("letters_by_reason", "state", "reason"),
)

LETTER_ACCOUNTS: Final = Table(
    "letter_accounts",
    METADATA,
    Column("account", String, primary_key=True),
    Column("letter", ForeignKey("letters.id", ondelete="CASCADE"), primary_key=True),
    Index("accounts_of_letter", "letter"),
)

#: A request that came again has a letter of the guard's for each time; they are one here, found by every number.
ALIASES: Final = Table(
    "aliases",
    METADATA,
    Column("id", String, primary_key=True),
    Column("letter", ForeignKey("letters.id", ondelete="CASCADE"), nullable=False),
    Index("aliases_of_letter", "letter"),
)

ATTEMPTS: Final = Table(
    "attempts",
    METADATA,
    Column("number", Integer, primary_key=True),
    Column("letter", ForeignKey("letters.id", ondelete="CASCADE"), nullable=False),
    Column("at", String, nullable=False),
    Column("what", String, nullable=False),
    Column("outcome", String, nullable=False),
    Column("incident", String),
    Column("detail", Text, nullable=False),
    Index("attempts_of_letter", "letter", "number"),
)

PROPOSALS: Final = Table(
    "proposals",
    METADATA,
    Column("id", String, primary_key=True),
    Column("incident", String, nullable=False),
    Column("kind", String, nullable=False),
    Column("text", Text, nullable=False),
    Column("state", String, nullable=False),
    Column("rule", Text),
    Column("rule_id", String),  # under which the guard enforces it
    Column(
        "unsure", Boolean, nullable=False, server_default=false()
    ),  # whether the guard does what this row says
    Column("tested", Text),
    Column("owner", String, nullable=False),
    Column("note", Text, nullable=False),
    Column("made_at", String, nullable=False),
    Index("proposals_of_incident", "incident"),
    Index("proposals_in_order", "made_at", "id"),
)

BULKS: Final = Table(
    "bulks",
    METADATA,
    Column("id", String, primary_key=True),
    Column("verb", String, nullable=False),
    Column("reason", Text, nullable=False),
    Column("who", String, nullable=False),
    Column("ended", String, nullable=False),
    Column("current", String),
)

BULK_ITEMS: Final = Table(
    "bulk_items",
    METADATA,
    Column("bulk", ForeignKey("bulks.id", ondelete="CASCADE"), primary_key=True),
    Column("place", Integer, primary_key=True),
    Column("letter", String, nullable=False),
    Column("outcome", String),  # None: not begun; "done", or the code of a refusal
)

AUDIT: Final = Table(
    "audit",
    METADATA,
    Column("number", Integer, primary_key=True),
    Column("at", String, nullable=False),
    Column("who", String, nullable=False),
    Column("verb", String, nullable=False),
    Column("what", Text, nullable=False),
    Column("reason", Text, nullable=False),
    Column("outcome", Text, nullable=False),
)

DRILLS: Final = Table(
    "drills",
    METADATA,
    Column("id", String, primary_key=True),
    Column("at", String, nullable=False),
    Column("fault", String, nullable=False),
    Column("ok", Boolean, nullable=False),
    Column("outage_ms", Float),
    Column("incident", String),
    Column("scheduled", Boolean, nullable=False),
    Index("drills_in_order", "at", "id"),
)

#: Changes of the state for people, as the guard told them; its own file has the newest alone.
STATES: Final = Table(
    "states",
    METADATA,
    Column("number", Integer, primary_key=True),
    Column("at", String, nullable=False),
    Column("before", String, nullable=False),
    Column("after", String, nullable=False),
    Column("phase", String, nullable=False),
    Column("reason", String, nullable=False),
)

#: Messages of the spool that are in the archive already: one whose file outlived its reader is not taken in twice.
TAKEN: Final = Table(
    "taken",
    METADATA,
    Column("number", Integer, primary_key=True),
    Column("message", String, nullable=False, unique=True),
)


_TO_2: Final = (
    "ALTER TABLE incidents ADD COLUMN base VARCHAR NOT NULL DEFAULT ''",
    "ALTER TABLE incidents ADD COLUMN apart BOOLEAN NOT NULL DEFAULT 0",
    "ALTER TABLE incidents ADD COLUMN note TEXT NOT NULL DEFAULT ''",
    "UPDATE incidents SET base = fingerprint",
    "ALTER TABLE proposals ADD COLUMN unsure BOOLEAN NOT NULL DEFAULT 0",
    "ALTER TABLE letters ADD COLUMN corrected_by VARCHAR",
    "ALTER TABLE letters ADD COLUMN correction VARCHAR",
)
_TO_3: Final = ("ALTER TABLE letters ADD COLUMN was_held BOOLEAN NOT NULL DEFAULT '0'",)


def migrate(connection: Connection, found: int) -> None:
    """Bring the tables of version `found` (0: an empty file) to SCHEMA, inside the caller's transaction."""
    assert found < SCHEMA, found
    # From 3 to 4 a table is new and nothing of the old ones is other.
    steps = (*_TO_2, *_TO_3) if found == 1 else _TO_3 if found == 2 else ()
    for statement in steps:
        connection.exec_driver_sql(statement)
    METADATA.create_all(connection)
    connection.exec_driver_sql(f"PRAGMA user_version = {SCHEMA}")
