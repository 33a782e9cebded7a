"""What comes back from the core, turned into triggers for the request it belongs to.

The other half of `sending`: an answer, half an answer, silence, a refusal, a look-up's result. Each is
judged here for what it says about the core too (a core that hung up is doubted, one that is leaving is not
sent anything more), and then the request is moved on.
"""

from collections.abc import Callable
from typing import Protocol

from hardcore.crisis import pages
from hardcore.crisis.exchange import Exchange
from hardcore.crisis.heads import AnswerHead
from hardcore.crisis.holding import OVER, Life, Trigger, after_death
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.outlook import Outlook
from hardcore.crisis.upstream import Pool


class Mover(Protocol):
    """Who moves requests along their table."""

    def step(self, exchange: Exchange, trigger: Trigger, answer: pages.Answer | None = None) -> None:
        """Take one step; `answer` comes with those triggers that bring one."""


class Returns:
    """The `sending.Sender` of the house."""

    def __init__(
        self, mover: Mover, outlook: Outlook, limits: GatewayLimits, absent: Callable[[Exchange], Trigger]
    ) -> None:
        self._mover = mover
        self._outlook = outlook
        self._limits = limits
        self._absent = absent  # what becomes of a request that the ledger does not have

    def answered(self, exchange: Exchange, head: AnswerHead, body: bytes) -> None:
        """The answer is whole."""
        if exchange.life in OVER:
            return
        if self._outlook.pool is not None and head.epoch == self._outlook.pool.epoch:
            self._outlook.answered(self._outlook.pool)
        if head.rule is not None:
            self._outlook.ruled(head.rule)
        exchange.upstream = None
        if exchange.life is Life.ANSWERING:
            self._mover.step(exchange, Trigger.ANSWER)
        else:
            self._mover.step(exchange, Trigger.ANSWER, pages.Answer(head, body))
        if head.commit is not None and 200 <= head.status < 400:  # a form that was done leads on: 303
            self._outlook.passed_on(head)

    def begun(self, exchange: Exchange, head: AnswerHead, first: bytes) -> None:
        """The answer is too long to keep."""
        self._mover.step(exchange, Trigger.BEGUN, pages.Answer(head, first))

    def continued(self, exchange: Exchange, data: bytes) -> None:
        """A piece of the answer that was begun."""
        if not exchange.stalled:  # the core is not to blame; the client has a limit of its own
            exchange.client.limit.set(self._limits.upstream_deadline_ms)
        exchange.client.more(data)

    def not_run(self, exchange: Exchange, pool: Pool) -> None:
        """The core is leaving and did not run it: as if it had never been sent."""
        exchange.sends -= 1
        exchange.upstream = None
        self._outlook.leaving(pool)
        self._unsent(exchange)

    def undelivered(self, exchange: Exchange, pool: Pool) -> None:
        """No core took it."""
        self._outlook.doubt(pool)
        self._unsent(exchange)

    def _unsent(self, exchange: Exchange) -> None:
        """Back to where it came from. What an earlier core may have seen stays lost, whatever this one says."""
        if exchange.life is Life.ASKED:
            self._mover.step(exchange, Trigger.CORE_LOST)
        elif exchange.life is Life.FORWARDED:
            if exchange.sends:
                self._mover.step(exchange, after_death(exchange.plea()))
            elif exchange.spent:
                self._mover.step(exchange, Trigger.NOT_RUN_SPENT)
            else:
                self._mover.step(exchange, Trigger.NOT_RUN)

    def looked_up(self, exchange: Exchange, pool: Pool, *, found: pages.Answer | None) -> None:
        """The ledger has it, or does not. Only a later core than the one that had it knows that it never will."""
        if exchange.life is not Life.ASKED:
            return
        if found is not None:
            self._mover.step(exchange, Trigger.FOUND, found)
        elif pool.epoch <= exchange.lost_epoch:
            self._mover.step(exchange, Trigger.NOT_YET)
        else:
            self._mover.step(exchange, self._absent(exchange))

    def not_told(self, exchange: Exchange, pool: Pool) -> None:
        """No word of the contract came: the last one of a later core, but one that had it may die and leave it to the next."""
        if exchange.life is Life.ASKED:
            later = pool.epoch > exchange.lost_epoch
            self._mover.step(exchange, Trigger.GARBLED if later else Trigger.NOT_YET)

    def core_lost(self, exchange: Exchange, pool: Pool) -> None:
        """The core is gone (or not the one we serve): no answer will come."""
        exchange.upstream = None
        self._outlook.doubt(pool)
        if exchange.life in OVER:
            return
        exchange.lost_epoch = pool.epoch
        self._mover.step(exchange, after_death(exchange.plea()))

    def answer_garbled(self, exchange: Exchange) -> None:
        """What came is no answer."""
        exchange.upstream = None
        if exchange.life not in OVER:
            self._mover.step(exchange, Trigger.GARBLED)
