"""The rules of the tables for a server, made of those for a file: each is written down once (`schema`).

A file's trigger says in one text when something is refused; a server wants a function that says so. The text is read by
its shape, and one of another shape is a mistake of ours that no ledger would be founded with. Refusals are raised as
what they are, violations of integrity. What a server has beside: a table can be emptied without any row being deleted.
"""

import re
from collections.abc import Iterable, Iterator
from typing import Final

_SHAPE: Final = re.compile(
    r"CREATE TRIGGER (?P<name>\w+) BEFORE (?P<deed>UPDATE|DELETE|INSERT) ON (?P<table>\w+)\s+"
    r"(?:WHEN (?P<when>.+?)\s+)?BEGIN SELECT RAISE\(ABORT, (?P<text>'[^']+')\); END",
    re.DOTALL,
)


def in_plpgsql(triggers: Iterable[str]) -> Iterator[str]:
    """Return the statements by which a server keeps the same rules."""
    for trigger in triggers:
        found = _SHAPE.fullmatch(trigger)
        assert found is not None, f"a trigger of another shape: {trigger}"
        name, deed, table, when, text = found.group("name", "deed", "table", "when", "text")
        condition = "true" if when is None else when.replace(" IS NOT ", " IS DISTINCT FROM ")
        row = "OLD" if deed == "DELETE" else "NEW"
        yield (
            f"CREATE FUNCTION {name}() RETURNS trigger LANGUAGE plpgsql AS $$ BEGIN IF {condition} THEN"
            f" RAISE EXCEPTION {text} USING ERRCODE = 'integrity_constraint_violation'; END IF;"
            f" RETURN {row}; END $$"
        )
        yield f"CREATE TRIGGER {name} BEFORE {deed} ON {table} FOR EACH ROW EXECUTE FUNCTION {name}()"
        if deed == "DELETE":
            yield f"CREATE TRIGGER {table}_is_never_emptied BEFORE TRUNCATE ON {table} EXECUTE FUNCTION {name}()"
