"""The hands of the simulated guard that speak to a core which lives: how each order goes is a matter of the switches."""

from typing import TYPE_CHECKING

from hardcore.model import actions as orders
from hardcore.model import observations as seen
from tests.simulation.clock import NS_PER_MS
from tests.simulation.machine import Life
from tests.simulation.switches import Draining, Order

if TYPE_CHECKING:  # the guard has these hands
    from tests.simulation.guard import Guard


def drain(guard: "Guard", life: Life, order: orders.Drain) -> None:
    """Have a core drain, or not, as the switches say."""
    now_ns = guard.world.clock.now_ns
    match guard.world.switches.draining():
        case Draining.OBEYED:
            life.drain(order.within_ms * NS_PER_MS)
        case Draining.REFUSED:
            guard.condemned.discard(life.serial)
            guard.tell(
                seen.Drained(now_ns, life.number, False, 0, "it takes too long"),
                order.within_ms * NS_PER_MS,
            )
        case Draining.NEVER:
            life.draining = True
        case Draining.DIES:
            life.draining = True
            guard.world.clock.after(guard.world.rng.randrange(200) * NS_PER_MS, lambda: life.signal(11))


def set_safe(guard: "Guard", life: Life, order: orders.SetSafe) -> None:
    """Have a core read only or write again, as the switches say."""
    now_ns, wait_ns = guard.world.clock.now_ns, guard.world.rng.randrange(1, 20) * NS_PER_MS
    match guard.world.switches.safe_order():
        case Order.OBEYED:
            pass
        case Order.LOST:
            return
        case Order.REFUSED:
            guard.tell(seen.SafeSwitched(now_ns, life.number, order.on, done=False, reason="no"), wait_ns)
            return
        case Order.LATE:
            wait_ns = guard.world.rng.randrange(1000, 9000) * NS_PER_MS
    guard.soon(wait_ns, lambda: life.on_loop(lambda: life.set_safe(order)))


def restart_part(guard: "Guard", life: Life, name: str) -> None:
    """A part is begun anew; or stands still again, can't be begun, or the order is lost."""
    switches, now_ns = guard.world.switches, guard.world.clock.now_ns
    again = switches.part_again > 0
    switches.part_again -= again
    how = guard.world.rng.randrange(4) if again else 0
    if how < 2:
        life.part_stalled_ns = now_ns if how and life.part_stalled_ns else 0
        guard.tell(seen.ComponentRestarted(now_ns, life.number, name, done=True))
    elif how == 2:
        guard.tell(seen.ComponentRestarted(now_ns, life.number, name, done=False, reason="it can't be ended"))
