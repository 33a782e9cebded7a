"""The files that a page of the ledger loads: read once, kept in memory, named by what they hold.

All of them live under one folder whose name is a hash of their bytes, so that every copy may be kept for ever and
a new version is never mixed with an old one: an ES module that imports "./amounts.js" gets the one it was written
with, and no file has to be rewritten to carry its neighbours' hashes. The words of the scripts are made from the
page's catalogue, one module per language. What only a reader of the source needs (comments that are lines of their
own, indentation) stays here; a real minifier was not chosen, because it would be a build step.
"""

import functools
import gzip
import hashlib
import json
import re
from pathlib import Path
from types import MappingProxyType
from typing import Final

import msgspec

from frontend.catalogue_pages import SCRIPT_WORDS, TEXTS
from frontend.catalogue_receipts import RECEIPTS
from frontend.render import Language

_FOLDER: Final = Path(__file__).parent / "static"
_TYPES: Final = MappingProxyType(
    {
        ".css": "text/css; charset=utf-8",
        ".js": "text/javascript; charset=utf-8",
        ".svg": "image/svg+xml",
    }
)
#: No text of ours goes over several lines or begins one like a comment: a test sees to it.
_FOR_READERS: Final = re.compile(r"^ *(?://.*|/\*(?s:.*?)\*/)\n|^ +", flags=re.MULTILINE)
_HASH_CHARACTERS: Final = 12
_LANGUAGES: Final[tuple[Language, ...]] = ("ko", "en")


class Asset(msgspec.Struct, frozen=True):
    """One file as it is sent. `etag` has its quotes; `packed` is the body in gzip."""

    body: bytes
    packed: bytes
    content_type: str
    etag: str


class Assets(msgspec.Struct, frozen=True):
    """All files of the pages, by name, and the folder they are served under (no slashes around it)."""

    folder: str
    files: MappingProxyType[str, Asset]

    def path(self, name: str) -> str:
        """Return the path of a file on the server. A name that is none of ours is our own bug."""
        assert name in self.files, f"there is no {name} in frontend/static"
        return f"/static/{self.folder}/{name}"


@functools.cache
def assets() -> Assets:
    """Return the files, read on first use."""
    bodies = {path.name: _sent(path) for path in sorted(_FOLDER.iterdir()) if path.suffix in _TYPES}
    bodies |= {f"words.{lang}.js": _words(lang) for lang in _LANGUAGES}
    whole = hashlib.sha256()
    for name, body in sorted(bodies.items()):
        whole.update(name.encode() + b"\0" + hashlib.sha256(body).digest())
    files = {name: _asset(name, body) for name, body in bodies.items()}
    return Assets(whole.hexdigest()[:_HASH_CHARACTERS], MappingProxyType(files))


def _sent(path: Path) -> bytes:
    text = path.read_text("utf-8")
    return (_FOR_READERS.sub("", text) if path.suffix in {".js", ".css"} else text).encode()


def _asset(name: str, body: bytes) -> Asset:
    etag = f'"{hashlib.sha256(body).hexdigest()[:_HASH_CHARACTERS]}"'
    # No time in the packed form: the same bytes on every start, as the name promises.
    return Asset(body, gzip.compress(body, 9, mtime=0), _TYPES[Path(name).suffix], etag)


def _words(lang: Language) -> bytes:
    words = {name: TEXTS[name][lang] for name in SCRIPT_WORDS}
    words |= {f"receipt.{code}": texts[_LANGUAGES.index(lang)] for code, texts in RECEIPTS.items()}
    return f"export default {json.dumps(words, ensure_ascii=False)};\n".encode()
