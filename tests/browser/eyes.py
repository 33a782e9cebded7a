"""What a page is like for people who see, hear or move in another way: axe-core's rules, and room for large text.

axe-core comes inside a Python package of the development lock, and is put into the page through the browser's own
protocol: the policy of our pages lets no strange script in, which is as it should be. Korean pages are looked at in the
dark and English ones in the light: colours do not follow from a language, and nothing else follows from a theme, so
the two together say as much as all four, in half the time.
"""

import json
from dataclasses import dataclass, field
from typing import Any, Final

from axe_playwright_python.base import AXE_SCRIPT
from playwright.sync_api import Page

_QUICKLY: Final = {"resultTypes": ["violations"], "preload": False}
#: Beside what is on by itself: room to hit a thing with a finger (WCAG 2.2).
EVERYTHING: Final = {**_QUICKLY, "rules": {"target-size": {"enabled": True}}}
#: A phone, and a desk screen at 200 %.
PHONE: Final = (390, 844)
DESK: Final = (1280, 800)
DESK_ZOOMED: Final = (640, 400)
_SHOWN_MAX: Final = 6

_ASK: Final = "async ([within, options]) => (await axe.run(within ?? document, options)).violations"
_OVERHANGS: Final = """() => {
  const wide = document.documentElement.scrollWidth;
  if (wide <= innerWidth) return [];
  return [`${wide} px wide in ${innerWidth}`, ...[...document.querySelectorAll("body *")]
    .filter((one) => one.getBoundingClientRect().right > innerWidth + 1 && one.checkVisibility())
    .slice(0, 4).map((one) => one.outerHTML.slice(0, 120))];
}"""


@dataclass
class Eyes:
    """Looks at pages one after the other and keeps what is wrong with any of them.

    `within`: a selector, where only a part of the page is ours.
    """

    within: str | None = None
    found: list[str] = field(default_factory=list)

    def look(self, page: Page, name: str) -> None:
        """Look at a page as it stands now, also on a phone and enlarged."""
        if not page.evaluate("'axe' in window"):
            page.evaluate(AXE_SCRIPT)
        theme = "dark" if page.evaluate("document.documentElement.lang") == "ko" else "light"
        self._ask(page, name, theme)
        self._reflow(page, name)

    def _ask(self, page: Page, name: str, theme: str) -> None:
        page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]  # one of the two words
        page.evaluate("document.getAnimations().forEach((one) => one.finish())")
        for one in page.evaluate(_ASK, [self.within, EVERYTHING]):
            self.found.append(f"{name} ({theme}): {_told(one)}")

    def _reflow(self, page: Page, name: str) -> None:
        """Nothing may stand beyond the edge: two ways to scroll are one too many."""
        for width, height in (PHONE, DESK_ZOOMED):
            page.set_viewport_size({"width": width, "height": height})
            self.found += [f"{name} at {width} px: {one}" for one in page.evaluate(_OVERHANGS)]
        page.set_viewport_size({"width": DESK[0], "height": DESK[1]})

    def are_content(self) -> None:
        """Nothing was found, or the test fails with all of it."""
        assert not self.found, f"{len(self.found)} found:\n" + "\n".join(self.found)


def _told(violation: dict[str, Any]) -> str:
    nodes = violation["nodes"]
    lines = [f"{violation['id']} ({violation['impact']}): {violation['help']}"]
    for node in nodes[:_SHOWN_MAX]:
        wrong = [check["message"] for check in (*node["any"], *node["all"], *node["none"])]
        lines.append(f"    {json.dumps(node['target'])} {node['html'][:160]}\n      {'; '.join(wrong)}")
    if len(nodes) > _SHOWN_MAX:
        lines.append(f"    and {len(nodes) - _SHOWN_MAX} more")
    return "\n".join(lines)
