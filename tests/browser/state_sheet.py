"""Every state of a crisis on one sheet: each in both languages, both themes, at a desk and on a phone.

A real house shows the states that it comes into; here a scripted gateway stays in each for as long as a picture takes, over
a page that a real ledger has drawn. So nothing is left out because it is rare.
"""

import html
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser, Error, Page, Route, expect

from frontend.crisis_paper import (
    GATE_KINDS,
    KINDS,
    OUTCOMES,
    RECEIPT_OUTCOMES,
    gate_page,
    receipt_page,
    recovery_page,
)
from frontend.render import Language
from tests.browser.scripted_gateway import SERVING, ScriptedGateway, back, down

LANGUAGES: Final[tuple[Language, ...]] = ("ko", "en")
LOCALES: Final = {"ko": "ko-KR", "en": "en-US"}
SIZES: Final = {"desk": (1280, 800), "phone": (390, 844)}
THEMES: Final = ("light", "dark")
MODAL, CORNER, STRIP, BAR = "dialog[open]", ".corner:popover-open", ".strip:popover-open", ".bar"
_ETA: Final = {"low_s": 2, "high_s": 4, "samples": 7}
_LATER: Final = {"v": 1, "type": "hello", "overlay_after_ms": 60_000, "demo": False}
_KEY: Final = "01JC3Q5Y8F4Z2M7N9P0R1S2T3V"
_HELD: Final[list[Route]] = []
Act = Callable[[ScriptedGateway, Page], None]


def _says(*frames: Mapping[str, object]) -> Act:
    def act(gateway: ScriptedGateway, _page: Page) -> None:
        for frame in frames:
            gateway.say(frame)

    return act


def _typed(act: Act) -> Act:
    def typed(gateway: ScriptedGateway, page: Page) -> None:
        page.locator("form#entry [name=description]").fill("김치찌개")
        page.wait_for_timeout(400)  # it is kept
        act(gateway, page)

    return typed


def _hold(page: Page, address: str) -> None:
    """Leave what goes there without an answer until `_let_go`."""

    def keep(route: Route) -> None:
        _HELD.append(route)

    page.route(address, keep)


def _let_go() -> None:
    """End what was held: a browser that closes over it complains about each one."""
    while _HELD:
        with suppress(Error):  # the page itself may have given it up
            _HELD.pop().abort()


def _slow(_gateway: ScriptedGateway, page: Page) -> None:
    _hold(page, "**/never")
    page.evaluate("void fetch('/never')")


def _cut(gateway: ScriptedGateway, page: Page) -> None:
    page.context.set_offline(True)
    gateway.hang_up()


def _silent(gateway: ScriptedGateway, page: Page) -> None:
    _hold(page, "**/__hc/status.json")
    gateway.refuses_sockets = True
    gateway.hang_up()


def _signed_out(gateway: ScriptedGateway, page: Page) -> None:
    page.route("**/__hc/status.json", lambda route: route.fulfill(status=401, body="{}"))
    gateway.refuses_sockets = True
    gateway.hang_up()


def _restored(_gateway: ScriptedGateway, page: Page) -> None:
    page.locator("form#entry [name=description]").fill("김치찌개")
    page.wait_for_timeout(400)
    page.reload()


_RECEIPT: Final = {"v": 1, "type": "receipt", "key": _KEY, "outcome": "waiting", "at": None, "letter": None}
#: name -> where it is seen, and how the page comes into it.
STATES: Final[Mapping[str, tuple[str, Act]]] = {
    "R0 slow": (STRIP, _slow),
    "R1 first sign": (STRIP, _says(_LATER, down(stage=1))),
    "R1 no estimate": (MODAL, _typed(_says(down(stage=2)))),
    "R1 estimate": (MODAL, _says(down(eta=_ETA, samples=7, stage=3, elapsed_ms=1600))),
    "R1b R1c waiting": (
        MODAL,
        _says(_RECEIPT, down(eta=_ETA, samples=7, held=2, promised=1, stage=3, elapsed_ms=12_000)),
    ),
    "R2 planned": (MODAL, _says(down("R2", stage=3), down("R2", stage=4))),
    "R3 back": (CORNER, _says(down(eta=_ETA, samples=7), back(3210, verified=True), SERVING)),
    "R3b unproven": (CORNER, _says(down(eta=_ETA, samples=7), back(3210), SERVING)),
    "R3c short": (STRIP, _says(_LATER, down(), back(310, verified=True), SERVING)),
    "R7 long, told": (
        MODAL,
        _says(down("R7", stage=3, elapsed_ms=41_000, alerted_at="2026-11-21T10:00:00Z")),
    ),
    "R7b long, untold": (MODAL, _says(down("R7b", stage=3, elapsed_ms=41_000))),
    "R8 stopped": (MODAL, _says(down("R8", phase="FATAL", state="MANUAL_INTERVENTION"))),
    "off": (MODAL, _says(down("OFF", phase="STOPPED"))),
    "R9 reads only": (BAR, _says({**SERVING, "state": "SAFE_MODE", "safe": "DISK_FULL"})),
    "R10 not whole": (
        CORNER,
        _says({"v": 1, "type": "verified", "ok": False}, {**SERVING, "sound": False}),
    ),
    "R10 reads only": (
        BAR,
        _says({**SERVING, "state": "SAFE_MODE", "safe": "STORE_CORRUPT", "sound": False}),
    ),
    "R11 cut off": (STRIP, _typed(_cut)),
    "R11 silent": (STRIP, _silent),
    "R12 signed out": (BAR, _typed(_signed_out)),
    "R13 restored": (".notice:popover-open", _restored),
}


