"""The page of plans: a budget is set, seen and ended; what comes back is written down once, and its days are told."""

import datetime as dt
import re
from collections.abc import Iterator

import pytest

from tests.integration.lone_core import Core, ready, started
from tests.integration.test_pages import begin, get, post
from tests.waiting import until


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Core]:
    with started(tmp_path_factory.mktemp("plans") / "data", CORE_SCHEDULE_EVERY_MS="20") as made:
        ready(made)
        begin(made)
        yield made


@pytest.fixture
def ids(core: Core) -> dict[str, str]:
    return {one["name"]: one["id"] for one in core.ask("GET", "/api/ledger/accounts").body["items"]}


def words(page: str) -> str:
    """What stands on a page, without its marks."""
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", page))


def test_a_budget_holds_from_its_month_on_and_says_what_is_left(core: Core, ids: dict[str, str]) -> None:
    spent = {
        "date": "2026-11-03",
        "amount": "-30000",
        "account": ids["현금"],
        "category": "식비",
        "currency": "KRW",
    }
    assert core.ask("POST", "/api/ledger/entries", spent).status == 201
    wish = {"month": "2026-11", "budget_account": ids["식비"], "budget_amount": "300,000"}
    assert post(core, "/plans/budgets", wish).headers["location"] == "/plans?month=2026-11"
    now = words(get(core, "/plans?month=2026-11", Accept_Language="ko").text)
    assert "30,000원 / 300,000원" in now
    assert "남은 예산 270,000원" in now
    assert "/ 300,000원" in words(get(core, "/plans?month=2027-03", Accept_Language="ko").text)
    assert "/ 300,000원" not in words(get(core, "/plans?month=2026-10", Accept_Language="ko").text)
    post(core, "/plans/budgets", wish | {"budget_amount": "20000"})
    assert "예산보다 10,000원 더 썼어요" in words(
        get(core, "/plans?month=2026-11", Accept_Language="ko").text
    )
    post(core, "/plans/budgets", wish | {"budget_amount": ""})
    assert "20,000원" not in words(get(core, "/plans?month=2026-11", Accept_Language="ko").text)


def test_what_comes_back_is_booked_on_its_days_and_each_of_them_is_told(
    core: Core, ids: dict[str, str]
) -> None:
    start = dt.date.today() - dt.timedelta(days=1)  # noqa: DTZ011  the core goes by the same calendar
    wish = {
        "title": "신문", "kind": "out", "money": "1,500", "from": f"{ids['생활비 통장']} KRW", "category": "여가",
        "unit": "day", "every": "1", "start": start.isoformat(), "end": "",
    }  # fmt: skip
    assert post(core, "/plans/recurring", wish).status == 303
    (item,) = core.ask("GET", "/api/ledger/recurring").body["items"]
    path = f"/plans/recurring/{item['id']}"
    until(
        lambda: get(core, path, Accept_Language="ko").text.count("/entries/") == 2, "both days to be booked"
    )
    listed = words(get(core, "/plans", Accept_Language="ko").text)
    assert "신문 날마다 · 다음" in listed
    assert "−1,500원" in listed
    assert post(core, f"{path}/end", {}).headers["location"] == "/plans"
    assert "신문" not in words(get(core, "/plans", Accept_Language="ko").text)
    assert "끝냈어요" in get(core, path, Accept_Language="ko").text


@pytest.mark.parametrize(
    ("path", "changed", "field"),
    [
        ("/plans/budgets", {"budget_amount": "many"}, "budget_amount"),
        ("/plans/budgets", {"budget_account": "nobody", "budget_amount": "1"}, "budget_account"),
        ("/plans/recurring", {"title": ""}, "title"),
        ("/plans/recurring", {"every": "0"}, "every"),
        ("/plans/recurring", {"start": "2026-02-30"}, "start"),
        ("/plans/recurring", {"end": "2020-01-01"}, "end"),
    ],
)
def test_a_fault_is_told_at_its_field(
    core: Core, ids: dict[str, str], path: str, changed: dict[str, str], field: str
) -> None:
    fields = {
        "month": "2026-11", "budget_account": ids["교통"], "budget_amount": "5", "title": "월세", "kind": "out",
        "money": "10", "from": f"{ids['현금']} KRW", "unit": "month", "every": "1", "start": "2026-11-01", "end": "",
    }  # fmt: skip
    page = post(core, path, fields | changed, Accept_Language="ko")
    assert page.status == 422, page.text
    told = [
        part.split('"')[0] for part in page.text.split('data-fault="')[1:] if part.split(">")[1].split("<")[0]
    ]
    assert told == [field]


def test_a_month_or_an_item_that_is_not_there_is_a_calm_page(core: Core) -> None:
    assert get(core, "/plans?month=2026-13").status == 404
    assert get(core, "/plans/recurring/none").status == 404


def test_what_the_bank_says_is_held_against_the_book_and_remembered(core: Core, ids: dict[str, str]) -> None:
    account = ids["신용카드"]
    spent = {"date": "2026-11-05", "amount": "-7000", "account": account, "category": "외식"}
    assert core.ask("POST", "/api/ledger/entries", spent).status == 201
    path, back = f"/accounts/{account}/balance", f"/register?account={account}"
    assert post(core, path, {"date": "2026-11-30", "amount": "-7,000"}).headers["location"] == back
    assert "장부와 맞았어요" in words(get(core, back, Accept_Language="ko").text)
    post(core, path, {"date": "2026-11-30", "amount": "-8000"})
    assert "장부에는 −7,000원" in words(get(core, back, Accept_Language="ko").text)
    wrong = post(core, path, {"date": "2026-02-30", "amount": "1"}, Accept_Language="ko")
    assert wrong.status == 422
    assert "달력에 있는 날짜" in wrong.text


def test_the_overview_says_when_the_whole_ledger_was_proven(core: Core) -> None:
    until(lambda: "장부를 모두 확인" in get(core, "/", Accept_Language="ko").text, "the proof to be told")
    assert core.ask("GET", "/api/ledger/verify").body["ok"]
    events = core.ask("GET", "/healthz").body["seq"]
    assert f"just now. Records until then: {events}" in words(get(core, "/", Accept_Language="en").text)
