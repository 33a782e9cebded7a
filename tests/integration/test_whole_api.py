"""The API of the whole ledger, asked of one real core: two phases, versions, days, batches, plans, and bad input."""

import datetime as dt
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.integration.lone_core import Answer, Core, moving, ready, started
from tests.waiting import until

TRANSACTIONS = "/api/ledger/transactions"
NOBODY = "00000000-0000-0000-0000-000000000000"
CASH, SHOP, FOOD = "assets:cash", "liabilities:shop", "expense:food"


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Core]:
    """One core for all of this file; what a test books on is its own."""
    data: Path = tmp_path_factory.mktemp("whole") / "data"
    data.mkdir()
    with started(data, CORE_SCHEDULE_EVERY_MS="100", CORE_BACKUP_EVERY_H="0") as made:
        yield ready(made)


@pytest.fixture(scope="module", autouse=True)
def accounts(core: Core) -> None:
    for name, kind in ((CASH, "asset"), (SHOP, "liability"), (FOOD, "expense")):
        assert core.open(name, kind).status == 201


@pytest.fixture(scope="module", autouse=True)
def whole(core: Core) -> Iterator[None]:
    """Whatever was sent, the book is proven whole at the end."""
    yield
    verdict = core.ask("GET", "/api/ledger/verify")
    assert verdict.body["ok"], verdict.body


def account(core: Core, name: str) -> Any:
    return core.ask("GET", f"/api/ledger/accounts/{name}").body


def problem(answer: Answer) -> tuple[int, str, list[str]]:
    """Return what a problem says: its status, its slug, and the pointers of its faults."""
    assert answer.headers["content-type"] == "application/problem+json", answer
    pointers = [fault["pointer"] for fault in answer.body.get("errors", [])]
    return answer.status, answer.body["type"].removeprefix("/problems/"), pointers


# ---- two phases ----


def test_a_pending_transaction_is_posted_in_part_and_the_rest_is_free(core: Core) -> None:
    core.open("assets:pump")
    made = core.ask(
        "POST", TRANSACTIONS, {**moving(100, SHOP, "assets:pump"), "state": "pending", "timeout_s": 60}
    )
    assert (made.status, made.body["state"]) == (201, "pending")
    pending = made.body["id"]
    assert account(core, "assets:pump")["balances"] == {"posted": "0", "pending": "-100", "available": "-100"}
    assert pending in [one["id"] for one in core.ask("GET", f"{TRANSACTIONS}?state=pending").body["items"]]
    part = {"postings": moving(60, SHOP, "assets:pump")["postings"]}
    booked = core.ask("POST", f"{TRANSACTIONS}/{pending}/post", part, Idempotency_Key="part")
    assert (booked.status, booked.body["pending"]) == (201, pending)
    assert account(core, "assets:pump")["balances"] == {"posted": "-60", "pending": "0", "available": "-60"}
    assert problem(core.ask("POST", f"{TRANSACTIONS}/{pending}/void"))[:2] == (409, "pending-posted")
    assert pending not in [
        one["id"] for one in core.ask("GET", f"{TRANSACTIONS}?state=pending").body["items"]
    ]


def test_what_is_voided_moves_nothing_and_what_is_reversed_moves_it_back_once(core: Core) -> None:
    pending = core.ask("POST", TRANSACTIONS, {**moving(7, CASH, SHOP), "state": "pending"}).body["id"]
    voided = core.ask("POST", f"{TRANSACTIONS}/{pending}/void", {})
    assert (voided.status, voided.body["state"]) == (200, "voided")
    booked = core.move(9, CASH, SHOP).body["id"]
    taken = core.ask("POST", f"{TRANSACTIONS}/{booked}/reverse")
    assert (taken.status, taken.body["reverses"]) == (201, booked)
    again = core.ask("POST", f"{TRANSACTIONS}/{booked}/reverse")
    assert problem(again)[:2] == (409, "transaction-reversed")
    assert problem(core.ask("POST", f"{TRANSACTIONS}/{NOBODY}/post"))[:2] == (404, "pending-not-found")
    assert problem(core.ask("POST", f"{TRANSACTIONS}/nonsense/reverse"))[:2] == (404, "transaction-not-found")


