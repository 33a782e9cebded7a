"""The Python files of the checkout as the architecture tests read them: path, syntax tree, comments.

Rules are asked of the syntax tree and not of the text, so that a word in a docstring never counts as a deed.
Only comments come from the tokens, because the tree has dropped them, and they are where reasons stand.
"""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
PACKAGES: Final = ("hardcore", "core", "postmortem", "frontend")
TESTS_AND_SCRIPTS: Final = ("tests", "bench", "examples")
REASON_CHARS_MIN: Final = 8

type_of_function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Source:
    """One file: its path from the top of the checkout, its tree and the reasons given in it, by line."""

    path: str
    tree: ast.Module
    reasons: frozenset[int]
    lines: int

    @property
    def is_empty(self) -> bool:
        """Whether the file holds nothing at all, as a package's `__init__.py` may."""
        return not self.tree.body

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """Every node of the tree; walked once, however many rules look at it."""
        return tuple(ast.walk(self.tree))

    @cached_property
    def functions(self) -> tuple[tuple[str, type_of_function], ...]:
        """Every function with its qualified name, the ones inside classes and functions too."""
        return tuple(_functions(self.tree, ""))

    def calls(self) -> Iterator[tuple[str, ast.Call]]:
        """Every call with the dotted name of what is called, as far as it is written there."""
        for node in self.nodes:
            if isinstance(node, ast.Call):
                yield dotted(node.func), node

    def has_reason_at(self, line: int) -> bool:
        """Whether a comment that says more than a tool's keyword stands on this line or the one above."""
        return line in self.reasons or line - 1 in self.reasons


def parse(path: str, text: str) -> Source:
    """A source from its text."""
    reasons = frozenset(
        token.start[0]
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT and _says_something(token.string)
    )
    return Source(path, ast.parse(text), reasons, len(text.splitlines()))


def read(*tops: str) -> list[Source]:
    """All Python files under the given folders of the checkout, in the order of their paths."""
    paths = sorted(path for top in tops for path in (ROOT / top).rglob("*.py"))
    return [read_file(str(path.relative_to(ROOT))) for path in paths]


@cache
def read_file(path: str) -> Source:
    """One file of the checkout, by its path from the top; read once, every rule looks at the same tree."""
    return parse(path, (ROOT / path).read_text("utf-8"))


def dotted(node: ast.expr) -> str:
    """`a.b.c` of a name or attribute; what stands left of a call or subscript is `?`."""
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=value, attr=attr):
            return f"{dotted(value)}.{attr}"
        case _:
            return "?"


def _says_something(comment: str) -> bool:
    words = re.sub(
        r"(noqa|type: ignore|pragma|fmt)\b(: ?[A-Z]+[0-9]+(, ?[A-Z]+[0-9]+)*)?(\[[a-z, -]*\])?", "", comment
    )
    return len(words.strip("# -:")) >= REASON_CHARS_MIN


def _functions(node: ast.AST, prefix: str) -> Iterator[tuple[str, type_of_function]]:
    for child in ast.iter_child_nodes(node):
        match child:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield prefix + name, child
                yield from _functions(child, f"{prefix}{name}.")
            case ast.ClassDef(name=name):
                yield from _functions(child, f"{prefix}{name}.")
            case _:
                yield from _functions(child, prefix)
