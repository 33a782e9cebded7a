"""Every page and every state of it, by the rules of axe-core: in both languages, both themes, narrow and enlarged."""

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

import pytest
from playwright.sync_api import Page, expect

from frontend.catalogue_crisis import CRISIS
from frontend.crisis_paper import (
    KINDS,
    OUTCOMES,
    RECEIPT_OUTCOMES,
    Gate,
    Kind,
    gate_page,
    receipt_page,
    recovery_page,
)
from tests.browser.bank_files import hana_csv
from tests.browser.conftest import OpenTab
from tests.browser.eyes import Eyes
from tests.browser.furniture import BANK, furnish
from tests.browser.readers import save, write_entry
from tests.browser.scripted_gateway import SERVING, ScriptedGateway, back, down
from tests.browser.scripted_pages import OpenLedger
from tests.browser.tabs import Watch
from tests.integration.house import House, transaction
from tests.integration.poisoning import armed, letter_of

LANGUAGES: Final = ("ko", "en")
NOWHERE: Final = "/nowhere"
PLACES: Final = (
    "/",
    "/?month=2026-10",
    "/register",
    f"/register?account={BANK}",
    "/register?q=nothing+like+it",
    "/accounts",
    "/plans",
    "/plans?month=2026-10",
    "/import",
    "/transactions/new",
    NOWHERE,
)
ACCOUNTS: Final = "/api/ledger/accounts?limit=500"
DESKS: Final = tuple(
    f"/admin/{place}"
    for place in ("", "incidents?view=all", "dlq", "snapshots", "trends", "alerts", "policy", "settings")
)
#: One of each drawing; the others differ in their sentence alone.
GATES: Final[tuple[Gate, ...]] = ("in", "wrong", "again", "differ", "gone")
#: axe-core measures with styles of its own, which no page of ours allows. That they don't is held by all other tests.
SEEN: Final = {"reduced_motion": "reduce", "bypass_csp": True}
#: A page without a fault of its own, under all that the crisis script can show.
UNDER: Final = """<!doctype html><html lang="{lang}"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1"><title>Ledger</title><link rel="icon" href="data:,">
</head><body><main><h1>October</h1><form id="entry" data-hc-draft><label>What <input name="what"></label>
<button>Save</button></form></main></body></html>"""


@pytest.fixture
def eyes() -> Iterator[Eyes]:
    """Somebody who looks, and complains once, at the end."""
    eyes = Eyes()
    yield eyes
    eyes.are_content()


def _moments(gateway: ScriptedGateway, page: Page) -> Iterator[tuple[str, str]]:
    """Bring the page into one state after the other; each with where it is seen, and by which heading."""
    modal, corner, strip = "dialog[open]", ".corner:popover-open", ".strip:popover-open"
    page.locator("[name=what]").fill("typed")
    gateway.say({"v": 1, "type": "hello", "overlay_after_ms": 60_000, "demo": False})
    gateway.say(down(stage=1))
    yield strip, "R1"
    gateway.say(down(eta={"low_s": 2, "high_s": 4, "samples": 7}, samples=7))
    yield modal, "R1"
    gateway.say(down("R7", stage=4, elapsed_ms=9000, alerted_at="2026-11-21T10:00:00Z", held=2))
    yield modal, "R7"
    gateway.say(down("R8", phase="FATAL"))
    page.locator("dialog summary").click()
    yield modal, "R8"
    gateway.say(down("OFF"))
    yield modal, "OFF"
    gateway.say(down("R7b"))
    gateway.say(back(3210))
    gateway.say(SERVING)
    yield corner, "R3"
    gateway.say({"v": 1, "type": "verified", "ok": False})
    gateway.say({**SERVING, "sound": False})
    yield corner, "R10"
    gateway.say({"v": 1, "type": "verified", "ok": True})
    gateway.say({**SERVING, "sound": True, "state": "SAFE_MODE", "safe": "DISK_FULL"})
    yield ".bar", "R9"
    gateway.say(SERVING)
    gateway.say(back(900))
    yield strip, "R3c"
    page.context.set_offline(True)
    gateway.hang_up()
    yield strip, "R11"


def test_what_shuts_somebody_out_is_seen(open_ledger: OpenLedger) -> None:
    page = open_ledger("/en", **SEEN)
    page.set_content(
        "<html lang=en><title>x</title><main><h1>x</h1><button></button><p><s>wide</s></p></main>"
    )
    page.add_style_tag(content="p { color: #ccc; width: 900px }")
    eyes = Eyes()
    eyes.look(page, "a bad page")
    told = "\n".join(eyes.found)
    assert all(wrong in told for wrong in ("button-name", "color-contrast", "at 390 px", "at 640 px"))


