"""Rule: the core left by itself with an exit code that nobody had asked for.

The codes are the core's own contract with the guard; a code outside of it says only that it left.
"""

from postmortem.analyzer.case import Case, Confidence, Finding

#: Exit codes with a meaning, as the wires between guard and core define them.
MEANINGS = {
    65: "the proof of the ledger failed",
    69: "the store stayed busy",
    73: "no room on the disk",
    74: "a commit failed",
    75: "a higher epoch has taken over",
    78: "the configuration is unusable",
}


#: Words that are finer than their code: a rule of their own tells it.
_TOLD_BY_OTHERS = frozenset({"STORE_AWAY", "DISK_READ_ONLY"})


def examine(case: Case) -> list[Finding]:
    """Name the exit code, what it means, and the last words."""
    code = case.incident.exit.code
    if code is None or case.incident.planned or case.incident.diagnosis == "OPERATOR":
        return []
    words = case.incident.last_words
    if words is not None and words.code in _TOLD_BY_OTHERS:
        return []
    evidence = [f"exit status: code {code}" + (f" ({MEANINGS[code]})" if code in MEANINGS else "")]
    if words is not None:
        evidence.append(f"last words: {words.code} {words.text}".rstrip())
    rule = f"exited_{code}" if code in MEANINGS else "exited"
    return [Finding(rule, Confidence.CERTAIN, {"code": str(code)}, tuple(evidence))]
