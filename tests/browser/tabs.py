"""Tabs of a real browser, and what goes wrong in them: errors on the console, refusals of the page's own policy.

A tab is watched from its first moment to its last. What a browser writes on its console about an outage (an
answer with 503, a socket that was closed) is what the outage is; everything else is our mistake and fails the
test that saw it, even where nothing else looks wrong.
"""

import re
from dataclasses import dataclass, field
from typing import Final

from playwright.sync_api import ConsoleMessage, Dialog, Error, Page

#: What the browser itself says of answers that are meant, and of a server that is not there.
OUTAGE: Final = re.compile(
    r"Failed to load resource: .*(status of (4(?!04)\d\d|503)|net::ERR_)|WebSocket connection to .* failed"
)
#: Where a page asks what became of a wish.
LOOK_UP: Final = "/api/ledger/commands/"


@dataclass
class Watch:
    """What a tab has complained about, and every dialog that a script has opened in it.

    `leaving` counts how often a browser asked whether the page may really be left; whoever leaves is let go.
    """

    troubles: list[str] = field(default_factory=list)
    dialogs: list[str] = field(default_factory=list)
    leaving: int = 0

    def on(self, page: Page) -> None:
        """Begin to watch a tab."""
        page.on("console", self._console)
        page.on("pageerror", self._error)
        page.on("dialog", self._dialog)

    def _console(self, message: ConsoleMessage) -> None:
        if message.type not in {"error", "warning"} or OUTAGE.search(message.text):
            return
        if (
            LOOK_UP not in message.location["url"]
        ):  # a wish that is asked about and not there yet: 404 is the answer
            self.troubles.append(f"{message.type}: {message.text} ({message.location['url']})")

    def _error(self, error: Error) -> None:
        self.troubles.append(f"not caught: {error}")

    def _dialog(self, dialog: Dialog) -> None:
        if dialog.type == "beforeunload":
            self.leaving += 1
            dialog.accept()
            return
        self.dialogs.append(dialog.message)
        dialog.dismiss()
