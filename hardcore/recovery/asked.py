"""What an operator asks for, and what it means at this moment.

The operator's will always wins: it is kept as `wanted`, whatever the phase, and asked for wherever the next step is decided.
A word that means nothing now (a resume of what goes on, a safe mode of what is down) changes nothing; the door tells so
before it comes here.
"""

from typing import assert_never

from hardcore.model import observations as seen
from hardcore.model import phases
from hardcore.model.phases import Phase, Wanted
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony
from hardcore.recovery import chronicle, mandate, parts, plan, readiness, relief, succession, telling
from hardcore.recovery.course import Course
from hardcore.recovery.moves import dismiss, fire, heed
from hardcore.recovery.story import Trouble
from hardcore.recovery.transitions import Trigger, step
from hardcore.sentinel.deaths import Death


def obey(c: Course, fact: seen.OperatorAsked) -> None:
    """Do what the operator asks for."""
    why = fact.reason or "the operator asked for it"
    if fact.verb is not seen.Verb.RESTART_COMPONENT:
        chronicle.come(c, fact.at_ns)
    if c.shut and c.phase is not Phase.FATAL:
        _undo(c, fact)
    match fact.verb:
        case seen.Verb.STOP:
            c.wanted, c.safety.held = Wanted.DOWN, False
            if c.shut:
                c.shut = False  # whoever starts the service after this has come
                telling.keep(c, c.budget)
            dismiss(c, fact.at_ns)
            fire(c, Trigger.STOP, fact.at_ns, why)
        case seen.Verb.RESUME:
            if fact.accept_ledger and in_question(c):
                c.store.forget()
            c.safety.locked = False
            if c.phase in phases.SERVING:
                relief.resumed(c, fact.at_ns)
                parts.resumed(c, fact.at_ns)
                succession.resumed(c, fact.at_ns)
                if _is_left_to_a_person(c):
                    chronicle.end_judged(c, fact.at_ns, why)
                    return
            fire(c, Trigger.RESUME, fact.at_ns, why)
        case seen.Verb.RESTART | seen.Verb.RESTART_HARD:
            asked = Testimony("operator", Colour.GREEN, fact.reason or "no reason was given")
            trouble = Trouble(Death(Diagnosis.OPERATOR, Grade.CERTAIN, (asked,)), fact.at_ns)
            trigger, c.switch_fault = _restart(c, fact), ""
            if _is_left_to_a_person(c):
                chronicle.end_judged(c, fact.at_ns, why)
                return
            if trigger is Trigger.RESTART and succession.asked(c, fact, trouble):
                return
            c.pending = trouble
            fire(c, trigger, fact.at_ns, why)
        case seen.Verb.RESTART_COMPONENT:
            parts.asked(c, fact)
        case seen.Verb.SAFE_ON:
            _keep_safe(c, fact.at_ns, why)
        case seen.Verb.SAFE_OFF:
            _keep_safe_no_more(c, fact.at_ns, why)
        case _:
            assert_never(fact.verb)


def _undo(c: Course, fact: seen.OperatorAsked) -> None:
    """A person wants something else of a service that the policy is just shutting down: that holds."""
    if fact.verb in {seen.Verb.RESUME, seen.Verb.RESTART, seen.Verb.RESTART_HARD, seen.Verb.STOP}:
        c.shut, c.hopeless = False, None
        telling.keep(c, c.budget)


def _keep_safe(c: Course, now_ns: int, why: str) -> None:
    """The operator wants reads only. A core that does not serve yet is told so before anybody is sent to it."""
    if c.wanted is Wanted.DOWN:
        return  # nothing runs, or will
    c.wanted, c.safety.held, c.why = Wanted.SAFE, True, why
    if c.phase in phases.SERVING:
        heed(c, c.safety.want(now_ns, reads_only=True), now_ns, asked=True)


def _keep_safe_no_more(c: Course, now_ns: int, why: str) -> None:
    if c.wanted is not Wanted.SAFE:
        return
    c.wanted, c.safety.held, c.why = Wanted.UP, False, why
    if c.phase in phases.SERVING:
        heed(c, c.safety.want(now_ns, reads_only=False), now_ns, asked=True)
    elif c.awaits is not None:
        readiness.serve(c, c.awaits, now_ns)


def _is_left_to_a_person(c: Course) -> bool:
    """Whether a serving core is judged, and the mode leaves what is to be done about it to a person."""
    wrong = c.verdict.diagnosis
    judged = c.phase in phases.SERVING and c.verdict.colour is Colour.RED and wrong is not None
    return judged and wrong is not None and mandate.watches_only(c) and plan.ends(c.policy, wrong)


def in_question(c: Course) -> bool:
    """Whether a person may say of the ledger that it is right as it stands: nothing goes on by itself."""
    return c.phase is Phase.FATAL or c.safety.locked or c.reader is Diagnosis.STORE_CORRUPT


def _restart(c: Course, fact: seen.OperatorAsked) -> Trigger:
    """Return what the operator's wish for a new core means; there is an image only of one that serves."""
    if fact.image and c.policy.memory_image != "never" and step(c.phase, Trigger.RESTART_IMAGED):
        c.image_asked = True
        return Trigger.RESTART_IMAGED
    return Trigger.RESTART_HARD if fact.verb is seen.Verb.RESTART_HARD else Trigger.RESTART
