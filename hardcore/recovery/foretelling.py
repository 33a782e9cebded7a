"""What is done about what will run out: it is told once, and where another core would have more of it, one takes over.

The switch is a planned one in a quiet moment (`succession.py` waits for that, but not beyond the limit: a planned
switch costs less than the death it forestalls). It is asked for only where the policy has PLANNED_SWITCH on the diagnosis, at most so often in a day, and
is judged by what the next core begins with. A disk, a queue or a log that complains is only told of: another core
would have the same.
"""

from hardcore.model.actions import AlertStage
from hardcore.model.forecasts import DIAGNOSES, Forecast, Resource
from hardcore.model.observations import Sampled, Surveyed
from hardcore.model.phases import Phase
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony
from hardcore.recovery import foresight, succession
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.course import Course
from hardcore.recovery.foresight import Judgement, told_amount
from hardcore.recovery.policy import Word
from hardcore.recovery.story import Trouble
from hardcore.recovery.telling import say
from hardcore.sentinel.deaths import Death

#: A switch that was given up is asked for again after so long.
AGAIN_NS = 60 * NS_PER_S
#: What another core would have more of.
_HELPED = frozenset({Resource.MEMORY, Resource.FDS, Resource.THREADS})
#: What those are told under that are no diagnosis by themselves: what they lead to.
_ABOUT = {**DIAGNOSES, Resource.QUEUE: Diagnosis.NO_PROGRESS, Resource.ERRORS: Diagnosis.NO_PROGRESS}


def sampled(c: Course, fact: Sampled) -> None:
    """Take in a look at the core that serves."""
    f, now_ns = c.foresight, fact.at_ns
    by = foresight.numbers(c.policy)
    if f.life != c.life:
        f.begin(c.life, now_ns, by)
    if fact.process is not None and fact.process.fds is not None:
        _note(c, Resource.FDS, fact.process.fds, now_ns)
    if now_ns - f.looked_ns >= foresight.LOOK_NS:
        f.looked_ns = now_ns
        f.done = fact.beats.completed if fact.beats is not None else f.done
        f.limits |= {
            Resource.MEMORY: by.memory_bytes,
            Resource.THREADS: by.threads,
            Resource.QUEUE: foresight.SLOTS,
        }
        for resource, value in foresight.of_sample(fact, private=f.private):
            _note(c, resource, value, now_ns)
    _switch(c, now_ns)


def surveyed(c: Course, fact: Surveyed) -> None:
    """Take in what was looked at beside the watch."""
    f, by = c.foresight, foresight.numbers(c.policy)
    if f.life != c.life:
        return  # a look at the core itself begins with it
    if fact.private_bytes is not None and not f.private:
        f.private = True
        f.tracks.pop(Resource.MEMORY, None)  # what it shares with others was counted too
    if fact.fds_limit is not None:
        f.limits[Resource.FDS] = fact.fds_limit
    if fact.disk is not None:
        f.limits[Resource.DISK] = max(1, fact.disk.size_bytes - by.floor_bytes)
    for resource, value in foresight.of_survey(fact):
        _note(c, resource, value, fact.at_ns)
    if fact.log is not None:
        _tell(c, f.hear_log(fact.log.warnings + fact.log.errors, fact.at_ns, by))


def _note(c: Course, resource: Resource, value: int, now_ns: int) -> None:
    f, by = c.foresight, foresight.numbers(c.policy)
    no_lower = f.begins_no_lower(resource, value, now_ns)
    if no_lower is not None:
        _did_not_help(c, no_lower)
    _tell(c, f.look(resource, value, now_ns, by))


def _tell(c: Course, forecast: Forecast | None) -> None:
    """Say it once. One that another core would not help is a person's from the beginning."""
    if forecast is None:
        return
    about = _ABOUT[forecast.resource]
    drilled = c.drill.explains(about, forecast.since_ns)
    if c.policy.asks(about, Word.SEND_ALERT) and not drilled:
        say(c, about, f"{forecast.why}.", AlertStage.FORECAST)


def _did_not_help(c: Course, judged: Judgement) -> None:
    about = _ABOUT[judged.resource]
    if c.policy.asks(about, Word.SEND_ALERT):
        text = (
            f"The core was changed because of its {judged.resource}, and the new one has begun no lower: "
            f"{told_amount(judged.resource, judged.lowest or 0)} after {told_amount(judged.resource, judged.before)}."
        )
        say(c, about, text, AlertStage.FORECAST)


def _switch(c: Course, now_ns: int) -> None:
    """Ask for another core if one would help, the policy wants it, and it was not in vain."""
    if c.foresight.judgement is not None and c.foresight.judgement.life == c.life and c.switching is None:
        c.foresight.judgement = None  # what was asked for was given up
    f = c.foresight
    helped = (one for one in f.soonest(c.life) if one.resource in _HELPED)
    found = next((one for one in helped if _may(c, one, now_ns)), None)
    if found is None:
        return
    said = Testimony("forecast", Colour.YELLOW, found.why)
    trouble = Trouble(Death(_ABOUT[found.resource], Grade.LIKELY, (said,)), now_ns)
    f.asked_ns = now_ns
    if succession.relieve(c, trouble, now_ns, limit_ns=found.due_ns):
        f.judgement = Judgement(found.resource, int(found.level), c.life)


def _may(c: Course, forecast: Forecast, now_ns: int) -> bool:
    """Whether a switch is wanted for it; whether one can be done now is `succession`'s to know."""
    f = c.foresight
    lately = f.asked_ns is not None and now_ns - f.asked_ns < AGAIN_NS
    wanted = Word.PLANNED_SWITCH in c.policy.words(_ABOUT[forecast.resource])
    sound = c.phase is Phase.RUNNING and c.verdict.colour is not Colour.RED and c.story is None
    return wanted and sound and not lately and not f.in_vain(forecast.resource, now_ns)
