"""An entry in words becomes double entry: pure, without a store."""

import unicodedata

import pytest

from core.ledger.accounts import Account, AccountType, is_account_id
from core.ledger.book import Book, KnownEntry, ids_for, is_uncategorised
from core.ledger.commands import Command, fingerprint_of, transaction_of
from core.ledger.decider import decide
from core.ledger.entries import EntryBody, Origin, record_entry, replace_entry
from core.ledger.events import AccountOpened, EntryPosted, Event, TransactionReversed, decode, encode
from core.ledger.money import INT64_MIN
from core.ledger.reasons import Reason, Rejection, Slug
from tests.unit.core.books import entering, replacing, reversing

BANK = Account("bank", "통장", AccountType.ASSET, "KRW", no_overdraft=True, posted=50_000)
CARD = Account("card", "신한카드", AccountType.LIABILITY, "KRW", no_overdraft=False)
USD = Account("usd", "Dollars", AccountType.ASSET, "USD", no_overdraft=False)
FOOD = Account("expenses:food", "식비", AccountType.EXPENSE, "KRW", no_overdraft=False)
OLD = Account("old", "Old", AccountType.ASSET, "KRW", no_overdraft=False, closed=True)
GONE = Account("gone", "지난 분류", AccountType.EXPENSE, "KRW", no_overdraft=False, closed=True)
MARK = "0123456789abcdef" * 2


def book(*more: Account) -> Book:
    return Book.of((BANK, CARD, USD, FOOD, OLD, GONE, *more))


def happens(command: Command, among: Book | None = None) -> tuple[Event, ...]:
    events = decide(command, among or book())
    assert not isinstance(events, Rejection), events
    return events


def refused(command: Command, among: Book | None = None) -> tuple[Slug, list[tuple[str, Reason]]]:
    found = decide(command, among or book())
    assert isinstance(found, Rejection), found
    return found.slug, [(fault.pointer, fault.reason) for fault in found.faults]


def posted(events: tuple[Event, ...]) -> EntryPosted:
    last = events[-1]
    assert isinstance(last, EntryPosted)
    return last


def lines(event: EntryPosted | TransactionReversed) -> list[tuple[str, str]]:
    return [(line.account, line.amount) for line in event.postings]


def known(command: Command, among: Book) -> Book:
    event = posted(happens(command, among))
    among.entries[event.entry] = KnownEntry(1, event)
    return among


def faults(body: EntryBody) -> list[tuple[str, Reason]]:
    found = record_entry(body, "id")
    assert isinstance(found, Rejection), found
    assert found.slug is Slug.INVALID_BODY
    return [(fault.pointer, fault.reason) for fault in found.faults]


def test_what_was_spent_stands_against_an_expense_and_what_came_in_against_an_income() -> None:
    spent = posted(happens(entering("-12000", category="식비")))
    assert lines(spent) == [("bank", "-12000"), ("expenses:food", "12000")]
    opened, came_in = happens(entering("3000000", category="급여"))
    assert isinstance(opened, AccountOpened)
    assert (opened.type, opened.name, opened.currency) == (AccountType.INCOME, "급여", "KRW")
    assert lines(posted((came_in,))) == [("bank", "3000000"), (opened.id, "-3000000")]


def test_a_category_of_the_same_name_is_used_instead_of_a_new_one() -> None:
    for spelled in ("식비", "  식비 ", unicodedata.normalize("NFD", "식비")):
        assert lines(posted(happens(entering("-1", category=spelled))))[1][0] == "expenses:food"
    cafe = Account("cafe", "Café", AccountType.EXPENSE, "KRW", no_overdraft=False)
    spelled = unicodedata.normalize("NFD", "CAFÉ")
    entry = posted(happens(entering("-1", category=spelled), book(cafe)))
    assert (entry.category, lines(entry)[1][0]) == ("Café", "cafe")


