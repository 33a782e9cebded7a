"""A core alone with its guard's rules: what it refuses, what it leaves out, what it dies of, and what waits."""

import hashlib
import json
import signal
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import unix_connect
from websockets.typing import Subprotocol

from core.guarded.poison import name_of
from core.ledger.accounts import AccountType
from core.ledger.book import ids_for
from frontend.paper import page_text
from tests.integration.lone_core import Answer, moving, verify
from tests.integration.test_imports import form, statement
from tests.integration.wired_core import Guard, Wired, guarding
from tests.waiting import WAIT_S, until

POST = "/api/ledger/transactions"
DRILL = "/api/ledger/drill"


class Ruled:
    """The test in the guard's place, with a file of rules."""

    def __init__(self, guard: Guard) -> None:
        self.guard = guard
        self.state = guard.data / "state"
        self.serial = 0

    @property
    def environ(self) -> dict[str, str]:
        return {"HARDCORE_QUARANTINE": str(self.state / "quarantine.json")}

    def core(self) -> Wired:
        return self.guard.core(**self.environ)

    def rule(self, *rules: Any, suspects: tuple[str, ...] = ()) -> None:
        self.serial += 1
        named = [{"name": name, "account_ids": []} for name in suspects]
        said = {"version": 1, "serial": self.serial, "rules": rules, "suspects": named, "sources": []}
        self.put("quarantine.json", said)

    def put(self, name: str, said: Any) -> None:
        self.state.mkdir(parents=True, exist_ok=True)
        fresh = self.state / f"{name}.new"
        fresh.write_text(json.dumps(said))
        fresh.rename(self.state / name)

    def arm(self, at: str, key: str = "poison", seq: int | None = None) -> None:
        self.put("drill.json", {"version": 1, "fault": "poison", "name": name_of(key), "at": at, "seq": seq})

    def told(self, life: Wired, rules: int) -> None:
        assert life.order(verb="quarantine") == {"ok": True, "serial": self.serial, "rules": rules}


@pytest.fixture
def ruled(tmp_path: Path) -> Iterator[Ruled]:
    with guarding(tmp_path) as guard:
        yield Ruled(guard)


def letter(**named: Any) -> dict[str, Any]:
    return {"id": "L-1", "type": "letter", "name": "0f" * 16, "reason": "CRASHED_CORE", **named}


def parked(seq: int, *accounts: str) -> dict[str, Any]:
    return {"id": "L-2", "type": "parked", "seq": seq, "account_ids": accounts}


def limit(**named: Any) -> dict[str, Any]:
    kind = {"kind": "transaction.post", "per_minute": None, "body_bytes_max": None}
    return {"id": "R-1", "type": "limit", **kind, **named}


def said_no(answer: Answer, status: int, slug: str, rule: str, **members: str) -> None:
    assert (answer.status, answer.body["type"]) == (status, f"/problems/{slug}"), answer
    assert (answer.body["outcome"], answer.headers["x-core-rule"]) == ("not_done", rule)
    assert members.items() <= answer.body.items()


def booked(life: Wired) -> None:
    for name in ("a", "b", "c"):
        assert life.core.open(name).status == 201
    assert life.core.move(5, "a", "b", Idempotency_Key="done").status == 201


def ended(life: Wired) -> int:
    return life.core.ends_with()


def end(life: Wired) -> None:
    life.core.process.terminate()
    assert ended(life) == 0


