"""More memory than the core may have: not a forecast, it is so. Told once, and worth another core in a calm moment.

Nobody is ended for it: a core above its limit still answers, and the kernel's own limit is another matter. It must
have lasted, because a large request comes and goes; the time counts only while our looks come in time.
"""

from hardcore.model.observations import Sampled
from hardcore.model.phases import Phase
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony
from hardcore.recovery import succession, telling
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.course import Course
from hardcore.recovery.policy import Word
from hardcore.recovery.story import Trouble
from hardcore.sentinel.deaths import Death

#: A core that has held too much for so long goes on to.
LASTED_NS = 10 * NS_PER_S
#: A look that came later than this after the last one begins the time anew.
GAP_NS = 3 * NS_PER_S
TOLD = 0


def watch(c: Course, tick: Sampled) -> None:
    """Take in one look at the serving core."""
    last_ns, c.pressed_looked_ns = c.pressed_looked_ns, tick.at_ns
    limit = c.policy.memory_limit_mb << 20
    if tick.process is None or c.pressed_ns == TOLD:
        return
    if tick.process.rss_bytes <= limit:
        c.pressed_ns = None
    elif c.pressed_ns is None or tick.at_ns - last_ns > GAP_NS:
        c.pressed_ns = tick.at_ns
    elif tick.at_ns - c.pressed_ns >= LASTED_NS and c.phase is not Phase.PROBATION and c.switching is None:
        _press(c, c.pressed_ns, tick.process.rss_bytes, tick.at_ns)


def _press(c: Course, since_ns: int, rss_bytes: int, now_ns: int) -> None:
    c.pressed_ns = TOLD
    pressed = Diagnosis.MEMORY_PRESSURE
    why = f"the core holds {rss_bytes >> 20} MiB of memory; {c.policy.memory_limit_mb} MiB are allowed"
    death = Death(pressed, Grade.CERTAIN, (Testimony("resources", Colour.YELLOW, why),))
    drilled = c.drill.explains(pressed, now_ns)
    switched = c.policy.asks(pressed, Word.PLANNED_SWITCH) and succession.relieve(
        c, Trouble(death, since_ns), now_ns, limit_ns=now_ns
    )
    what = "Another core takes over in a calm moment." if switched else "The core goes on."
    if not drilled:
        telling.alert(c, pressed, f"{why}. {what}")
