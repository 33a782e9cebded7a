"""A bank's file on its way into the ledger, as a person sends it: chosen, looked at, booked."""

import signal
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.browser.bank_files import PASSWORD, hana_csv, kakao_xlsx
from tests.browser.conftest import MakeHouse, OpenTab
from tests.browser.readers import BANK, a_bank, answer_of, is_joined
from tests.integration.house import House, bytes_of
from tests.waiting import until

MB = 1 << 20


def choose(page: Page, path: Path) -> None:
    """Choose a file on the import's page and have it read."""
    page.locator("#upload-file").set_input_files(path)
    page.locator("form[data-upload] button.primary").click()


def previewed(page: Page) -> None:
    """Wait until the file is read and its rows are shown."""
    expect(page.locator("#import-body[data-state=preview]")).to_be_visible()


def choose_account(page: Page, account: str = BANK, *, ready: bool = True) -> None:
    """Choose the account and wait until the file was looked at with it; `ready`: and may be booked."""
    page.locator("#how-account").select_option(account)
    expect(page.locator(f"#how-account option[value='{account}'][selected]")).to_be_attached()
    if ready:
        expect(page.locator("form[data-commit][data-ready]")).to_be_visible()


def commit(page: Page) -> None:
    """Choose the account and book."""
    choose_account(page)
    page.locator("form[data-commit] button.primary").click()


def done(page: Page) -> None:
    """Wait until everything is booked."""
    expect(page.locator("#import-body[data-state=done]")).to_be_visible()


def entries(house: House) -> list[dict[str, str]]:
    """What is in the ledger, oldest day first."""
    items = answer_of(house, "/api/ledger/entries?limit=500")["items"]
    return sorted(items, key=lambda entry: str(entry["date"]))


@pytest.fixture
def own_house(new_house: MakeHouse) -> House:
    """A house with nothing in it but a bank's account."""
    house = new_house().up()
    a_bank(house)
    return house


