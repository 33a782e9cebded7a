"""Limits: what every posting is judged by, whichever wish it belongs to.

First whether its account is there, open and in its currency, then where all the events of the wish would leave the
accounts. Balances are judged with what is pending: neither all that may still come in nor all that may still go out may
leave the 64 bits of an amount, so that what was taken as pending can always be posted.
"""

from collections.abc import Callable, Sequence

from core.ledger.accounts import Account, is_overdrawn
from core.ledger.commands import Posting
from core.ledger.events import Event
from core.ledger.evolving import Accounts, evolve
from core.ledger.money import fits, format_amount
from core.ledger.reasons import Fault, Reason, Rejection, Slug


def unusable(lines: Sequence[Posting], accounts: Accounts) -> Rejection | None:
    """Say which accounts can't take these lines: they are not there, they are closed, or in another currency."""
    return (
        _unknown_accounts(lines, accounts)
        or _closed_accounts(lines, accounts)
        or _other_currencies(lines, accounts)
    )


def beyond(
    events: Sequence[Event], accounts: Accounts, lines: Sequence[Posting], pointer: Callable[[int], str]
) -> Rejection | None:
    """Judge the balances as they would be after all the events, which touch what `lines` name.

    A line is at fault if its account is; `pointer` says where in the body it stands.
    """
    after = {line.account: accounts[line.account] for line in lines if line.account in accounts}
    for event in events:
        after |= evolve(after, event)
    for slug, reason, is_broken in (
        (Slug.BALANCE_OUT_OF_RANGE, Reason.OUT_OF_RANGE, _does_not_fit),
        (Slug.OVERDRAFT, Reason.OVERDRAFT, _is_forbidden),
    ):
        broken = {account.id for account in after.values() if is_broken(account)}
        at_fault = [n for n, posting in enumerate(lines) if posting.account in broken] if broken else []
        if at_fault:
            account = after[lines[at_fault[0]].account]
            balance = format_amount(account.available, account.currency)
            values = {"account": account.id, "balance": balance, "currency": account.currency}
            faults = tuple(dict.fromkeys(Fault(pointer(n), reason) for n in at_fault))
            return Rejection(slug, faults, values)
    return None


def amount_of_line(line: int) -> str:
    """Point at the amount of a line of a transaction."""
    return f"/postings/{line}/amount"


def amount_of_entry(_: int) -> str:
    """Point at the one amount of an entry."""
    return "/amount"


def nothing_in_particular(_: int) -> str:
    """Point at the whole: nobody has said a line."""
    return ""


def _does_not_fit(account: Account) -> bool:
    posted, debit, credit = account.posted, account.pending_debit, account.pending_credit
    return not (
        fits(posted) and fits(debit) and fits(credit) and fits(posted + debit) and fits(posted - credit)
    )


def _is_forbidden(account: Account) -> bool:
    return account.no_overdraft and is_overdrawn(account.type, account.available)


def _unknown_accounts(lines: Sequence[Posting], accounts: Accounts) -> Rejection | None:
    wrong = [n for n, posting in enumerate(lines) if posting.account not in accounts]
    if not wrong:
        return None
    account = lines[wrong[0]].account
    return Rejection(
        Slug.UNKNOWN_ACCOUNT, _faults(wrong, "account", Reason.UNKNOWN_ACCOUNT), {"account": account}
    )


def _closed_accounts(lines: Sequence[Posting], accounts: Accounts) -> Rejection | None:
    wrong = [n for n, posting in enumerate(lines) if accounts[posting.account].closed]
    if not wrong:
        return None
    account = lines[wrong[0]].account
    return Rejection(Slug.ACCOUNT_CLOSED, _faults(wrong, "account", Reason.CLOSED), {"account": account})


def _other_currencies(lines: Sequence[Posting], accounts: Accounts) -> Rejection | None:
    wrong = [n for n, line in enumerate(lines) if accounts[line.account].currency != line.currency]
    if not wrong:
        return None
    first = lines[wrong[0]]
    values = {"account": first.account, "given": first.currency, "currency": accounts[first.account].currency}
    return Rejection(Slug.CURRENCY_DIFFERS, _faults(wrong, "currency", Reason.CURRENCY_DIFFERS), values)


def _faults(lines: list[int], member: str, reason: Reason) -> tuple[Fault, ...]:
    return tuple(Fault(f"/postings/{line}/{member}", reason) for line in lines)