def test_each_rule_refuses_what_it_names_and_is_heard_of_without_a_restart(ruled: Ruled) -> None:
    life = ruled.core()
    booked(life)
    core, body = life.core, json.dumps(moving(7, "a", "b")).encode()
    digest = hashlib.sha256(f"POST {POST}\n".encode() + body).hexdigest()

    ruled.rule(letter(name=name_of("k")))
    ruled.told(life, 1)
    said_no(core.ask("POST", POST, body, Idempotency_Key="k"), 422, "set-aside", "L-1", letter="L-1")
    found = core.ask("GET", "/api/ledger/commands/k")
    assert (found.status, found.body["outcome"]) == (404, "not_done")

    ruled.rule(letter(digest=digest))
    ruled.told(life, 1)
    korean = core.ask("POST", POST, body, Idempotency_Key="k2", Accept_Language="ko")
    said_no(korean, 422, "set-aside", "L-1")
    assert korean.body["detail"].endswith("번호: L-1.")
    ruled.rule(letter(name=name_of("f" * 32)))
    ruled.told(life, 1)
    fields = f"kind=out&amount=5&account=a&date=2026-11-21&_idempotency_key={'f' * 32}".encode()
    form_type = "application/x-www-form-urlencoded"
    page = core.raw(
        "POST", "/entries", fields, Accept="text/html", Accept_Language="en", Content_Type=form_type
    )
    assert b"Number: L-1." in page
    cash = ids_for(page_text("example_cash", "en"), AccountType.ASSET, "KRW")[0]
    ruled.rule(parked(4, cash))
    ruled.told(life, 1)
    start = {"Accept": "application/json", "Accept_Language": "en", "Content_Type": form_type}
    half = core.ask("POST", "/start", b"currency=KRW&_idempotency_key=start", **start)
    assert (half.status, half.body["type"], half.body["outcome"]) == (422, "/problems/partly-done", "unknown")
    assert (half.headers["x-core-rule"], half.body["letter"]) == ("L-2", "L-2")
    assert len(core.ask("GET", "/api/ledger/accounts").body["items"]) == 4, "the first of them is there"

    ruled.rule(parked(4, "a"), limit(per_minute=1))
    ruled.told(life, 2)
    said_no(core.move(7, "a", "b"), 422, "account-set-aside", "L-2", letter="L-2", account="a")
    limited = core.move(7, "c", "b")
    said_no(limited, 429, "limited", "R-1")
    assert limited.body["rule"] == "R-1"
    assert 0 < int(limited.headers["retry-after"]) <= 60
    assert core.ask("GET", "/api/ledger/accounts/a").body["balances"]["posted"] == "5"
    verdict = core.ask("GET", "/api/ledger/verify").body
    assert (verdict["ok"], verdict["parked"]) == (True, [4])

    ruled.rule(limit(body_bytes_max=10))
    ruled.told(life, 1)
    said_no(core.move(7, "c", "b"), 413, "limited", "R-1")
    again = core.move(5, "a", "b", Idempotency_Key="done")
    assert (again.status, again.headers["idempotent-replayed"]) == (201, "true")

    (ruled.state / "quarantine.json").write_text("{")
    assert life.order(verb="quarantine")["ok"] is False
    said_no(core.move(7, "c", "b"), 413, "limited", "R-1")
    ruled.rule({"id": "D", "type": "deadline", "kind": "transaction.post", "limit_ms": 1_234})
    ruled.told(life, 1)
    assert core.move(7, "c", "b", X_Request_Name="0e" * 16).status == 201
    noted = [one for one in life.page().finished if one.key_hash == "0e" * 16]
    assert [one.kind for one in noted] == ["transaction.post"]
    assert {"RULES", "RULES_UNREAD"} <= set(life.events())


@pytest.mark.parametrize("at", ["decide", "write", "later"])
def test_a_drill_kills_the_core_in_its_place_and_its_key_is_not_done(ruled: Ruled, at: str) -> None:
    life = ruled.core()
    assert life.core.ask("POST", DRILL, b"poison", Idempotency_Key="poison").status == 404
    ruled.arm(at)
    ruled.rule()
    ruled.told(life, 0)
    connection = life.core.connect()
    connection.request("POST", DRILL, b"poison", {"Idempotency-Key": "poison"})
    if at == "later":
        assert connection.getresponse().status == 200
    assert ended(life) == -signal.SIGSEGV
    stages = {slot.stage.name: slot.key_hash for slot in life.page().in_flight}
    wanted = {"decide": {"DECIDING": name_of("poison")}, "write": {"WRITING": name_of("poison")}, "later": {}}
    assert stages == wanted[at]
    ruled.rule(letter(name=name_of("poison")))
    after = ruled.core()
    said_no(after.core.ask("POST", DRILL, b"poison", Idempotency_Key="poison"), 422, "set-aside", "L-1")
    assert after.core.ask("GET", "/api/ledger/commands/poison").status == 404
    assert verify(ruled.guard.data).returncode == 0


