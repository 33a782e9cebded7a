"""The dashboard's paper: its pages in one language, and the files they load, which are sent by whoever draws them.

The look is the ledger's own style sheet with one of the dashboard's behind it, so that both are one house; it is
served anew under `/admin/`, because the ledger's copy is away exactly when the dashboard is needed. Templates ask
nothing of anybody: they get plain values and the words of one catalogue. Sharing the ledger's environment was not
chosen, because its words and files are another process's.
"""

import datetime as dt
import functools
import hashlib
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import msgspec
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from frontend.amounts import show_count
from frontend.catalogue_admin import TEXTS
from frontend.catalogue_admin_alerts import ALERT_TEXTS
from frontend.catalogue_admin_guard import GUARD_TEXTS
from frontend.catalogue_admin_letters import LETTER_TEXTS
from frontend.render import Language, language

LANGUAGES: Final[tuple[Language, ...]] = ("ko", "en")
#: A text from outside is shown up to here; the page links to the whole of it.
SHOWN_CHARACTERS_MAX: Final = 400

_HERE: Final = Path(__file__).parent
_TEMPLATES: Final = _HERE.parent / "templates" / "admin"
_SHARED: Final = ("ledger.css", "drawings.css", "icon.svg")
_TYPES: Final = MappingProxyType(
    {
        ".css": "text/css; charset=utf-8",
        ".js": "text/javascript; charset=utf-8",
        ".svg": "image/svg+xml",
    }
)
_WORDS: Final = MappingProxyType({**TEXTS, **LETTER_TEXTS, **ALERT_TEXTS, **GUARD_TEXTS})


class AdminFile(msgspec.Struct, frozen=True):
    """One file as it is sent."""

    body: bytes
    content_type: str


class AdminReader(msgspec.Struct, frozen=True):
    """Who reads: the language, and the path that a change of language leads back to."""

    lang: Language
    path: str


@functools.cache
def admin_files() -> tuple[str, MappingProxyType[str, AdminFile]]:
    """Return the folder they are served under (a hash of them all) and the files by name, read on first use."""
    paths = [_HERE / "static" / name for name in _SHARED]
    paths += sorted(path for path in (_HERE / "admin").iterdir() if path.suffix in _TYPES)
    files = {path.name: AdminFile(path.read_bytes(), _TYPES[path.suffix]) for path in paths}
    whole = hashlib.sha256()
    for name, file in sorted(files.items()):
        whole.update(name.encode() + b"\0" + hashlib.sha256(file.body).digest())
    return whole.hexdigest()[:12], MappingProxyType(files)


def admin_text(text: str, lang: Language, /, **values: object) -> str:
    """Return a text of the dashboard. One that is missing, or a value of it, is our own bug.

    A whole number among the values is grouped; where `n` is one, the form for one is taken if there is one.
    """
    single = f"{text}_one"
    chosen = single if values.get("n") == 1 and single in _WORDS else text
    shown = {name: show_count(value) if isinstance(value, int) else value for name, value in values.items()}
    return _WORDS[chosen][lang].format_map(shown)


def knows(text: str) -> bool:
    """Tell whether the catalogue has this text: codes that come from elsewhere may be newer than it."""
    return text in _WORDS


def admin_language(cookie: str | None, accept_language: str | None) -> Language:
    """Return the language of a page: what the reader chose here, else what the browser asks for."""
    return next((lang for lang in LANGUAGES if lang == cookie), None) or language(accept_language)


def draw_admin(template: str, reader: AdminReader, **values: Any) -> str:
    """Return a page as HTML. Everything in `values` is escaped, unless it is markup already."""
    lang = reader.lang
    return (
        _environment()
        .get_template(template)
        .render(
            **values,
            reader=reader,
            lang=lang,
            t=lambda text, /, **named: admin_text(text, lang, **named),
            moment=functools.partial(moment, lang=lang),
            took=functools.partial(took, lang=lang),
        )
    )


def moment(at: str | None, *, lang: Language) -> str:
    """Return a time as the machine's own clock shows it: whoever reads this sits at it. What is no time stays."""
    if not at:
        return "–"
    try:
        here = dt.datetime.fromisoformat(at).astimezone()
    except (ValueError, OverflowError):
        return shortened(at)
    if lang == "ko":
        return f"{here.month}월 {here.day}일 {here:%H:%M:%S}"
    return f"{here:%Y-%m-%d %H:%M:%S}"


def took(length_ms: float | None, *, lang: Language) -> str:
    """Return a length of time for people: the longer, the coarser."""
    if length_ms is None:
        return "–"
    if length_ms < 1_000:
        return f"{length_ms:.0f} ms"
    seconds = length_ms / 1_000
    for size, (ko, en) in ((86_400, ("일", "d")), (3_600, ("시간", "h")), (60, ("분", "min"))):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f}{ko if lang == 'ko' else ' ' + en}"
    return f"{seconds:.1f}{'초' if lang == 'ko' else ' s'}"


def shortened(text: object, characters_max: int = SHOWN_CHARACTERS_MAX) -> str:
    """Return somebody's text as it may stand on a page: what can't be seen is written out, what is long is cut."""
    said = str(text)
    cut = said if len(said) <= characters_max else said[: characters_max - 1] + "…"
    return "".join(one if one.isprintable() or one == "\n" else _escaped(one) for one in cut)


def _escaped(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")


@functools.cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
    folder, files = admin_files()
    environment.globals.update(
        asset=lambda name: f"/admin/static/{folder}/{name}" if name in files else _missing(name),
        short=shortened,
        knows=knows,
    )
    return environment


def _missing(name: str) -> str:
    raise AssertionError(f"there is no {name} among the dashboard's files")