def test_a_category_of_another_currency_is_another_category() -> None:
    opened, entry = happens(entering("-1.50", account="usd", category="식비"))
    assert isinstance(opened, AccountOpened)
    assert opened.currency == "USD"
    assert lines(posted((entry,))) == [("usd", "-1.50"), (opened.id, "1.50")]


def test_ids_of_accounts_made_on_first_use_follow_from_type_name_and_currency() -> None:
    assert ids_for("Food", AccountType.EXPENSE, "KRW")[0] == "expense:food:krw"
    assert ids_for("eating out", AccountType.EXPENSE, "US.D")[0] == "expense:eating-out:us-d"
    korean = ids_for("식비", AccountType.EXPENSE, "KRW")[0]
    assert korean == ids_for(unicodedata.normalize("NFD", " 식비"), AccountType.EXPENSE, "KRW")[0]
    others = {
        ids_for(*one)[0]
        for one in (
            ("식비", AccountType.INCOME, "KRW"),
            ("식비", AccountType.EXPENSE, "USD"),
            ("교통", AccountType.EXPENSE, "KRW"),
            ("food!", AccountType.EXPENSE, "KRW"),
            ("food", AccountType.EXPENSE, "KRW"),
        )
    }
    assert len({korean, *others}) == 6


@pytest.mark.parametrize(
    "name", ["식비", "<script>alert(1)</script>", "\u202egnp.exe", "🍜" * 100, "a" * 200, "-"]
)
def test_every_name_has_ids_that_are_ids(name: str) -> None:
    for kind in AccountType:
        for one in ids_for(name, kind, "A" * 24):
            assert is_account_id(one)
            assert not is_uncategorised(one)


def test_an_id_that_somebody_has_taken_is_never_taken_over() -> None:
    first, second = ids_for("Food", AccountType.EXPENSE, "KRW")[:2]
    taken = Account(first, "Something else", AccountType.ASSET, "KRW", no_overdraft=False)
    opened = happens(entering("-1", category="food"), book(taken))[0]
    assert isinstance(opened, AccountOpened)
    assert opened.id == second
    everything = [
        Account(one, "Something else", AccountType.ASSET, "KRW", no_overdraft=False)
        for one in ids_for("Food", AccountType.EXPENSE, "KRW")
    ]
    found = refused(entering("-1", category="food"), book(*everything))
    assert found == (Slug.ACCOUNT_EXISTS, [("/category", Reason.EXISTS)])


def test_an_entry_without_a_category_stands_on_an_account_of_its_own() -> None:
    opened, entry = happens(entering("-1", category="   "))
    assert isinstance(opened, AccountOpened)
    assert is_uncategorised(opened.id)
    assert posted((entry,)).category is None
    account = Account(opened.id, opened.name, opened.type, opened.currency, no_overdraft=False)
    assert len(happens(entering("-1"), book(account))) == 1


def test_a_way_of_paying_names_the_account_that_the_money_moves_on() -> None:
    card = posted(happens(entering("-1", None, payment_method="신한카드", category="식비")))
    assert (lines(card)[0], card.payment_method) == (("card", "-1"), "신한카드")
    opened, entry = happens(entering("-1", None, payment_method="현금", currency="KRW", category="식비"))
    assert isinstance(opened, AccountOpened)
    assert (opened.type, opened.name) == (AccountType.ASSET, "현금")
    assert lines(posted((entry,)))[0] == (opened.id, "-1")


def test_beside_an_account_a_way_of_paying_is_a_word() -> None:
    events = happens(entering("-1", payment_method="신한카드", category="식비"))
    assert lines(posted(events))[0] == ("bank", "-1")
    assert posted(events).payment_method == "신한카드"


def test_the_currency_is_the_accounts_own() -> None:
    assert posted(happens(entering("-1.5", "usd", category="식비"))).postings[0].amount == "-1.50"
    assert refused(entering("-1.5")) == (Slug.INVALID_BODY, [("/amount", Reason.TOO_MANY_DIGITS)])
    differs = refused(entering("-1", currency="USD"))
    assert differs == (Slug.CURRENCY_DIFFERS, [("/currency", Reason.CURRENCY_DIFFERS)])
    unknown = refused(entering("-1", None, payment_method="새 카드"))
    assert unknown == (Slug.CURRENCY_NEEDED, [("/currency", Reason.MISSING)])
    twice = Account("usd-card", "신한카드", AccountType.LIABILITY, "USD", no_overdraft=False)
    command = entering("-1", None, payment_method="신한카드")
    assert refused(command, book(twice))[0] is Slug.CURRENCY_NEEDED


