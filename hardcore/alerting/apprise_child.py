"""The process in which Apprise runs: one message from standard input, one exit code. Nothing of it is printed."""

import importlib
import json
import sys
from typing import Any

from hardcore.alerting.over_apprise import ABSENT_CODE, ARRIVED_CODE, REFUSED_CODE


def main() -> int:
    """Send what standard input says; return how it went."""
    told = json.load(sys.stdin)
    try:
        apprise: Any = importlib.import_module(
            "apprise"
        )  # an extra: it need not be there, and brings no types
    except ImportError:
        return ABSENT_CODE
    service = apprise.Apprise()
    # Asked first: of an address that it does not know it would only say "nothing to notify".
    if not service.add(told["url"]):
        return REFUSED_CODE
    return ARRIVED_CODE if service.notify(title=told["title"], body=told["body"]) else REFUSED_CODE


if __name__ == "__main__":
    sys.exit(main())
