"""A spare takes over while somebody looks: after a death one slow click, for a restart that was asked for nothing at all."""

import subprocess
import sys
from typing import Any, Final

from playwright.sync_api import Page, expect

from tests.browser.conftest import OpenTab
from tests.browser.readers import a_bank, booked, is_joined, is_saved, is_serving, save, write_entry
from tests.integration.house import House
from tests.waiting import until

#: No switch here is too slow for this overlay, however much else the machine does.
POLICY: Final = {"spare": True, "gateway": {"hold_ms": 25_000, "overlay_after_ms": 60_000, "drain_ms": 1_000}}

#: Writes down every strip and overlay that the crisis script shows from now on.
WATCH: Final = """() => {
  window.shown = [];
  const look = (root) => {
    if (root.querySelector("dialog[open]")) shown.push("overlay");
    for (const strip of root.querySelectorAll(".strip:popover-open")) shown.push(strip.innerText);
  };
  for (const { shadowRoot } of document.body.children) {
    if (shadowRoot) new MutationObserver(() => look(shadowRoot))
      .observe(shadowRoot, { subtree: true, childList: true, attributes: true, characterData: true });
  }
  window.sameDocument = true;
}"""


def with_a_spare(house: House) -> None:
    """Wait until a spare stands ready behind the core."""
    house.until(lambda s: s["phase"] == "RUNNING" and (s["spare"] or {}).get("ready"), "a spare to be ready")


def core_of(house: House) -> Any:
    """The pid of the core that serves."""
    return house.status()["core"]["pid"]


def look(house: House, open_tab: OpenTab) -> Page:
    """A page of the house that has been joined, and writes down what it is shown."""
    a_bank(house)
    with_a_spare(house)
    page = open_tab(house)
    is_joined(page)
    page.evaluate(WATCH)
    return page


def test_a_crash_with_a_spare_is_one_slow_click_and_a_strip(house: House, open_tab: OpenTab) -> None:
    page = look(house, open_tab)
    old = core_of(house)
    form = write_entry(page, "Over the crash", "7000")
    house.hit("core")
    save(form)
    is_saved(form)
    is_serving(page)
    until(lambda: any("Interrupted for" in one for one in page.evaluate("shown")), "the strip to say it")
    assert "overlay" not in page.evaluate("shown")
    assert page.evaluate("sameDocument") is True
    assert booked(house, "Over the crash") == 1
    assert core_of(house) != old


def test_a_restart_that_was_asked_for_shows_nothing_and_loses_nothing(
    house: House, open_tab: OpenTab
) -> None:
    page = look(house, open_tab)
    old = core_of(house)
    words = [sys.executable, "-m", "hardcore.cli", "--data", str(house.data), "restart", "--reason", "test"]
    names: list[str] = []
    with subprocess.Popen(words, env=house.environment(), stdout=subprocess.DEVNULL) as asking:
        while asking.poll() is None or core_of(house) in {None, old}:
            names.append(f"Over the restart {len(names)}")
            form = write_entry(page, names[-1], "7000")
            save(form)
            expect(form.locator("[name=description]")).to_have_value("")
    assert asking.returncode == 0
    house.running()
    is_serving(page)
    assert page.evaluate("shown") == []
    assert page.evaluate("sameDocument") is True
    assert [booked(house, name) for name in names] == [1] * len(names)
