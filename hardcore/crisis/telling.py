"""What a request is told that no core has answered: the problem, and whether it was done. Values from values.

The table in `holding` says that something is to be said; here is what is true then. A form's case differs from a
program's in most of them: it may be several commands, each under a key of its own made from the form's, so that "not
done" can't be said of one that a core has had. Making the answers where requests are moved was not chosen: what is
said must be readable in one place.
"""

import msgspec

from hardcore.crisis import pages
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.holding import Deed
from hardcore.crisis.plight import KEPT, Cover
from hardcore.crisis.problems import Outcome, Problem
from hardcore.crisis.receipts_form import KeptForm
from hardcore.crisis.shelf import Shelf


class Told(msgspec.Struct, frozen=True):
    """`word`: what is written of it in the list of an outage, where that is not its outcome; `offers`: if it is a form,
    the gateway would keep it, and look it up first (one that is not done it would keep in any case).
    """

    problem: Problem
    outcome: Outcome
    word: str | None = None
    offers: bool = False


def told_for(deed: Deed, exchange: Exchange, *, early: bool) -> Told:
    """What a deed says. `early`: the request never waited."""
    head = exchange.head
    doubtful = Outcome.NOT_DONE if head.safe else Outcome.UNKNOWN  # a safe request leaves nothing half done
    in_parts = head.navigation and not head.safe and exchange.sends > 0
    match deed:
        case Deed.SAY_NOT_DONE | Deed.SAY_UNTRIED if in_parts:
            return Told(Problem.OUTCOME_UNKNOWN, Outcome.UNKNOWN, offers=True)
        case Deed.SAY_NOT_DONE if exchange.refusal is not None and exchange.askable:
            return Told(Problem.OUTCOME_UNKNOWN, Outcome.UNKNOWN)  # it waited only to be looked up
        case Deed.SAY_NOT_DONE:
            why = exchange.fault or Problem.RECOVERING
            return Told(why, Outcome.NOT_DONE, "refused" if early else None)
        case Deed.SAY_ABSENT if head.navigation:
            return Told(Problem.OUTCOME_UNKNOWN, Outcome.UNKNOWN)
        case Deed.SAY_ABSENT | Deed.SAY_UNTRIED:
            return Told(exchange.fault or Problem.NOT_DONE, Outcome.NOT_DONE)
        case Deed.SAY_PROMISE_UNKNOWN:
            return Told(Problem.PROMISE_UNKNOWN, Outcome.UNKNOWN)
        case Deed.SAY_UNKNOWN:
            why = Problem.RECOVERING if head.safe else Problem.OUTCOME_UNKNOWN
            return Told(why, doubtful, offers=True)
        case Deed.SAY_GARBLED:
            return Told(Problem.BROKEN_ANSWER, doubtful)
        case Deed.SAY_LATE:
            return Told(Problem.CORE_TOO_SLOW, doubtful)
        case Deed.SAY_FAULT:
            assert exchange.fault is not None
            return Told(exchange.fault, doubtful if exchange.spent else Outcome.NOT_DONE)
        case Deed.DROP_UNSENT:
            return Told(Problem.RECOVERING, Outcome.NOT_DONE, "gone")
        case _:
            assert deed is Deed.DROP_SENT, f"nobody says anything for {deed}"
            return Told(Problem.OUTCOME_UNKNOWN, doubtful, "gone")


def of_a_refused(exchange: Exchange, *, looked_up: bool) -> Outcome:
    """What became of a request that a rule refuses. `looked_up`: the ledger does not have its key."""
    head = exchange.head
    if head.key is None:
        return Outcome.UNKNOWN if exchange.sends else Outcome.NOT_DONE
    return Outcome.NOT_DONE if looked_up and not head.navigation else Outcome.UNKNOWN


def words(
    told: Told, head: RequestHead, page: Cover | None, shelf: Shelf, form: KeptForm | None
) -> pages.Answer:
    """A problem as its reader can use it: a page for a tab, fields for a program. `form`: may be kept."""
    if not head.navigation:
        return pages.problem(told.problem, head.accept_language, told.outcome)
    sheet = shelf.cover(page, head.accept_language) if page is not None else None
    if sheet is None or page is None:
        return pages.plain(told.problem, head)
    return pages.recovery(sheet, told.problem, head, form if page.asked in KEPT else None)
