import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardcore.model.recorder import Beats, LastWords, Page, RingEvent, Threads
from hardcore.snapshot.collectors import page_as_json
from hardcore.snapshot.masking import MASK, mask_line, mask_local, mask_payload, mask_shapes, readable_payload

CANARY = "canary-7f3a"


NAMES = (
    "password db_passwd API_KEY apikey token session_id cookies authorization secretKey private_key key_material"
    " pwd user_pwd credentials 비밀번호"
)


@pytest.mark.parametrize("name", NAMES.split())
def test_a_secret_name_hides_its_value_wherever_the_name_stands(name: str) -> None:
    assert CANARY not in mask_local("f", name, f'"{CANARY}"')
    assert CANARY not in mask_local("f", "d", f'{{"a": 1, "{name}": "{CANARY}"}}')
    assert CANARY not in mask_local("f", "pairs", f'[("{name}", "{CANARY}")]')
    assert CANARY not in mask_local("f", "swapped", f'{{"value": "{CANARY}", "name": "{name}"}}')
    assert CANARY not in mask_local("f", "cut", f'{{"x": {{"{name}": "{CANARY}...')
    assert CANARY not in mask_line(f"POST /x {name}={CANARY}")
    assert CANARY not in mask_line(f'{{"{name}": "{CANARY}", "other": 1}}')
    assert CANARY not in mask_payload(f'{{"{name}": "{CANARY}"}}'.encode()).decode()


def test_the_locals_of_a_function_with_a_secret_name_are_hidden() -> None:
    assert mask_local("check_password", "text", f'"{CANARY}"') == MASK


@pytest.mark.parametrize(
    "text",
    [
        "eyJhbGciOiJIUzI1NiJ9.eyJzdWIiOiIxIn0.c2lnbmF0dXJl",
        "postgresql://ledger:hunter2@db/x",
        "4111 1111 1111 1111",
        "4111111111111111",
        "900101-1234567",
        "-----BEGIN RSA PRIVATE KEY-----\nMIIE",
    ],
)
def test_what_looks_like_a_secret_is_hidden_without_a_name(text: str) -> None:
    assert MASK in mask_shapes(f"before {text}")


@pytest.mark.parametrize(
    "text",
    [
        "01934567-8901-7234-8567-123456789012",
        "0193c5b2-7b1e-7000-8000-000000000001",
        "assets:bank:110-123-456789",
        "2518728192772",
        "-12000",
        "2026-11-21",
        "자산:현금",
    ],
)
def test_ids_amounts_and_times_stay_readable(text: str) -> None:
    assert mask_local("post", "transaction_id", f'"{text}"') == f'"{text}"'
    assert mask_shapes(text) == text


@pytest.mark.parametrize("name", ["description", "x", "body", "headers", "memo", "environ"])
def test_a_value_whose_name_is_not_on_the_list_is_hidden(name: str) -> None:
    assert mask_local("post", name, f'"{CANARY}"') == MASK
    assert mask_local("post", name, "4711") == MASK


@pytest.mark.parametrize(
    ("name", "shown"),
    [("transaction_id", '"two words"'), ("amount", f'"{CANARY}"'), ("account_ids", '["a", {"b": 1}]')],
)
def test_a_name_on_the_list_does_not_open_the_door_for_any_value(name: str, shown: str) -> None:
    assert mask_local("post", name, shown) == MASK


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("account_ids", '["assets:kb", "expenses:food"]'),
        ("held_by", '"4711"'),
        ("held_by", '""'),
        ("transaction_id", '""'),
        ("until_ns", "2518728192772"),
        ("lock", "<_thread.lock at 0x7f2d63ddb680>"),
        ("found", "None"),
    ],
)
def test_lists_of_ids_numbers_with_a_unit_and_addresses_are_shown(name: str, shown: str) -> None:
    assert mask_local("post", name, shown) == shown


