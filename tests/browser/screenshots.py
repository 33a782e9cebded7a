"""Pictures of every state, for whoever wants to look at all of it at once: `make screenshots`.

A real house with an invented year in it, a real browser, real outages: nothing is posed but the moment. The
pictures and a contact sheet go to `./var/screenshots`; `--tour` also writes the few that the README shows.
"""

import argparse
import html
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

from examples.line import Line
from examples.sample_household import book, household
from frontend.render import Language
from tests.browser.conftest import ARGUMENTS, PATIENCE_MS
from tests.browser.outages import cores, held_start, outage
from tests.browser.readers import first_sign, is_joined, overlay, send_now, write_entry
from tests.browser.state_sheet import LANGUAGES, state_sheet, take_states
from tests.integration.house import House, transaction
from tests.integration.poisoning import armed, letter_of

ROOT: Final = Path(__file__).parents[2]
DESK: Final = {"width": 1280, "height": 800}
READER: Final = {"width": 1280, "height": 1000}
PHONE: Final = {"width": 390, "height": 844}
#: What the README shows: picture -> name in docs/images, for each language.
TOUR: Final = {
    "overview": "overview",
    "import": "import",
    "overlay": "overlay",
    "recovery-phone": "recovery-page",
    "demo": "demo",
    "admin-incident-top": "incident",
}
#: A bank's list to look at: when, what the bank calls it, who, won in, won out, won left.
LIST: Final = (
    ("2026-11-02 09:00", "이체", "가상회사", 2_400_000, 0, 3_184_500),
    ("2026-11-03 12:41", "카드결제", "동네 국숫집", 0, 9_000, 3_175_500),
    ("2026-11-04 18:05", "카드결제", "가상마트", 0, 48_320, 3_127_180),
    ("2026-11-06 08:12", "카드결제", "지하철", 0, 1_550, 3_125_630),
    ("2026-11-09 20:30", "카드결제", "똠방각하 분식", 0, 14_500, 3_111_130),
    ("2026-11-12 10:15", "자동이체", "도시가스", 0, 71_300, 3_039_830),
)


class Album:
    """The pictures of one run."""

    def __init__(self, browser: Browser, house: House, folder: Path, lang: str) -> None:
        """`folder` is where they go; it is there."""
        self.browser, self.house, self.folder, self.lang = browser, house, folder, lang

    def say(self, ko: str, en: str) -> str:
        """The one of two texts that is in this album's language."""
        return ko if self.lang == "ko" else en

    @contextmanager
    def tab(self, path: str, *, phone: bool = False, dark: bool = False) -> Iterator[Page]:
        """A tab on the house, as somebody with this language and screen has it."""
        context = self.browser.new_context(
            base_url=self.house.url,
            locale=self.say("ko-KR", "en-US"),
            viewport=PHONE if phone else DESK,  # type: ignore[arg-type]  # a dict with these two keys is one
            color_scheme="dark" if dark else "light",
        )
        context.set_default_timeout(PATIENCE_MS)
        page = context.new_page()
        page.goto(path)
        try:
            yield page
        finally:
            context.close()

    def take(self, page: Page, name: str, *, whole: bool = False) -> None:
        """Take a picture; `whole`: of the page and not of the screen."""
        page.wait_for_timeout(300)  # what glides has arrived
        page.screenshot(path=self.folder / f"{name}-{self.lang}.png", full_page=whole)
        sys.stdout.write(f"{name}-{self.lang}\n")


def pages(album: Album) -> None:
    """The ledger in peace."""
    for name, path in {"overview": "/", "register": "/register", "accounts": "/accounts"}.items():
        with album.tab(path) as page:
            album.take(page, name)
    with album.tab("/", phone=True) as page:
        album.take(page, "overview-phone", whole=True)
    with album.tab("/", dark=True) as page:
        album.take(page, "overview-dark")
    with album.tab("/import") as page:
        page.locator("#upload-file").set_input_files(_list(album.house.data.parent))
        page.locator("form[data-upload] button.primary").click()
        expect(page.locator("#import-body[data-state=preview]")).to_be_visible()
        page.locator("#how-account").select_option("assets:bank:living")
        expect(page.locator("form[data-commit] button.primary")).to_be_enabled()
        page.locator("h1").click()
        album.take(page, "import", whole=True)


