"""The survey: one look at all rows of a table, before anything is booked.

Pure and lazy: rows pass once, numbers and the first few rows stay. What the ledger knows already is asked by
the caller, with the fingerprints gathered here, because that question goes to a store in bounded pieces.
"""

from collections.abc import Iterable

import msgspec

from core.imports.judging import judge, sample_of
from core.imports.reading.balance import BalanceCheck
from core.imports.reading.candidates import Candidate, Result
from core.imports.reading.fingerprints import fingerprint
from core.imports.records import PROBLEMS_MAX, SAMPLE_MAX, Problem, SampleRow, Survey


class Surveyor(msgspec.Struct):
    """Takes the results of a file one by one. `account` and `currency` are None until one is chosen."""

    account: str | None
    currency: str | None
    good: int = 0
    refused: int = 0
    skipped: int = 0
    sample: list[SampleRow] = []
    problems: list[Problem] = []
    fingerprints: list[str] = []
    balance: BalanceCheck = msgspec.field(default_factory=BalanceCheck)

    def see(self, result: Result) -> None:
        """Take the next row."""
        self.balance.see(result)
        judged = judge(result, self.currency)
        if len(self.sample) < SAMPLE_MAX:
            self.sample.append(sample_of(judged))
        if isinstance(judged, Candidate):
            self.good += 1
            if self.account is not None:
                self.fingerprints.append(fingerprint(self.account, judged))
        elif isinstance(judged, Problem):
            self.refused += 1
            if len(self.problems) < PROBLEMS_MAX:
                self.problems.append(judged)
        else:
            self.skipped += 1

    def found(self, duplicates: int, fitting: tuple[str, ...]) -> Survey:
        """Return the numbers."""
        return Survey(
            total=self.good + self.refused + self.skipped,
            good=self.good,
            refused=self.refused,
            skipped=self.skipped,
            duplicates=duplicates,
            sample=tuple(self.sample),
            problems=tuple(self.problems),
            balance_check=self.balance.verdict,
            fitting=fitting,
        )


def survey(results: Iterable[Result], account: str | None, currency: str | None) -> Surveyor:
    """Look at all rows."""
    surveyor = Surveyor(account, currency)
    for result in results:
        surveyor.see(result)
    return surveyor
