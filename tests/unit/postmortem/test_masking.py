"""What of a letter is shown, and what only to somebody who asked for it."""

import json

import pytest

from postmortem import as_told
from postmortem.dead_letters.masking import MASK, masked, masked_path, shown
from tests.unit.postmortem.web_archive import letter

CANARY = "c4nary"
BODY = {
    "amount": "-12000",
    "currency": "KRW",
    "account": "expenses:food",
    "description": f"점심, password: {CANARY}",
    "password": CANARY,
    "token": [CANARY],
    "nested": {"api_key": CANARY, "X-Api-Key": CANARY, "Authorization": f"Bearer {CANARY}", "말": "점심"},
    "memo": f"Bearer {CANARY}",
    "비밀번호": {"x": CANARY},
}
PATH = f"/api/ledger/entries?token={CANARY}&date=2026-11-22&%70assword={CANARY}&next=http://me:{CANARY}@h/"


@pytest.mark.parametrize("payload", [BODY, [BODY], json.dumps(BODY), f"api_key={CANARY}&x=1"])
def test_no_secret_of_a_letter_is_shown_unasked(payload: object) -> None:
    one = letter(payload=payload, path=PATH, row={"password": CANARY, "line": 3})
    assert CANARY not in repr(shown(one))
    assert CANARY not in json.dumps([as_told.letter(one, "en"), as_told.whole_letter(one, "ko")])
    assert CANARY in json.dumps(as_told.whole_letter(one, "ko", revealed=True))


def test_what_is_needed_to_decide_about_a_letter_stays_to_be_seen() -> None:
    kept = {
        "amount": "-12000",
        "currency": "KRW",
        "account": "assets:bank:kb",
        "count": 3,
        "lines": [None, 1.5],
    }
    assert masked(kept) == kept
    assert masked(BODY)["nested"]["말"] == "점심"
    assert masked_path("/api/ledger/entries?date=2026-11-22") == "/api/ledger/entries?date=2026-11-22"
    assert masked_path(PATH).startswith(
        f"/api/ledger/entries?token={MASK}&date=2026-11-22&%70assword={MASK}&"
    )


def test_what_lies_too_deep_to_be_looked_at_is_hidden() -> None:
    deep: object = CANARY
    for _ in range(900):
        deep = [deep]
    assert CANARY not in json.dumps(masked(deep))
