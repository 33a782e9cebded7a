"""Rule: what is known of a guard that was lost.

Nobody was there to see it: what its successor found is all there is. So the finding says how long nobody watched, and
whether the guard had stood still before it was ended, where the page it left behind shows that; why it died stays
open, and it is said that nobody can tell.
"""

import re

from postmortem.analyzer.case import Case, Confidence, Finding

_UNWATCHED = re.compile(r"nobody watched for (\d{1,15}) ms")
_STOOD_STILL = "stood still"


def examine(case: Case) -> list[Finding]:
    """Say how long nobody watched, and how the guard before ended as far as that can be told."""
    if case.incident.diagnosis != "SENTINEL_LOST":
        return []
    said = [words.text for words in case.incident.evidence]
    frozen = [line for line in said if _STOOD_STILL in line]
    unwatched = next((match for line in said if (match := _UNWATCHED.search(line))), None)
    if unwatched is None:
        rule = "sentinel_frozen" if frozen else "sentinel_gone"
        sure = Confidence.CERTAIN if frozen else Confidence.UNKNOWN
        return [Finding(rule, sure, {}, tuple(frozen) or ("how long nobody watched is not on record",))]
    rule = "sentinel_frozen_for" if frozen else "sentinel_gone_for"
    values = {"seconds": f"{int(unwatched[1]) / 1000:.1f}"}
    return [Finding(rule, Confidence.CERTAIN, values, (unwatched[0], *frozen))]
