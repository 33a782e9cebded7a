"""The household's pages over real HTTP, as a browser without scripts and as the page's script ask for them."""

import http.client
import json
import re
import urllib.parse
from collections.abc import Iterator
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from tests import waiting
from tests.integration.lone_core import Core, ready, started

HOSTILE = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>{{7*7}}"
FIRST_LOAD_BYTES_MAX = 100_000


@dataclass
class Page:
    status: int
    headers: dict[str, str]
    text: str

    @property
    def json(self) -> Any:
        return json.loads(self.text)


class Elements(HTMLParser):
    """What elements a page has, and which words stand in it."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.words.append(data.strip())

    def field(self, name: str) -> str:
        return next(str(attrs.get("value")) for tag, attrs in self.found if attrs.get("name") == name)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return tmp_path / "data"


@pytest.fixture
def core(data: Path) -> Iterator[Core]:
    with started(data) as made:
        yield ready(made)


def ask(core: Core, method: str, path: str, body: bytes | None = None, **headers: str) -> Page:
    connection: http.client.HTTPConnection = core.connect()
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body, {"Accept": "text/html", **named})
    response = connection.getresponse()
    text = response.read().decode()
    connection.close()
    return Page(response.status, {name.lower(): value for name, value in response.getheaders()}, text)


def get(core: Core, path: str, **headers: str) -> Page:
    return ask(core, "GET", path, None, **headers)


def post(core: Core, path: str, fields: dict[str, str], **headers: str) -> Page:
    body = urllib.parse.urlencode(fields).encode()
    return ask(core, "POST", path, body, Content_Type="application/x-www-form-urlencoded", **headers)


def begin(core: Core, lang: str = "ko", currency: str = "KRW") -> str:
    """Open the example accounts and return the id of the bank account."""
    made = post(core, "/start", {"currency": currency, "_idempotency_key": "start"}, Accept_Language=lang)
    assert made.status == 303
    named = {one["name"]: one["id"] for one in core.ask("GET", "/api/ledger/accounts").body["items"]}
    return str(named["생활비 통장" if lang == "ko" else "Bank account"])


def lunch(account: str, **other: str) -> dict[str, str]:
    fields = {"kind": "out", "description": "점심", "amount": "9,000", "account": account, "category": "식비"}
    return {**fields, "date": "2026-11-21", "_idempotency_key": "k1", **other}


def entries(core: Core) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = core.ask("GET", "/api/ledger/entries").body["items"]
    return found


def test_every_page_comes_with_a_policy_that_nothing_in_it_breaks(core: Core) -> None:
    account = begin(core)
    post(core, "/entries", lunch(account))
    entry = entries(core)[0]["id"]
    for path in (
        "/",
        "/register",
        f"/register?account={account}",
        "/accounts",
        "/import",
        f"/entries/{entry}",
    ):
        for lang in ("ko", "en"):
            page = get(core, path, Accept_Language=lang)
            assert page.status == 200, path
            policy = page.headers["content-security-policy"]
            assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self';")
            assert "unsafe" not in policy
            assert page.headers["cache-control"] == "no-store"
            assert page.headers["x-content-type-options"] == "nosniff"
            assert f'<html lang="{lang}">' in page.text
            for tag, attrs in Elements(page.text).found:
                assert tag != "style"
                assert tag != "script" or attrs["src"], path
                assert not [name for name in attrs if name == "style" or name.startswith("on")], (path, tag)


def test_an_empty_start_offers_three_ways_and_example_accounts_are_made_once(core: Core) -> None:
    empty = get(core, "/", Accept_Language="en")
    assert "Start with example accounts" in empty.text
    assert 'href="/import"' in empty.text
    begin(core)
    once = core.ask("GET", "/api/ledger/accounts").body["items"]
    assert {one["name"] for one in once} >= {"현금", "생활비 통장", "신용카드", "급여", "식비"}
    begin(core)
    post(core, "/start", {"currency": "KRW", "_idempotency_key": "other"}, Accept_Language="ko")
    assert core.ask("GET", "/api/ledger/accounts").body["items"] == once


def test_a_form_begins_with_the_account_used_last_in_this_browser_else_with_the_first_made(
    core: Core,
) -> None:
    bank = begin(core)
    for name in ("가나다", "하하하"):
        core.ask(
            "POST",
            "/api/ledger/accounts",
            {"name": name, "type": "asset", "currency": "KRW", "id": f"a:{ord(name[0])}"},
        )
    page = get(core, "/").text
    assert chosen(page) == bank
    # What one has before what one owes, then by name, in every list alike.
    names = ["가나다 (KRW)", "생활비 통장 (KRW)", "하하하 (KRW)", "현금 (KRW)", "신용카드 (KRW)"]
    # Once to choose what it is booked on, once to choose where money is moved to.
    assert [word for word in Elements(page).words if word.endswith("(KRW)")] == names * 2
    used = post(core, "/entries", lunch("a:44032"))
    cookie = used.headers["set-cookie"].partition(";")[0]
    assert chosen(get(core, "/", Cookie=cookie).text) == "a:44032"
    assert chosen(get(core, "/").text) == bank
    assert chosen(get(core, "/", Cookie="account=a:no-longer").text) == bank


def chosen(page: str) -> str:
    """Return the account that the form of an entry begins with."""
    options = [attrs for tag, attrs in Elements(page).found if tag == "option" and "selected" in attrs]
    return str(options[0]["value"])


def test_a_form_without_scripts_books_once_however_often_it_is_sent(core: Core) -> None:
    account = begin(core)
    for _ in range(2):
        sent = post(core, "/entries", lunch(account))
        assert (sent.status, sent.headers["location"]) == (303, "/")
    assert [(one["amount"], one["description"]) for one in entries(core)] == [("-9000", "점심")]
    page = get(core, "/", Accept_Language="ko")
    assert "점심" in page.text
    assert "−9,000원" in page.text


def test_the_script_of_a_page_sends_the_same_form_and_is_answered_in_json(core: Core) -> None:
    account = begin(core)
    fields = {name: value for name, value in lunch(account).items() if name != "_idempotency_key"}
    sent = post(
        core, "/entries", fields, Accept="application/json", Idempotency_Key="s1", Accept_Language="ko"
    )
    assert (sent.status, sent.json["said"]) == (201, "저장했어요")
    assert sent.json["id"] == entries(core)[0]["id"]
    wrong = post(
        core, "/entries", {**fields, "amount": "12x", "date": "2026-02-30"}, Accept="application/json"
    )
    assert (wrong.status, wrong.headers["content-type"]) == (422, "application/problem+json")
    assert set(wrong.json["faults"]) == {"amount", "date"}
    assert len(entries(core)) == 1


def test_faults_are_told_at_their_fields_and_what_was_typed_is_still_there(core: Core) -> None:
    account = begin(core)
    wrong = post(core, "/entries", lunch(account, amount="많이", description=HOSTILE), Accept_Language="ko")
    assert wrong.status == 422
    assert "금액은 숫자로 적어 주세요" in wrong.text
    shown = Elements(wrong.text)
    assert shown.field("amount") == "많이"
    assert shown.field("description") == HOSTILE
    assert shown.field("_idempotency_key") != "k1"
    assert not entries(core)


def test_a_key_that_was_used_for_another_wish_is_said_and_books_nothing_twice(core: Core) -> None:
    account = begin(core)
    post(core, "/entries", lunch(account))
    other = post(core, "/entries", lunch(account, amount="10"), Accept_Language="en")
    assert other.status == 422
    assert len(entries(core)) == 1


def test_changing_an_entry_keeps_what_its_form_does_not_show(core: Core) -> None:
    account = begin(core)
    body = {"date": "2026-11-20", "amount": "-100", "account": account, "description": "a", "tags": ["trip"]}
    made = core.ask("POST", "/api/ledger/entries", body).body
    seen = Elements(get(core, f"/entries/{made['id']}").text)
    assert (seen.field("amount"), seen.field("date")) == ("100", "2026-11-20")
    changed = post(core, f"/entries/{made['id']}", lunch(account, kind="in", amount="1,250"))
    assert (changed.status, changed.headers.get("location")) == (303, "/register"), changed.text
    now = core.ask("GET", f"/api/ledger/entries/{made['id']}").body
    assert (now["amount"], now["description"], now["tags"]) == ("1250", "점심", ["trip"])
    wrong = post(core, f"/entries/{made['id']}", lunch(account, date="x", _idempotency_key="k2"))
    assert (wrong.status, Elements(wrong.text).field("date")) == (422, "x")


def test_a_deleted_entry_leaves_the_register_and_stays_on_record(core: Core) -> None:
    account = begin(core)
    post(core, "/entries", lunch(account))
    entry = entries(core)[0]["id"]
    events = len(core.ask("GET", "/api/ledger/events").body["items"])
    assert post(core, f"/entries/{entry}/delete", {"_idempotency_key": "d"}).status == 303
    assert "점심" not in get(core, "/register").text
    assert get(core, f"/entries/{entry}").status == 404
    assert len(core.ask("GET", "/api/ledger/events").body["items"]) == events + 1
    assert core.ask("GET", "/api/ledger/verify").body["ok"] is True


def test_a_change_of_what_somebody_else_changed_first_shows_both_and_books_after_a_second_look(
    core: Core,
) -> None:
    account = begin(core)
    post(core, "/entries", lunch(account))
    path = f"/entries/{entries(core)[0]['id']}"
    seen = Elements(get(core, path).text).field("expected_seq")
    first = lunch(account, amount="101", expected_seq=seen, _idempotency_key="q")
    assert post(core, path, first).status == 303
    late = lunch(account, amount="202", expected_seq=seen, _idempotency_key="a")
    told = post(core, path, late, Accept_Language="ko")
    assert told.status == 409
    assert "다른 화면에서 먼저 바꿨어요" in told.text
    assert "−101원" in told.text
    again = Elements(told.text)
    assert again.field("amount") == "202"
    assert entries(core)[0]["amount"] == "-101"
    late |= {"expected_seq": again.field("expected_seq"), "_idempotency_key": "b"}
    assert post(core, path, late).status == 303
    assert entries(core)[0]["amount"] == "-202"
    old = {"expected_seq": seen, "_idempotency_key": "d"}
    assert post(core, f"{path}/delete", old).status == 409


def test_a_deleted_entry_says_so_to_whoever_changes_it(core: Core) -> None:
    account = begin(core)
    post(core, "/entries", lunch(account))
    path = f"/entries/{entries(core)[0]['id']}"
    assert post(core, f"{path}/delete", {"_idempotency_key": "d"}).status == 303
    for accept in ("text/html", "application/json"):
        told = post(core, path, lunch(account, _idempotency_key=accept), Accept=accept, Accept_Language="ko")
        assert told.status == 409
        assert "지운 내역은 바꿀 수 없어요" in told.text
    assert "주소를 확인" not in get(core, path, Accept_Language="ko").text


def test_other_peoples_texts_stay_text_on_every_page(core: Core) -> None:
    account = begin(core)
    name = HOSTILE
    added = post(
        core, "/accounts", {"name": name, "type": "asset", "currency": "KRW", "_idempotency_key": "a"}
    )
    assert added.status == 303
    for number in range(3):
        fields = lunch(account, description=HOSTILE, category=HOSTILE, _idempotency_key=f"h{number}")
        assert post(core, "/entries", fields).status == 303
    entry = entries(core)[0]["id"]
    found = urllib.parse.urlencode({"q": HOSTILE})
    for path in ("/", "/register", f"/register?{found}", "/accounts", f"/entries/{entry}", f"/?x={found}"):
        page = get(core, path)
        shown = Elements(page.text)
        assert not [tag for tag, attrs in shown.found if tag == "script" and not attrs.get("src")], path
        assert not [tag for tag, _ in shown.found if tag == "img"], path
        assert "49" not in [word for word in shown.words if word == "49"], path


def test_the_register_pages_without_losing_or_repeating_a_line(core: Core) -> None:
    account = begin(core)
    for number in range(60):
        fields = lunch(account, description=f"line {number}", _idempotency_key=f"n{number}")
        assert post(core, "/entries", fields).status == 303
    first = get(core, f"/register?account={account}", Accept_Language="ko")
    older = re.search(r'rel="next" href="([^"]+)"', first.text)
    assert older is not None
    second = get(core, older[1].replace("&amp;", "&"), Accept_Language="ko")
    lines = re.findall(r"line \d+", first.text + second.text)
    assert sorted(lines) == sorted(f"line {number}" for number in range(60))
    assert "−540,000원" in first.text  # the balance after the newest line
    words = get(core, "/register?q=line+59", Accept_Language="ko")
    assert set(re.findall(r"line \d+", words.text)) == {"line 59"}


@pytest.mark.parametrize(
    "path",
    ["/?month=2026-13", "/?month=x", "/register?cursor=zzz", "/register?from=2026-02-30", "/register?account=%00",
     "/entries/none", "/import/none", "/nothing-here", "/register?q=" + "x" * 500],
)  # fmt: skip
def test_an_address_that_means_nothing_is_told_in_a_page(core: Core, path: str) -> None:
    page = get(core, path, Accept_Language="ko")
    assert page.status in {400, 404}
    assert page.headers["content-type"].startswith("text/html")
    assert "처음 화면으로" in page.text
    told = get(core, "/nothing-here", Accept="*/*")
    assert told.headers["content-type"] == "application/problem+json"


def test_a_page_of_somebody_else_can_change_nothing_here(core: Core) -> None:
    account = begin(core)
    for headers in (
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
        {"Origin": "http://elsewhere.example"},
        {"Origin": "null"},
    ):
        assert post(core, "/entries", lunch(account), **headers).status == 403
        assert core.ask("POST", "/api/ledger/accounts/x/close", {}, **headers).status == 403
    own = {"Origin": f"http://127.0.0.1:{core.port}", "Sec_Fetch_Site": "same-origin"}
    assert post(core, "/entries", lunch(account), **own).status == 303
    assert len(entries(core)) == 1


def test_the_chosen_language_beats_the_browsers_and_leads_back_to_this_server(core: Core) -> None:
    chosen = post(core, "/language", {"lang": "ko", "back": "/register?q=a"})
    assert (chosen.status, chosen.headers["location"]) == (303, "/register?q=a")
    cookie = chosen.headers["set-cookie"].partition(";")[0]
    assert '<html lang="ko">' in get(core, "/", Accept_Language="en", Cookie=cookie).text
    for back in (
        "//elsewhere.example",
        "/\\elsewhere.example",
        "https://elsewhere.example",
        "",
        "/a\r\nX: y",
    ):
        assert post(core, "/language", {"lang": "en", "back": back}).headers["location"] == "/"
    assert "set-cookie" not in post(core, "/language", {"lang": "xx", "back": "/"}).headers


def test_the_files_of_a_page_are_kept_for_ever_under_a_name_of_their_content(core: Core) -> None:
    page = get(core, "/")
    paths = re.findall(r'(?:href|src)="(/static/[^"]+)"', page.text)
    kept = get(core, paths[0])
    assert "immutable" in kept.headers["cache-control"]
    assert get(core, paths[0], If_None_Match=kept.headers["etag"]).status == 304
    assert get(core, re.sub("/static/[0-9a-f]+/", "/static/0123456789ab/", paths[0])).status == 404
    assert get(core, "/static/..%2f..%2fpyproject.toml/x").status == 404


def test_the_first_load_is_small(core: Core) -> None:
    begin(core)
    page = get(core, "/", Accept_Language="ko")
    paths = set(re.findall(r'(?:href|src)="(/static/[^"]+)"', page.text))
    whole = len(page.text.encode()) + sum(len(get(core, path).text.encode()) for path in paths)
    assert whole <= FIRST_LOAD_BYTES_MAX


def test_an_account_is_added_at_its_name_and_closed_with_its_past_kept(core: Core) -> None:
    begin(core)
    fields = {"name": "여행", "type": "asset", "currency": "usd", "_idempotency_key": "a1"}
    assert post(core, "/accounts", fields).status == 303
    taken = post(core, "/accounts", {**fields, "_idempotency_key": "a2"}, Accept_Language="ko")
    assert taken.status == 409
    assert "이미 있는 이름이에요" in taken.text
    account = next(
        one for one in core.ask("GET", "/api/ledger/accounts").body["items"] if one["name"] == "여행"
    )
    assert account["currency"] == "USD"
    shut = f"/accounts/{urllib.parse.quote(account['id'])}/close"
    assert post(core, shut, {"_idempotency_key": "c"}).status == 303
    assert core.ask("GET", f"/api/ledger/accounts/{account['id']}").body["closed"] is True
    assert "여행" in get(core, "/accounts").text


def test_names_that_stand_twice_in_a_list_are_told_apart_by_their_currency(core: Core) -> None:
    begin(core)
    body = {"id": "a:usd", "name": "Dollars", "type": "asset", "currency": "USD"}
    assert core.ask("POST", "/api/ledger/accounts", body).status == 201
    assert "USD" not in Elements(get(core, "/accounts").text).words
    for number, account in enumerate(("a:usd", begin(core))):
        post(core, "/entries", lunch(account, amount="5", category="", _idempotency_key=f"c{number}"))
    for path in ("/accounts", "/?month=2026-11"):
        words = Elements(get(core, path, Accept_Language="ko").text).words
        assert [
            words[at + 1]
            for at, word in enumerate(words)
            if word == "분류 없음" and words[at + 1] in {"KRW", "USD"}
        ]
        assert {"KRW", "USD"} <= set(words)


def test_an_import_is_shown_from_its_preview_to_its_end(core: Core) -> None:
    account = begin(core, "en", "USD")
    file = f"Date,Description,Amount\n2026-11-02,Coffee,-4.50\n2026-02-31,Impossible,-1.00\n2026-11-03,{HOSTILE.replace(',', '')!r},2.00\n"
    mark = "boundary-of-a-test"
    body = (
        f'--{mark}\r\nContent-Disposition: form-data; name="account"\r\n\r\n{account}\r\n'
        f'--{mark}\r\nContent-Disposition: form-data; name="file"; filename="<b>bank.csv"\r\n\r\n{file}\r\n--{mark}--\r\n'
    ).encode()
    made = ask(
        core, "POST", "/api/ledger/imports", body, Content_Type=f"multipart/form-data; boundary={mark}"
    )
    assert made.status == 201, made.text
    address = f"/import/{made.json['id']}"
    preview = get(core, address, Accept_Language="en")
    assert 'data-state="preview"' in preview.text
    assert "There is no such day" in preview.text
    assert not [tag for tag, _ in Elements(preview.text).found if tag in {"img", "b"} and tag == "img"]
    committed = core.ask("POST", f"/api/ledger/imports/{made.json['id']}/commit", {})
    assert committed.status == 202
    waiting.until(lambda: 'data-state="done"' in get(core, address).text, "the import to be done")
    assert "booked" in get(core, address, Accept_Language="en").text
    assert made.json["id"] in get(core, "/import").text
