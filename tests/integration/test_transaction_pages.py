"""The full form and the page of a transaction: what a person types in double entry, and what may be done with it after."""

from collections.abc import Iterator

import pytest

from tests.integration.lone_core import Core, ready, started
from tests.integration.test_pages import Page, begin, get, post


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Core]:
    """One ledger for all of them: each looks at what it wrote itself."""
    with started(tmp_path_factory.mktemp("book") / "data") as made:
        ready(made)
        begin(made)
        yield made


@pytest.fixture
def ids(core: Core) -> dict[str, str]:
    return {one["name"]: one["id"] for one in core.ask("GET", "/api/ledger/accounts").body["items"]}


def fields(*lines: tuple[str, str, str], **more: str) -> dict[str, str]:
    """A filled-in form; a line is an account, an amount in and an amount out."""
    told = {"description": "나눠 낸 저녁", "date": "2026-11-21", "state": "posted"}
    for at, (account, debit, credit) in enumerate(lines):
        told |= {
            f"account_{at}": f"{account} KRW" if account else "",
            f"debit_{at}": debit,
            f"credit_{at}": credit,
        }
    return told | more


def written(core: Core, ids: dict[str, str], **more: str) -> str:
    """Write a transaction of three lines and return the path of its page."""
    lines = ((ids["식비"], "30,000", ""), (ids["신용카드"], "", "20,000"), (ids["현금"], "", "10000"))
    page = post(core, "/transactions", fields(*lines, **more))
    assert page.status == 303, page.text
    return page.headers["location"]


def told(core: Core, path: str) -> dict[str, object]:
    body: dict[str, object] = core.ask("GET", f"/api/ledger{path}").body
    return body


def test_what_is_typed_line_by_line_is_one_transaction_with_a_page_of_its_own(
    core: Core, ids: dict[str, str]
) -> None:
    path = written(core, ids)
    assert [(line["account"], line["amount"]) for line in told(core, path)["postings"]] == [  # type: ignore[attr-defined]
        (ids["식비"], "30000"),
        (ids["신용카드"], "-20000"),
        (ids["현금"], "-10000"),
    ]
    page = get(core, path, Accept_Language="ko").text
    assert "나눠 낸 저녁" in page
    assert page.count("30,000원") == 1
    assert path in get(core, "/register", Accept_Language="ko").text


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        ((("식비", "10", ""), ("현금", "", "")), "debit_1"),
        ((("식비", "10", ""), ("", "", "10")), "account_1"),
        ((("식비", "10", "10"), ("현금", "", "10")), "credit_0"),
        ((("식비", "10", ""),), "account_1"),
        ((("식비", "ten", ""), ("현금", "", "10")), "debit_0"),
        ((("식비", "10", ""), ("현금", "", "10.5")), "credit_1"),
        ((("식비", "10", ""), ("nobody", "", "10")), "account_1"),
    ],
)
def test_a_fault_is_told_at_its_line_with_everything_still_there(
    core: Core, ids: dict[str, str], lines: tuple[tuple[str, str, str], ...], fault: str
) -> None:
    named = [(ids.get(name, name), debit, credit) for name, debit, credit in lines]
    page = post(core, "/transactions", fields(*named), Accept_Language="ko")
    assert page.status == 422, page.text
    told_at = [
        part.split('"')[0] for part in page.text.split('data-fault="')[1:] if part.split(">")[1].split("<")[0]
    ]
    assert told_at == [fault]
    assert 'value="나눠 낸 저녁"' in page.text


def test_two_sides_that_differ_are_told_by_how_much(core: Core, ids: dict[str, str]) -> None:
    page = post(
        core, "/transactions", fields((ids["식비"], "10", ""), (ids["현금"], "", "7")), Accept_Language="ko"
    )
    assert page.status == 422
    assert "3" in page.text.split('role="status">')[-1]


def test_a_transaction_is_reversed_once_and_both_say_so(core: Core, ids: dict[str, str]) -> None:
    path = written(core, ids)
    back = post(core, f"{path}/reverse", {})
    assert back.status == 303
    assert "/reverse" not in get(core, path).text
    assert back.headers["location"] in get(core, path).text
    assert path in get(core, back.headers["location"]).text
    assert "/reverse" not in get(core, back.headers["location"]).text
    assert post(core, f"{path}/reverse", {}).status == 409


