"""The demo's page and its files, made once and kept as bytes like everything the gateway shows of its own.

The page is a stranger to the ledger: it presses the drill's door, listens to what the crisis script tells every
page, and keeps a list. So it shows at the same time what a page has to do to be taken over well: nothing.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from frontend.catalogue_demo import FAULTS, words
from frontend.render import Language

_FOLDER: Final = Path(__file__).parent / "demo"
_TEMPLATES: Final = Path(__file__).parent.parent / "templates"


def demo_page(lang: Language) -> bytes:
    """Return the page in one language. It needs the files of `demo_files` and the crisis script beside it."""
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    texts = words(lang)
    told = json.dumps(texts, ensure_ascii=False, separators=(",", ":"))
    page = environment.get_template("demo.html.j2")
    return page.render(lang=lang, w=texts, faults=FAULTS, told=told).encode()


def demo_files() -> Mapping[str, tuple[bytes, str]]:
    """Return what the page loads: path to body and content type."""
    return {
        "/__hc/demo.js": ((_FOLDER / "demo.js").read_bytes(), "text/javascript; charset=utf-8"),
        "/__hc/demo.css": ((_FOLDER / "demo.css").read_bytes(), "text/css; charset=utf-8"),
    }
