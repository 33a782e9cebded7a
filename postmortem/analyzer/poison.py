"""Rule: a command that does it again in a throw-away core is what killed the core.

The trial is the only proof there is: a death with a command at work is no more than a suspicion (random kills convicted
79 innocents in 150 deaths where two of them were enough). What was tried and survived is told as well, because a
person who was told of a suspect wants to know that it was cleared.
"""

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.incident import Command, Trial, unique

#: Cleared ones are told in one line from so many on.
CLEARED_MAX = 8


def examine(case: Case) -> list[Finding]:
    """Name each command that was convicted or held, and count those that were cleared."""
    found = [_told(case, one) for one in case.incident.trials if one.reproduced or one.letter]
    cleared = [
        one for one in case.incident.trials if one.ordeal in {"survived", "committed"} and not one.letter
    ]
    if cleared:
        lines = tuple(_line(one) for one in cleared[:CLEARED_MAX])
        found.append(Finding("cleared", Confidence.CERTAIN, {"count": str(len(cleared))}, lines))
    return found


def known_command(case: Case, trial: Trial) -> Command | None:
    """Return the command in flight that a trial was about: by its id, else by the hash of its key."""
    commands = case.incident.in_flight
    by_id = (one for one in commands if trial.command_id and one.command_id == trial.command_id)
    by_key = (one for one in commands if trial.name and one.key_hash == trial.name)
    return next(by_id, None) or next(by_key, None)


def _told(case: Case, trial: Trial) -> Finding:
    command = known_command(case, trial)
    kind = trial.kind or (command.kind if command else "")
    # The slot's first: the number that a trial makes up on its copy is in no book.
    transaction = (command.transaction_id if command else "") or trial.transaction_id
    accounts = unique([*trial.account_ids, *(command.account_ids if command else ())])
    values = {
        "kind": kind or "?",
        "transaction": transaction or trial.command_id or trial.name or "?",
        "letter": trial.letter or "-",
    }
    unproven = "untried" if trial.ordeal == "untried" else "unproven"
    rule = f"poison_{trial.ordeal}" if trial.reproduced else unproven
    sure = Confidence.CERTAIN if trial.reproduced else Confidence.UNKNOWN
    evidence = [_line(trial)]
    if command is not None:
        evidence.append(f"the recorder's slot had it in stage {command.stage}")
    if trial.letter:
        evidence.append(f"it is set aside as letter {trial.letter}")
    return Finding(rule, sure, values, tuple(evidence), accounts, unique([transaction]))


def _line(trial: Trial) -> str:
    took = f" after {trial.took_ms:.0f} ms" if trial.took_ms is not None else ""
    why = f" ({trial.why})" if trial.why else ""
    return f"tried in a throw-away core: {trial.command_id or trial.name} {trial.ordeal}{took}{why}"