def _still(lang: Language) -> Iterator[tuple[str, bytes]]:
    """The pages that stand for themselves, as a browser without scripts shows them (R15)."""
    for kind in KINDS:
        yield f"R15 recovery {kind}", recovery_page(lang, kind, "get").body
    for outcome in OUTCOMES[1:]:
        yield f"R15 form {outcome}", recovery_page(lang, KINDS[0], outcome).body
    for settled in RECEIPT_OUTCOMES:
        body = receipt_page(lang, settled).body
        marks = {
            b"<!--key-->": _KEY.encode(),
            b"<!--id-->": _KEY[-8:].encode(),
            b"<!--letter-->": b"01JC3Q5Y",
        }
        for mark, value in marks.items():
            body = body.replace(mark, value)
        yield f"receipt {settled}", body
    for asked in GATE_KINDS:
        yield f"gate {asked}", gate_page(lang, asked).body.replace(b"<!--who-->", b"mina")


def take_states(
    browser: Browser, folder: Path, drawn: Mapping[Language, str], files: Mapping[str, bytes]
) -> int:
    """Take a picture of every state. `drawn`: a page of the ledger by language, `files`: what it loads. Their number."""
    taken = 0
    with ScriptedGateway({f"/{lang}": drawn[lang] for lang in LANGUAGES}) as gateway:
        gateway.files = {path: (body, "text/css") for path, body in files.items()}
        for lang in LANGUAGES:
            for name, (where, act) in STATES.items():
                context = browser.new_context(
                    base_url=gateway.url, reduced_motion="reduce", locale=LOCALES[lang]
                )
                page = context.new_page()
                gateway.refuses_sockets = False
                gateway.say(SERVING)
                page.goto(f"/{lang}")
                expect(page.locator("html")).to_have_attribute("data-hc", "serving")
                act(gateway, page)
                expect(page.locator(where).first).to_be_visible()
                taken += _take(page, folder, name, lang)
                _let_go()
                context.close()
            context = browser.new_context()
            page = context.new_page()
            for name, body in _still(lang):
                page.set_content(_without_scripts(body))
                taken += _take(page, folder, name, lang)
            context.close()
    return taken


def _without_scripts(body: bytes) -> str:
    plain = re.sub(r"<script.*?</script>|<meta http-equiv[^>]*>", "", body.decode(), flags=re.DOTALL)
    return plain.replace("<noscript>", "").replace("</noscript>", "")


def _take(page: Page, folder: Path, name: str, lang: str) -> int:
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        for theme in THEMES:
            page.emulate_media(color_scheme=theme)
            page.screenshot(path=folder / _file(name, lang, theme, size), type="jpeg", quality=80)
    return len(SIZES) * len(THEMES)


def _file(name: str, lang: str, theme: str, size: str) -> str:
    return f"state-{re.sub(r'[^a-z0-9]+', '-', name.lower())}-{lang}-{theme}-{size}.jpg"


def state_sheet(folder: Path) -> Path:
    """Write the sheet: a row for each state, a column for each reader."""
    columns = [(lang, theme, size) for size in SIZES for lang in LANGUAGES for theme in THEMES]
    names = [*STATES, *(name for name, _ in _still("en"))]
    head = "".join(f"<th>{' '.join(column)}</th>" for column in columns)
    rows = "".join(
        f"<tr><th>{html.escape(name)}</th>"
        + "".join(
            f'<td><a href="{file}"><img src="{file}" loading="lazy" alt=""></a></td>'
            for file in (_file(name, *column) for column in columns)
        )
        + "</tr>"
        for name in names
    )
    style = "body{font:14px sans-serif;background:#ddd}th{text-align:left;padding:4px}img{height:300px}"
    sheet = folder / "states.html"
    page = f"<!doctype html><meta charset=utf-8><title>States</title><style>{style}</style>"
    sheet.write_text(f"{page}<table><tr><th></th>{head}</tr>{rows}</table>", "utf-8")
    return sheet