@pytest.mark.parametrize("lang", LANGUAGES)
def test_nothing_that_the_crisis_script_shows_shuts_anybody_out(
    open_ledger: OpenLedger, gateway: ScriptedGateway, eyes: Eyes, lang: str
) -> None:
    gateway.pages[f"/{lang}"] = UNDER.format(lang=lang)
    page = open_ledger(f"/{lang}", **SEEN)
    for where, code in _moments(gateway, page):
        head = CRISIS[code][LANGUAGES.index(lang)].replace("{n}", "900")
        expect(page.locator(where).get_by_text(head).first).to_be_visible()
        eyes.look(page, f"{code} in {where}, {lang}")


@pytest.mark.parametrize("kind", KINDS)
def test_the_living_recovery_page_shuts_nobody_out(
    open_ledger: OpenLedger, gateway: ScriptedGateway, eyes: Eyes, kind: Kind
) -> None:
    texts = {"planned": "R2", "stopped_trying": "R8", "off": "OFF"}
    gateway.recovering = ("en", kind, "keepable")
    gateway.say(down(texts.get(kind, "R1"), stage=2))
    page = open_ledger("/en", **SEEN)
    for lang in ("en", "ko"):
        expect(page.locator("html")).to_have_attribute("lang", lang)
        eyes.look(page, f"living recovery page {kind}, {lang}")
        page.locator(".foot .plain").click()


def _without_scripts(body: bytes) -> str:
    """The page as a browser without scripts draws it."""
    plain = re.sub(r"<script.*?</script>|<meta http-equiv[^>]*>", "", body.decode(), flags=re.DOTALL)
    return plain.replace("<noscript>", "").replace("</noscript>", "")


@pytest.mark.parametrize("lang", LANGUAGES)
def test_no_page_of_the_gateway_s_own_shuts_anybody_out(
    open_ledger: OpenLedger, eyes: Eyes, lang: str
) -> None:
    page = open_ledger("/en", **SEEN)
    first = KINDS[0]
    for kind, outcome in (
        *((kind, "get") for kind in KINDS[1:]),
        *((first, outcome) for outcome in OUTCOMES),
    ):
        page.set_content(_without_scripts(recovery_page(lang, kind, outcome).body))
        eyes.look(page, f"recovery page {kind} {outcome}, {lang}")
    for settled in RECEIPT_OUTCOMES:
        page.set_content(_without_scripts(receipt_page(lang, settled).body))
        eyes.look(page, f"receipt {settled}, {lang}")
    for asked in GATES:
        page.set_content(_without_scripts(gate_page(lang, asked).body))
        eyes.look(page, f"gate {asked}, {lang}")


def _opened(page: Page) -> None:
    """Open everything that can be opened."""
    page.evaluate("document.querySelectorAll('main details').forEach((one) => { one.open = true; })")


@pytest.mark.parametrize("lang", LANGUAGES)
def test_no_page_of_the_ledger_shuts_anybody_out(
    shared_house: House, open_tab: OpenTab, watch: Watch, eyes: Eyes, lang: str, tmp_path: Path
) -> None:
    page = open_tab(shared_house, lang=lang, **SEEN)
    if page.locator("form[action='/start']").count():
        eyes.look(page, f"the empty start, {lang}")
        page.goto("about:blank")  # it would draw itself anew with the first account
    for path in (*PLACES, *furnish(shared_house).values()):
        page.goto(path)
        _opened(page)
        eyes.look(page, f"{path}, {lang}")
    page.goto("/")
    page.locator("form#entry [value=move]").check()
    save(page.locator("form#entry"))  # with nothing in it: a field says what is wrong
    expect(page.locator("form#entry [aria-invalid]").first).to_be_visible()
    eyes.look(page, f"faults at their fields, {lang}")
    page.locator("form#entry [value=out]").check()
    page.locator("[data-keys]").click()
    eyes.look(page, f"the list of keys, {lang}")
    page.keyboard.press("Escape")
    save(write_entry(page, f"Looked at, {lang}"))
    expect(page.locator("[data-live]").get_by_text(f"Looked at, {lang}").first).to_be_visible()
    eyes.look(page, f"an entry was saved, {lang}")
    _imports(page, eyes, lang, hana_csv(tmp_path, refused=1))
    watch.troubles[:] = [one for one in watch.troubles if NOWHERE not in one]


