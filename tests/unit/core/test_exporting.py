"""A book on paper for other programs: names that are legal and told apart, and texts that end nothing early."""

import itertools
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.exporting import beancount, hledger
from core.exporting.names import ROOTS, names_of
from core.exporting.paper import NO_DAY, Paper
from core.journal.exporting import moment, slice_after
from core.ledger.accounts import Account, AccountType
from core.ledger.commands import Posting, PostTransaction
from core.ledger.money import parse_amount
from tests.unit.core.books import Pen, entering, moving, opening, pen, replacing, reversing

LEGAL: Final = re.compile(
    r"(Assets|Liabilities|Equity|Income|Expenses):([A-Z0-9]|[^\x00-\x7f])([A-Za-z0-9-]|[^\x00-\x7f])*"
)
BOOKED: Final = (
    250  # of bean-example's transactions: a few months of a household with shares and vacation hours
)
READ: Final = """
import json, sys
from beancount import loader
from beancount.core.data import Open, Transaction
entries, errors, options = loader.load_file(sys.argv[1])
assert not errors, errors
told = []
for one in entries:
    if isinstance(one, Transaction):
        lines = [[p.account, str(p.units.number), p.units.currency,
                  [str(p.cost.number), p.cost.currency] if p.cost else
                  [str(p.price.number), p.price.currency] if p.price else None] for p in one.postings]
        told.append([one.date.isoformat(), one.narration or "", sorted(one.tags or ()), lines])
json.dump(told, sys.stdout)
"""


def account(
    name: str, kind: AccountType = AccountType.ASSET, currency: str = "KRW", ident: str = "a"
) -> Account:
    return Account(ident, name, kind, currency, no_overdraft=False)


def test_a_name_keeps_its_letters_and_begins_with_a_capital() -> None:
    told = names_of(
        [account("생활비 통장 (주거래)"), account("my bank", ident="b"), account("401k", ident="c")]
    )
    assert list(told.accounts.values()) == ["Assets:X-생활비-통장-주거래", "Assets:My-bank", "Assets:401k"]


def test_accounts_of_one_name_are_told_apart_by_currency_and_then_by_their_ids_whatever_their_order() -> None:
    same = [
        account("Cash", currency="KRW", ident="x"),
        account("Cash", currency="USD", ident="y"),
        account("Cash", currency="USD", ident="z"),
        account("Cash", AccountType.EXPENSE, ident="w"),
    ]
    told = names_of(same).accounts
    assert (told["x"], told["w"]) == ("Assets:Cash-KRW", "Expenses:Cash")
    assert len(set(told.values())) == 4
    assert names_of(reversed(same)).accounts == told


_accounts = st.lists(
    st.builds(
        account,
        st.text(max_size=20),
        st.sampled_from(AccountType),
        st.sampled_from(["KRW", "USD", "A.", "A-", "B'", "A.0", "VTI"]),
        st.text("ab:_-", min_size=1, max_size=6),
    ),
    unique_by=lambda one: one.id,
    max_size=12,
)


@given(_accounts)
def test_every_name_is_legal_and_no_two_are_alike(accounts: list[Account]) -> None:
    told = names_of(accounts)
    assert set(told.accounts) == {one.id for one in accounts}
    assert len(set(told.accounts.values())) == len(accounts)
    assert all(LEGAL.fullmatch(name) for name in told.accounts.values()), told
    assert all(told.accounts[one.id].startswith(ROOTS[one.type] + ":") for one in accounts)
    assert len(set(told.currencies.values())) == len(told.currencies)
    assert all(re.fullmatch(r"[A-Z]([A-Z0-9._'-]{0,22}[A-Z0-9])?", code) for code in told.currencies.values())


def written(made: Pen, printer: ModuleType) -> str:
    of = moment(made.connection)
    paper = Paper(
        of.seq,
        of.accounts,
        names_of(of.accounts.values()),
        of.first_day or NO_DAY,
        of.last_day or NO_DAY,
        of.pendings,
    )
    parts, seq = list(printer.head(paper)), 0
    while some := slice_after(made.connection, seq, of.seq, ()):
        parts += [text for one in some for text in printer.transaction(paper, one.seen, one.payment_method)]
        seq = some[-1].seen.seq
    return "".join([*parts, *printer.foot(paper)])


@pytest.fixture(scope="module")
def tools() -> dict[str, str]:
    """The two programs that read what we write; a missing one is a failure where it is required."""
    check = Path(sys.executable).with_name("bean-check")
    found = shutil.which("hledger")
    if found is None:
        assert os.environ.get("HLEDGER_TESTS") != "required", "scripts/hledger install was to see to it"
        pytest.skip("No hledger here: sh scripts/hledger install")
    return {"beancount": str(check), "hledger": found}


def run(*argv: str) -> str:
    done = subprocess.run(
        argv, capture_output=True, text=True, env={**os.environ, "LC_ALL": "C.UTF-8"}, check=False
    )
    assert done.returncode == 0, done.stdout[-3_000:] + done.stderr[-3_000:]
    return done.stdout


def agreed(made: Pen, folder: Path, tools: dict[str, str]) -> None:
    """Both programs accept the book, and their balances are ours."""
    beans, journal = folder / "book.beancount", folder / "book.journal"
    beans.write_text(written(made, beancount), encoding="utf-8")
    journal.write_text(written(made, hledger), encoding="utf-8")
    run(tools["beancount"], str(beans))  # with an assertion for each account
    run(tools["hledger"], "-f", str(journal), "check", "--strict")
    of = moment(made.connection)
    names = names_of(of.accounts.values())
    rows, _ = json.loads(run(tools["hledger"], "-f", str(journal), "bal", "--flat", "--empty", "-O", "json"))
    theirs = {row[0]: _minor(row[3]) for row in rows}
    for one in of.accounts.values():
        assert theirs.get(names.accounts[one.id], {}).get(names.currencies[one.currency], 0) == one.posted, (
            one
        )


