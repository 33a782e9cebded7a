"""What the ledger shows in the end, held against what it was told.

Every check gives sentences, one for each thing that is wrong; an empty list is the good news. Nothing is
taken from the answers that came while the books were told, except where the check is about those answers.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

from examples.household import CONVERSIONS, Household, Wish
from examples.reading import Books


def wrong_balances(books: Books, household: Household) -> list[str]:
    """Each balance is beancount's, each account is there, and there is none that nobody opened."""
    asked = {wish.body["id"] for wish in household.accounts}
    wrong = [f"{name} was opened and is not there" for name in sorted(asked - set(books.balances))]
    wrong += [f"{name} is there and nobody opened it" for name in sorted(set(books.balances) - asked)]
    for name, balance in sorted(books.balances.items()):
        if name.startswith(CONVERSIONS):
            continue  # beancount keeps no such account; that they fit is seen by every currency's sum
        due = household.balances.get(name)
        if balance != due:
            wrong.append(f"{name} holds {balance}, by beancount {due}")
    return wrong


def wrong_counts(books: Books, wishes: Sequence[Wish]) -> list[str]:
    """Each key has booked exactly one event, and each event has a key of ours."""
    booked = Counter(str(event["key"]) for event in books.events)
    asked = {wish.key for wish in wishes}
    wrong = [f"{key} is missing" for key in sorted(asked - set(booked))]
    wrong += [f"{key} is there, and nobody asked for it" for key in sorted(set(booked) - asked)]
    return wrong + [f"{key} is there {times} times" for key, times in sorted(booked.items()) if times > 1]


def wrong_contents(books: Books, wishes: Sequence[Wish], told: Mapping[str, str]) -> list[str]:
    """The list has each transaction once, as it was asked for, under the id that its answer gave (`told`)."""
    listed = {each["id"]: each for each in books.transactions}
    wrong = []
    if len(listed) != len(books.transactions):
        wrong.append("the list shows a transaction twice")
    booked = books.transaction_of
    for wish in wishes:
        id_ = booked.pop(wish.key, None)
        shown = listed.pop(id_ or "", None)
        if shown is None or _content(shown) != _content(wish.body):
            wrong.append(f"{wish.key} is not in the list as it was asked for")
        if told.get(wish.key) != id_:
            wrong.append(f"{wish.key} was answered as {told.get(wish.key)}, booked as {id_}")
    return wrong + [f"{id_} is in the list, and nobody asked for it" for id_ in sorted(listed)]


def wrong_orders(books: Books, wishes: Sequence[Wish]) -> list[str]:
    """Each account has its transactions in the order in which the household made them."""
    place = {event["key"]: event["seq"] for event in books.events}
    last: dict[str, int] = {}
    wrong = []
    for wish in wishes:
        for account in wish.accounts:
            seq = place.get(wish.key, 0)
            if seq < last.get(account, 0):
                wrong.append(f"{wish.key} stands before its predecessor in {account}")
            last[account] = seq
    return wrong


def _content(shown: Mapping[str, Any]) -> tuple[Any, ...]:
    """What has to be the same; 12 and 12.00 dollars are."""
    lines = [(line["account"], Decimal(line["amount"]), line["currency"]) for line in shown["postings"]]
    return shown["date"], shown["description"], list(shown["tags"]), lines