def test_a_command_that_has_seen_an_older_account_is_refused(core: Core) -> None:
    core.open("assets:seen")
    read = core.ask("GET", "/api/ledger/accounts/assets:seen")
    assert read.headers["etag"] == f'"{read.body["version"]}"'
    body = {**moving(1, "assets:seen", SHOP), "expected_versions": {"assets:seen": read.body["version"]}}
    assert core.ask("POST", TRANSACTIONS, body).status == 201
    assert problem(core.ask("POST", TRANSACTIONS, body))[:2] == (412, "account-changed")
    path = "/api/ledger/accounts/assets:seen/close"
    assert problem(core.ask("POST", path, If_Match=read.headers["etag"]))[:2] == (412, "account-changed")
    assert problem(core.ask("POST", path, If_Match="yes"))[:2] == (400, "invalid-parameter")
    now = core.ask("GET", "/api/ledger/accounts/assets:seen").headers["etag"]
    assert core.ask("POST", path, If_Match=now).status == 200


def test_what_stood_on_a_day_is_asked_for_and_asserted(core: Core) -> None:
    core.open("assets:days")
    for day, amount in (("2026-01-10", 100), ("2026-02-10", 50)):
        core.ask("POST", TRANSACTIONS, {**moving(amount, "assets:days", SHOP), "date": day})
    path = "/api/ledger/accounts/assets:days"
    assert core.ask("GET", f"{path}?as_of=2026-01-31").body["balances"]["posted"] == "100"
    listed = core.ask("GET", "/api/ledger/accounts?as_of=2026-01-31").body["items"]
    assert next(one for one in listed if one["id"] == "assets:days")["balances"]["posted"] == "100"
    right = core.ask("POST", f"{path}/assertions", {"date": "2026-02-28", "amount": "150"})
    wrong = core.ask("POST", f"{path}/assertions", {"date": "2026-01-31", "amount": "90"})
    assert (right.status, right.body["holds"]) == (201, True)
    assert (wrong.status, wrong.body["holds"], wrong.body["off_by"]) == (201, False, "-10")
    listed = core.ask("GET", f"{path}/assertions?limit=1").body
    assert listed["items"] == [wrong.body]
    rest = core.ask("GET", f"{path}/assertions?limit=1&cursor={listed['next_cursor']}").body
    assert rest == {"items": [right.body], "next_cursor": None}
    assert (
        core.ask("POST", f"{path}/assertions", {"date": "2026-01-31", "amount": "0"}).body["off_by"] == "-100"
    )


# ---- batches ----


def batch(*amounts: int, **more: Any) -> dict[str, Any]:
    return {"transactions": [moving(amount, CASH, SHOP) for amount in amounts], **more}


def test_each_of_a_batch_has_its_own_answer_and_the_same_key_gets_the_same(core: Core) -> None:
    body = batch(1, 2, 3)
    body["transactions"][1]["postings"][0]["account"] = "assets:nobody"
    body["transactions"][2]["date"] = "2026-02-30"
    first = core.ask("POST", f"{TRANSACTIONS}/batch", body, Idempotency_Key="batch-1")
    assert (first.status, first.body["done"], first.body["refused"]) == (200, 1, 2)
    booked, refused, malformed = first.body["results"]
    assert (booked["status"], refused["problem"]["type"]) == (201, "/problems/unknown-account")
    assert malformed["problem"]["errors"] == [{"pointer": "/transactions/2/date", "reason": "malformed"}]
    again = core.ask("POST", f"{TRANSACTIONS}/batch", body, Idempotency_Key="batch-1")
    assert again.body == first.body
    told = core.ask("GET", "/api/ledger/commands/batch-1").body
    assert (told["outcome"], told["answer"]["results"]) == ("done", [booked, refused])
    assert core.ask("GET", "/api/ledger/commands/batch-2").status == 404


