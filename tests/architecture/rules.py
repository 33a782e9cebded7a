"""The rules of a room, each a function from one source to the faults found in it.

A linter knows general manners; these are the ones of this house, which none asks for: reasons beside late
imports, the size of a function, no second door to the ledger's file. They are functions of a source, so that
test_rules.py can show to each rule a piece of code it has to refuse.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from typing import Final

from tests.architecture.sources import PACKAGES, ROOT, Source, dotted

FUNCTION_LINES_MAX: Final = 70
FILE_LINES_MAX: Final = 500
PUBLIC_METHODS_MAX: Final = 12

_VAGUE_NAME: Final = re.compile(r"(^|_)(utils?|common|helpers?|managers?|misc|stuff)(_|$)")
_BLIND: Final = frozenset({"Exception", "BaseException"})
# What a field of a dataclass can be told, and a field of a struct cannot.
_BEYOND_STRUCTS: Final = frozenset({"init", "repr", "compare", "hash", "metadata"})
# What a pure room could still do without importing anything.
_IMPURE_BUILTINS: Final = frozenset(
    {"open", "print", "input", "breakpoint", "exec", "eval", "__import__", "id", "hash"}
)
_CLOCK_READINGS: Final = re.compile(r"(^|\.)(datetime|date|dt)\.(now|today|utcnow)$")

LEDGER_FILE: Final = "ledger.db"
# The one room that names the ledger's file: it hands the name to SQLite and does nothing else with it.
LEDGER_FILE_ROOM: Final = "core/journal/stores/sqlite.py"
LEDGER_FILE_NAME: Final = "LEDGER_FILE"
# Where the core touches files by itself, and which files these are. None of them sees the ledger's.
CORE_FILE_ROOMS: Final = {
    "core/build.py": "the code itself, as it lies on the disk",
    "core/cases.py": "the cases of what the core itself wished for, beside the guard's rules",
    "core/guarded/": "the recorder's page, the control socket, the file for stacks; the guard's rules and drills",
    "core/imports/": "the files of an import: what was given, its rows, the formats of banks; the case of a row",
    "core/journal/backup.py": "the copy that SQLite made of an older ledger, once it is closed",
    "core/journal/ballast.py": "the ballast beside the ledger's file",
    "core/journal/checkpoints.py": "the folder of checkpoints, which holds nothing else",
    "core/journal/disk.py": "a small file of its own, and ledger.lock, to see whether the disk takes writes",
    "core/journal/lock.py": "ledger.lock, the start guard beside the ledger's file",
    "core/keeping/daily.py": "none: it lists the folder of backups",
    "core/keeping/making.py": "copies in the folder of backups, once SQLite is done with them",
    "core/keeping/writing_out.py": "the file of a log that is written out",
    "core/keeping/restoring.py": "a copy in a folder that has no ledger yet",
    "core/store_file.py": "the address of a server, which the data folder keeps",
    "core/trying/asking.py": "none: it has the bytes of an answer read as if they came from one",
    "core/trying/forking.py": "what the kernel says of this process, and the file for a throw-away core's stacks",
    "core/trying/place.py": "the folder of a trial",
    "core/trying/rows.py": "the files of an import, whose row is on trial",
    "core/trying/sitting.py": "the rules and the drill that a trial's folder is given",
    "core/trying/watch.py": "what the kernel says of a throw-away core, and the file for its stacks",
}
# Methods that only files have, with anything before them; then names that lists and dicts have as well.
_FILE_CALL: Final = re.compile(
    r"(^|\.)(open|fdopen|read_text|write_text|read_bytes|write_bytes|copyfile|copytree|copyfileobj|sendfile|"
    r"copy_file_range|rename|renames|hardlink_to|symlink_to|symlink|unlink|rmtree|truncate|ftruncate|pread|"
    r"pwrite|posix_fallocate)$|^(os\.)(remove|replace|link)$"
)
_CALL_ON_A_CLASS_OF_OURS: Final = re.compile(r"(^|\.)(?!Path\.)[A-Z]\w*\.\w+$")
_FILE_MODULES: Final = frozenset({"shutil", "mmap", "fcntl", "tempfile", "io"})
_MEMORY_ALONE: Final = frozenset({"io.StringIO", "io.BytesIO"})

# Distributions that are imported by another name than their own.
_IMPORTED_AS: Final = {"argon2-cffi": "argon2", "msoffcrypto-tool": "msoffcrypto"}

# Methods whose names a library has chosen: a protocol has as many as asyncio and httptools call.
_CALLED_BY_A_LIBRARY: Final = re.compile(
    r"connection_made|connection_lost|data_received|eof_received|pause_writing|resume_writing|datagram_received|"
    r"error_received|get_buffer|buffer_updated|on_(message|chunk)_(begin|complete)|on_headers?(_complete)?|"
    r"on_(body|status|url)"
)


def sizes_of_functions(source: Source) -> dict[str, int]:
    """Lines of each function that is longer than it should be, by `path::name`."""
    lengths = {f"{source.path}::{name}": _lines_of(node) for name, node in source.functions}
    return {name: lines for name, lines in lengths.items() if lines > FUNCTION_LINES_MAX}


def size_of_file(source: Source) -> dict[str, int]:
    """Lines of the file when it is longer than it should be, by path."""
    return {source.path: source.lines} if source.lines > FILE_LINES_MAX else {}


def sizes_of_classes(source: Source) -> dict[str, int]:
    """Public methods of each class that has more than it should, by `path::name`.

    Counted are the verbs a class offers: not its properties, and not what a library calls by its own names.
    """
    counts = {
        f"{source.path}::{node.name}": sum(_is_public_method(child) for child in node.body)
        for node in source.nodes
        if isinstance(node, ast.ClassDef)
    }
    return {name: count for name, count in counts.items() if count > PUBLIC_METHODS_MAX}


def vague_names(source: Source) -> list[str]:
    """A room called after no subject at all."""
    parts = source.path.removesuffix(".py").split("/")
    return [f"{source.path}: `{part}` says nothing" for part in parts if _VAGUE_NAME.search(part)]


def late_imports_without_reason(source: Source) -> list[str]:
    """Imports inside functions beside which no comment says why."""
    return [
        f"{source.path}:{node.lineno}: an import inside {name} without a reason beside it"
        for name, function in source.functions
        for node in _unexplained_imports(source, function)
    ]


def blind_excepts_without_reason(source: Source) -> list[str]:
    """Handlers that catch everything, not to tidy up and raise it on, beside which no comment says why."""
    return [
        f"{source.path}:{node.lineno}: catches everything without a reason beside it"
        for node in source.nodes
        if isinstance(node, ast.ExceptHandler) and _is_blind(node) and not _raises_on(node)
        if not source.has_reason_at(node.lineno) and node.lineno + 1 not in source.reasons
    ]


def missing_head(source: Source) -> list[str]:
    """A room without its docstring, or with one that does not begin with a sentence."""
    head = ast.get_docstring(source.tree)
    if source.is_empty or (head and re.match(r"[^\n]+(\n[^\n]+)*[.:]", head)):
        return []
    return [f"{source.path}: begins with no sentence that says what it is"]


def sleeps_in_tests(source: Source) -> list[str]:
    """Waiting by the clock instead of for a condition."""
    found = [node.lineno for name, node in source.calls() if name == "time.sleep"]
    for node in source.nodes:
        if isinstance(node, ast.ImportFrom) and node.module == "time":
            found += [node.lineno for alias in node.names if alias.name == "sleep"]
    return [f"{source.path}:{line}: sleeps; wait for a condition with a deadline" for line in found]


def impurities(source: Source) -> list[str]:
    """Deeds of a pure room that need no import: files, terminals, the wall clock, addresses of objects."""
    return [
        f"{source.path}:{node.lineno}: a pure room calls {name}"
        for name, node in source.calls()
        if name in _IMPURE_BUILTINS or _CLOCK_READINGS.search(name)
    ]


def thawed_words(source: Source) -> list[str]:
    """Structs and dataclasses of the shared words that could be changed after they were said."""
    classes = [node for node in source.nodes if isinstance(node, ast.ClassDef)]
    dataclasses = [
        f"{source.path}:{node.lineno}: {node.name} is not a frozen dataclass with slots"
        for node in classes
        for decorator in node.decorator_list
        if _is_dataclass(decorator) and not {"frozen", "slots"} <= _switched_on(decorator)
    ]
    structs = [
        f"{source.path}:{node.lineno}: {node.name} is not a frozen struct"
        for node in classes
        if any(dotted(base).endswith("Struct") for base in node.bases)
        and "frozen" not in _switched(node.keywords)
    ]
    return dataclasses + structs


def needless_dataclasses(source: Source) -> list[str]:
    """Dataclasses whose fields a struct could say, which is made fifty times faster."""
    return [
        f"{source.path}:{node.lineno}: {node.name} is a dataclass where a struct would do"
        for node in source.nodes
        if isinstance(node, ast.ClassDef)
        and any(map(_is_dataclass, node.decorator_list))
        and not any(isinstance(line, ast.AnnAssign) and _says_more(line.value) for line in node.body)
    ]


def doors_to_the_ledger(source: Source) -> list[str]:
    """Ways to the ledger's file other than SQLite.

    Two locks on one door: the file's name is written in one room, and a room that may know it (by the constant
    of that room) may not touch files, the others may not know it. Closing any descriptor of the file, even
    one opened for reading, drops SQLite's locks.
    """
    may_touch_files = not source.path.startswith("core/") or source.path.startswith(tuple(CORE_FILE_ROOMS))
    named = [
        f"{source.path}:{line}: names {LEDGER_FILE}"
        for line, by_constant in _mentions_of_the_ledger(source)
        if source.path != LEDGER_FILE_ROOM and (may_touch_files or not by_constant)
    ]
    if may_touch_files:
        return named
    opened = [
        f"{source.path}:{node.lineno}: touches a file by {name}, beside SQLite"
        for name, node in source.calls()
        if (_FILE_CALL.search(name) and not _CALL_ON_A_CLASS_OF_OURS.search(name))
        or (name.split(".")[0] in _FILE_MODULES and name not in _MEMORY_ALONE)
    ]
    return named + opened


def foreign_imports(source: Source) -> set[str]:
    """The packages of others that are imported, by their import names."""
    found = {name.split(".")[0] for name in _imported(source)}
    return found - set(sys.stdlib_module_names) - set(PACKAGES) - {"tests"}


def imports_beyond_the_standard_library(source: Source) -> list[str]:
    """Imports of ours or of others, in a room that may have neither."""
    named = {dotted_name.split(".")[0] for dotted_name in _imported(source)} - set(sys.stdlib_module_names)
    relative = any(isinstance(node, ast.ImportFrom) and node.level for node in source.nodes)
    return [f"{source.path}: imports {name}" for name in sorted(named | ({"."} if relative else set()))]


def declared_dependencies() -> set[str]:
    """The run-time dependencies of pyproject.toml by their import names."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    names = [re.split(r"[<>=!~ \[;]", dependency)[0] for dependency in project["dependencies"]]
    return {_IMPORTED_AS.get(name, name.lower().replace("-", "_")) for name in names}


def _imported(source: Source) -> Iterator[str]:
    for node in source.nodes:
        match node:
            case ast.Import(names=names):
                yield from (alias.name for alias in names)
            case ast.ImportFrom(module=str(module), level=0):
                yield module
            case _:
                pass


def _mentions_of_the_ledger(source: Source) -> Iterator[tuple[int, bool]]:
    """Lines that mention the ledger's file, and whether they do so by the constant of its room."""
    for node in source.nodes:
        match node:
            case ast.Constant(value=str(text)) if text.strip("/") == LEDGER_FILE:
                yield node.lineno, False
            case ast.alias(name=name) | ast.Attribute(attr=name) | ast.Name(id=name) if (
                name == LEDGER_FILE_NAME
            ):
                yield node.lineno, True
            case _:
                pass


def _lines_of(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    assert node.end_lineno is not None, "the parser gives every statement its end"
    return node.end_lineno - node.lineno + 1


def _is_public_method(node: ast.stmt) -> bool:
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or node.name.startswith("_"):
        return False
    is_property = any(dotted(decorator).endswith("property") for decorator in node.decorator_list)
    return not is_property and not _CALLED_BY_A_LIBRARY.fullmatch(node.name)


def _unexplained_imports(source: Source, function: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    explained_until = 0
    for node in ast.walk(function):
        if isinstance(node, ast.Import | ast.ImportFrom):
            # One reason serves a block of imports that stand line by line.
            if source.has_reason_at(node.lineno) or explained_until == node.lineno - 1:
                explained_until = node.end_lineno or node.lineno
            else:
                yield node


def _is_blind(node: ast.ExceptHandler) -> bool:
    match node.type:
        case None:
            return True
        case ast.Tuple(elts=kinds):
            return any(dotted(kind) in _BLIND for kind in kinds)
        case kind:
            return dotted(kind) in _BLIND


def _raises_on(node: ast.ExceptHandler) -> bool:
    last = node.body[-1]
    return isinstance(last, ast.Raise) and last.exc is None


def _is_dataclass(decorator: ast.expr) -> bool:
    return dotted(decorator.func if isinstance(decorator, ast.Call) else decorator).endswith("dataclass")


def _switched_on(decorator: ast.expr) -> set[str | None]:
    return _switched(decorator.keywords) if isinstance(decorator, ast.Call) else set()


def _switched(keywords: list[ast.keyword]) -> set[str | None]:
    return {k.arg for k in keywords if isinstance(k.value, ast.Constant) and k.value.value is True}


_SETTINGS: Final = frozenset({"setting", "_setting"})  # a field with bounds and a text


def _says_more(value: ast.expr | None) -> bool:
    """Whether a field says more than a default: its bounds, or that it is neither given nor shown."""
    if not isinstance(value, ast.Call):
        return False
    name = dotted(value.func).rpartition(".")[2]
    return name in _SETTINGS or (name == "field" and bool(_BEYOND_STRUCTS & {k.arg for k in value.keywords}))
