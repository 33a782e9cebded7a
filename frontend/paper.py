"""Paper: templates, texts and numbers become one page in one language.

Every value that a template prints is escaped, a name that it does not get is an error and no empty string, and all
words come from the catalogue. A template sees plain values and a handful of functions (`t`, `money`, `day`,
`asset`); it can ask nothing of the ledger. No macro library and no inheritance deeper than one: a page should be
readable beside what it draws.
"""

import datetime as dt
import functools
from pathlib import Path
from typing import Any, Final

import msgspec
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from frontend.amounts import show_amount, show_count
from frontend.assets import assets
from frontend.catalogue_pages import TEXTS
from frontend.days import month_beside, show_day, show_month
from frontend.render import Language, language

_TEMPLATES: Final = Path(__file__).parent.parent / "templates"
LANGUAGES: Final[tuple[Language, ...]] = ("ko", "en")


class Reader(msgspec.Struct, frozen=True):
    """Who reads: the language, the day it is for the household, the path the page stands on, and the name under which
    somebody is signed in (empty: nobody has to be).
    """

    lang: Language
    today: dt.date
    path: str
    who: str = ""


def page_text(text: str, lang: Language, /, **values: object) -> str:
    """Return a text of the pages by its name. One that is missing, or a value of it, is our own bug.

    A number among the values is how many there are of something, and is grouped as one writes it. Where `n` is one
    and the language has a form for it, that form is taken.
    """
    single = f"{text}_one"
    chosen = single if values.get("n") == 1 and single in TEXTS else text
    shown = {name: show_count(value) if isinstance(value, int) else value for name, value in values.items()}
    return TEXTS[chosen][lang].format_map(shown)


def reader_language(cookie: str | None, accept_language: str | None) -> Language:
    """Return the language of a page: what the reader chose here, else what the browser asks for."""
    return next((lang for lang in LANGUAGES if lang == cookie), None) or language(accept_language)


def draw(template: str, reader: Reader, **values: Any) -> str:
    """Return a page as HTML."""
    lang = reader.lang
    return (
        _environment()
        .get_template(template)
        .render(
            **values,
            reader=reader,
            lang=lang,
            t=lambda text, /, **named: page_text(text, lang, **named),
            count=show_count,
            money=functools.partial(_money, lang),
            day=lambda text: show_day(text, lang, reader.today),
            month=lambda text: show_month(text, lang),
        )
    )


def load_templates() -> None:
    """Compile every page now, and not while somebody waits for it."""
    environment = _environment()
    for name in environment.list_templates(
        filter_func=lambda name: name.endswith(".html.j2") and not name.startswith("admin/")
    ):
        environment.get_template(name)


def _money(lang: Language, amount: str, currency: str, *, signed: bool = False) -> str:
    return show_amount(amount, currency, lang, signed=signed)


@functools.cache
def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        autoescape=True,  # whatever a file is called: all of them become HTML
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
    environment.globals.update(asset=assets().path, month_beside=month_beside, languages=LANGUAGES)
    return environment
