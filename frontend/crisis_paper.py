"""What the gateway shows of its own: the recovery page and the files under `/__hc/`, made once and kept as bytes.

The recovery page must work when nothing else does, so it needs nothing but itself: its style and its script stand
in it and are allowed by their hash. Its script and that of a living page are ES modules set one after the other, so
that a page never has half of them or two versions at once. A bundler was not needed for that, because each module
imports by one line from its neighbours and no two of them use the same name at their top (a test sees to both).
Comments and indentation stay in the checkout and are not sent.
"""

import base64
import functools
import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final, Literal, get_args

import msgspec
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from frontend.catalogue_crisis import LANGUAGES, words
from frontend.catalogue_gate import GATE
from frontend.catalogue_receipts import RECEIPTS
from frontend.render import Language

#: Why the ledger is away. `off`: the operator stopped it.
Kind = Literal["recovering", "planned", "stopped_trying", "off"]
#: What became of the request that the page answers: `get` if it asked for a page, else a form's outcome. `keepable`:
#: not done, and the page offers to have it kept; `doubtful`: unknown, and the same.
Outcome = Literal["get", "not_done", "unknown", "keepable", "doubtful"]
#: What became of a request that was promised (docs/wires.md, section 9).
Settled = Literal["waiting", "done", "already_done", "not_done", "refused", "set_aside", "ask", "unknown"]

#: What a page at the gate is for, and what it says of the try before: `in` and `unsent` (a form was sent without a
#: session) and `out` (somebody signed out) ask to sign in, `again` asks for the password of who is in, `invited` for a new one.
Gate = Literal[
    "in",
    "unsent",
    "out",
    "wrong",
    "wait",
    "again",
    "again_wrong",
    "invited",
    "short",
    "differ",
    "not_kept",
    "gone",
]

KINDS: Final[tuple[Kind, ...]] = ("recovering", "planned", "stopped_trying", "off")
OUTCOMES: Final[tuple[Outcome, ...]] = ("get", "not_done", "unknown", "keepable", "doubtful")
GATE_KINDS: Final[tuple[Gate, ...]] = get_args(Gate)
RECEIPT_OUTCOMES: Final[tuple[Settled, ...]] = get_args(Settled)

#: What the gateway puts its own into: the hidden fields of a kept form; a receipt's key, number and the ledger's word.
FIELDS_MARK: Final = "<!--fields-->"
KEY_MARK: Final = "<!--key-->"
NUMBER_MARK: Final = "<!--id-->"
LETTER_MARK: Final = "<!--letter-->"
WHY_MARK: Final = "<!--why-->"
#: Where a page at the gate leads to (or the key of an invitation), and for whom it is.
TO_MARK: Final = "<!--to-->"
WHO_MARK: Final = "<!--who-->"

#: The modules of the recovery page and of a living page, each after those it imports from.
PAGE_MODULES: Final = ("channel.js", "outage.js", "wording.js", "card.js", "recovery.js")
RECEIPT_MODULES: Final = ("receipt.js",)
GATE_MODULES: Final = ("gate.js",)
CLIENT_MODULES: Final = (
    *PAGE_MODULES[:-1],
    "place.js",
    "screen.js",
    "bar.js",
    "drafts.js",
    "slowness.js",
    "typing.js",
    "client.js",
)

#: What only the recovery page says, by the beginning of the code.
PAGE_ONLY: Final = frozenset({"R15", "reopens", "reopen", "back", *OUTCOMES[1:]})

SOURCES: Final = Path(__file__).parent / "crisis"
_TEMPLATES: Final = Path(__file__).parent.parent / "templates"
_SCRIPT: Final = "text/javascript; charset=utf-8"
_STYLE: Final = "text/css; charset=utf-8"
#: The code of the heading and the sentence that a page begins with, before its script has heard anything.
_OPENING: Final[Mapping[Kind, str]] = MappingProxyType(
    {"recovering": "R1", "planned": "R2", "stopped_trying": "R8", "off": "OFF"}
)
_IMPORT: Final = re.compile(r'^import [^"]*"\./[\w.]+\.js";\n', flags=re.MULTILINE)
#: The spaces before a line, and what stands behind code for its reader; spaces between two brackets at its end.
_AROUND: Final = re.compile(r"^ +|  +// .*$| +$|(?<=\)) (?=[{]$)", flags=re.MULTILINE)
#: Spaces around an operator; none of our strings has one (a test sees to it).
OPERATOR: Final = re.compile(r" (=>|[=!]==|&&|\|\||\?\?|[<>]=?|[-+]=|[=?:*/]) ")
_LOOSE: Final = re.compile(r"(?<=[;,{}])\s+|;?\s+(?=})|\s+(?={)|(?<=\w:) ")
#: Spaces inside braces, behind a comma and behind words that a bracket follows; none of our strings has one either.
BRACKET: Final = re.compile(
    r"(?<={) (?=[a-z.])|(?<=[a-z;)\"]) (?=})|(?<=\bif) (?=\()|(?<=\bfor) (?=\()|(?<=,) "
)
#: Ends of lines where a statement can't be meant to end: behind what opens or separates, before what closes.
_JOINED: Final = re.compile(r"(?<=[;,{(\[])\n|\n(?=[})\]])")
_GAP: Final = re.compile(r"\n{2,}")
_COMMENT: Final = re.compile(r"^ *//[^\n]*\n|^ */\*.*?\*/ *\n", flags=re.MULTILINE | re.DOTALL)


