"""A small ledger with one of everything in it, for tests that look at every page rather than at one number."""

from typing import Any, Final

from tests.integration.house import House

MONTH: Final = "2026-11"
BANK, CARD, DOLLARS = "assets:bank:living", "liabilities:card", "assets:bank:dollars"
#: account, day, amount, category, what
ENTRIES: Final = (
    (BANK, "10", "2400000", "급여", "가상회사 11월 급여"),
    (BANK, "11", "-650000", "주거", "월세"),
    (BANK, "12", "-48320", "식비", "가상마트 A very long description that has to be broken somewhere on a narrow screen"),
    (CARD, "12", "-9000", "식비", "동네 국숫집"),
    (BANK, "13", "-71300", "", ""),
    (DOLLARS, "13", "-12.50", "Travel", "Coffee, airport"),
)  # fmt: skip


def furnish(house: House) -> dict[str, str]:
    """Put it all in, through the ledger's own door. Returns the paths of what has a page of its own."""
    for account, kind, currency in (
        (BANK, "asset", "KRW"),
        (CARD, "liability", "KRW"),
        (DOLLARS, "asset", "USD"),
    ):
        body = {
            "id": account,
            "name": account.rpartition(":")[2].title(),
            "type": kind,
            "currency": currency,
        }
        _done(house, "accounts", body)
    entries = [
        _done(
            house,
            "entries",
            {
                "account": account,
                "date": f"{MONTH}-{day}",
                "amount": amount,
                "currency": "USD" if account == DOLLARS else "KRW",
                "category": category or None,
                "description": what,
            },
        )
        for account, day, amount, category, what in ENTRIES
    ]
    pending = _done(
        house,
        "transactions",
        {
            "date": f"{MONTH}-20",
            "description": "예약한 숙소",
            "state": "pending",
            "postings": [
                {"account": CARD, "amount": "-150000", "currency": "KRW"},
                {"account": BANK, "amount": "150000", "currency": "KRW"},
            ],
        },
    )
    food = next(
        one["id"]
        for one in house.ask("GET", "/api/ledger/accounts?limit=500").body["items"]
        if one["name"] == "식비"
    )
    for amount in ("50000",):  # less than was spent
        _done(house, f"budgets?month={MONTH}", {"account": food, "amount": amount}, "PUT")
    item = _done(
        house,
        "recurring",
        {
            "title": "월세",
            "rule": {"unit": "month"},
            "start": f"{MONTH}-11",
            "entry": {"amount": "-650000", "currency": "KRW", "account": BANK, "category": "주거"},
        },
    )
    entry = entries[2]
    return {
        "entry": f"/entries/{entry['id']}",
        "transaction": f"/transactions/{entry['transaction']}",
        "pending": f"/transactions/{pending['id']}",
        "recurring": f"/plans/recurring/{item['id']}",
    }


def _done(house: House, what: str, body: dict[str, Any], method: str = "POST") -> dict[str, Any]:
    key = "-".join([what, *(str(value) for value in body.values())])[:120]
    key = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in key)
    answer = house.ask(method, f"/api/ledger/{what}", body, key=key)
    assert answer.status in {200, 201}, answer
    told: dict[str, Any] = answer.body
    return told