def _minor(amounts: list[dict[str, Any]]) -> dict[str, int]:
    told = {}
    for one in amounts:
        digits = one["aquantity"]["decimalPlaces"]
        code = one["acommodity"].strip('"')
        text = f"{abs(one['aquantity']['decimalMantissa']):0{digits + 1}d}"
        number = f"{text[:-digits]}.{text[-digits:]}" if digits else text
        minor = parse_amount(number, code)
        assert isinstance(minor, int), number
        told[code] = -minor if one["aquantity"]["decimalMantissa"] < 0 else minor
    return told


def test_both_programs_accept_every_kind_of_text_and_agree_on_every_balance(
    tmp_path: Path, tools: dict[str, str]
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(
            opening("bank"),
            opening("kwd", currency="KWD"),
            opening("other", currency="KWD"),
            opening("odd", currency="A."),
            opening("even", currency="A."),
        )
        gone, changed = entering("-7000", description='he said "no; not 5 | 6" \\ #tag'), entering("-1")
        made.carry_out(
            gone,
            changed,
            entering(
                "1200000", description="(월급) 11월\n두 줄", tags=["급여", "a-b"], payment_method="이체"
            ),
            entering("-3", description="* ; !", category="카페, 빵"),
            moving(12_345, "kwd", "other", "KWD"),
            moving(1, "odd", "even", "A."),
        )
        made.carry_out(reversing(gone.id), replacing(changed.id, "-250", category="食費"))
        agreed(made, tmp_path, tools)


def test_a_balance_that_is_off_by_the_smallest_unit_is_refused_by_both_programs(
    tmp_path: Path, tools: dict[str, str]
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(
            opening("bank", currency="USD"),
            opening("food", currency="USD"),
            moving(1_000, "food", "bank", "USD"),
        )
        for printer, name in ((beancount, "beancount"), (hledger, "hledger")):
            text = written(made, printer)
            assert text.count("10.00") >= 3
            head, _, foot = text.rpartition("10.00")
            file = tmp_path / f"off.{name}"
            file.write_text(f"{head}10.01{foot}", encoding="utf-8")
            argv = (
                [tools[name], str(file)] if name == "beancount" else [tools[name], "-f", str(file), "check"]
            )
            assert subprocess.run(argv, capture_output=True, check=False).returncode != 0
            file.write_text(text, encoding="utf-8")
            run(*argv)


def test_what_waits_is_told_and_counts_in_neither(tmp_path: Path, tools: dict[str, str]) -> None:
    lines = (Posting("food", 700, "KRW"), Posting("bank", -700, "KRW"))
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"), opening("food"), moving(5, "food", "bank"))
        made.carry_out(PostTransaction("p", "2026-11-21", "hotel; held", (), lines, pending=True))
        for printer in (beancount, hledger):
            assert "hotel; held" in written(made, printer)
        agreed(made, tmp_path, tools)


def test_an_empty_book_is_accepted_too(tmp_path: Path, tools: dict[str, str]) -> None:
    with pen(tmp_path) as made:
        agreed(made, tmp_path, tools)


def _translated(path: Path) -> Iterator[tuple[str, str, list[str], list[tuple[str, str, int]]]]:
    """Give transactions of a Beancount file: what has a price goes through an account of exchange, as four postings."""
    for date, text, tags, lines in json.loads(run(sys.executable, "-c", READ, str(path))):
        moved: dict[tuple[str, str], int] = {}

        def move(name: str, code: str, minor: int, moved: dict[tuple[str, str], int] = moved) -> None:
            moved[name, code] = moved.get((name, code), 0) + minor

        for name, number, code, priced in lines:
            minor = _rounded(number, code)
            move(name, code, minor)
            if priced is not None:
                move("Equity:Exchange", code, -minor)
                move("Equity:Exchange", priced[1], _rounded(str(float(number) * float(priced[0])), priced[1]))
        for code in {code for _, code in moved}:
            left = sum(minor for (_, one), minor in moved.items() if one == code)
            if left:
                move("Equity:Rounding", code, -left)
        yield date, text, tags, [(name, code, minor) for (name, code), minor in moved.items() if minor]


def _rounded(number: str, code: str) -> int:

    return int((Decimal(number) * 10 ** (2 if code == "USD" else 6)).to_integral_value())


def test_a_generated_household_with_shares_comes_out_with_the_balances_that_both_programs_find(
    tmp_path: Path, tools: dict[str, str]
) -> None:
    source = tmp_path / "example.beancount"
    source.write_text(
        run(str(Path(sys.executable).with_name("bean-example")), "--seed", "7"), encoding="utf-8"
    )
    kinds = {text: kind for kind, text in ROOTS.items()}
    with pen(tmp_path) as made:
        known: set[str] = set()
        commands: list[Any] = []
        for number, (date, text, tags, lines) in enumerate(itertools.islice(_translated(source), BOOKED)):
            if len(lines) < 2:
                continue
            postings = []
            for name, code, minor in lines:
                ident = f"{name}:{code}".lower().replace(".", "-")
                if ident not in known:
                    known.add(ident)
                    commands.append(opening(ident, kinds[name.split(":")[0]], code))
                postings.append(Posting(ident, minor, code))
            commands.append(PostTransaction(f"t{number}", date, text, tuple(tags), tuple(postings)))
        for start in range(0, len(commands), 200):
            made.carry_out(*commands[start : start + 200])
        assert len(known) > 20
        agreed(made, tmp_path, tools)