class OwnFile(msgspec.Struct, frozen=True):
    """A file of the gateway's own paths, as it is sent."""

    body: bytes
    content_type: str


class Page(msgspec.Struct, frozen=True):
    """A page that needs nothing but itself. The hashes are what its content security policy has to allow,
    without the quotes around them: `sha256-...`.
    """

    body: bytes
    script_hash: str
    style_hash: str


@functools.cache
def own_files() -> Mapping[str, OwnFile]:
    """Return the scripts and styles of the gateway by their path, such as `/__hc/client.js`."""
    files = {
        "client.js": OwnFile(_modules(CLIENT_MODULES).encode(), _SCRIPT),
        "client.css": OwnFile(_style("client.css").encode(), _STYLE),
    }
    for lang in LANGUAGES:
        said = {code: text for code, text in words(lang).items() if not _is_of_the_page(code)}
        body = f"export const words = {_json(said)};\n".encode()
        files[f"words.{lang}.js"] = OwnFile(body, _SCRIPT)
    return MappingProxyType({f"/__hc/{name}": one for name, one in files.items()})


@functools.cache
def recovery_page(lang: Language, kind: Kind, outcome: Outcome = "get") -> Page:
    """Return the page that stands at an address while the ledger is away. It reopens the address by itself if
    that sends nothing twice (`get`), and says what became of a form otherwise.
    """
    script = _page_script()
    style = "\n" + _style("client.css") + _style("recovery.css")
    page = _environment().get_template("recovery.html.j2")
    body = page.render(
        lang=lang,
        languages=LANGUAGES,
        kind=kind,
        outcome=outcome,
        opening=_OPENING[kind],
        w=words(lang),
        fields=FIELDS_MARK,
        reopens=kind in {"recovering", "planned"} and outcome == "get",
        style=_verbatim(style, "</style"),
        script=_verbatim(script, "</script"),
    )
    return Page(body.encode(), csp_hash(script), csp_hash(style))


@functools.cache
def receipt_page(lang: Language, outcome: Settled) -> Page:
    """Return the page of a receipt: what was promised, or what became of it. Its marks are the gateway's to fill;
    while it is not settled, the page asks again by itself.
    """
    script = "\n" + _modules(RECEIPT_MODULES)
    style = "\n" + _style("client.css") + _style("recovery.css")
    which = LANGUAGES.index(lang)
    page = _environment().get_template("receipt.html.j2")
    body = page.render(
        lang=lang,
        outcome=outcome,
        w={code: texts[which] for code, texts in RECEIPTS.items()},
        marks={"key": KEY_MARK, "id": NUMBER_MARK, "why": WHY_MARK, "letter": LETTER_MARK},
        style=_verbatim(style, "</style"),
        script=_verbatim(script, "</script"),
    )
    return Page(body.encode(), csp_hash(script), csp_hash(style))


@functools.cache
def gate_page(lang: Language, kind: Gate) -> Page:
    """Return a page at which somebody signs in, types a password again, or chooses one. It works without scripts."""
    script = "\n" + _modules(GATE_MODULES)
    style = "\n" + _style("client.css") + _style("recovery.css") + _style("gate.css")
    which = LANGUAGES.index(lang)
    body = (
        _environment()
        .get_template("gate.html.j2")
        .render(
            lang=lang,
            kind=kind,
            w={code: texts[which] for code, texts in GATE.items()},
            to=TO_MARK,
            who=WHO_MARK,
            style=_verbatim(style, "</style"),
            script=_verbatim(script, "</script"),
        )
    )
    return Page(body.encode(), csp_hash(script), csp_hash(style))


def csp_hash(text: str) -> str:
    """Return the hash by which a content security policy allows a text that stands in the page."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def in_one(modules: Iterable[str]) -> str:
    """Return ES modules as one: what they import from each other stands before it."""
    return "".join(_IMPORT.sub("", text).replace("\nexport ", "\n") for text in modules)


@functools.cache
def _page_script() -> str:
    texts = {lang: words(lang) for lang in LANGUAGES}
    return f"\nconst WORDS = {_json(texts)};\n" + _modules(PAGE_MODULES)


def _modules(names: Iterable[str]) -> str:
    return _JOINED.sub("", in_one("\n" + _tight(_source(name)) for name in names))


def _tight(script: str) -> str:
    """A script without the spaces and lines that mean nothing."""
    return _GAP.sub("\n", BRACKET.sub("", OPERATOR.sub(r"\1", script)))


@functools.cache
def _source(name: str) -> str:
    """A file of the folder without its comments and indentation. A comment is a full line here or stands two
    spaces behind the code, as in no string of ours, and no text goes over several lines.
    """
    return _AROUND.sub("", _COMMENT.sub("", (SOURCES / name).read_text("utf-8")))


@functools.cache
def _style(name: str) -> str:
    """A style of the folder without the spaces that mean nothing."""
    return _LOOSE.sub("", _source(name))


def _is_of_the_page(code: str) -> bool:
    """Whether the recovery page alone says it: what became of a form is said where the form was answered."""
    return code.partition(".")[0] in PAGE_ONLY


def _json(value: object) -> str:
    """A value as JSON that may stand in a script: nothing in it can end the element."""
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def _verbatim(text: str, end: str) -> str:
    """A text of ours that the template prints as it is, inside an element that `end` would close."""
    assert end not in text.lower(), f"{end} inside what we wrote"
    return text


@functools.cache
def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
