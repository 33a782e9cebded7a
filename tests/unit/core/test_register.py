"""The household's side of the book as it is read: order, balances, search, months."""

import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from core.journal import queries, register
from core.journal.answers import Done
from core.journal.register import HouseholdFilter, Position
from core.ledger.accounts import AccountType
from core.ledger.money import INT64_MAX
from core.ledger.overview import RegisterLine
from core.web import pages_book
from tests.unit.core.books import Pen, entering, moving, opening, pen, replacing, reversing
from tests.unit.core.test_verify import verdict


def lines(made: Pen, **wanted: object) -> list[RegisterLine]:
    which = msgspec.structs.replace(HouseholdFilter(limit=500), **wanted)  # type: ignore[arg-type]
    return register.list_register(made.connection, which, ())


def shown(made: Pen, **wanted: object) -> list[tuple[str, str, str]]:
    return [(line.date[-2:], line.amount, line.balance) for line in lines(made, **wanted)]


def a_month(made: Pen) -> None:
    made.carry_out(
        opening("bank"),
        opening("card", AccountType.LIABILITY),
        entering("3000", date="2026-11-10", category="급여", description="월급"),
        entering("-500", date="2026-11-12", category="식비", description="Lunch <b>"),
        entering("-700", "card", date="2026-11-11", category="식비", description="마트"),
        entering("-100", date="2026-11-11", description="kiosk 100%"),
        moving(700, "card", "bank"),
    )


