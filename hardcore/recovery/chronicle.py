"""The state for people, as it went: each change with its reason, since when a person is needed, and for how long.

The state is a reading of everything else and never kept; what is kept is that it changed. A reason is what the step
began with: that the core died, not that a spare was ready a moment later. When a person is needed that is said once, and
once more when nobody has come in time; then what the policy says about that is done, once in each need, because a
service that begins anew by itself every five minutes is no better for it.
"""

from hardcore.model import phases
from hardcore.model.actions import AlertStage
from hardcore.model.phases import HAState, Phase
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony
from hardcore.recovery import mandate, plan, telling
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.course import HISTORY_MAX, Course
from hardcore.recovery.moves import fire, heed
from hardcore.recovery.policy import HUNG, NEVER_REBOOT, Word
from hardcore.recovery.reading import StateChange
from hardcore.recovery.safety import Deed
from hardcore.recovery.spare import Lack
from hardcore.recovery.story import Trouble
from hardcore.recovery.transitions import Trigger
from hardcore.sentinel.deaths import Death


def state(c: Course) -> HAState:
    """Return the state for people at this moment."""
    serving = c.phase in phases.SERVING
    return phases.ha_state(
        c.phase,
        c.wanted,
        c.cause,
        yellow=_is_yellow(c),
        safe=c.safety.reason if serving else None,
        alone=alone(c),
    )


def alone(c: Course) -> Diagnosis | None:
    """Return what is wrong with a serving core that nothing is done about, if anything is."""
    if c.phase not in phases.SERVING or c.verdict.colour is not Colour.RED:
        return None
    wrong = c.verdict.diagnosis
    if wrong is None:
        return None
    hangs = wrong in HUNG and mandate.watches_only(c)
    return wrong if hangs or plan.left_alone(c.policy, wrong) else None


def needs(c: Course) -> Diagnosis | Phase | None:
    """Return what a person is needed for, or None."""
    if c.phase in phases.SERVING:
        person = telling.left_to_a_person(c)
        return person if person is not None else alone(c)
    if c.phase is Phase.FATAL:
        return c.hopeless or c.blame
    return c.phase if c.phase is Phase.UNKILLABLE else None


def note(c: Course, now_ns: int) -> None:
    """Take in that a step is over: tell what it changed."""
    now = state(c)
    if now is not c.state:
        why = c.why or _reason(c)
        c.history = (*c.history, StateChange(now_ns, c.state, now, c.phase, why))[-HISTORY_MAX:]
        c.state = now
    c.why = ""
    wrong = None if now is HAState.SHUTDOWN else needs(c)
    if wrong is None:
        c.needs_ns = None
        c.overdue = c.overdue and c.phase is not Phase.RUNNING
    elif c.needs_ns is None:
        c.needs_ns = now_ns
        _call(c, wrong)


def ring(c: Course, now_ns: int) -> None:
    """Do what the time has come for: nobody has come."""
    due_ns, wrong = next_ns(c), needs(c)
    if due_ns is None or now_ns < due_ns or wrong is None:
        return
    c.overdue = True
    waited = f"nobody has come within {c.policy.await_operator_sec} s"
    about = wrong if isinstance(wrong, Diagnosis) else c.blame
    words = frozenset(c.policy.on_await_timeout)
    if Word.SEND_ALERT in words:
        telling.say(c, about, f"{wrong}: {waited}.", AlertStage.OVERDUE)
    if c.policy.mode == mandate.OBSERVE:
        return
    if Word.SHUTDOWN in words:
        _shut_down(c, about, waited, now_ns)
    elif Word.REBOOT_PROCESS in words and about not in NEVER_REBOOT and not c.safety.locked:
        _start_anew(c, about, waited, now_ns)
    elif Word.SAFE_MODE_ENTER in words:
        _read_only(c, about, waited, now_ns)


def next_ns(c: Course) -> int | None:
    """Return when `ring` wants to be called, or None while nobody is waited for."""
    if c.needs_ns is None or c.overdue:
        return None
    return c.needs_ns + c.policy.await_operator_sec * NS_PER_S