def test_an_atomic_batch_is_booked_whole_or_not_at_all(core: Core) -> None:
    before = account(core, CASH)
    body = batch(1, 2, atomic=True)
    body["transactions"][1]["postings"][0]["account"] = "assets:nobody"
    refused = core.ask("POST", f"{TRANSACTIONS}/batch", body)
    assert problem(refused) == (422, "unknown-account", ["/transactions/1/postings/0/account"])
    assert account(core, CASH) == before
    whole = core.ask("POST", f"{TRANSACTIONS}/batch", batch(1, 2, atomic=True), Idempotency_Key="atomic")
    assert (whole.status, len(whole.body["items"])) == (201, 2)
    again = core.ask("POST", f"{TRANSACTIONS}/batch", batch(1, 2, atomic=True), Idempotency_Key="atomic")
    assert (again.body, again.headers["idempotent-replayed"]) == (whole.body, "true")


def test_the_largest_batch_is_taken_and_one_more_is_not(core: Core) -> None:
    largest = core.ask("POST", f"{TRANSACTIONS}/batch", batch(*[1] * 8_190), Idempotency_Key="largest")
    assert (largest.status, largest.body["done"]) == (200, 8_190)
    too_many = core.ask("POST", f"{TRANSACTIONS}/batch", batch(*[1] * 8_191))
    assert problem(too_many) == (422, "invalid-body", ["/transactions"])
    assert problem(core.ask("POST", f"{TRANSACTIONS}/batch", batch())) == (
        422,
        "invalid-body",
        ["/transactions"],
    )


# ---- plans ----


def test_a_budget_holds_from_its_month_until_another_is_said(core: Core) -> None:
    for month, amount in (("2026-03", "300"), ("2026-05", "500"), ("2026-06", None)):
        said = core.ask("PUT", f"/api/ledger/budgets?month={month}", {"account": FOOD, "amount": amount})
        assert (said.status, said.body["amount"]) == (200, amount)
    core.ask("POST", TRANSACTIONS, {**moving(120, FOOD, CASH), "date": "2026-04-15"})

    def meant(month: str) -> list[tuple[str, str, str]]:
        told = core.ask("GET", f"/api/ledger/budgets?month={month}").body
        assert told["items"] == core.ask("GET", f"/api/ledger/summary?month={month}").body["budgets"]
        return [(one["amount"], one["spent"], one["left"]) for one in told["items"]]

    assert [meant(f"2026-{n:02d}") for n in (2, 4, 5, 7)] == [
        [],
        [("300", "120", "180")],
        [("500", "0", "500")],
        [],
    ]
    refused = core.ask("PUT", "/api/ledger/budgets?month=2026-03", {"account": CASH, "amount": "1"})
    assert problem(refused) == (422, "not-a-category", ["/account"])


