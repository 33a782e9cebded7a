"""What an order may still change, once the end of the process was asked for."""

from core.draining import LEAVING
from core.guarded.orders import PromoteOrder
from core.obedience import NO_SPARE, Obedience

ORDER = PromoteOrder(1, (), None, 1)


def test_who_was_asked_to_leave_is_promoted_no_more() -> None:
    obedience = Obedience()
    assert obedience.promote(ORDER) == NO_SPARE
    obedience.leave()
    assert obedience.promote(ORDER) == LEAVING
