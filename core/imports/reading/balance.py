"""The running balance of a file, held against its amounts: the best witness that a mapping is right.

A wrong sign or a wrong column can't keep a running balance going. Whether the file runs from old to new or
back is found by trying both. A refused row leaves a gap that no pair is taken across; every currency has a
chain of its own.
"""

from enum import StrEnum

import msgspec

from core.imports.reading.candidates import Candidate, RefusedRow, Result


class BalanceVerdict(StrEnum):
    """What the balances of a file say about its amounts."""

    MATCH = "match"
    MISMATCH = "mismatch"
    ABSENT = "absent"


class BalanceCheck(msgspec.Struct):
    """Takes the results of a file one by one, in its order, and keeps only the last row of each currency."""

    pairs: int = 0
    forwards: int = 0
    backwards: int = 0
    last: dict[str, Candidate] = {}

    def see(self, result: Result) -> None:
        """Take the next row."""
        if isinstance(result, RefusedRow):
            self.last.clear()
        if not isinstance(result, Candidate):
            return
        before = self.last.pop(result.currency, None)
        if result.balance_minor is None:
            return
        self.last[result.currency] = result
        if before is not None and before.balance_minor is not None:
            self.pairs += 1
            self.forwards += before.balance_minor + result.amount_minor == result.balance_minor
            self.backwards += result.balance_minor + before.amount_minor == before.balance_minor

    @property
    def verdict(self) -> BalanceVerdict:
        """`absent` when no two neighbouring rows have a balance, `match` when all pairs hold in one direction."""
        if not self.pairs:
            return BalanceVerdict.ABSENT
        holds = self.pairs in {self.forwards, self.backwards}
        return BalanceVerdict.MATCH if holds else BalanceVerdict.MISMATCH