def crisis(album: Album) -> None:
    """The open page while the server is away, and the page of a reload."""
    for dark, phone in ((False, False), (True, False), (False, True)):
        name = f"{'-dark' if dark else ''}{'-phone' if phone else ''}"
        with album.tab("/", dark=dark, phone=phone) as page:
            is_joined(page)
            write_entry(page, album.say("점심 김치찌개", "Lunch, kimchi stew"), "9,000")
            with outage(album.house):
                expect(overlay(page)).to_be_visible()
                page.wait_for_timeout(1200)
                album.take(page, f"overlay{name}")
            expect(overlay(page)).to_have_count(0)
            expect(page.locator(".corner:popover-open .card")).to_be_visible()
            album.take(page, f"back{name}")
        album.house.running()
        with album.tab("/register", dark=dark, phone=phone) as page, outage(album.house):
            page.reload()
            page.wait_for_timeout(900)
            album.take(page, f"recovery{name}")
        album.house.running()


def reads_only(album: Album) -> None:
    """A disk that takes no write: the page goes on, and a change is refused with what was typed still there."""
    for dark, phone in ((False, False), (True, False), (False, True)):
        name = f"{'-dark' if dark else ''}{'-phone' if phone else ''}"
        with album.tab("/", dark=dark, phone=phone) as page:
            is_joined(page)
            form = write_entry(page, album.say("점심 김치찌개", "Lunch, kimchi stew"), "9,000")
            album.house.running()
            assert album.house.order("drill", fault="diskfull", yes=True)["ok"]
            expect(page.locator(".bar")).to_be_visible()
            form.locator("button.primary").click()
            expect(form.locator("[data-said].wrong")).to_be_visible()
            album.take(page, f"reads-only{name}")
            expect(page.locator(".bar")).to_have_count(0)
            album.take(page, f"reads-only-over{name}")
    album.house.running()


def promised(album: Album) -> None:
    """A wish that was promised: on the page that sent it, on the one that offers to keep it, on its own, and its end."""
    for dark, phone in ((False, False), (True, False), (False, True)):
        name = f"{'-dark' if dark else ''}{'-phone' if phone else ''}"
        with album.tab("/", dark=dark, phone=phone) as page:
            is_joined(page)
            form = write_entry(page, album.say("점심 김치찌개", "Lunch, kimchi stew"), "9,000")
            with outage(album.house):
                send_now(form)
                expect(form.locator("[data-said]")).to_contain_text(
                    album.say("이 창을 닫아도", "You can close")
                )
                album.take(page, f"promised{name}")
                _post_by_itself(album, form)
                expect(page.locator("form[action='/__hc/keep']")).to_be_visible()
                album.take(page, f"keepable{name}")
                page.locator("form[action='/__hc/keep'] button").click()
                expect(page.locator("body[data-outcome=waiting]")).to_be_visible()
                album.take(page, f"receipt{name}")
            expect(page.locator("body[data-outcome=done]")).to_be_visible()
            album.take(page, f"receipt-done{name}")
            page.goto("/register")  # where no form tells it itself
            expect(page.locator("#receipts section")).to_be_visible()
            album.take(page, f"results{name}")
            album.house.running()


def _post_by_itself(album: Album, form: Locator) -> None:
    """Send another entry as a browser without scripts would."""
    form.evaluate(
        """(form, what) => {
          form.elements._idempotency_key.value = crypto.getRandomValues(new Uint32Array(4)).join("-");
          form.elements.description.value = what;
          form.submit();
        }""",
        album.say("저녁 국수", "Dinner, noodles"),
    )


def asked_again(album: Album) -> None:
    """A promise that has grown old: a person is asked."""
    for dark, phone in ((False, False), (True, False), (False, True)):
        with album.tab("/", dark=dark, phone=phone) as page:
            is_joined(page)
            form = write_entry(page, album.say("점심 김치찌개", "Lunch, kimchi stew"), "9,000")
            with outage(album.house):
                send_now(form)
                expect(form.locator("[data-said]")).to_contain_text(
                    album.say("이 창을 닫아도", "You can close")
                )
            asked = page.locator("#receipts section")
            expect(asked).to_be_visible()
            album.take(page, f"asked-again{'-dark' if dark else ''}{'-phone' if phone else ''}")
            asked.locator("button").last.click()
            expect(form.locator("[data-said].wrong")).to_be_visible()
            album.take(page, f"cancelled{'-dark' if dark else ''}{'-phone' if phone else ''}")
            album.house.running()


