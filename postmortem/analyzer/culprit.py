"""Who did it: the one command that a report names, how sure that is, and why.

There is one order of proof, and it is a list: a command that did it again in a throw-away core; one that the guard's
verdict named; one that a frame or a slot names with certainty; the only one at work. What comes from outside has no
culprit among the commands, and the report says so instead of naming whoever was nearest.
"""

from collections.abc import Iterator

import msgspec

from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.analyzer.poison import known_command
from postmortem.incident import Command, unique

#: Findings that say that no command is to blame.
_NOBODY = frozenset(
    {
        "killed", "frozen", "locked_out", "locked_out_by", "store_away", "disk_full", "disk_read_only", "disk_stalled",
        "operator", "operator_reason", "config_invalid", "startup_failed", "starved", "slept",
        "exited_65", "exited_69", "exited_73", "exited_75", "exited_78",
    }
)  # fmt: skip


class Culprit(msgspec.Struct, frozen=True):
    """The command behind an incident. `why` is a key of the catalogue; `kind` may be empty."""

    confidence: Confidence
    why: str
    command_id: str
    kind: str
    transaction_id: str
    account_ids: tuple[str, ...]


def name_culprit(case: Case, findings: tuple[Finding, ...]) -> Culprit | None:
    """Return the command behind an incident, or None: nobody can be named, or nobody is to blame."""
    proven = next(_convicted(case), None)
    if proven is not None:
        return proven
    if any(finding.rule in _NOBODY for finding in findings):
        return None
    return next(_blamed(case), None) or next(_found(case, findings), None)


def _convicted(case: Case) -> Iterator[Culprit]:
    for trial in case.incident.trials:
        command = known_command(case, trial)
        if trial.reproduced:
            yield Culprit(
                Confidence.CERTAIN,
                "reproduced",
                trial.command_id or (command.command_id if command else ""),
                trial.kind or (command.kind if command else ""),
                (command.transaction_id if command else "") or trial.transaction_id,
                unique([*trial.account_ids, *(command.account_ids if command else ())]),
            )


def _blamed(case: Case) -> Iterator[Culprit]:
    for command in case.incident.in_flight:
        if command.command_id in case.incident.blamed:
            yield _of(command, Confidence.CERTAIN, "blamed")


def _found(case: Case, findings: tuple[Finding, ...]) -> Iterator[Culprit]:
    """The findings come the surest first; the sure ones rest on a frame or a slot, the likely ones on being at work."""
    for finding in findings:
        if finding.confidence is Confidence.UNKNOWN or not (finding.transaction_ids or finding.account_ids):
            continue
        why = {"at_work": "at_work", "near_often": "near"}.get(finding.rule, "in_frame")
        command = _command_of(case, finding)
        if command is not None:
            yield _of(command, finding.confidence, why)
        else:
            transaction = finding.transaction_ids[0] if finding.transaction_ids else ""
            yield Culprit(finding.confidence, why, "", "", transaction, finding.account_ids)


def _command_of(case: Case, finding: Finding) -> Command | None:
    of_it = (one for one in case.incident.in_flight if one.transaction_id in finding.transaction_ids)
    return next((one for one in of_it if one.transaction_id), None)


def _of(command: Command, sure: Confidence, why: str) -> Culprit:
    return Culprit(
        sure, why, command.command_id, command.kind, command.transaction_id, unique(command.account_ids)
    )