@pytest.mark.parametrize(
    "line",
    [
        "2026-11-22 07:20:10,123 INFO core Serving the ledger, epoch 12.",
        "잔액 확인",
        "OSError at core/x.py:12 decide: [Errno 28] No space left (called from a/b.py:1 run, c/d.py:3 <module>)",
        "sqlite3.OperationalError: database is locked",
        "0193c5b2-7b1e-7000-8000-000000000001 at 2026-11-21T14:08:15.000Z took 12.5ms",
    ],
)
def test_a_line_keeps_its_words_numbers_ids_and_places(line: str) -> None:
    assert mask_line(line) == line


@pytest.mark.parametrize(
    "line", [f"got {CANARY} here", f"KeyError: '{CANARY}'", f"/home/me/{CANARY}", f'{{"memo":"{CANARY}"}}']
)
def test_what_is_none_of_these_is_hidden_in_a_line(line: str) -> None:
    assert CANARY not in mask_line(line)


@pytest.mark.parametrize(
    ("line", "secret"),
    [
        ("ran backup --password Sommer now", "Sommer"),
        ("password Sommer accepted", "Sommer"),
        ("Cookie sid Abcdefgh", "Abcdefgh"),
        ("비밀번호 봄여름", "봄여름"),
        ("PIN 4711 was right", "4711"),
    ],
)
def test_the_name_of_a_secret_hides_the_rest_of_a_line_whatever_stands_between(
    line: str, secret: str
) -> None:
    assert secret not in mask_line(line)


@pytest.mark.parametrize("number", ["110234567890", "9001011234567", "(110234567890),", "110234567890x"])
def test_a_long_number_without_a_unit_is_somebodys(number: str) -> None:
    assert mask_line(f"moved to account {number} today") == f"moved to account {MASK} today"


@pytest.mark.parametrize(
    "line",
    [
        "took 2518728192772 ns, held 1073741824 bytes",
        "took 2518728192772ns at 2026-11-21T14:08:15.000000000Z",
        "KeyError at web/session_tokens.py:12 parse: no such key",
    ],
)
def test_a_time_a_size_and_a_file_of_code_are_nobodys(line: str) -> None:
    assert mask_line(line) == line


def test_a_frame_in_a_log_names_its_file_without_the_folders_of_the_machine() -> None:
    assert mask_line('  File "/home/me/core/main.py", line 3, in run') == '  File "main.py", line 3, in run'


def test_a_body_keeps_its_length_and_shows_only_fields_of_the_list() -> None:
    body = (
        f'{{"description": "{CANARY}", "amount": "-4500", "account": "자산:현금", "date": "{CANARY}'.encode()
    )
    masked = mask_payload(body)
    assert len(masked) == len(body)
    assert readable_payload(masked) == f'{MASK}"amount": "-4500"{MASK}"account": "자산:현금"{MASK}'


@pytest.mark.parametrize("body", [b"amount=-4500&memo=x", b"\x00\xff\xfe", b"", b'"amount": {"x": 1}'])
def test_a_body_that_is_not_understood_is_hidden_as_a_whole(body: bytes) -> None:
    assert set(mask_payload(body)) <= {ord("*")}


@given(st.text(), st.text(), st.text())
def test_no_text_is_too_strange_to_be_masked(function: str, name: str, shown: str) -> None:
    mask_local(function, name, shown)
    mask_line(shown)
    assert len(mask_payload(shown.encode("utf-8", "replace"))) == len(shown.encode("utf-8", "replace"))


def test_a_carried_credential_is_hidden_in_a_line() -> None:
    assert CANARY not in mask_line(f"sent Bearer {CANARY} to x")


def test_last_words_are_kept_without_what_follows_a_secret_name() -> None:
    words = LastWords(1, "EXCEPTION", f"KeyError at x.py:1: password={CANARY}")
    page = Page("n", "b", 1, 1, Threads(), Beats(), None, words, (), (), (RingEvent(1, 1, "E", words.text),))
    told = page_as_json(page, 2)
    assert CANARY not in str(told)
    assert told["last_words"]["code"] == "EXCEPTION"
    assert "KeyError at x.py:1" in told["last_words"]["text"]