def test_a_cp949_list_is_read_by_the_names_of_its_columns_and_booked(
    own_house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    page = open_tab(own_house, "/import", lang="ko-KR")
    choose(page, hana_csv(tmp_path, refused=1))
    previewed(page)
    expect(page.get_by_text("똠방각하 분식").first).to_be_visible()
    expect(page.locator("#import-problems")).to_contain_text("없는 날")
    commit(page)
    done(page)
    # What the bank calls the movement stands behind the other's name, after a dot.
    assert [(e["date"], e["amount"], e["description"].split(" · ")[0]) for e in entries(own_house)] == [
        ("2026-06-02", "7000", "가상인"),
        ("2026-06-03", "-35000", "가상마트"),
        ("2026-06-04", "-9500", "똠방각하 분식"),
    ]


def test_a_locked_workbook_asks_for_its_password_and_keeps_it_nowhere(
    own_house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    page = open_tab(own_house, "/import")
    choose(page, kakao_xlsx(tmp_path))
    password = page.locator("form[data-upload] [name=password]")
    expect(password).to_be_visible()
    password.fill("999999")
    page.locator("form[data-upload] button.primary").click()
    expect(page.locator("form[data-upload] [data-said]")).to_contain_text("password")
    password.fill(PASSWORD)
    page.locator("form[data-upload] button.primary").click()
    previewed(page)
    expect(page.get_by_text("가상다방").first).to_be_visible()
    commit(page)
    done(page)
    assert [e["amount"] for e in entries(own_house)] == ["500000", "-14700"]
    assert PASSWORD not in page.evaluate(
        "JSON.stringify([{...sessionStorage}, {...localStorage}, document.cookie])"
    )
    kept = [
        path for path in own_house.data.rglob("*") if path.is_file() and PASSWORD.encode() in bytes_of(path)
    ]
    assert kept == []


def test_a_booking_goes_on_over_the_death_of_the_core_and_books_each_row_once(
    own_house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    page = open_tab(own_house, "/import")
    is_joined(page)
    choose(page, hana_csv(tmp_path, rows=2_000))
    previewed(page)
    commit(page)
    own_house.hit("core", signal.SIGKILL)
    done(page)
    counted = answer_of(own_house, "/api/ledger/verify")
    assert counted["ok"]
    booked: list[str] = []
    cursor: str | None = ""
    while cursor is not None:
        part = answer_of(own_house, f"/api/ledger/entries?limit=500{cursor}")
        booked += [f"{entry['date']} {entry['description']}" for entry in part["items"]]
        cursor = f"&cursor={part['next_cursor']}" if part["next_cursor"] else None
    assert (len(booked), len(set(booked))) == (2_000, 2_000)


def test_two_tabs_that_import_the_same_file_book_it_once(
    own_house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    path = hana_csv(tmp_path)
    first = open_tab(own_house, "/import")
    second = open_tab(own_house, "/import", beside=first)
    for page in (first, second):
        choose(page, path)
        previewed(page)
        choose_account(page)
    for page in (first, second):
        page.locator("form[data-commit] button.primary").click()
    for page in (first, second):
        done(page)
    assert len(entries(own_house)) == 3
    expect(second.locator("#import-body")).to_contain_text("3")


def test_the_button_says_how_many_are_booked_and_rests_where_nothing_is_new(
    own_house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    path = hana_csv(tmp_path)
    page = open_tab(own_house, "/import")
    button = page.locator("form[data-commit] button.primary")
    for is_new in (True, False):
        page.goto("/import")
        choose(page, path)
        previewed(page)
        choose_account(page)
        if is_new:
            expect(button).to_have_text("Book 3")
            button.click()
            done(page)
    expect(page.locator("#import-facts .counts")).to_contain_text("0 new, to book")
    expect(button).to_have_text("Nothing to book")
    expect(button).to_be_disabled()
    expect(page.locator("#import-skipping")).to_be_visible()
    page.locator("[name=again]").check()
    expect(page.locator("#import-skipping")).to_be_hidden()
    expect(button).to_have_text("Book 3")
    expect(button).to_be_enabled()
    page.locator("[name=again]").uncheck()
    expect(button).to_be_disabled()
    page.locator("[name=again]").check()
    button.click()
    done(page)
    assert len(entries(own_house)) == 6


def test_a_column_is_chosen_by_its_name_however_long_that_is(
    own_house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    long = "Wieviel' \"" + "x" * 500
    path = tmp_path / "own.csv"
    path.write_text('Wann;Was;"' + long.replace('"', '""') + '"\n2026-11-02;Kaffee;-3\n2026-11-03;Lohn;5\n')
    page = open_tab(own_house, "/import")
    choose(page, path)
    previewed(page)
    choose_account(page, ready=False)
    for role, column in (("date", "Wann"), ("amount", "Wieviel")):
        option = page.locator(f"#map-{role} option", has_text=column)
        assert len(option.inner_text()) <= 60
        page.locator(f"#map-{role}").select_option(option.get_attribute("value"))
        expect(page.locator(f"#map-{role} option[selected]")).to_contain_text(column)
    expect(page.locator("#import-facts .counts")).to_contain_text("2 new, to book")


def test_what_is_chosen_while_an_earlier_choice_is_looked_at_is_looked_at_too(
    own_house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    path = tmp_path / "own.csv"
    path.write_text("Wann;Was;Wieviel\n2026-11-02;Kaffee;-3\n2026-11-03;Lohn;5\n")
    page = open_tab(own_house, "/import")
    choose(page, path)
    previewed(page)
    page.evaluate(
        """(account) => {
          const choose = (id, which) => {
            const field = document.getElementById(id);
            field.value = [...field.options].find(which).value;
            field.dispatchEvent(new Event("change", { bubbles: true }));
          };
          choose("how-account", (one) => one.value === account);
          choose("map-date", (one) => one.textContent.includes("Wann"));
          choose("map-amount", (one) => one.textContent.includes("Wieviel"));
        }""",
        BANK,
    )
    expect(page.locator("#import-facts .counts")).to_contain_text("2 new, to book")
    expect(page.locator("#map-amount option[selected]")).to_contain_text("Wieviel")
    expect(page.locator("form[data-commit][data-ready]")).to_be_visible()


def test_a_file_that_changed_after_it_was_chosen_is_asked_for_again(
    house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    page = open_tab(house, "/import")
    path = hana_csv(tmp_path)
    page.locator("#upload-file").set_input_files(path)
    path.unlink()
    page.locator("form[data-upload] button.primary").click()
    expect(page.locator("form[data-upload] [data-said].wrong")).to_contain_text("choose it again")
    choose(page, hana_csv(tmp_path))
    previewed(page)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.csv", b""),
        ("binary.xlsx", bytes(range(256)) * 400),
        ("headerless.csv", b"1,2,3\n4,5,6\n"),
        ("bomb.xlsx", b"PK\x03\x04" + b"\0" * 5000),
    ],
)
def test_a_file_that_cannot_be_read_is_refused_with_a_sentence_and_another_may_be_chosen(
    house: House, open_tab: OpenTab, tmp_path: Path, name: str, content: bytes
) -> None:
    a_bank(house)
    (tmp_path / name).write_bytes(content)
    page = open_tab(house, "/import")
    choose(page, tmp_path / name)
    said = page.locator("form[data-upload] [data-said].wrong")
    asked_for_columns = page.locator("details.columns-of-file[open]")
    expect(said.or_(asked_for_columns).first).to_be_visible()
    page.goto("/import")
    choose(page, hana_csv(tmp_path))
    previewed(page)


def test_a_file_of_50_mb_is_refused_with_a_sentence(house: House, open_tab: OpenTab, tmp_path: Path) -> None:
    path = tmp_path / "large.csv"
    path.write_bytes(b"2026-06-01,1000,nothing in it\n" * (50 * MB // 30))
    page = open_tab(house, "/import")
    choose(page, path)
    said = page.locator("form[data-upload] [data-said].wrong")
    expect(said).to_contain_text("over the limit")
    until(lambda: house.status()["core"]["ready"], "the core to serve")


def test_a_file_sent_into_an_outage_is_read_once_the_server_is_back(
    own_house: House, open_tab: OpenTab, tmp_path: Path
) -> None:
    page = open_tab(own_house, "/import")
    is_joined(page)
    page.locator("#upload-file").set_input_files(hana_csv(tmp_path))
    own_house.hit("core")
    page.locator("form[data-upload] button.primary").click()
    previewed(page)
    assert len(answer_of(own_house, "/api/ledger/imports")["items"]) == 1
