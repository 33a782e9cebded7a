"""Entries over real HTTP, on a core that runs alone."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.integration.lone_core import Answer, Core, ready, started

ENTRIES = "/api/ledger/entries"
LUNCH = {"date": "2026-11-21", "amount": "-12000", "account": "bank", "category": "식비"}
HOSTILE = "<script>alert(1)</script>\u202e"


@pytest.fixture
def core(tmp_path: Path) -> Iterator[Core]:
    with started(tmp_path / "data") as made:
        ready(made).open("bank")
        yield made


def wrong(answer: Answer, status: int, slug: str, *pointers: str) -> None:
    assert (answer.status, answer.body["type"]) == (status, f"/problems/{slug}"), answer.body
    assert [fault["pointer"] for fault in answer.body.get("errors", [])] == list(pointers)


def get(core: Core, path: str) -> Any:
    answer = core.ask("GET", f"/api/ledger/{path}")
    assert answer.status == 200, answer.body
    return answer.body


def test_an_entry_is_written_changed_read_and_reversed(core: Core) -> None:
    made = core.ask("POST", ENTRIES, LUNCH | {"description": HOSTILE, "tags": ["집"]}, Idempotency_Key="k1")
    assert made.status == 201
    one = f"{ENTRIES}/{made.body['id']}"
    assert core.ask("GET", one).body == made.body
    assert (made.body["amount"], made.body["currency"], made.body["account_name"]) == (
        "-12000",
        "KRW",
        "bank",
    )
    assert (made.body["description"], made.body["category"]) == (HOSTILE, "식비")
    changed = core.ask("PUT", one, LUNCH | {"amount": "-9000"}, Idempotency_Key="k2")
    assert (changed.status, changed.body["id"]) == (200, made.body["id"])
    assert core.ask("PUT", one, LUNCH | {"amount": "-9000.0"}, Idempotency_Key="k2").status == 200
    assert get(core, "accounts/bank")["balances"]["posted"] == "-9000"
    gone = core.ask("DELETE", one, Idempotency_Key="k3")
    assert (gone.status, gone.body["reverses"]) == (200, changed.body["transaction"])
    again = core.ask("DELETE", one, Idempotency_Key="k3")
    assert (again.body, again.headers["idempotent-replayed"]) == (gone.body, "true")
    wrong(core.ask("DELETE", one), 409, "entry-reversed", "")
    wrong(core.ask("PUT", one, LUNCH), 409, "entry-reversed", "")
    wrong(core.ask("GET", one), 404, "entry-not-found")
    nobody = "0" * 36
    wrong(core.ask("PUT", f"{ENTRIES}/{nobody}", LUNCH), 404, "entry-not-found", "")
    for path in ("nothing", "%00", "%ff", "x" * 5_000):
        wrong(core.ask("DELETE", f"{ENTRIES}/{path}"), 404, "entry-not-found")
    assert len(get(core, "transactions")["items"]) == 4
    assert get(core, "verify")["ok"]


def test_who_changes_what_somebody_else_changed_first_is_told_and_nothing_is_done(core: Core) -> None:
    made = core.ask("POST", ENTRIES, LUNCH).body
    one = f"{ENTRIES}/{made['id']}"
    first = LUNCH | {"amount": "-1", "expected_seq": made["seq"]}
    changed = core.ask("PUT", one, first, Idempotency_Key="k1")
    assert changed.status == 200
    late = LUNCH | {"amount": "-2", "expected_seq": made["seq"]}
    wrong(core.ask("PUT", one, late, Idempotency_Key="k2"), 409, "entry-changed", "/expected_seq")
    wrong(core.ask("DELETE", one, {"expected_seq": made["seq"]}), 409, "entry-changed", "/expected_seq")
    assert core.ask("GET", one).body == changed.body
    wrong(core.ask("DELETE", one, {"expected_seq": 0}), 422, "invalid-body", "/expected_seq")
    wrong(core.ask("PUT", one, LUNCH | {"expected_seq": 1 << 53}), 422, "invalid-body", "/expected_seq")
    assert core.ask("DELETE", one, {"expected_seq": changed.body["seq"]}).status == 200
    again = core.ask("PUT", one, first, Idempotency_Key="k1")
    assert (again.status, again.body, again.headers["idempotent-replayed"]) == (200, changed.body, "true")


def test_a_key_of_an_entry_is_looked_up_like_any_other(core: Core) -> None:
    made = core.ask("POST", ENTRIES, LUNCH, Idempotency_Key="k1")
    found = get(core, "commands/k1")
    assert (found["outcome"], found["status"], found["answer"]) == ("done", 201, made.body)
    wrong(core.ask("POST", ENTRIES, LUNCH | {"amount": "-1"}, Idempotency_Key="k1"), 422, "key-reused")


def test_faults_of_an_entry_name_their_fields(core: Core) -> None:
    def refused(status: int, slug: str, *pointers: str, **changes: Any) -> None:
        wrong(core.ask("POST", ENTRIES, LUNCH | changes), status, slug, *pointers)

    refused(422, "invalid-body", "/date", date="2026-02-30")
    refused(422, "invalid-body", "/date", "/amount", date="", amount="0")
    refused(422, "invalid-body", "/amount", amount="12.5")
    refused(422, "invalid-body", "/amount", amount=-12000)
    refused(422, "invalid-body", "/origin", origin={"import": "i", "row": 1, "fingerprint": "0" * 32})
    refused(422, "invalid-body", "/category", category="a\nb")
    refused(422, "unknown-account", "/account", account="nobody")
    refused(422, "currency-differs", "/currency", currency="USD")
    refused(422, "currency-needed", "/currency", account=None, payment_method="현금")
    assert get(core, "events?after=1")["items"] == []


def test_categories_and_ways_of_paying_are_made_on_first_use(core: Core) -> None:
    paid = {"date": "2026-11-21", "amount": "-100", "payment_method": "현금", "currency": "KRW"}
    first = core.ask("POST", ENTRIES, paid | {"category": "교통"}).body
    again = core.ask("POST", ENTRIES, paid | {"category": " 교통 "} | {"currency": None}).body
    assert (first["account"], first["category_account"]) == (again["account"], again["category_account"])
    assert {one["name"] for one in get(core, "categories")["items"]} == {"교통"}
    assert get(core, f"accounts/{first['account']}")["balances"]["posted"] == "-200"


def test_lists_come_in_pages_and_refuse_what_they_do_not_know(core: Core) -> None:
    for day in range(1, 8):
        core.ask("POST", ENTRIES, LUNCH | {"date": f"2026-11-{day:02d}", "amount": str(-day)})
    for path, items in (("entries?", 7), ("register?account=bank&", 7), ("register?", 7)):
        first = get(core, f"{path}limit=4")
        rest = get(core, f"{path}limit=4&cursor={first['next_cursor']}")
        assert (len(first["items"]), len(rest["items"]), rest["next_cursor"]) == (4, items - 4, None)
        days = [item["date"] for item in (*first["items"], *rest["items"])]
        assert days == sorted(days, reverse=True)
    assert [line["balance"] for line in get(core, "register?account=bank&limit=2")["items"]] == ["-28", "-21"]
    found = get(core, "register?q=%EC%8B%9D%EB%B9%84&from=2026-11-02&to=2026-11-03")
    assert [line["amount"] for line in found["items"]] == ["-3", "-2"]
    for path in ("entries?cursor=s1", "register?from=1", "summary?month=2026-13", "categories?q=x"):
        assert core.ask("GET", f"/api/ledger/{path}").status == 400
    assert core.ask("DELETE", ENTRIES).status == 405


def test_a_summary_is_of_the_month_that_is_asked_for_or_of_today(core: Core) -> None:
    core.ask("POST", ENTRIES, LUNCH)
    asked = get(core, "summary?month=2026-11")
    assert asked["currencies"] == [{"currency": "KRW", "income": "0", "expense": "12000", "net": "-12000"}]
    assert asked["categories"][0]["share_percent"] == 100
    assert get(core, "summary?month=1999-01")["categories"] == []
    assert len(get(core, "summary")["month"]) == 7


def test_entries_outlive_their_core(tmp_path: Path) -> None:
    with started(tmp_path / "data") as core:
        ready(core).open("bank")
        made = core.ask("POST", ENTRIES, LUNCH, Idempotency_Key="k").body
        core.process.kill()
    with started(tmp_path / "data") as heir:
        assert ready(heir).ask("POST", ENTRIES, LUNCH, Idempotency_Key="k").body == made
        assert heir.ask("GET", f"{ENTRIES}/{made['id']}").body == made
        assert get(heir, "verify")["ok"]
