"""A contract type for import-linter: "forbidden", for rooms that may not be built yet.

The plan of the house names every room, the parts build them one after another. import-linter's own contract
fails when a source module does not exist; this one leaves that module out, so that the whole plan can stand in
pyproject.toml from the first day and each wall bites the moment its room appears. That a name in the plan is
misspelt, and so guards nothing, is not noticed here: test_imports.py compares the names with the plan.
"""

from typing import cast

from grimp import ImportGraph
from importlinter import ContractCheck
from importlinter.contracts.forbidden import ForbiddenContract
from importlinter.domain.imports import ModuleExpression


class RoomsContract(ForbiddenContract):
    """Forbids imports, also indirect ones, to those of the source modules that exist."""

    type_name = "rooms"

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Check the rooms that stand; a room that is not there cannot break the law."""
        planned = cast("set[ModuleExpression]", self.source_modules)
        # The class attribute declares a field, the instance holds its value: a type checker sees only the first.
        self.source_modules = {room for room in planned if room.expression in graph.modules}  # type: ignore[assignment]
        return super().check(graph, verbose)
