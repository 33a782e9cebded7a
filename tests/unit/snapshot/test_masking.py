import pytest

from hardcore.model.recorder import Beats, LastWords, Page, RingEvent, Threads
from hardcore.snapshot.collectors import page_as_json
from hardcore.snapshot.masking import MASK, mask_line, mask_local, mask_payload, mask_shapes

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
    assert CANARY not in mask_payload(f'{{"{name}": "{CANARY}"}}')


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
        "http://127.0.0.1:3000/api",
    ],
)
def test_ids_amounts_and_times_stay_readable(text: str) -> None:
    assert mask_local("post", "transaction_id", text) == text
    assert mask_shapes(text) == text


def test_a_carried_credential_is_hidden_in_a_line() -> None:
    assert CANARY not in mask_line(f"sent Bearer {CANARY} to x")


def test_last_words_are_kept_without_what_follows_a_secret_name() -> None:
    words = LastWords(1, "EXCEPTION", f"KeyError at x.py:1: password={CANARY}")
    page = Page("n", "b", 1, 1, Threads(), Beats(), None, words, (), (), (RingEvent(1, 1, "E", words.text),))
    told = page_as_json(page, 2)
    assert CANARY not in str(told)
    assert told["last_words"]["code"] == "EXCEPTION"
    assert "KeyError at x.py:1" in told["last_words"]["text"]
