"""Laying down: the rows go to the driver as they are, so no column may want its values turned on the way."""

import pytest
from sqlalchemy import Column, LargeBinary
from sqlalchemy.dialects import registry
from sqlalchemy.engine import Dialect

from core.journal import schema

COLUMNS = [column for table in schema.metadata.sorted_tables for column in table.columns]


@pytest.mark.parametrize("name", ["sqlite", "postgresql.psycopg"])
def test_no_column_turns_its_values_on_the_way_to_the_store(name: str) -> None:
    dialect: Dialect = registry.load(name)()
    assert [column.name for column in COLUMNS if _turns(column, dialect)] == []


def _turns(column: Column, dialect: Dialect) -> bool:  # type: ignore[type-arg]
    if isinstance(column.type, LargeBinary):
        return False  # both drivers take bytes as bytes
    return column.type.dialect_impl(dialect).bind_processor(dialect) is not None
