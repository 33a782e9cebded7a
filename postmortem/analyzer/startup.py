"""Rule: the core could not start, or is set up in a way that can't work.

What a core says on its way out of a start names the setting or the file, so its last words are the cause and not only
a sign of it. A command is never to blame: none had been taken.
"""

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.analyzer.uncaught import last_story

RULES = {"CONFIG_INVALID": "config_invalid", "STARTUP_FAILED": "startup_failed", "CRASH_LOOP": "crash_loop"}
_WITNESSES = frozenset({"start", "spawn", "log", "last words", "pidfd", "core"})


def examine(case: Case) -> list[Finding]:
    """Say what the core said of its own start."""
    incident = case.incident
    rule = RULES.get(incident.diagnosis)
    if rule is None:
        return []
    words = incident.last_words
    evidence = [f"{line.code}: {line.text}" for line in incident.evidence if line.code in _WITNESSES]
    if words is not None:
        evidence.append(f"last words: {words.code} {words.text}".rstrip())
    if (story := last_story(case.log)) is not None and words is None and story[2]:
        evidence.append(f"the log's last traceback: {story[0]} in {story[1][0]}")
    evidence += [f"{len(incident.deaths)} ends in this incident"] if len(incident.deaths) > 1 else []
    sure = Confidence.CERTAIN if words is not None or incident.grade == "certain" else Confidence.LIKELY
    said = words.text if words is not None and words.text else "-"
    return [Finding(rule, sure, {"said": said}, tuple(evidence))]