def test_money_moves_on_what_one_owns_or_owes() -> None:
    found = refused(entering("-1", "expenses:food"))
    assert found == (Slug.NOT_A_MONEY_ACCOUNT, [("/account", Reason.NOT_SUPPORTED)])
    assert refused(entering("-1", "nobody")) == (
        Slug.UNKNOWN_ACCOUNT,
        [("/account", Reason.UNKNOWN_ACCOUNT)],
    )


def test_closed_accounts_take_no_entries_by_id_or_by_name() -> None:
    closed = Slug.ACCOUNT_CLOSED
    assert refused(entering("-1", "old")) == (closed, [("/account", Reason.CLOSED)])
    assert refused(entering("-1", category="지난 분류")) == (closed, [("/category", Reason.CLOSED)])
    by_name = refused(entering("-1", None, payment_method="Old", currency="KRW"))
    assert by_name == (closed, [("/payment_method", Reason.CLOSED)])


def test_an_overdraft_names_the_amount() -> None:
    assert refused(entering("-50001")) == (Slug.OVERDRAFT, [("/amount", Reason.OVERDRAFT)])


def test_an_amount_whose_opposite_does_not_fit_is_refused() -> None:
    found = refused(entering(str(INT64_MIN), "card"))
    assert found == (Slug.INVALID_BODY, [("/amount", Reason.OUT_OF_RANGE)])


def test_a_change_reverses_what_stood_and_is_judged_by_what_comes_of_both() -> None:
    among = known(entering("-40000", category="식비"), book())
    entry = next(iter(among.entries))
    among.put(Account("bank", "통장", AccountType.ASSET, "KRW", no_overdraft=True, posted=10_000))
    reversal, changed = happens(replacing(entry, "-45000", category="식비"), among)
    assert isinstance(reversal, TransactionReversed)
    assert lines(reversal) == [("bank", "40000"), ("expenses:food", "-40000")]
    assert (reversal.entry, posted((changed,)).entry) == (entry, entry)
    assert len({reversal.reverses, reversal.id, posted((changed,)).id}) == 3
    assert refused(replacing(entry, "-50001"), among)[0] is Slug.OVERDRAFT


def test_what_is_reversed_or_was_never_there_is_not_reversed() -> None:
    among = known(entering("-1"), book())
    entry, stood = next(iter(among.entries.items()))
    among.entries[entry] = KnownEntry(stood.seq, stood.event, reversed=True)
    for command in (reversing(entry), replacing(entry, "-1")):
        assert refused(command, among) == (Slug.ENTRY_REVERSED, [("", Reason.REVERSED)])
    for command in (reversing("nothing"), replacing("nothing", "-1")):
        assert refused(command, among)[0] is Slug.ENTRY_NOT_FOUND


def test_what_stands_on_a_closed_account_stays_there() -> None:
    among = known(entering("-1", category="식비"), book())
    among.put(Account("expenses:food", "식비", AccountType.EXPENSE, "KRW", no_overdraft=False, closed=True))
    assert refused(reversing(next(iter(among.entries))), among)[0] is Slug.ACCOUNT_CLOSED


def test_a_row_that_is_known_is_booked_again_only_if_that_is_wanted() -> None:
    among = book()
    among.fingerprints.add(MARK)
    origin = Origin("import-1", 3, MARK)
    assert refused(entering("-1", origin=origin), among)[0] is Slug.ALREADY_IMPORTED
    entry = posted(happens(entering("-1", origin=origin, duplicates_wanted=True), among))
    assert entry.origin == origin
    assert happens(entering("-1", origin=Origin("import-1", 4, "f" * 32)), among)