def test_an_event_that_kills_every_start_is_left_out_once_it_is_parked(ruled: Ruled) -> None:
    first = ruled.core()
    booked(first)
    end(first)
    ruled.arm("log", seq=4)
    assert ended(ruled.guard.start(**ruled.environ)) == -signal.SIGSEGV
    ruled.rule(parked(4, "a", "b"))
    life = ruled.core()
    said_no(life.core.move(1, "a", "c"), 422, "account-set-aside", "L-2", account="a")
    assert life.core.open("d").status == 201
    assert life.core.move(1, "c", "d").status == 201
    listed = life.core.ask("GET", "/api/ledger/transactions?account=a").body["items"]
    assert [(one["seq"], one["state"]) for one in listed] == [(4, "set-aside")]
    assert [one["amount"] for one in listed[0]["postings"]] == ["5", "-5"]
    kinds = [Subprotocol("hardcore.v1")]
    with unix_connect(str(life.folder / "sock"), "ws://core/ws?after=3", subprotocols=kinds) as page:
        said = [json.loads(page.recv(WAIT_S))["type"] for _ in range(2)]
    assert said == ["ledger.hello", "ledger.resync"], "no frame is made of what is left out"
    verdict = life.core.ask("GET", "/api/ledger/verify").body
    assert (verdict["ok"], verdict["parked"]) == (True, [4])
    spare = ruled.guard.spare(**ruled.environ)
    ruled.rule(parked(4, "a", "b"), letter(name=name_of("k")))
    life.core.process.kill()
    ended(life)
    assert spare.promote(None)["ok"]
    spare.hears("READY")
    said_no(spare.core.move(1, "c", "d", Idempotency_Key="k"), 422, "set-aside", "L-1")
    told = verify(ruled.guard.data)
    assert (told.returncode, b"events 4" in told.stdout) == (0, True)


def _imported(life: Wired, import_id: str) -> dict[str, Any]:
    seen: dict[str, Any] = life.core.ask("GET", f"/api/ledger/imports/{import_id}").body
    return seen


def test_a_suspect_row_waits_for_its_trial_and_costs_itself_alone(ruled: Ruled) -> None:
    life = ruled.core()
    assert life.core.open("bank").status == 201
    body, kind = form(statement(60, "row"), {"account": "bank"}, "bank.csv")
    key = uuid.uuid4().hex
    import_id: str = life.core.ask(
        "POST", "/api/ledger/imports", body, Content_Type=kind, Idempotency_Key=key
    ).body["id"]
    cleared, poison = (name_of(f"{import_id}:{ordinal}") for ordinal in (3, 30))
    ruled.rule(suspects=(cleared, poison))
    ruled.told(life, 0)
    assert life.core.ask("POST", f"/api/ledger/imports/{import_id}/commit", {}).status in {200, 202}
    assert life.hears("X_CASE")["X_CASE"] == cleared
    assert json.loads((ruled.state / "cases" / f"{cleared}.json").read_text())["case"]["row"]["ordinal"] == 3
    assert _imported(life, import_id)["done"] <= 2
    until(
        lambda: (_imported(life, import_id)["waiting"] or {}).get("reason") == "trial",
        "it to say why it rests",
    )
    page = life.core.raw("GET", f"/import/{import_id}", Accept="text/html", Accept_Language="en")
    assert b'data-waiting="trial"' in page
    assert b"whether a row of this file stopped the server" in page
    ruled.rule(suspects=(poison,))
    life.core.process.kill()
    ended(life)
    after = ruled.core()
    assert after.hears("X_CASE")["X_CASE"] == poison
    assert after.core.open("c").status == 201, "the service waits for nothing"
    ruled.rule(letter(name=poison))
    ruled.told(after, 1)
    until(lambda: _imported(after, import_id)["state"] == "done", "the rest to be booked")
    seen = _imported(after, import_id)
    assert (seen["rows"]["new"], seen["rows"]["refused"], seen["waiting"]) == (59, 1, None)
    assert [one["reason"] for one in seen["problems"]] == ["set-aside"]
    assert "L-1" in seen["problems"][0]["sentence"]