def _imports(page: Page, eyes: Eyes, lang: str, file: Path) -> None:
    page.goto("/import")
    page.locator("#upload-file").set_input_files(file)
    page.locator("form[data-upload] button.primary").click()
    expect(page.locator("#import-body[data-state=preview]")).to_be_visible()
    page.locator("#how-account").select_option(BANK)
    expect(page.locator("form[data-commit][data-ready]")).to_be_visible()
    if page.locator("[name=again]").count():  # in another language these rows were booked before
        page.locator("[name=again]").check()
    expect(page.locator("form[data-commit] button.primary")).to_be_enabled()
    _opened(page)
    eyes.look(page, f"an import's preview, {lang}")
    page.locator("form[data-commit] button.primary").click()
    expect(page.locator("#import-body[data-state=done]")).to_be_visible()
    eyes.look(page, f"an import's end, {lang}")


@pytest.fixture(scope="module")
def story(shared_house: House) -> dict[str, str]:
    """What the dashboard has to tell: an incident and a letter, by the path of their pages."""
    furnish(shared_house)
    if not any(one["id"] == "assets:bank" for one in shared_house.ask("GET", ACCOUNTS).body["items"]):
        shared_house.open_accounts()
    key = armed(shared_house)
    with ThreadPoolExecutor(1) as pool:
        pool.submit(shared_house.ask, "POST", "/api/ledger/transactions", transaction("poison"), key=key)
        letter = letter_of(shared_house, key)
    assert shared_house.order("drill", fault="deadlock", yes=True)["ok"]
    incident = shared_house.closed(2)["id"]
    shared_house.running()
    return {"incident": f"/admin/incidents/{incident}", "letter": f"/admin/dlq/{letter}"}


@pytest.mark.parametrize("lang", LANGUAGES)
def test_no_page_of_the_dashboard_shuts_anybody_out(
    shared_house: House, open_tab: OpenTab, eyes: Eyes, story: dict[str, str], lang: str
) -> None:
    page = open_tab(shared_house, "/admin/", lang=lang, **SEEN)
    for path in (*DESKS, *story.values(), f"{story['incident']}/bundle"):
        page.goto(path)
        _opened(page)
        eyes.look(page, f"{path}, {lang}")
    page.goto(story["letter"])
    page.locator("form[action$='/discard'] button").click()
    expect(page.locator("dialog[open]")).to_be_visible()
    eyes.look(page, f"a question of the dashboard, {lang}")


#: Where the focus is, and what is wrong with how it is shown there: empty where nothing is.
FOCUS: Final = """() => {
  let one = document.activeElement;
  if (one === document.body) return ["body", ""];
  // The browser marks it for who uses keys; a mark may stand on what lies over a hidden choice.
  const shown = one.matches(".kinds input") ? one.nextElementSibling : one;
  const { outlineStyle, outlineWidth } = getComputedStyle(shown);
  const box = shown.getBoundingClientRect();
  const top = document.querySelector(".top")?.getBoundingClientRect().bottom ?? 0;
  const isUnder = !one.closest(".top, .skip") && box.top < top - 1;
  const wrong = outlineStyle === "none" || parseFloat(outlineWidth) < 2 ? "no outline"
    : box.bottom > innerHeight + 1 || isUnder ? "out of sight" : "";
  return [one.outerHTML.slice(0, 90), wrong];
}"""
STEPS: Final = 80


@pytest.mark.parametrize("path", ["/", "/accounts", "/plans"])
def test_whoever_goes_through_a_page_by_keys_sees_where_they_are(
    shared_house: House, open_tab: OpenTab, path: str
) -> None:
    furnish(shared_house)
    page = open_tab(shared_house, path, viewport={"width": 1280, "height": 500})
    seen: list[list[str]] = []
    for _ in range(STEPS):
        page.keyboard.press("Tab")
        seen.append(page.evaluate(FOCUS))
        if seen[-1][0] == "body":
            break
    assert [one for one in seen if one[1]] == []
    assert len(seen) > 10, "the page was gone through"


def test_who_wants_no_motion_gets_none(shared_house: House, open_tab: OpenTab) -> None:
    furnish(shared_house)
    page = open_tab(shared_house, reduced_motion="reduce")
    save(write_entry(page, "Without motion"))
    expect(page.locator("[data-live]").get_by_text("Without motion").first).to_be_visible()
    assert page.evaluate("document.getAnimations().length") == 0