def test_all_faults_of_an_entry_are_told_at_once() -> None:
    body = EntryBody(
        date="2026-02-30",
        amount="1,000",
        currency="won",
        category="a\x00b",
        description="\x07",
        payment_method="x" * 201,
        tags=["y" * 65],
    )
    assert faults(body) == [
        ("/date", Reason.MALFORMED),
        ("/currency", Reason.MALFORMED),
        ("/amount", Reason.MALFORMED),
        ("/category", Reason.CONTROL_CHARACTER),
        ("/payment_method", Reason.TOO_LONG),
        ("/description", Reason.CONTROL_CHARACTER),
        ("/tags/0", Reason.TOO_LONG),
    ]


@pytest.mark.parametrize(
    ("amount", "currency", "reason"),
    [
        ("0", None, Reason.ZERO),
        ("-0.00", "USD", Reason.ZERO),
        ("1.234", "USD", Reason.TOO_MANY_DIGITS),
        ("1.0", "KRW", Reason.TOO_MANY_DIGITS),
        ("9" * 41, None, Reason.TOO_LONG),
        ("9" * 20, "KRW", Reason.OUT_OF_RANGE),
        ("", None, Reason.MALFORMED),
        ("1e5", None, Reason.MALFORMED),
    ],
)
def test_an_amount_that_is_none_is_refused_with_its_reason(
    amount: str, currency: str | None, reason: Reason
) -> None:
    body = EntryBody(date="2026-11-21", amount=amount, currency=currency, account="bank")
    assert faults(body) == [("/amount", reason)]


def test_an_entry_says_where_the_money_moves() -> None:
    assert faults(EntryBody(date="2026-11-21", amount="1")) == [("/account", Reason.MISSING)]
    blank = EntryBody(date="2026-11-21", amount="1", payment_method="  ")
    assert faults(blank) == [("/account", Reason.MISSING)]
    assert faults(EntryBody(date="2026-11-21", amount="1", account="")) == [("/account", Reason.MALFORMED)]


@pytest.mark.parametrize("name", ["<script>alert(1)</script>", "\u202etxt.exe", "🍜" * 200, "' OR 1=1 --"])
def test_hostile_names_are_text(name: str) -> None:
    opened, entry = happens(entering("-1", category=name, description=name))
    assert isinstance(opened, AccountOpened)
    assert opened.name == posted((entry,)).category == posted((entry,)).description == name


def test_the_same_wish_is_recognised_in_other_words() -> None:
    def mark(amount: str, **changes: str) -> bytes:
        return fingerprint_of(entering(amount, "usd", **changes))

    assert mark("-12") == mark("-12.00")
    assert mark("-12") == mark("-12", category=" ")
    assert mark("-12") != mark("12")
    assert mark("-12") != mark("-12", category="식비")
    assert mark("-10") != mark("-1")
    assert fingerprint_of(replacing("a", "-1")) != fingerprint_of(replacing("b", "-1"))
    assert fingerprint_of(reversing("a")) == fingerprint_of(reversing("a"))


def test_evidence_names_an_entry_that_exists_by_its_id() -> None:
    assert transaction_of(reversing("e")) == transaction_of(replacing("e", "1")) == "e"
    command = entering("1")
    assert transaction_of(command) == command.id


def test_events_of_entries_read_back_from_their_bytes() -> None:
    among = known(entering("-1", category="식비", origin=Origin("i", 1, MARK), tags=["집"]), book())
    entry = next(iter(among.entries))
    for event in (among.entries[entry].event, *happens(replacing(entry, "-2", category="새"), among)):
        assert decode(encode(event)) == event
    newer = encode(among.entries[entry].event).replace(b'"v":1', b'"v":2')
    assert decode(newer) is None


def test_a_replacement_is_checked_like_an_entry() -> None:
    found = replace_entry("e", EntryBody(date="x", amount="1", account="bank"), "t", "r")
    assert isinstance(found, Rejection)
