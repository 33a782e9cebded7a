"""What the guard says of suspects, trials and letters, as lines and messages: pure, and cut to what its readers take.

The words are `docs/wires.md` sections 6, 14 and 15. They are made here and not where they are sent, so that what a
successor says again is what its predecessor said.
"""

from collections.abc import Sequence
from typing import Any, Final

from msgspec import structs

from hardcore.host.docket import Case, Unknown
from hardcore.model.trials import CourtMemory, Letter, Ordeal, Reason, Suspect, SuspectNote, Tried
from hardcore.quarantine_file import RULES_MAX, Aside

#: Keys, and accounts, in one line of the feed, which a gateway reads up to 64 KiB.
KEYS_A_LINE: Final = 512
ACCOUNTS_A_LINE: Final = 64
_HELD: Final = frozenset({Reason.UNPROVEN, Reason.OPERATOR_HOLD})


def suspect_lines(notes: Sequence[SuspectNote]) -> list[dict[str, object]]:
    """Return who is suspect, in lines that a gateway reads; they add up."""
    lines: list[dict[str, object]] = []
    for at in range(0, len(notes), KEYS_A_LINE):
        part = notes[at : at + KEYS_A_LINE]
        accounts = list(dict.fromkeys(account for note in part for account in note.account_ids))
        lines.append(_suspects([note.name for note in part], accounts[:ACCOUNTS_A_LINE]))
        rest = range(ACCOUNTS_A_LINE, len(accounts), ACCOUNTS_A_LINE)
        lines += [_suspects([], accounts[more : more + ACCOUNTS_A_LINE]) for more in rest]
    return lines


def _suspects(names: list[str], accounts: list[str]) -> dict[str, object]:
    return {"type": "suspects", "keys": names, "account_ids": accounts}


def verdict_of_letter(name: str, letter: str, reason: str) -> dict[str, object]:
    """Return the line that tells whoever waits that its request is set aside."""
    outcome = "held" if reason in _HELD else "convicted"
    return {"type": "verdict", "name": name, "outcome": outcome, "letter": letter, "reason": reason}


def verdict_of_acquittal(name: str, *, run: bool) -> dict[str, object]:
    """Return the line that tells whoever waits that its request is nobody's death."""
    outcome = "cleared" if run else "dropped"
    return {"type": "verdict", "name": name, "outcome": outcome, "letter": None, "reason": None}


def said_again(memory: CourtMemory, aside: Aside) -> dict[str, dict[str, object]]:
    """Return the verdicts that an earlier guard came to, by name; a gateway that missed one waits for it still.

    Who was on nobody's side (a trial that could not be held) is not run on the word of a guard that is gone.
    """
    lines = {}
    for one in memory.suspects:
        if one.ordeal is None:
            continue
        rule = aside.rule(one.letter) if one.letter else None
        if rule is not None:
            lines[one.name] = verdict_of_letter(one.name, one.letter, str(rule.get("reason", "")))
        elif not one.letter:
            run = one.ordeal in {Ordeal.SURVIVED, Ordeal.COMMITTED}
            lines[one.name] = verdict_of_acquittal(one.name, run=run)
    return lines


def settled_by(memory: CourtMemory, aside: Aside) -> CourtMemory:
    """Return the memory as the rules have it: a guard may have set one aside and died before it wrote that down."""
    letters = {rule.get("name"): rule for rule in aside.rules if rule.get("type") == "letter"}

    def settled(one: Suspect) -> Suspect:
        rule = letters.get(one.name) if one.ordeal is None else None
        if rule is None:
            return one
        ordeal = Ordeal.UNTRIED if rule.get("reason") in _HELD else Ordeal.DIED
        return structs.replace(one, ordeal=ordeal, letter=str(rule["id"]))

    return structs.replace(memory, suspects=tuple(map(settled, memory.suspects)))


def unruled(memory: CourtMemory, aside: Aside) -> tuple[Suspect, ...]:
    """Return who is remembered as set aside though no rule keeps it out, and no person took that rule away.

    The memory does not wait for the rules' disk, so a guard may have died between the two; or the rules were lost.
    """
    ruled = {str(rule["id"]) for rule in aside.rules} | set(aside.released)
    found = tuple(one for one in memory.suspects if one.letter and one.letter not in ruled)
    gone = len(found) - (RULES_MAX - len(aside.rules))  # where there are too many, the oldest went by itself
    return found[max(0, gone) :]


def message(letter: Letter, case: Case | Unknown, tried: Tried | None, at: str) -> dict[str, Any]:
    """Return what the investigators are told of a letter, but for its request, which lies among the cases."""
    return {
        "id": letter.id,
        "state": "HELD" if letter.held else "QUARANTINED",
        "reason": str(letter.reason),
        "name": letter.name,
        "command_id": letter.command_id,
        "idempotency_key": case.key if isinstance(case, Case) else None,
        "kind": letter.kind,
        "source": letter.source,
        "account_ids": list(letter.account_ids),
        "transaction_id": letter.transaction_id,
        "fingerprint": letter.fingerprint or None,
        "digest": letter.digest or None,
        "incident_ids": list(letter.incidents),
        "deaths": letter.deaths,
        "quarantined_at": at,
        "seq": letter.seq,
        "trial": None if tried is None else _trial(tried),
    }


def _trial(tried: Tried) -> dict[str, Any]:
    """Return a verdict in the words of the court; its answer, if it had one, is nobody's business here."""
    return {
        "type": "tried",
        "name": tried.name,
        "ordeal": str(tried.ordeal),
        "fingerprint": tried.fingerprint or None,
        "kind": tried.kind,
        "account_ids": list(tried.account_ids),
        "transaction_id": tried.transaction_id,
        "exit": {"code": tried.code, "signal": tried.signal},
        "ms": tried.took_ms,
        "status": None,
        "answer": None,
        "frame": tried.frame,
        "seq": tried.seq,
        "why": tried.why,
    }
