"""What is done for a part of the core that stands still while the ledger answers: it alone is started anew.

That ends nobody, so one kind of evidence more than its own beat is enough (the process lives and beats), and the order
may be repeated. A part that stands still again and again, or can't be started anew, is worth another core in a calm
moment where the policy says so; the answers never stop for it. Not chosen: a kill. Whoever posts a transaction has
nothing to do with an import.
"""

from hardcore.model import observations as seen
from hardcore.model.actions import AlertStage, RestartComponent
from hardcore.model.phases import SERVING, Phase
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony, Verdict
from hardcore.recovery import mandate, relief, succession, telling
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.course import Course
from hardcore.recovery.policy import Word
from hardcore.recovery.story import Trouble
from hardcore.recovery.telling import order
from hardcore.sentinel.deaths import Death

STALLED = Diagnosis.COMPONENT_STALLED


def judged(c: Course, verdict: Verdict, now_ns: int, why: str) -> None:
    """Take in that a part stands still."""
    relief.judged(c, verdict, now_ns, why)
    name = verdict.component
    if mandate.watches_only(c) or c.repair.name or c.repair.settles(name, now_ns):
        return
    spent = c.repair.is_spent(name, now_ns, c.policy.restart_window_sec * NS_PER_S)
    if name in c.repair.helpless or spent or not c.policy.asks(STALLED, Word.RESTART_COMPONENT):
        _give_up(c, verdict, now_ns)
        return
    c.repair.order(name, now_ns, asked=False)
    order(c, RestartComponent(c.life, name))


def asked(c: Course, fact: seen.OperatorAsked) -> None:
    """A person wants a part of the serving core started anew."""
    if c.phase not in SERVING or c.repair.name:
        return
    said = Testimony("operator", Colour.GREEN, fact.reason or f"the part {fact.component} was to begin anew")
    telling.open_aside(c, Trouble(Death(Diagnosis.OPERATOR, Grade.CERTAIN, (said,)), fact.at_ns), fact.at_ns)
    c.repair.order(fact.component, fact.at_ns, asked=True)
    order(c, RestartComponent(c.life, fact.component))


def resumed(c: Course, now_ns: int) -> None:
    """A person says of a core with a part that stands still: do what is to be done."""
    if c.verdict.diagnosis is STALLED and not c.repair.name:
        c.repair.order(c.verdict.component, now_ns, asked=True)
        order(c, RestartComponent(c.life, c.verdict.component))


def restarted(c: Course, fact: seen.ComponentRestarted) -> None:
    """Take in what the core answered."""
    if fact.name == c.repair.name:
        _over(c, fact.name, fact.at_ns, "" if fact.done else fact.reason or "the core gave no reason")


def ring(c: Course, now_ns: int) -> None:
    """Do what the time has come for: an order was not answered."""
    if c.repair.due_ns is not None and now_ns >= c.repair.due_ns:
        _over(c, c.repair.name, now_ns, "the core did not answer the order")


def next_ns(c: Course) -> int | None:
    """Return when `ring` wants to be called, or None while nothing waits for its time."""
    return c.repair.due_ns


def _over(c: Course, name: str, now_ns: int, fault: str) -> None:
    c.repair.over()
    if fault:
        c.repair.give_up(name)
    if c.story is not None:
        colour = Colour.YELLOW if fault else Colour.GREEN
        why = f"the part {name} was not begun anew: {fault}" if fault else f"the part {name} was begun anew"
        c.story.add_evidence((Testimony("parts", colour, why),))
    if c.repair.asked:
        telling.close_aside(c, now_ns)


def _give_up(c: Course, verdict: Verdict, now_ns: int) -> None:
    """Nothing more is done for this part alone."""
    if c.phase is Phase.PROBATION:
        return  # nothing is changed before it is proven
    wants = c.policy.asks(STALLED, Word.PLANNED_SWITCH) or c.policy.asks(STALLED, Word.REBOOT_PROCESS)
    trouble = Trouble(Death(STALLED, verdict.grade, verdict.testimonies), verdict.fault_ns)
    if wants and succession.relieve(c, trouble, now_ns, limit_ns=now_ns):
        return
    if c.switching is None and c.repair.tell(verdict.component):
        text = f"The part {verdict.component} stands still, and to begin it anew did not help. The ledger answers."
        telling.alert(c, STALLED, text, AlertStage.WAITS)