def test_pending_money_is_held_then_booked_or_given_up(core: Core, ids: dict[str, str]) -> None:
    kept, given_up = (written(core, ids, state="pending") for _ in range(2))
    assert told(core, kept)["state"] == "pending"
    assert kept in get(core, "/").text
    assert "대기" in get(core, "/accounts", Accept_Language="ko").text
    booked = post(core, f"{kept}/post", {})
    assert booked.status == 303
    assert told(core, booked.headers["location"])["pending"] == kept.rpartition("/")[2]
    assert post(core, f"{given_up}/void", {}).status == 303
    assert told(core, given_up)["state"] == "voided"
    assert kept not in get(core, "/").text
    again = post(core, f"{kept}/void", {}, Accept="application/json")
    assert (again.status, again.json["type"]) == (409, "/problems/pending-posted")


def test_an_entry_s_transaction_leads_to_its_entry_and_is_not_reversed_by_itself(
    core: Core, ids: dict[str, str]
) -> None:
    body = {"date": "2026-11-21", "amount": "-900", "account": ids["현금"], "description": "버스"}
    entry = core.ask("POST", "/api/ledger/entries", body).body
    assert f"/transactions/{entry['transaction']}" in get(core, f"/entries/{entry['id']}").text
    page = get(core, f"/transactions/{entry['transaction']}")
    assert f'href="/entries/{entry["id"]}"' in page.text
    assert "/reverse" not in page.text


def test_a_transaction_that_is_not_there_is_a_calm_page(core: Core) -> None:
    page: Page = get(core, "/transactions/none", Accept_Language="ko")
    assert page.status == 404
    assert "<h1" in page.text


def moved(ids: dict[str, str], **other: str) -> dict[str, str]:
    """The form of an entry, with money moved from the bank into a purse."""
    told = {"kind": "move", "description": "현금 찾기", "amount": "30,000", "date": "2026-11-21"}
    return told | {"account": ids["생활비 통장"], "to": f"{ids['현금']} KRW"} | other


def test_money_is_moved_without_a_script_and_is_nothing_earned_or_spent(
    core: Core, ids: dict[str, str]
) -> None:
    before = len(core.ask("GET", "/api/ledger/entries?limit=500").body["items"])
    key = {"_idempotency_key": "move-1"}
    assert [post(core, "/entries", moved(ids, **key)).status for _ in range(2)] == [303, 303]
    found = core.ask("GET", "/api/ledger/transactions?limit=500").body["items"]
    (made,) = [one for one in found if one["description"] == "현금 찾기"]
    assert [(line["account"], line["amount"]) for line in made["postings"]] == [
        (ids["현금"], "30000"),
        (ids["생활비 통장"], "-30000"),
    ]
    assert len(core.ask("GET", "/api/ledger/entries?limit=500").body["items"]) == before


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"to": ""}, "받는 계좌를 골라 주세요."),
        ({"to": "생활비 통장"}, "보내는 계좌와 다른 계좌를 골라 주세요."),
        ({"to": "assets:nobody KRW"}, "없는 계좌예요."),
        ({"to": "현금", "amount": "lots"}, "금액은 숫자로 적어 주세요."),
        ({"to": "현금", "amount": "0"}, "0"),
    ],
    ids=["nowhere", "to itself", "to nobody", "no amount", "nothing"],
)
def test_what_is_wrong_with_moved_money_is_said_at_its_field_with_all_that_was_typed(
    core: Core, ids: dict[str, str], wrong: dict[str, str], sentence: str
) -> None:
    to = wrong["to"]
    page = post(
        core,
        "/entries",
        moved(ids, **wrong | {"to": f"{ids[to]} KRW" if to in ids else to}),
        Accept_Language="ko",
    )
    assert page.status == 422
    field = "amount" if "amount" in wrong else "to"
    assert sentence in page.text.split(f'data-fault="{field}">')[1].partition("</p>")[0]
    assert 'value="move" checked' in page.text
    assert 'value="현금 찾기"' in page.text


def test_what_was_earned_is_read_as_it_is_said_above_and_its_register_stays_when_the_days_change(
    core: Core, ids: dict[str, str]
) -> None:
    entry = {"kind": "in", "description": "월급", "amount": "3,000,000", "account": ids["생활비 통장"]}
    post(core, "/entries", entry | {"category": "급여", "date": "2026-11-10"})
    page = get(core, f"/register?account={ids['급여']}", Accept_Language="ko").text
    assert page.count("3,000,000원") == 3  # above, in the line, and behind it
    assert "−" not in page.split("<tbody")[1].partition("</tbody>")[0]
    assert f'<option value="{ids["급여"]}" selected>급여</option>' in page
