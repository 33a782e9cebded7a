"""Changing on a page what somebody else has changed or deleted meanwhile, over real HTTP."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.integration.lone_core import Core, ready, started
from tests.integration.test_pages import begin, entries, get, lunch, post

SCRIPT = {"Accept": "application/json", "Accept_Language": "en"}


@pytest.fixture
def core(tmp_path: Path) -> Iterator[Core]:
    with started(tmp_path / "data") as made:
        yield ready(made)


def test_the_later_of_two_forms_is_told_and_changes_nothing(core: Core) -> None:
    account = begin(core)
    post(core, "/entries", lunch(account))
    shown = entries(core)[0]
    form = lunch(account, expected_seq=str(shown["seq"]))
    path = f"/entries/{shown['id']}"
    assert post(core, path, form | {"amount": "101", "_idempotency_key": "first"}).status == 303
    late = form | {"amount": "202", "_idempotency_key": "late"}
    told = post(core, path, late, **SCRIPT)
    assert (told.status, told.json["type"]) == (409, "/problems/entry-changed")
    for action, wish in ((path, late), (f"{path}/delete", late | {"_idempotency_key": "gone"})):
        page = post(core, action, wish, Accept_Language="ko")
        assert page.status == 409
        assert "그사이에 바뀐 내역이에요" in page.text or "지금 내용을 확인하고" in page.text
    assert [one["amount"] for one in entries(core)] == ["-101"]
    assert post(core, path, form | {"expected_seq": "x", "_idempotency_key": "odd"}).status == 422


def test_an_entry_that_was_deleted_is_told_by_its_own_sentence(core: Core) -> None:
    account = begin(core)
    post(core, "/entries", lunch(account))
    path = f"/entries/{entries(core)[0]['id']}"
    change = lunch(account, amount="1", _idempotency_key="change")
    done = post(core, path, change, **SCRIPT)
    assert done.status == 201
    assert post(core, f"{path}/delete", {"_idempotency_key": "delete"}).status == 303
    again = post(core, path, change, **SCRIPT)
    assert (again.status, again.json) == (201, done.json)
    for action, wish in ((path, change), (f"{path}/delete", {})):
        late = wish | {"_idempotency_key": f"late {action}".replace(" ", "-")}
        told = post(core, action, late, **SCRIPT)
        assert (told.status, told.json["type"]) == (409, "/problems/entry-reversed")
        assert "이미 지운 내역이에요" in post(core, action, late, Accept_Language="ko").text
    assert "없는 내역이에요" in get(core, path, Accept_Language="ko").text
