"""A plugin of the type check: `msgspec.structs.replace` takes the fields of its struct, with their types, and no others.

The library declares that it takes any keyword. mypy knows better for `dataclasses.replace`, and knows a struct's fields the
same way: this lends the one its eyes for the other.
"""

from collections.abc import Callable
from typing import Final

from mypy.plugin import FunctionSigContext, Plugin
from mypy.plugins.dataclasses import replace_function_sig_callback
from mypy.types import FunctionLike

REPLACE: Final = "msgspec.structs.replace"


class Replaced(Plugin):
    """Looks into the calls of one function."""

    def get_function_signature_hook(
        self, fullname: str
    ) -> Callable[[FunctionSigContext], FunctionLike] | None:
        """Return what looks into the calls of a function, or None where that is not ours."""
        return (
            replace_function_sig_callback
            if fullname == REPLACE
            else super().get_function_signature_hook(fullname)
        )


def plugin(_version: str) -> type[Plugin]:
    """Return the plugin: mypy asks for it by this name."""
    return Replaced
