"""The docket: which cases are to be tried, as a value that was judged whole before anything is begun.

A request in it was once some stranger's, kept by the gateway and handed on by two processes of ours; it goes into a
socket here, so what could end its head early, or begin another request behind it, is kept out of it: such a case
has a verdict like any other, that nobody could try it, and the cases beside it have theirs. What a case is (a request, a row,
a piece of the log) is told by the one member it has. A docket whose own shape is wrong is refused whole: whoever wrote it has
a mistake. Not chosen: to pass over a case that can't be used; one that is silently missing would have no verdict.
"""

import re
from typing import Final, TypeAlias, assert_never

import msgspec

from core.imports.folder import is_import_id

VERSION: Final = 1
DOCKET_BYTES_MAX: Final = 128 << 20  # a file that a bank makes people give has 20 MiB, in base64 a third more
CASES_MAX: Final = 256
LIMIT_MS_MAX: Final = 600_000
COPY_BYTES_MAX: Final = 2 << 30
HEADERS_MAX: Final = 128
PATH_CHARACTERS_MAX: Final = 16_384
NAME_CHARACTERS_MAX: Final = 64

_NAME: Final = re.compile(rf"[0-9A-Za-z_.:-]{{1,{NAME_CHARACTERS_MAX}}}")
_TOKEN: Final = re.compile(r"[!#$%&'*+.^_`|~0-9A-Za-z-]{1,256}")
_PATH: Final = re.compile(rf"/[\x21-\x7e\x80-\xff]{{0,{PATH_CHARACTERS_MAX}}}")
_VALUE: Final = re.compile(r"[\t\x20-\x7e\x80-\xff]{0,16384}")
KEY_HEADER: Final = "idempotency-key"


class Request(msgspec.Struct, frozen=True):
    """A request as it came; `path` with its query, `body` is base64 on the wire."""

    method: str
    path: str
    headers: list[tuple[str, str]] = []
    body: bytes = b""

    @property
    def key(self) -> str | None:
        """The key under which it asks to be done once."""
        return next((value for name, value in self.headers if name.lower() == KEY_HEADER), None)


class Row(msgspec.Struct, frozen=True, rename={"import_id": "import"}):
    """A row of an import; `ordinal` is its place in the file, from 1."""

    import_id: str
    ordinal: int

    @property
    def key(self) -> str:
        """The key under which the importer books it."""
        return f"{self.import_id}:{self.ordinal}"


class Events(msgspec.Struct, frozen=True):
    """The log itself, from the event behind `after` to its head."""

    after: int


class _Case(msgspec.Struct, frozen=True):
    name: str
    request: Request | None = None
    row: Row | None = None
    events: Events | None = None


class _Docket(msgspec.Struct, frozen=True):
    version: int
    limit_ms: int
    cases: list[_Case]
    memory_bytes: int | None = None
    copy_bytes_max: int = COPY_BYTES_MAX


class Unusable(msgspec.Struct, frozen=True):
    """Something that nobody can try; `why` is a part of a sentence."""

    why: str


Tried: TypeAlias = Request | Row | Events | Unusable


class Case(msgspec.Struct, frozen=True):
    """One case: what is tried, under the name that its verdict will have."""

    name: str
    tried: Tried


class Docket(msgspec.Struct, frozen=True):
    """Everything that is on trial. `memory_bytes` None: nobody has set a bound."""

    limit_ms: int
    memory_bytes: int | None
    copy_bytes_max: int
    cases: tuple[Case, ...]


def read_docket(raw: bytes) -> Docket | str:
    """Return the docket in the bytes of a file, or one sentence that says why it can't be used."""
    try:
        said = msgspec.json.decode(raw, type=_Docket)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        return f"The docket can't be read: {error}."
    if said.version != VERSION:
        return f"The docket has version {said.version}, and this program knows {VERSION}."
    if not 1 <= said.limit_ms <= LIMIT_MS_MAX:
        return f"The docket's limit_ms must be from 1 to {LIMIT_MS_MAX}, not {said.limit_ms}."
    if said.copy_bytes_max < 0 or (said.memory_bytes is not None and said.memory_bytes < 1):
        return "The docket's copy_bytes_max and memory_bytes can't be negative, nor the memory nothing."
    if len(said.cases) > CASES_MAX:
        return f"The docket has {len(said.cases)} cases, and may have {CASES_MAX}."
    if len({case.name for case in said.cases}) < len(said.cases):
        return "Two cases of the docket have the same name."
    cases = []
    for number, case in enumerate(said.cases, 1):
        found = _case(case)
        if isinstance(found, str):
            return f"Case {number} of the docket can't be used: {found}."
        cases.append(found)
    return Docket(said.limit_ms, said.memory_bytes, said.copy_bytes_max, tuple(cases))


def _case(case: _Case) -> Case | str:
    if _NAME.fullmatch(case.name) is None:
        return "its name is none"
    tried = [one for one in (case.request, case.row, case.events) if one is not None]
    if len(tried) != 1:
        return "it must be a request, a row or events, and only one of them"
    fault = _fault(tried[0])
    return Case(case.name, tried[0] if fault is None else Unusable(fault))


def _fault(tried: Request | Row | Events) -> str | None:
    match tried:
        case Request():
            return _fault_of_request(tried)
        case Row(import_id, ordinal):
            return None if is_import_id(import_id) and ordinal >= 1 else "it is no row of an import"
        case Events(after):
            return None if after >= 0 else "its events begin before the first"
        case _:
            assert_never(tried)


def _fault_of_request(request: Request) -> str | None:
    if _TOKEN.fullmatch(request.method) is None or _PATH.fullmatch(request.path) is None:
        return "its method or its path could be no request's"
    if len(request.headers) > HEADERS_MAX:
        return f"it has more than {HEADERS_MAX} headers"
    if not all(_TOKEN.fullmatch(name) and _VALUE.fullmatch(value) for name, value in request.headers):
        return "one of its headers could be no request's"
    return None
