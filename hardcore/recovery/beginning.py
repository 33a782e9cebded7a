"""What a guard does first: it goes on with a core that it finds serving, ends what is left of another, or starts one.

A core that has only just begun to serve has its probation still before it, whoever watched it begin: its page says
since when it serves. Not chosen: a probation for every core that is found. One that has served for days and dies in the
guard's first seconds would be treated as one that proved nothing, and its successor would have to wait.
"""

from hardcore.model import observations as seen
from hardcore.model.phases import Wanted
from hardcore.model.recorder import LifeState, Page
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony
from hardcore.recovery import hearing
from hardcore.recovery.budget import NS_PER_MS
from hardcore.recovery.course import Course
from hardcore.recovery.moves import fire
from hardcore.recovery.story import Trouble
from hardcore.recovery.transitions import Trigger
from hardcore.sentinel.deaths import Death


def begin(c: Course, fact: seen.SentinelBegan) -> None:
    """Go on with the core that serves, end what an earlier guard has left, or start a core."""
    c.budget = c.budget.at(fact.at_ns)
    hearing.inherit(c, fact.court, fact.suspects, fact.at_ns)
    c.store.saw(fact.page)
    c.store.certain = False  # a core of the earlier guard may have raised it since
    c.shut, c.hopeless = fact.shut is not None, fact.shut
    if fact.adoptable is not None:
        _adopt(c, fact, fact.adoptable)
        if c.wanted is Wanted.DOWN:
            fire(c, Trigger.STOP, fact.at_ns, "the operator wants no core")
        elif fact.shut is not None:
            _shut_again(c, fact.shut, fact.at_ns)
    elif c.wanted is Wanted.DOWN and not fact.leftovers:
        fire(c, Trigger.STOP, fact.at_ns, "the operator wants no core")
    elif fact.leftovers or _served(fact) or (fact.unwatched_ns is not None and fact.shut is None):
        why = "the core of a guard that is gone was found" if fact.leftovers else "guard and core are gone"
        found = Testimony("run folder", Colour.RED, why)
        death = Death(Diagnosis.SENTINEL_LOST, Grade.CERTAIN, (found, *_unwatched(fact)))
        c.pending = Trouble(death, _since(fact), asked=True)
        fire(c, Trigger.FOUND, fact.at_ns, "processes of an earlier guard were found")
    elif fact.shut is not None:
        fire(c, Trigger.HOPELESS, fact.at_ns, f"{fact.shut}: the policy has shut the service down")
    else:
        fire(c, Trigger.START, fact.at_ns, "the guard is up")


def _served(fact: seen.SentinelBegan) -> bool:
    """Whether a core that is gone served when its page was last written."""
    return fact.page is not None and fact.page.beats.state is LifeState.READY


def _adopt(c: Course, fact: seen.SentinelBegan, page: Page) -> None:
    """Go on with a core that serves: what ended was its guard."""
    c.store.saw(page)
    c.store.certain = False  # a core that was started since may have raised it
    c.epoch = page.beats.epoch
    why = "the guard was gone; its core was found serving and goes on"
    found = Testimony("run folder", Colour.YELLOW, why)
    death = Death(Diagnosis.SENTINEL_LOST, Grade.CERTAIN, (found, *_unwatched(fact)))
    c.pending = Trouble(death, _since(fact), drill="sentinel" if fact.drilled else None)
    fire(c, Trigger.FOUND_NEW if _is_new(c, fact) else Trigger.FOUND_SERVING, fact.at_ns, why)


def _shut_again(c: Course, why: Diagnosis, now_ns: int) -> None:
    """The guard before died while it shut the service down: its core is told to leave again."""
    c.hopeless = why
    said = Testimony("policy", Colour.RED, f"{why}: the policy has shut the service down")
    c.pending = Trouble(Death(why, Grade.CERTAIN, (said,)), now_ns, asked=True)
    fire(c, Trigger.SHUTDOWN, now_ns, said.why)


def _unwatched(fact: seen.SentinelBegan) -> tuple[Testimony, ...]:
    """Return what is known of the guard before, and of the time without one."""
    said = []
    if fact.found_frozen:
        said.append(Testimony("sentinel page", Colour.YELLOW, "the guard before stood still, and was ended"))
    if fact.unwatched_ns is not None:
        why = f"nobody watched for {fact.unwatched_ns // NS_PER_MS} ms"
        said.append(Testimony("sentinel page", Colour.YELLOW, why))
    return tuple(said)


def _since(fact: seen.SentinelBegan) -> int:
    """Return since when nobody has watched, as far as anybody knows."""
    return max(0, fact.at_ns - (fact.unwatched_ns or 0))


def _is_new(c: Course, fact: seen.SentinelBegan) -> bool:
    """Whether a core that was found has served for less than a probation, as far as its page says."""
    since_ns = fact.serves_since_ns
    return since_ns is not None and fact.at_ns - since_ns < c.policy.probation_ms * NS_PER_MS
