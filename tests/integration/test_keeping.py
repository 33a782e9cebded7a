"""Backing up while everything is at work, going back to it, and what is refused on the way."""

import os
import shutil
import urllib.request
from functools import partial
from pathlib import Path

import pytest

from core.keeping.shelf import newest
from tests.integration.clients import at_work
from tests.integration.house import House, run_cli
from tests.integration.lone_core import ready, started
from tests.waiting import until


def test_a_backup_made_under_load_is_gone_back_to_elsewhere_and_holds_what_was_booked_before_it(
    house: House, tmp_path: Path
) -> None:
    with at_work(house, 2, "kept", patient=False) as clients:
        until(lambda: len(clients.told) > 5, "the load to run")
        before = house.status()["core"]["last_seq"]
        made = house.cli("--json", "backup", "--keep", "2")
        assert made.code == 0, made
    assert made.told["events"] >= before

    refused = house.cli("restore", made.told["path"])
    assert refused.code == 1
    assert "hardcore down" in refused.err

    folder = tmp_path / "back"
    again = run_cli("--data", str(folder), "--json", "restore", made.told["path"], env=house.environment())
    assert again.code == 0, again
    proven = run_cli("--data", str(folder), "--json", "verify", env=house.environment())
    assert (proven.told["ok"], proven.told["events"], proven.told["head"]) == (
        True,
        made.told["events"],
        made.told["head"],
    )

    rehearsed = house.cli("--json", "drill", "restore")
    assert rehearsed.code == 0, rehearsed
    assert rehearsed.told["restore"]["backup"] == Path(made.told["path"]).name


def test_a_core_makes_one_backup_a_day_by_itself_and_frees_what_has_run_out(tmp_path: Path) -> None:
    def lies_there() -> list[str]:
        folder = tmp_path / "data" / "backups"
        return [path.name for path in folder.iterdir()] if folder.is_dir() else []

    quick = partial(started, tmp_path / "data", CORE_BACKUP_AFTER_MS="0", CORE_SCHEDULE_EVERY_MS="20")
    with quick() as core:
        ready(core).open("bank")
        core.open("food", "expense")
        until(lambda: newest(lies_there()), "the first backup")
    with quick() as core:
        lines = [{"account": "food", "amount": "5", "currency": "KRW"}]
        lines.append({"account": "bank", "amount": "-5", "currency": "KRW"})
        body = {
            "date": "2026-11-23",
            "description": "held",
            "state": "pending",
            "timeout_s": 1,
            "postings": lines,
        }
        held = ready(core).ask("POST", "/api/ledger/transactions", body).body["id"]
        path = f"/api/ledger/transactions/{held}"
        # By then the scheduler of this life has made its rounds, and freed what has run out.
        until(
            lambda: core.ask("GET", path).body["state"] == "expired", "the scheduler to free what has run out"
        )
        balances = core.ask("GET", "/api/ledger/accounts/bank").body["balances"]
    assert balances == {"posted": "0", "pending": "0", "available": "0"}
    assert len(lies_there()) == 2  # one copy, and what is known of it


JOURNAL = """
decimal-mark .
2026-11-01 opening  ; note:
    assets:bank            1,000,000 KRW
    equity:opening

2026-11-02 lunch
    expenses:food             12,000 KRW
    assets:bank

2026-11-03 dollars
    assets:wallet           100.50 USD @@ 140,000 KRW
    assets:bank

2026-11-04 what is this
    mystery:thing               1 KRW
    assets:bank
"""


def test_a_journal_comes_in_once_however_often_and_what_is_not_taken_is_told(
    house: House, tmp_path: Path
) -> None:
    if shutil.which("hledger") is None:
        assert os.environ.get("HLEDGER_TESTS") != "required"
        pytest.skip("No hledger here: sh scripts/hledger install")
    file = tmp_path / "books.journal"
    file.write_text(JOURNAL, encoding="utf-8")
    seen = house.cli("--json", "journal", "import", "--dry-run", str(file))
    assert (seen.told["booked"], [one["why"] for one in seen.told["not_taken"]]) == (0, ["kind"])
    for _ in range(2):
        done = house.cli("--json", "journal", "import", str(file))
        assert (done.told["booked"], [one["line"] for one in done.told["not_taken"]]) == (3, [15])

    def posted(name: str) -> str:
        return str(house.ask("GET", f"/api/ledger/accounts/{name}").body["balances"]["posted"])

    assert [posted(one) for one in ("asset:bank:krw", "asset:wallet:usd", "equity:exchange:krw")] == [
        "848000",
        "100.50",
        "140000",
    ]
    beans = tmp_path / "book.beancount"
    with urllib.request.urlopen(f"{house.status()['url']}/api/ledger/export?format=beancount") as answer:
        beans.write_bytes(answer.read())
    again = house.cli("--json", "journal", "import", str(beans))
    assert again.told["not_taken"] == []
    assert again.told["booked"] >= 3
    assert house.cli("--json", "verify").told["ok"]