def dashboard(album: Album) -> None:
    """Every page of the dashboard, after a drill that has left something to look at."""
    count = len(album.house.incidents())
    assert album.house.order("drill", fault="deadlock", yes=True)["ok"]
    newest = album.house.closed(count + 1)["id"]
    album.house.running()
    with album.tab(f"/admin/incidents/{newest}") as page:
        page.set_viewport_size(READER)  # type: ignore[arg-type]  # a dict with these two keys is one
        album.take(page, "admin-incident-top")
    letter = _set_aside(album)
    paths = {
        "now": "",
        "incidents": "incidents",
        "incident": f"incidents/{newest}",
        "letters": "dlq",
        "letter": f"dlq/{letter}",
        "snapshots": "snapshots",
        "trends": "trends",
        "settings": "settings",
    }
    for dark, phone in ((False, False), (True, False), (False, True)):
        for name, path in paths.items():
            with album.tab(f"/admin/{path}", dark=dark, phone=phone) as page:
                kind = f"{'-dark' if dark else ''}{'-phone' if phone else ''}"
                album.take(page, f"admin-{name}{kind}", whole=True)


def _set_aside(album: Album) -> str:
    """Have a request kill its core; the number of its letter."""
    key = armed(album.house)
    with ThreadPoolExecutor(1) as pool:
        wish = transaction(album.say("점심 김치찌개", "Lunch, kimchi stew"))
        pool.submit(album.house.ask, "POST", "/api/ledger/transactions", wish, key=key)
        return letter_of(album.house, key)


def short_break(album: Album) -> None:
    """A crash with a spare behind it: a strip."""
    with album.tab("/") as page:
        is_joined(page)
        album.house.until(lambda s: (s["spare"] or {}).get("ready"), "a spare to be ready")
        album.house.hit("core")
        strip = page.locator(".strip[data-tone=good]:popover-open")
        expect(strip).to_be_visible()
        expect(strip).to_contain_text(album.say("잃은 내역은 없어요", "Nothing was lost"))
        album.take(page, "short-break")


def planned(album: Album) -> None:
    """A restart that somebody asked for, from its first sign."""
    with album.tab("/") as page:
        is_joined(page)
        known = cores(album.house)
        argv = [
            sys.executable,
            "-m",
            "hardcore.cli",
            "--data",
            str(album.house.data),
            "restart",
            "--reason",
            "tour",
        ]
        with subprocess.Popen(argv, env=album.house.environment(), stdout=subprocess.DEVNULL) as asking:
            with held_start(album.house, known):
                expect(first_sign(page)).to_be_visible()
                album.take(page, "first-sign")
                expect(overlay(page)).to_be_visible()
                album.take(page, "planned")
            asking.wait(60)
    album.house.running()


def demo(album: Album) -> None:
    """The page that breaks it."""
    with album.tab("/__hc/demo") as page:
        is_joined(page)
        page.locator("#later").uncheck()
        page.locator("#note").fill(album.say("이 글은 그대로 있어요", "This text stays where it is"))
        page.locator("[data-fault=freeze]").click()
        page.locator("#send").click()
        expect(page.locator("#log .ok").nth(2)).to_be_visible()
        page.evaluate("scrollTo(0, 0)")
        album.take(page, "demo")
    album.house.running()


def empty(album: Album) -> None:
    """The first moment."""
    with album.tab("/") as page:
        album.take(page, "empty")


def stopped_trying(album: Album) -> None:
    """The same problem again and again, until nobody tries any more."""
    with album.tab("/") as page:
        is_joined(page)
        for _death in range(2):
            album.house.until(lambda s: s["core"]["pid"], "a core to be hit")
            album.house.hit("core")
            album.house.until(
                lambda s: s["core"]["pid"] is None or s["state"] == "MANUAL_INTERVENTION", "its end"
            )
        album.house.until(lambda s: s["state"] == "MANUAL_INTERVENTION", "the guard to wait for a person")
        expect(overlay(page)).to_be_visible()
        page.wait_for_timeout(600)
        album.take(page, "stopped-trying")
        page.reload()
        page.wait_for_timeout(600)
        album.take(page, "recovery-stopped-trying")


@contextmanager
def at_home(folder: Path, name: str, *options: str, **policy: Any) -> Iterator[House]:
    """A house of its own, taken away at the end."""
    house = House(folder / name / "data", policy)
    house.data.parent.mkdir()
    try:
        yield house.up_unproven(*options)
    finally:
        house.end()


def contact_sheet(folder: Path) -> Path:
    """Write one page that shows all pictures."""
    names = sorted(path.name for path in folder.glob("*.png"))
    figures = "".join(
        f'<figure><a href="{html.escape(name)}"><img src="{html.escape(name)}" width="380"></a>'
        f"<figcaption>{html.escape(name)}</figcaption></figure>"
        for name in names
    )
    style = "body{font:14px sans-serif;display:flex;flex-wrap:wrap;background:#ddd}"
    sheet = folder / "index.html"
    sheet.write_text(f"<!doctype html><meta charset=utf-8><style>{style}</style>{figures}", "utf-8")
    return sheet


