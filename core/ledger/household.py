"""How an entry becomes double entry: which account the money moves on, and which one says what it was for.

A household names its ways of paying and its categories; here the names find their accounts, or say which ones
are to be opened with the entry, in the same transaction. What came in stands against an income account, what
was spent against an expense account, so one category may have one of each. Asking people to open accounts first
was not chosen: the first entry of an evening would then be three forms long.
"""

from typing import Final

import msgspec

from core.ledger.accounts import Account, AccountType
from core.ledger.book import UNCATEGORISED_NAME, Book, ids_for
from core.ledger.commands import Posting
from core.ledger.entries import EntryDetails
from core.ledger.events import AccountOpened
from core.ledger.money import fits, parse_amount
from core.ledger.reasons import Fault, Reason, Rejection, Slug, reject

MONEY_TYPES: Final = (AccountType.ASSET, AccountType.LIABILITY)
CATEGORY_TYPES: Final = (AccountType.EXPENSE, AccountType.INCOME)


class Resolved(msgspec.Struct, frozen=True):
    """An entry whose names have found their accounts: what is opened for it, and what it posts.

    `category` and `payment_method` are the names as the accounts have them.
    """

    opened: tuple[AccountOpened, ...]
    postings: tuple[Posting, Posting]
    category: str | None
    payment_method: str | None


def resolve(details: EntryDetails, book: Book) -> Resolved | Rejection:
    """Return what the entry means in this book, or why it means nothing there."""
    money = _money(details, book)
    if isinstance(money, Rejection):
        return money
    amount = _amount(details.amount, money.currency)
    if isinstance(amount, Rejection):
        return amount
    kind = AccountType.INCOME if amount > 0 else AccountType.EXPENSE
    category = _category(details.category, kind, money.currency, book)
    if isinstance(category, Rejection):
        return category
    return Resolved(
        tuple(account for account in (money, category) if isinstance(account, AccountOpened)),
        (Posting(money.id, amount, money.currency), Posting(category.id, -amount, money.currency)),
        category.name if details.category is not None else None,
        details.payment_method if details.account is not None else money.name,
    )


def _money(details: EntryDetails, book: Book) -> Account | AccountOpened | Rejection:
    if details.account is None:
        assert details.payment_method is not None, "an entry names an account or a way of paying"
        return _way_of_paying(details.payment_method, details.currency, book)
    account = book.accounts.get(details.account)
    if account is None:
        return reject(Slug.UNKNOWN_ACCOUNT, "/account", Reason.UNKNOWN_ACCOUNT, account=details.account)
    if account.type not in MONEY_TYPES:
        return reject(Slug.NOT_A_MONEY_ACCOUNT, "/account", Reason.NOT_SUPPORTED, account=account.id)
    if account.closed:
        return reject(Slug.ACCOUNT_CLOSED, "/account", Reason.CLOSED, account=account.id)
    if details.currency not in {None, account.currency}:
        values = {"account": account.id, "given": str(details.currency), "currency": account.currency}
        return reject(Slug.CURRENCY_DIFFERS, "/currency", Reason.CURRENCY_DIFFERS, **values)
    return account


def _way_of_paying(name: str, currency: str | None, book: Book) -> Account | AccountOpened | Rejection:
    found = book.named(name, MONEY_TYPES, currency)
    usable = [account for account in found if not account.closed]
    if len({account.currency for account in usable}) > 1 or (not found and currency is None):
        return reject(Slug.CURRENCY_NEEDED, "/currency", Reason.MISSING)
    if usable:
        return usable[0]
    if found:
        return reject(Slug.ACCOUNT_CLOSED, "/payment_method", Reason.CLOSED, account=found[0].id)
    assert currency is not None
    return _new(name, AccountType.ASSET, currency, "/payment_method", book)


def _category(
    name: str | None, kind: AccountType, currency: str, book: Book
) -> Account | AccountOpened | Rejection:
    if name is None:
        return _uncategorised(kind, currency, book)
    found = book.named(name, (kind,), currency)
    if not found:
        return _new(name, kind, currency, "/category", book)
    if found[0].closed:
        return reject(Slug.ACCOUNT_CLOSED, "/category", Reason.CLOSED, account=found[0].id)
    return found[0]


def _uncategorised(kind: AccountType, currency: str, book: Book) -> Account | AccountOpened | Rejection:
    for account_id in ids_for(None, kind, currency):
        account = book.accounts.get(account_id)
        if account is None or account.closed:
            continue
        if (account.type, account.currency) == (kind, currency):
            return account
    return _new(None, kind, currency, "/category", book)


def _new(
    name: str | None, kind: AccountType, currency: str, pointer: str, book: Book
) -> AccountOpened | Rejection:
    ids = ids_for(name, kind, currency)
    free = next((one for one in ids if one not in book.accounts), None)
    if free is None:
        return reject(Slug.ACCOUNT_EXISTS, pointer, Reason.EXISTS, account=ids[0])
    shown = name if name is not None else UNCATEGORISED_NAME
    return AccountOpened(free, shown, kind, currency, no_overdraft=False)


def _amount(text: str, currency: str) -> int | Rejection:
    amount = parse_amount(text, currency)
    if isinstance(amount, int):
        # The other posting is its opposite, and so is every posting of a reversal: both must fit.
        if fits(-amount):
            return amount
        amount = Reason.OUT_OF_RANGE
    return Rejection(Slug.INVALID_BODY, (Fault("/amount", amount),))