def come(c: Course, now_ns: int) -> None:
    """A person has come: whoever is needed on is waited for anew."""
    c.needs_ns, c.overdue = now_ns if c.needs_ns is not None else None, False


def _call(c: Course, wrong: Diagnosis | Phase) -> None:
    """Say that a person is needed, unless this step has said so."""
    if any(getattr(one, "stage", None) is AlertStage.WAITS for one in c.actions):
        return
    about = wrong if isinstance(wrong, Diagnosis) else c.blame
    text = (
        f"{wrong}: nothing more is done about it before a person says so. `hardcore status` says what helps."
    )
    if mandate.watches_only(c):
        telling.say(c, about, text, AlertStage.WAITS)
    else:
        telling.alert(c, about, text, AlertStage.WAITS)


def _shut_down(c: Course, about: Diagnosis, why: str, now_ns: int) -> None:
    if c.phase in phases.SERVING:
        c.shut, c.hopeless = True, about
        telling.keep(c, c.budget)
        said = Testimony("policy", Colour.RED, f"{about}, and {why}: the policy shuts the service down")
        c.pending = Trouble(Death(about, Grade.CERTAIN, (said,)), now_ns, asked=True)
        fire(c, Trigger.SHUTDOWN, now_ns, said.why)
    elif c.phase is Phase.FATAL:
        c.shut, c.deadline.due_ns = True, None
        telling.keep(c, c.budget)


def _start_anew(c: Course, about: Diagnosis, why: str, now_ns: int) -> None:
    if c.phase in phases.SERVING:
        if c.verdict.colour is Colour.RED and c.verdict.diagnosis is about:
            end_judged(c, now_ns, f"{about}, and {why}")
        elif c.safety.trouble is about:
            _try_to_write(c, about, why, now_ns)
    elif c.phase is Phase.FATAL:
        c.consent = True
        fire(c, Trigger.DEADLINE, now_ns, f"{about}, and {why}: the policy has another try made")


def _try_to_write(c: Course, about: Diagnosis, why: str, now_ns: int) -> None:
    """Have the core that reads only find out whether it may write, or another one, if it was started so."""
    deed = c.safety.try_to_write(now_ns)
    if deed is Deed.RENEW:
        c.trying, c.consent = about, True
        fire(c, Trigger.RENEW, now_ns, f"{about}, and {why}: a core that may write is tried")
    else:
        heed(c, deed, now_ns, asked=True)


def _read_only(c: Course, about: Diagnosis, why: str, now_ns: int) -> None:
    if c.phase in phases.SERVING:
        if about not in HUNG:
            heed(c, c.safety.enter(about, now_ns), now_ns)
    elif c.phase is Phase.FATAL:
        c.consent = True
        fire(c, Trigger.READS_ONLY, now_ns, f"{about}, and {why}: the policy has reads served")


def end_judged(c: Course, now_ns: int, reason: str) -> None:
    """Do what a red verdict asks for and was left to a person: evidence, end, another core."""
    wrong = c.verdict.diagnosis
    assert wrong is not None, "a red verdict has a diagnosis"
    death = Death(wrong, c.verdict.grade, c.verdict.testimonies)
    c.pending = Trouble(death, c.verdict.fault_ns, blamed=c.verdict.blamed, asked=True)
    fire(c, Trigger.LOST, now_ns, f"{wrong}: {reason}")


def _is_yellow(c: Course) -> bool:
    stuck = c.behind is not None and c.behind.stuck
    spareless = c.spare.lost or (c.switch_fault != "" and c.spare.lack is Lack.DIED)
    return c.worry.shown or c.audit.worries or c.troubles.on or spareless or stuck


def _reason(c: Course) -> str:
    """Return why the state changed though the phase did not."""
    if c.safety.reason is not None and c.phase in phases.SERVING:
        return f"reads only are served: {c.safety.reason}"
    worried = [one.why for one in c.verdict.testimonies if one.colour is not Colour.GREEN]
    if worried:
        return worried[0]
    if c.troubles.on:
        return ", ".join(c.troubles.known)
    return "something worries" if _is_yellow(c) else "nothing worries any more"