def states(browser: Browser, folder: Path) -> Path:
    """Every state of a crisis, over the page of a ledger with a year in it."""
    drawn: dict[Language, str] = {}
    files: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory(prefix="pictures-") as made:
        for lang in LANGUAGES:
            with at_home(Path(made), f"drawn-{lang}", spare=False) as house:
                _fill(house, lang)
                with urlopen(Request(house.url, headers={"Accept-Language": lang})) as answer:
                    page = answer.read().decode()
                for path in re.findall(r'href="(/static/[^"]+\.css)"', page):
                    with urlopen(house.url + path) as answer:
                        files[path] = answer.read()
                # The ledger's own scripts would ask a ledger; the crisis script comes from the scripted gateway.
                drawn[lang] = re.sub(
                    r"<script.*?</script>|<link rel=\"modulepreload\"[^>]*>", "", page, flags=re.DOTALL
                )
    count = take_states(browser, folder, drawn, files)
    sys.stdout.write(f"{count} pictures of states\n")
    return state_sheet(folder)


def take_all(browser: Browser, folder: Path, only: str | None = None) -> None:
    """Take every picture, in both languages; or those of one home."""
    # Without a spare an outage can be looked at: the next core is one that can be stopped.
    alone = {"spare": False}
    weary = {**alone, "max_restart_count": 1, "probation_ms": 60_000}
    soon = {"hold_ms": 600, "drain_ms": 1_000}
    homes: list[tuple[str, list[Callable[[Album], None]], dict[str, Any]]] = [
        ("empty", [empty], {}),
        ("full", [pages, crisis, reads_only, planned, demo], alone),
        ("patient", [promised], {**alone, "gateway": soon}),
        ("old", [asked_again], {**alone, "gateway": {**soon, "receipt_ask_after_ms": 1}}),
        ("guarded", [dashboard], alone),
        ("ready", [short_break], {"spare": True, "gateway": {"overlay_after_ms": 60_000}}),
        ("weary", [stopped_trying], weary),
    ]
    with tempfile.TemporaryDirectory(prefix="pictures-") as made:
        for lang in ("ko", "en"):
            for name, acts, policy in homes:
                if only not in {None, name}:
                    continue
                with at_home(Path(made), f"{name}-{lang}", "--demo", **policy) as house:
                    if name not in {"empty", "weary"}:
                        _fill(house, lang)
                    for act in acts:
                        act(Album(browser, house, folder, lang))


def _fill(house: House, lang: str) -> None:
    where = urlsplit(house.url)
    assert where.hostname is not None, "the guard tells whole addresses"
    with Line((where.hostname, where.port or 80)) as line:
        book(line, household(datetime.now().astimezone().date(), lang))


def _list(folder: Path) -> Path:
    lines = ["거래일시,적요,의뢰인/수취인,입금,출금,거래후잔액,구분,거래점,거래특이사항"]
    lines += [
        f'{at},{kind},{who},"{came:,}","{went:,}","{left:,}",체크,가상점,'
        for at, kind, who, came, went, left in LIST
    ]
    lines.append('2026-11-31 10:00,카드결제,없는 날,0,500,"1,000",체크,가상점,')
    path = folder / "거래내역.csv"
    path.write_bytes("\r\n".join([*lines, ""]).encode("cp949"))
    return path


def main() -> int:
    """Take the pictures and say where they are."""
    parser = argparse.ArgumentParser(prog="screenshots", description="Pictures of every state.")
    parser.add_argument("--into", type=Path, default=ROOT / "var" / "screenshots")
    parser.add_argument("--only", help="the pictures of one home alone")
    parser.add_argument("--states", action="store_true", help="only the sheet of all states of a crisis")
    parser.add_argument("--tour", action="store_true", help="also write the pictures of the README")
    asked = parser.parse_args()
    found = subprocess.run(
        ["sh", str(ROOT / "scripts" / "browser")], capture_output=True, text=True, check=False
    )
    if found.returncode:
        sys.stderr.write(found.stderr)
        return 1
    asked.into.mkdir(parents=True, exist_ok=True)
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found.stdout.strip(), args=ARGUMENTS)
        if not asked.states:
            take_all(browser, asked.into, asked.only)
        if asked.states or asked.only is None:
            sys.stdout.write(f"{states(browser, asked.into)}\n")
        browser.close()
    if asked.tour:
        for name, shown in TOUR.items():
            for lang in ("ko", "en"):
                taken = asked.into / f"{name}-{lang}.png"
                if taken.exists():  # with `--only` the others keep the picture that they have
                    (ROOT / "docs" / "images" / f"{shown}-{lang}.png").write_bytes(taken.read_bytes())
    sys.stdout.write(f"{contact_sheet(asked.into)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
