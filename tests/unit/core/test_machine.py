"""The book against a small dict: whatever is wished in whatever order, both say the same, and the book can be proven.

Every step goes through the real journal on a real file. The model knows the rules in a few lines of its own: what is owned, what
is spoken for, and what may still happen to a transaction.
"""

import itertools
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, initialize, invariant, rule

from core.journal import queries
from core.journal.answers import Done, Refused
from core.ledger.accounts import AccountType
from core.ledger.commands import (
    AtomicBatch,
    CloseAccount,
    Command,
    OpenAccount,
    Posting,
    PostPending,
    PostTransaction,
    ReverseTransaction,
    VoidPending,
)
from tests.unit.core.books import Pen, order
from tests.unit.core.test_verify import verdict

NAMES: Final = ("bank", "card", "food", "pay")
KINDS: Final = {
    "bank": AccountType.ASSET,
    "card": AccountType.LIABILITY,
    "food": AccountType.EXPENSE,
    "pay": AccountType.INCOME,
}
GUARDED: Final = frozenset({"bank"})  # may not be overdrawn
amounts = st.integers(1, 50)
names = st.sampled_from(NAMES)


@dataclass
class Model:
    """What a book is, as dicts. Debits are positive."""

    posted: dict[str, int] = field(default_factory=dict)
    debit: dict[str, int] = field(default_factory=dict)
    credit: dict[str, int] = field(default_factory=dict)
    closed: set[str] = field(default_factory=set)
    booked: dict[str, tuple[str, str, int]] = field(default_factory=dict)
    reversed: set[str] = field(default_factory=set)
    held: dict[str, tuple[str, str, int]] = field(default_factory=dict)

    def takes(self, *accounts: str) -> bool:
        return all(one in self.posted and one not in self.closed for one in accounts)

    def may_move(self, to: str, source: str, amount: int) -> bool:
        return to != source and self.takes(to, source) and self.covers(source, amount)

    def covers(self, source: str, amount: int) -> bool:
        return source not in GUARDED or self.posted[source] - self.credit[source] >= amount

    def move(self, to: str, source: str, amount: int) -> None:
        self.posted[to] += amount
        self.posted[source] -= amount


class Machine(RuleBasedStateMachine):
    """See the module."""

    moved = Bundle("moved")
    held = Bundle("held")

    @initialize()
    def begin(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="machine-"))
        self.pen, self.model, self.numbers = Pen(self.folder), Model(), itertools.count()
        for name in NAMES[1:]:  # the bank comes when it comes
            self.opens(name)

    def _said(self, command: Command, expected: bool, key: str | None = None) -> None:
        (answer,) = self.pen.write(order(command, key))
        assert isinstance(answer, Done if expected else Refused), (command, answer)

    def _transaction(self, to: str, source: str, amount: int, *, pending: bool = False) -> PostTransaction:
        lines = (Posting(to, amount, "KRW"), Posting(source, -amount, "KRW"))
        return PostTransaction(f"t{next(self.numbers)}", "2026-11-21", "", (), lines, pending=pending)

    @rule(name=st.just("bank"))
    def opens(self, name: str) -> None:
        is_new = name not in self.model.posted
        self._said(OpenAccount(name, name, KINDS[name], "KRW", name in GUARDED), is_new)
        if is_new:
            for sums in (self.model.posted, self.model.debit, self.model.credit):
                sums[name] = 0

    @rule(name=names, meant=st.integers(0, 5))
    def closes(self, name: str, meant: int) -> None:
        if meant:  # else every book would soon be closed
            return
        holds = self.model.debit.get(name) or self.model.credit.get(name)
        may = self.model.takes(name) and not holds
        self._said(CloseAccount(name), may)
        if may:
            self.model.closed.add(name)

    @rule(target=moved, to=names, source=names, amount=amounts, again=st.booleans())
    def moves(self, to: str, source: str, amount: int, again: bool) -> str:
        may = self.model.may_move(to, source, amount)
        if to == source:
            return ""
        command, key = self._transaction(to, source, amount), f"k{next(self.numbers)}"
        self._said(command, may, key)
        if again:  # the same wish under its key: the same answer, and nothing happens
            self._said(command, may, key)
        if may:
            self.model.move(to, source, amount)
            self.model.booked[command.id] = (to, source, amount)
        return command.id

    @rule(target=held, to=names, source=names, amount=amounts)
    def holds(self, to: str, source: str, amount: int) -> str:
        if to == source:
            return ""
        may = self.model.may_move(to, source, amount)
        command = self._transaction(to, source, amount, pending=True)
        self._said(command, may)
        if may:
            self.model.debit[to] += amount
            self.model.credit[source] += amount
            self.model.held[command.id] = (to, source, amount)
        return command.id

    def _release(self, name: str) -> tuple[str, str, int]:
        to, source, amount = self.model.held.pop(name)
        self.model.debit[to] -= amount
        self.model.credit[source] -= amount
        return to, source, amount

    @rule(name=held, part=st.integers(1, 60))
    def posts_pending(self, name: str, part: int) -> None:
        to, source, amount = self.model.held.get(name, ("food", "bank", 0))
        may = name in self.model.held and part <= amount and self.model.takes(to, source)
        lines = (Posting(to, part, "KRW"), Posting(source, -part, "KRW"))
        made = f"t{next(self.numbers)}"
        self._said(PostPending(made, name, lines), may)
        if may:
            self._release(name)
            self.model.move(to, source, part)
            self.model.booked[made] = (to, source, part)

    @rule(name=consumes(held))
    def voids(self, name: str) -> None:
        may = name in self.model.held
        self._said(VoidPending(name), may)
        if may:
            self._release(name)

    @rule(name=moved)
    def reverses(self, name: str) -> None:
        to, source, amount = self.model.booked.get(name, ("", "", 0))
        may = (
            name in self.model.booked
            and name not in self.model.reversed
            and self.model.takes(to, source)
            and self.model.covers(to, amount)
        )
        self._said(ReverseTransaction(name, f"t{next(self.numbers)}"), may)
        if may:
            self.model.reversed.add(name)
            self.model.move(source, to, amount)

    @rule(wishes=st.lists(st.tuples(names, names, amounts), min_size=1, max_size=4))
    def moves_all_or_none(self, wishes: list[tuple[str, str, int]]) -> None:
        wishes = [one for one in wishes if one[0] != one[1]] or [("food", "pay", 1)]
        before = dict(self.model.posted)
        may = True
        for to, source, amount in wishes:
            may = may and self.model.may_move(to, source, amount)
            if may:
                self.model.move(to, source, amount)
        self._said(AtomicBatch(tuple(self._transaction(*one) for one in wishes)), may)
        if not may:
            self.model.posted = before

    @invariant()
    def both_say_the_same(self) -> None:
        told = {
            one.id: (one.posted, one.pending_debit, one.pending_credit, one.closed)
            for one in queries.all_accounts(self.pen.connection)
        }
        model = self.model
        assert told == {
            name: (posted, model.debit[name], model.credit[name], name in model.closed)
            for name, posted in model.posted.items()
        }
        assert sum(model.posted.values()) == 0

    def teardown(self) -> None:
        self.pen.close()
        found = verdict(self.folder)
        shutil.rmtree(self.folder)
        assert found.ok, found


TestTheBookAgainstADict = Machine.TestCase
TestTheBookAgainstADict.settings = settings(
    max_examples=30, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck)
)