def test_the_register_goes_back_by_days_with_the_balance_of_each_day(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        a_month(made)
        assert shown(made, account="bank") == [
            ("21", "-700", "1700"),
            ("12", "-500", "2400"),
            ("11", "-100", "2900"),
            ("10", "3000", "3000"),
        ]
        made.carry_out(entering("-50", date="2026-11-09", category="식비"))
        assert [line[2] for line in shown(made, account="bank")] == ["1650", "2350", "2850", "2950", "-50"]


def test_the_register_of_all_accounts_shows_each_with_its_own_balance(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        a_month(made)
        assert [(line.account, line.amount, line.balance) for line in lines(made)] == [
            ("bank", "-700", "1700"),
            ("card", "700", "0"),
            ("bank", "-500", "2400"),
            ("bank", "-100", "2900"),
            ("card", "-700", "-700"),
            ("bank", "3000", "3000"),
        ]


def test_a_transfer_names_its_other_side_and_is_no_entry(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        a_month(made)
        transfer, lunch = lines(made, account="bank")[:2]
        assert (transfer.entry, transfer.category, transfer.counterparts) == (None, None, ("card",))
        assert (lunch.category, lunch.description) == ("식비", "Lunch <b>")
        assert lunch.entry == lunch.transaction


def test_what_was_reversed_or_replaced_is_in_no_register(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        command, other = entering("-5", category="식비"), entering("-9", category="식비")
        made.carry_out(opening("bank"), command, other, replacing(command.id, "-6"), reversing(other.id))
        assert shown(made, account="bank") == [("21", "-6", "-6")]
        assert [entry.id for entry in register.list_entries(made.connection, HouseholdFilter(), ())] == [
            command.id
        ]
        assert register.get_entry(made.connection, other.id, ()) is None


@pytest.mark.parametrize(
    ("words", "amounts"),
    [
        ("lunch", ["-500"]),
        ("식비", ["-500", "-700"]),
        ("700", ["-700", "700", "-700"]),
        ("-3,000", ["3000"]),
        ("0%", ["-100"]),
        ("%", ["-100"]),
        ("_", []),
        ("<b>", ["-500"]),
        ("미분류", ["-100"]),
        ("99999999999999999999999", []),
        ("' OR 1=1 --", []),
    ],
)
def test_a_search_finds_words_categories_and_amounts_and_keeps_the_balances(
    tmp_path: Path, words: str, amounts: list[str]
) -> None:
    with pen(tmp_path) as made:
        a_month(made)
        found = lines(made, words=words)
        assert [line.amount for line in found] == amounts
        every = {(line.seq, line.line): line.balance for line in lines(made)}
        assert all(every[line.seq, line.line] == line.balance for line in found)


def test_a_search_in_entries_finds_the_same(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        a_month(made)

        def amounts(**wanted: str) -> list[str]:
            found = register.list_entries(made.connection, HouseholdFilter(**wanted), ())  # type: ignore[arg-type]
            return [entry.amount for entry in found]

        assert amounts(words="식비") == ["-500", "-700"]
        assert amounts(words="700") == ["-700"]
        assert amounts(words="kiosk") == ["-100"]
        assert amounts(account="card") == ["-700"]
        assert amounts(account="expense:_uncategorised:krw") == ["-100"]


def test_days_limit_a_register_and_never_change_its_balances(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        a_month(made)
        whole = shown(made, account="bank")
        assert shown(made, account="bank", date_from="2026-11-11", date_to="2026-11-12") == whole[1:3]


def test_pages_of_a_register_join_without_gap_or_repeat_while_it_grows(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"), opening("cash"))
        made.carry_out(*[entering(str(-n), date=f"2026-11-{1 + n % 5:02d}") for n in range(1, 24)])
        made.carry_out(moving(9, "cash", "bank"))
        for account in (None, "bank"):
            before = [(line.seq, line.line) for line in lines(made, account=account)]
            seen: list[tuple[int, int]] = []
            place = None
            while page := lines(made, account=account, after=place, limit=3):
                seen += [(line.seq, line.line) for line in page]
                place = Position(page[-1].date, page[-1].seq, page[-1].line)
                made.carry_out(entering("-1", date="2026-12-01"))
            assert seen == before


def test_a_month_is_summed_by_the_days_of_its_entries(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        a_month(made)
        made.carry_out(
            opening("usd", currency="USD"),
            entering("-1.50", "usd", date="2026-11-30", category="식비"),
            entering("-10", date="2026-12-01", category="식비"),
            entering("-20", date="2026-10-31", category="식비"),
        )
        found = register.summary_of(made.connection, "2026-11", "2026-11-01", "2026-11-30")
        assert [(flow.currency, flow.income, flow.expense, flow.net) for flow in found.currencies] == [
            ("KRW", "3000", "1300", "1700"),
            ("USD", "0.00", "1.50", "-1.50"),
        ]
        assert [(one.name, one.type, one.amount, one.share_percent) for one in found.categories] == [
            ("식비", "expense", "1200", 92.3),
            (None, "expense", "100", 7.7),
            ("식비", "expense", "1.50", 100.0),
            ("급여", "income", "3000", 100.0),
        ]
        assert [(one.currency, one.amount) for one in found.net_worth] == [("KRW", "1670"), ("USD", "-1.50")]
        assert [account.id for account in found.accounts] == ["bank", "card", "usd"]


def test_no_account_is_left_out_of_a_sum_or_a_page_however_many_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (register, queries):
        monkeypatch.setattr(module, "ACCOUNTS_MAX", 3)
    with pen(tmp_path) as made:
        made.carry_out(opening("wallet"), opening("z-card", AccountType.LIABILITY))
        made.carry_out(*[entering(str(-n), "wallet", category=f"shop {n}") for n in range(1, 11)])
        made.carry_out(entering("-1000", "z-card", category="z"))
        found = register.summary_of(made.connection, "2026-11", "2026-11-01", "2026-11-30")
        assert [one.amount for one in found.net_worth] == ["-1055"]
        assert [(flow.income, flow.expense) for flow in found.currencies] == [("0", "1055")]
        page = pages_book.overview(made.connection, "2026-11", "2026-11", 1, ())
        assert [one.id for one in page.money_accounts] == ["wallet", "z-card"]


def test_a_sum_of_balances_may_be_larger_than_any_one_of_them(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        for name in ("one", "other"):
            made.carry_out(opening(name), entering(str(INT64_MAX), name, category=name))
        found = register.summary_of(made.connection, "2026-11", "2026-11-01", "2026-11-30")
        assert [one.amount for one in found.net_worth] == [str(2 * INT64_MAX)]


def test_categories_are_listed_with_the_day_they_were_last_used(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        a_month(made)
        found = register.list_categories(made.connection, None, 10)
        assert {(one.name, one.type, one.last_used) for one in found} == {
            ("식비", "expense", "2026-11-12"),
            (None, "expense", "2026-11-11"),
            ("급여", "income", "2026-11-10"),
        }
        assert register.list_categories(made.connection, found[0].account, 10) == found[1:]


def test_balances_are_exact_where_sums_would_leave_64_bits(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        most = str(INT64_MAX)
        made.carry_out(opening("bank"))
        made.carry_out(entering(most, date="2026-11-03"), entering(f"-{most}", date="2026-11-01"))
        made.carry_out(entering(most, date="2026-11-04", category="급여"))
        assert [line[2] for line in shown(made)] == [most, "0", f"-{most}"]
        assert [line[2] for line in shown(made, words="9223372036854775807")] == [most, "0", f"-{most}"]


@dataclass
class Kept:
    """An entry as a child would keep it: one line of a list."""

    account: str
    category: str | None
    amount: int
    date: str
    alive: bool = True
    seqs: list[int] = field(default_factory=list)


ACCOUNTS = st.sampled_from(["bank", "card"])
CATEGORIES = st.sampled_from([None, "식비", "교통", "Café", "CAFÉ "])
AMOUNTS = st.integers(-1_000, 1_000).filter(bool)
DATES = st.sampled_from(["2026-10-31", "2026-11-01", "2026-11-30", "2026-12-01"])


class HouseholdAgainstModel(RuleBasedStateMachine):
    """Any series of entries, changes and reversals, against a list of lines that anybody could keep by hand."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory(prefix="household-")
        self.path = Path(self.folder.name)
        self.made = Pen(self.path)
        self.made.carry_out(opening("bank"), opening("card", AccountType.LIABILITY))
        self.kept: dict[str, Kept] = {}

    @rule(account=ACCOUNTS, category=CATEGORIES, amount=AMOUNTS, date=DATES)
    def record(self, account: str, category: str | None, amount: int, date: str) -> None:
        command = entering(str(amount), account, category=category, date=date)
        assert isinstance(self.made.carry_out(command)[0], Done)
        self.kept[command.id] = Kept(account, category, amount, date)

    @rule(data=st.data(), account=ACCOUNTS, category=CATEGORIES, amount=AMOUNTS, date=DATES)
    def change(self, data: st.DataObject, account: str, category: str | None, amount: int, date: str) -> None:
        entry = self.pick(data)
        command = replacing(entry, str(amount), account, category=category, date=date)
        done = isinstance(self.made.carry_out(command)[0], Done)
        was = self.kept.get(entry)
        assert done == (was is not None and was.alive)
        if done:
            self.kept[entry] = Kept(account, category, amount, date)

    @rule(data=st.data())
    def reverse(self, data: st.DataObject) -> None:
        entry = self.pick(data)
        done = isinstance(self.made.carry_out(reversing(entry))[0], Done)
        was = self.kept.get(entry)
        assert done == (was is not None and was.alive)
        if was is not None:
            was.alive = False

    def pick(self, data: st.DataObject) -> str:
        return data.draw(st.sampled_from([*self.kept, "nothing"]))

    @property
    def standing(self) -> dict[str, Kept]:
        return {entry: kept for entry, kept in self.kept.items() if kept.alive}

    @invariant()
    def balances_are_the_sums_of_what_stands(self) -> None:
        for account in ("bank", "card"):
            mine = [kept for kept in self.standing.values() if kept.account == account]
            found = lines(self.made, account=account)
            assert sorted(line.date for line in found) == [line.date for line in reversed(found)]
            assert sorted(int(line.amount) for line in found) == sorted(kept.amount for kept in mine)
            running = 0
            for line in reversed(found):
                running += int(line.amount)
                assert int(line.balance) == running

    @invariant()
    def a_month_is_the_sum_of_what_stands(self) -> None:
        month = [kept for kept in self.standing.values() if kept.date.startswith("2026-11")]
        found = register.summary_of(self.made.connection, "2026-11", "2026-11-01", "2026-11-30")
        (flow,) = found.currencies
        assert int(flow.income) == sum(kept.amount for kept in month if kept.amount > 0)
        assert int(flow.expense) == -sum(kept.amount for kept in month if kept.amount < 0)
        cafe = [one for one in found.categories if one.name and one.name.casefold().strip() == "café"]
        assert len(cafe) <= 2
        (worth,) = found.net_worth
        assert int(worth.amount) == sum(kept.amount for kept in self.standing.values())

    @invariant()
    def entries_are_what_stands(self) -> None:
        found = register.list_entries(self.made.connection, HouseholdFilter(limit=500), ())
        assert {entry.id: int(entry.amount) for entry in found} == {
            entry: kept.amount for entry, kept in self.standing.items()
        }

    def teardown(self) -> None:
        self.made.close()
        try:
            found = verdict(self.path)
            assert found.ok, found.reason
        finally:
            self.folder.cleanup()


TestHouseholdAgainstModel = HouseholdAgainstModel.TestCase
TestHouseholdAgainstModel.settings = settings(max_examples=40, stateful_step_count=20, deadline=None)
