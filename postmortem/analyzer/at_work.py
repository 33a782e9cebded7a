"""Rule: which commands the core was at work on when it ended from inside, and so can have caused it.

The recorder's slot marks exactly one command as being decided, so that one is a likely cause; of a batch that was being
written nobody can tell one from another. A death that came from outside names nobody here: whoever stood at the till
when the light went out has not broken the lamp. Where a thread hangs, a command on another thread is not told at all. Only a trial (rule
`poison`) makes it certain, and what a trial has cleared is not told again.
"""

from postmortem.analyzer.case import Case, Confidence, Finding, loop_thread
from postmortem.analyzer.crashed import frames_of
from postmortem.analyzer.exited import MEANINGS
from postmortem.incident import Command, deciding, mapping, mappings, number, text, unique

#: Ends that can have come from inside. A transaction over its time names its command by its own rule.
CRASHES = frozenset({"CRASHED", "EXITED", "OUT_OF_MEMORY", "CRASH_LOOP"})
HANGS = frozenset({"LOOP_BLOCKED", "SPINNING", "GIL_HELD", "DEADLOCK"})
FROM_INSIDE = CRASHES | HANGS
#: What a trial says of an innocent.
CLEARED = frozenset({"survived", "committed"})
#: Calls every frame of an event loop's thread.
_RUNNER = "asyncio/runners.py"
#: Commands of one batch that are told.
BATCH_MAX = 8


def examine(case: Case) -> list[Finding]:
    """Name the command that was being decided, or the batch that was being written."""
    incident = case.incident
    if incident.diagnosis not in FROM_INSIDE or incident.exit.code in MEANINGS:
        return []
    if any(trial.reproduced for trial in incident.trials):
        return []  # it is known who did it: whoever was at work beside it is told as in flight, and no more
    cleared = {
        name
        for trial in incident.trials
        if trial.ordeal in CLEARED
        for name in (trial.name, trial.command_id)
    }
    touched = [
        command
        for command in deciding(incident)
        if _could_have(case, command) and not {command.command_id, command.key_hash} & (cleared - {""})
    ]
    one = next((command for command in touched if command.stage == "DECIDING"), None)
    alone = one or (touched[0] if len(touched) == 1 and len(deciding(incident)) == 1 else None)
    if alone is not None:
        return [_named(alone)]
    if not touched:
        return []
    lines = tuple(_line(command) for command in touched[:BATCH_MAX])
    accounts = unique(account for command in touched for account in command.account_ids)
    transactions = unique(command.transaction_id for command in touched)
    count = str(len(touched))
    return [Finding("batch_at_work", Confidence.UNKNOWN, {"count": count}, lines, accounts, transactions)]


def _could_have(case: Case, command: Command) -> bool:
    """Tell whether a command can have done it: after a crash any of them that did not run on another thread than died; for want of memory those during which
    the core grew, which are the guard's suspects; in a hang those on the thread that hung.
    """
    if case.incident.diagnosis == "OUT_OF_MEMORY":
        return command.key_hash in case.incident.suspects
    slots = mappings(case.recorder.get("in_flight"))
    slot = next((one for one in slots if text(one.get("command_id")) == command.command_id), {})
    if case.incident.diagnosis in CRASHES:
        return not _died_on_the_loop(case) or number(slot.get("thread")) in {None, 0, _loop_tid(case)}
    loop = loop_thread(case)
    stuck = {thread.tid for thread in case.threads if thread.holds_gil or thread is loop}
    return number(slot.get("thread")) in stuck - {None}


def _died_on_the_loop(case: Case) -> bool:
    """Tell whether the thread that died was the event loop's, as far as its printed stack says: a runner called it."""
    return any(path.endswith(_RUNNER) for _, path, _ in frames_of(case.traceback))


def _loop_tid(case: Case) -> int | None:
    return number(mapping(case.recorder.get("threads")).get("loop"))


def _named(command: Command) -> Finding:
    values = {"kind": command.kind or "?", "transaction": command.transaction_id or command.command_id or "?"}
    return Finding(
        "at_work",
        Confidence.LIKELY,
        values,
        (_line(command),),
        unique(command.account_ids),
        unique([command.transaction_id]),
    )


def _line(command: Command) -> str:
    accounts = ", ".join(command.account_ids) or "-"
    return (
        f"the recorder's slot: {command.kind or 'command'} {command.command_id} in stage {command.stage} "
        f"(transaction {command.transaction_id or '-'}, accounts {accounts})"
    )
