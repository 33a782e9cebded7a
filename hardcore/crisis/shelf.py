"""What the gateway can show without asking anybody: the recovery pages, the crisis script and its files.

All of it is rendered once, in peace, and kept as compressed bytes, so that an answer in a crisis is a look into
a table. Rendering needs a template engine and files; it happens on a thread after the gateway has begun to
serve, and until it is done (or if it fails) the gateway has its own plain page (`pages.plain`). Only the
compressed form is kept: nearly every browser takes it, and for the rest a page is unpacked in a moment.
"""

import gzip
import hashlib
from collections.abc import Mapping
from itertools import product
from typing import Final, get_args

import msgspec
from msgspec import structs

from frontend.render import Language, language
from hardcore.crisis.plight import Asked, Cover, Plight
from hardcore.crisis.routing import OWN_PREFIX

DEMO = OWN_PREFIX + b"demo"
_LANGUAGES: Final[tuple[Language, ...]] = get_args(Language)
HTML = b"text/html; charset=utf-8"

#: What is filled in for one reader, as the paper prints it (a test holds the two in step).
FIELDS_MARK: Final = b"<!--fields-->"
KEY_MARK: Final = b"<!--key-->"
NUMBER_MARK: Final = b"<!--id-->"
LETTER_MARK: Final = b"<!--letter-->"
WHY_MARK: Final = b"<!--why-->"
TO_MARK: Final = b"<!--to-->"
WHO_MARK: Final = b"<!--who-->"

_COMMON_POLICY = "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
_DEMO_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    + _COMMON_POLICY
)


class Sheet(msgspec.Struct, frozen=True):
    """One text as it is kept. `tag` names its content; `policy` is its Content-Security-Policy, if it is a page."""

    zipped: bytes
    kind: bytes
    tag: str
    policy: str = ""

    @property
    def plain(self) -> bytes:
        """The text itself."""
        return gzip.decompress(self.zipped)


class Shelf(msgspec.Struct, frozen=True):
    """All sheets: files by path, recovery pages by language and cover, receipts' pages by language and outcome, the
    demo's page by language, pages to sign in by language and kind.
    """

    files: Mapping[bytes, Sheet] = msgspec.field(default_factory=dict)
    covers: Mapping[tuple[str, Cover], Sheet] = msgspec.field(default_factory=dict)
    receipts: Mapping[tuple[str, str], Sheet] = msgspec.field(default_factory=dict)
    demo: Mapping[str, Sheet] = msgspec.field(default_factory=dict)
    gates: Mapping[tuple[str, str], Sheet] = msgspec.field(default_factory=dict)

    def cover(self, told: Cover, accept_language: str) -> Sheet | None:
        """The recovery page that says so to this reader; None if none was rendered."""
        return self.covers.get((language(accept_language), told))

    def receipt(self, outcome: str, accept_language: str) -> Sheet | None:
        """The page of a receipt with this outcome; None if none was rendered."""
        return self.receipts.get((language(accept_language), outcome))

    def gate(self, kind: str, accept_language: str) -> Sheet | None:
        """A page at which somebody signs in; None if none was rendered."""
        return self.gates.get((language(accept_language), kind))

    def own(self, path: bytes, accept_language: str) -> Sheet | None:
        """What stands under a path of the gateway's own, or None."""
        return self.demo.get(language(accept_language)) if path == DEMO else self.files.get(path)


def _sheet(text: bytes, kind: bytes, policy: str = "") -> Sheet:
    tag = hashlib.sha256(text).hexdigest()[:32]
    return Sheet(gzip.compress(text, mtime=0), kind, tag, policy)


def stock(*, demo: bool) -> Shelf:
    """Render everything. Takes a moment and may raise whatever templates and files raise: not for the loop."""
    # The template engine behind it takes longer to import than a gateway takes to serve.
    from frontend import crisis_paper as paper

    files = {
        path.encode(): _sheet(one.body, one.content_type.encode()) for path, one in paper.own_files().items()
    }
    covers: dict[tuple[str, Cover], Sheet] = {}
    for lang, kind, outcome in product(_LANGUAGES, paper.KINDS, paper.OUTCOMES):
        page = paper.recovery_page(lang, kind, outcome)
        policy = _policy(page.script_hash, page.style_hash)
        covers[lang, Cover(Plight(kind), Asked(outcome))] = _sheet(page.body, HTML, policy)
    receipts: dict[tuple[str, str], Sheet] = {}
    for lang, settled in product(_LANGUAGES, paper.RECEIPT_OUTCOMES):
        page = paper.receipt_page(lang, settled)
        receipts[lang, settled] = _sheet(page.body, HTML, _policy(page.script_hash, page.style_hash))
    gates: dict[tuple[str, str], Sheet] = {}
    for lang, asked in product(_LANGUAGES, paper.GATE_KINDS):
        page = paper.gate_page(lang, asked)
        gates[lang, asked] = _sheet(page.body, HTML, _policy(page.script_hash, page.style_hash))
    shelf = Shelf(files, covers, receipts, gates=gates)
    return _with_demo(shelf) if demo else shelf


def _with_demo(shelf: Shelf) -> Shelf:
    # As above; and only a demo needs it.
    from frontend import demo_paper as paper

    files = {path.encode(): _sheet(body, kind.encode()) for path, (body, kind) in paper.demo_files().items()}
    pages: dict[str, Sheet] = {lang: _sheet(paper.demo_page(lang), HTML, _DEMO_POLICY) for lang in _LANGUAGES}
    return structs.replace(shelf, files={**shelf.files, **files}, demo=pages)


def _policy(script_hash: str, style_hash: str) -> str:
    return (
        f"default-src 'none'; script-src '{script_hash}'; style-src '{style_hash}'; connect-src 'self'; "
        f"img-src data:; {_COMMON_POLICY}"
    )
