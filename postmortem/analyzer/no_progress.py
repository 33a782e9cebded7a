"""Rule: the core beat, took commands and finished none.

Both beats were fresh, so neither loop nor interpreter is to blame; what is left is what the commands waited
for. A thread that holds a transaction in its locals is named, as likely: it may be the victim.
"""

from collections import Counter

from postmortem.analyzer.blocked import blocked_frame, ids_of
from postmortem.analyzer.case import Case, Confidence, Finding
from postmortem.incident import at_work


def examine(case: Case) -> list[Finding]:
    """Count who waited where, and name the frame of the thread that holds a transaction."""
    if case.incident.diagnosis != "NO_PROGRESS":
        return []
    stages = Counter(command.stage for command in at_work(case.incident))
    waiting = ", ".join(f"{count} in {stage}" for stage, count in stages.items()) or "none recorded"
    found = [
        Finding(
            "no_progress",
            Confidence.CERTAIN,
            {"count": str(stages.total())},
            (f"commands in flight: {waiting}",),
        )
    ]
    for thread in case.threads:
        accounts, transactions = ids_of(thread.frames)
        frame = blocked_frame(thread)
        if transactions and frame is not None:
            evidence = (f"thread {thread.name or thread.tid} in {frame.function} ({frame.place})",)
            values = {"function": frame.function, "place": frame.place}
            likely = Finding("waits_in", Confidence.LIKELY, values, evidence, accounts, transactions)
            return [*found, likely]
    return found
