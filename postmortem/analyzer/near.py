"""Rule: commands that had just finished when the core died without a suspect, told as near and no more.

What does its damage late is answered before the core dies, so nothing in flight is to blame. A command that finished
within two seconds of a death from inside gets a mark; only where the guard has seen the same near several deaths
(a testimony `near` in the facts) is it called likely, and only where that names the request and not its kind: what
people do all day is near every death. Nobody is set aside for being near.
"""

from postmortem.analyzer.at_work import FROM_INSIDE
from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.incident import deciding, mappings, number, text, texts, unique

NEAR_NS = 2_000_000_000
NEAR_MAX = 8


def examine(case: Case) -> list[Finding]:
    """Name what had finished right before, where nothing was at work."""
    told = [line for line in case.incident.evidence if line.code == "near"]
    if told:
        lines = tuple(f"{line.code}: {line.text}" for line in told[:NEAR_MAX])
        about = [one for one in _finished(case) if any(_named(one, line.text) for line in told)]
        return [_finding("near_often", Confidence.LIKELY, lines, about)]
    if case.incident.diagnosis not in FROM_INSIDE or deciding(case.incident):
        return []
    found = _finished(case)
    lines = tuple(
        f"finished right before: {text(one.get('kind'))} {text(one.get('command_id'))}" for one in found
    )
    return [_finding("near", Confidence.UNKNOWN, lines, found)] if found else []


def _finished(case: Case) -> list[dict[str, object]]:
    taken_ns = number(case.recorder.get("taken_at_ns")) or 0
    ended = (
        dict(one)
        for one in mappings(case.recorder.get("finished"))
        if 0 <= taken_ns - (number(one.get("stage_ns")) or 0) <= NEAR_NS
    )
    return sorted(ended, key=lambda one: number(one.get("stage_ns")) or 0, reverse=True)[:NEAR_MAX]


def _named(one: dict[str, object], told: str) -> bool:
    """Tell whether a testimony names this very request; that all of them were of one kind names nobody."""
    name = text(one.get("key_hash"))
    return bool(name) and name in told


def _finding(rule: str, sure: Confidence, lines: tuple[str, ...], about: list[dict[str, object]]) -> Finding:
    accounts = unique(account for one in about for account in texts(one.get("account_ids")))
    transactions = unique(text(one.get("transaction_id")) for one in about)
    return Finding(rule, sure, {"count": str(max(len(about), len(lines)))}, lines, accounts, transactions)