def test_what_comes_back_is_booked_on_its_days_and_missed_ones_are_made_up_for(core: Core) -> None:
    today = dt.date.today()  # noqa: DTZ011  the core's own calendar
    start = (today - dt.timedelta(days=2)).isoformat()
    entry = {"amount": "-5", "account": "assets:rent", "currency": "KRW", "category": "rent"}
    body = {"title": "Rent", "rule": {"unit": "day"}, "start": start, "entry": entry}
    item = core.ask("POST", "/api/ledger/recurring", body, Idempotency_Key="rent").body["id"]
    path = f"/api/ledger/recurring/{item}"

    def outcomes() -> list[tuple[str, str]]:
        return [(one["date"], one["outcome"]) for one in core.ask("GET", path).body["bookings"]]

    # Nobody has opened the account: each of the three days is refused, once, and says why.
    until(lambda: len(outcomes()) == 3, "three days to be asked for")
    assert {outcome for _, outcome in outcomes()} == {"refused"}
    assert core.ask("GET", path).body["bookings"][0]["slug"] == "unknown-account"
    core.open("assets:rent")
    other = core.ask("POST", "/api/ledger/recurring", {**body, "title": "Rent again"}).body["id"]
    path = f"/api/ledger/recurring/{other}"
    until(lambda: [outcome for _, outcome in outcomes()] == ["booked"] * 3, "three days to be booked")
    assert account(core, "assets:rent")["balances"]["posted"] == "-15"
    shown = core.ask("GET", path).body
    assert shown["upcoming"][0] == (today + dt.timedelta(days=1)).isoformat()
    assert other in [one["id"] for one in core.ask("GET", "/api/ledger/recurring").body["items"]]
    changed = {**body, "rule": {"unit": "month", "day": 31}}
    assert core.ask("PUT", path, changed).status == 200
    assert core.ask("GET", path).body["since"] >= start
    for one in (item, other):
        assert core.ask("DELETE", f"/api/ledger/recurring/{one}").status == 200
        assert problem(core.ask("DELETE", f"/api/ledger/recurring/{one}"))[:2] == (409, "recurring-ended")
    assert core.ask("GET", "/api/ledger/recurring").body["items"] == []


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"title": " "}, "/title"),
        ({"start": "2026-02-30"}, "/start"),
        ({"end": "2025-01-01"}, "/end"),
        ({"rule": {"unit": "hour"}}, "/rule/unit"),
        ({"rule": {"unit": "day", "every": 0}}, "/rule/every"),
        ({"rule": {"unit": "month", "day": 32}}, "/rule/day"),
        ({"rule": {"unit": "week", "weekday": "Monday"}}, "/rule/weekday"),
        ({"entry": None}, "/entry"),
        ({"entry": {"amount": "0", "account": CASH}}, "/entry/amount"),
    ],
)
def test_a_plan_that_could_never_be_booked_is_refused_with_its_place(
    core: Core, change: dict[str, Any], pointer: str
) -> None:
    entry = {"amount": "-5", "account": CASH}
    body = {"title": "Rent", "rule": {"unit": "day"}, "start": "2030-01-01", "entry": entry, **change}
    assert problem(core.ask("POST", "/api/ledger/recurring", body)) == (422, "invalid-body", [pointer])


# ---- bad input ----


def line(**change: Any) -> dict[str, Any]:
    body: dict[str, Any] = moving(1, CASH, SHOP)
    body["postings"][0].update(change)
    return body


def raw(text: str) -> bytes:
    return text.encode()


DEEP = b'{"date": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"
GOOD = json.dumps(moving(1, CASH, SHOP))


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (line(amount=1.5), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount=1), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount=None), (422, "invalid-body", ["/postings/0/amount"])),
        (raw(GOOD.replace('"1"', "NaN")), (400, "malformed-json", [])),
        (raw(GOOD.replace('"1"', "Infinity")), (400, "malformed-json", [])),
        (raw(GOOD.replace('"1"', "1e400")), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount="NaN"), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount="1e3"), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount="+1"), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount="１"), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount="1.5"), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount="9" * 40), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount="9" * 41), (422, "invalid-body", ["/postings/0/amount"])),
        (line(amount="2"), (422, "unbalanced", ["/postings"])),
        (line(account="assets:nobody"), (422, "unknown-account", ["/postings/0/account"])),
        (line(account="Assets"), (422, "invalid-body", ["/postings/0/account"])),
        (line(currency="USD"), (422, "unbalanced", ["/postings"])),
        (line(currency="won"), (422, "invalid-body", ["/postings/0/currency"])),
        (line(amount="1", colour="red"), (422, "invalid-body", ["/postings/0/colour"])),
        ({**line(), "date": "2026-02-29"}, (422, "invalid-body", ["/date"])),
        ({**line(), "date": "2026-13-01"}, (422, "invalid-body", ["/date"])),
        ({**line(), "date": 20260101}, (422, "invalid-body", ["/date"])),
        ({**line(), "description": "a\x00b"}, (422, "invalid-body", ["/description"])),
        ({**line(), "description": "a\x1bb"}, (422, "invalid-body", ["/description"])),
        ({**line(), "description": "x" * 2_001}, (422, "invalid-body", ["/description"])),
        ({**line(), "description": "x" * 10_000_000}, (413, "body-too-large", [])),
        ({**line(), "tags": ["x"] * 51}, (422, "invalid-body", ["/tags"])),
        ({**line(), "tags": "x"}, (422, "invalid-body", ["/tags"])),
        ({**line(), "state": "later"}, (422, "invalid-body", ["/state"])),
        ({**line(), "timeout_s": 5}, (422, "invalid-body", ["/timeout_s"])),
        ({**line(), "state": "pending", "timeout_s": 0}, (422, "invalid-body", ["/timeout_s"])),
        ({**line(), "state": "pending", "timeout_s": 10**12}, (422, "invalid-body", ["/timeout_s"])),
        ({**line(), "expected_versions": {CASH: -1}}, (422, "invalid-body", [f"/expected_versions/{CASH}"])),
        ({**line(), "expected_versions": {"A/b": 1}}, (422, "invalid-body", ["/expected_versions/A~1b"])),
        ({**line(), "postings": []}, (422, "invalid-body", ["/postings"])),
        ({**line(), "postings": line()["postings"] * 251}, (422, "invalid-body", ["/postings"])),
        (raw('{"date": "2026-01-01", "date": "2026-01-02"}'), (422, "invalid-body", ["/description"])),
        (raw(GOOD.replace('"date"', '"date": "2026-01-01", "date"')), (422, "invalid-body", ["/date"])),
        (raw(GOOD.replace("moved", "\\ud800")), (400, "malformed-json", [])),
        (GOOD.encode().replace(b"moved", b"\xed\xa0\x80"), (400, "malformed-json", [])),
        (GOOD.encode().replace(b"moved", b"\xff"), (400, "malformed-json", [])),
        (DEEP, (422, "invalid-body", ["/date"])),
        (b"", (400, "malformed-json", [])),
        (b"null", (422, "invalid-body", [""])),
        (b"[]", (422, "invalid-body", [""])),
        (b"{", (400, "malformed-json", [])),
    ],
)  # fmt: skip
def test_bad_input_is_told_what_is_wrong_with_it_and_where(core: Core, body: Any, told: object) -> None:
    assert problem(core.ask("POST", TRANSACTIONS, body)) == told


def test_a_closed_account_and_another_currency_are_named(core: Core) -> None:
    core.open("assets:closed")
    core.ask("POST", "/api/ledger/accounts/assets:closed/close")
    closed = core.move(1, "assets:closed", SHOP)
    assert problem(closed) == (422, "account-closed", ["/postings/0/account"])
    dollars = moving(1, CASH, SHOP)
    for posting in dollars["postings"]:
        posting["currency"] = "USD"
    other = core.ask("POST", TRANSACTIONS, dollars)
    assert problem(other)[:2] == (422, "currency-differs")


@pytest.mark.parametrize(
    ("path", "pointer"),
    [
        (f"{TRANSACTIONS}?state=lost", "?state"),
        (f"{TRANSACTIONS}?limit=501", "?limit"),
        (f"{TRANSACTIONS}?cursor=x", "?cursor"),
        (f"{TRANSACTIONS}?colour=red", "?colour"),
        ("/api/ledger/accounts?as_of=2026-02-30", "?as_of"),
        (f"/api/ledger/accounts/{CASH}?as_of=now", "?as_of"),
        ("/api/ledger/budgets?month=2026-13", "?month"),
        ("/api/ledger/recurring?cursor=x", "?cursor"),
    ],
)
def test_a_parameter_that_can_not_be_used_is_named(core: Core, path: str, pointer: str) -> None:
    assert problem(core.ask("GET", path)) == (400, "invalid-parameter", [pointer])
