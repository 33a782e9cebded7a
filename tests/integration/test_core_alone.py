"""The core as a process of its own: real HTTP, real signals, a real file."""

import hashlib
import http.client
import json
import os
import signal
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hardcore.host.recorder import PageReader, make_page
from tests import stores, waiting
from tests.integration.lone_core import Answer, Core, moving, ready, started, verify

BOOT_ID = Path("/proc/sys/kernel/random/boot_id").read_text().strip()


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return tmp_path / "data"


@pytest.fixture
def core(data: Path) -> Iterator[Core]:
    with started(data) as made:
        yield ready(made)


def test_a_transaction_goes_in_and_balances_come_out(core: Core) -> None:
    assert core.open("assets:bank").status == 201
    assert core.open("income:pay", "income").status == 201
    booked = core.move(3_000, "assets:bank", "income:pay", Idempotency_Key="k1")
    assert booked.status == 201
    assert booked.headers["x-core-epoch"] == "1"
    assert {"id", "seq", "epoch", "hash"} <= booked.body.keys()
    account = core.ask("GET", "/api/ledger/accounts/assets:bank").body
    assert account["balances"] == {"posted": "3000", "pending": "0", "available": "3000"}
    shown = core.ask("GET", f"/api/ledger/transactions/{booked.body['id']}")
    assert shown.body == booked.body


def test_the_same_key_gets_the_same_answer_and_another_wish_gets_none(core: Core) -> None:
    core.open("a")
    core.open("b")
    first = core.move(5, "a", "b", Idempotency_Key="k")
    again = core.move(5, "a", "b", Idempotency_Key="k")
    other = core.move(6, "a", "b", Idempotency_Key="k")
    assert again.body == first.body
    assert again.headers["idempotent-replayed"] == "true"
    assert (other.status, other.body["type"]) == (422, "/problems/key-reused")
    assert core.ask("GET", "/api/ledger/accounts/a").body["balances"]["posted"] == "5"


def test_the_same_key_sent_many_times_at_once_is_booked_once(core: Core) -> None:
    core.open("a")
    core.open("b")
    answers: list[Answer] = []
    threads = [
        threading.Thread(target=lambda: answers.append(core.move(5, "a", "b", Idempotency_Key="k")))
        for _ in range(12)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {answer.status for answer in answers} == {201}
    assert len({answer.body["id"] for answer in answers}) == 1
    assert sum("idempotent-replayed" not in answer.headers for answer in answers) == 1
    assert core.ask("GET", "/api/ledger/accounts/a").body["balances"]["posted"] == "5"


def test_a_key_can_be_looked_up_whatever_stands_in_it(core: Core) -> None:
    core.open("a", locked=True)
    core.open("b")
    done = core.move(5, "a", "b", Idempotency_Key="k/1?x=%2F#")
    found = core.ask("GET", "/api/ledger/commands/k%2F1%3Fx=%252F%23")
    assert found.body == {"key": "k/1?x=%2F#", "outcome": "done", "status": 201, "answer": done.body}
    refused = core.move(500, "b", "a", Idempotency_Key="poor")
    kept = core.ask("GET", "/api/ledger/commands/poor").body
    assert (kept["status"], kept["answer"]) == (422, refused.body)
    absent = core.ask("GET", "/api/ledger/commands/nobody")
    assert (absent.status, absent.body["outcome"]) == (404, "not_done")


def _sent(body: bytes) -> str:
    return hashlib.sha256(b"POST /api/ledger/transactions\n" + body).hexdigest()


def test_a_look_up_never_tells_a_request_the_answer_of_another(core: Core) -> None:
    core.open("a")
    core.open("b")
    mine, others = (json.dumps(moving(amount, "a", "b")).encode() for amount in (5, 6))
    booked = core.ask("POST", "/api/ledger/transactions", mine, Idempotency_Key="k")
    refused = core.ask("POST", "/api/ledger/transactions", others, Idempotency_Key="k")
    assert (booked.status, refused.status) == (201, 422)

    def told(digest: str, key: str = "k") -> Any:
        return core.ask("GET", f"/api/ledger/commands/{key}", X_Request_Digest=digest).body

    assert told(_sent(mine)) == {"key": "k", "outcome": "done", "status": 201, "answer": booked.body}
    assert told(_sent(others)) == {"key": "k", "outcome": "unknown"}
    assert told("no digest") == {"key": "k", "outcome": "unknown"}
    assert told(_sent(others), "never")["outcome"] == "not_done"


def test_refusals_name_the_field_in_the_readers_language(core: Core) -> None:
    core.open("a", locked=True)
    core.open("b")
    english = core.move(1, "b", "a")
    korean = core.move(1, "b", "a", Accept_Language="ko-KR,ko;q=0.9")
    assert english.headers["content-type"] == "application/problem+json"
    assert english.body["type"] == korean.body["type"] == "/problems/overdraft"
    assert english.body["errors"] == [{"pointer": "/postings/1/amount", "reason": "overdraft"}]
    assert korean.body["title"] == "잔액이 부족해요"


@pytest.mark.parametrize(
    ("change", "slug", "pointer"),
    [
        ({"postings": moving(1, "a", "nobody")["postings"]}, "unknown-account", "/postings/1/account"),
        ({"postings": moving(1, "a", "closed")["postings"]}, "account-closed", "/postings/1/account"),
        (
            {"postings": [*moving(1, "a", "b")["postings"], *moving(1, "a", "b")["postings"][:1]]},
            "unbalanced",
            "/postings",
        ),
        ({"state": "later"}, "invalid-body", "/state"),
        ({"colour": "red"}, "invalid-body", "/colour"),
        ({"date": None}, "invalid-body", "/date"),
        (
            {"postings": [{"account": "a", "amount": 1, "currency": "KRW"}]},
            "invalid-body",
            "/postings/0/amount",
        ),
        (
            {"postings": [{"account": "a", "amount": "1.5", "currency": "KRW"}] * 2},
            "invalid-body",
            "/postings/0/amount",
        ),
    ],
)
def test_bad_transactions_are_422_with_the_field(
    core: Core, change: dict[str, Any], slug: str, pointer: str
) -> None:
    for name in ("a", "b", "closed"):
        core.open(name)
    core.ask("POST", "/api/ledger/accounts/closed/close")
    answer = core.ask("POST", "/api/ledger/transactions", moving(1, "a", "b") | change)
    assert (answer.status, answer.body["type"]) == (422, f"/problems/{slug}")
    assert answer.body["errors"][0]["pointer"] == pointer


def test_requests_that_cannot_be_read_are_problems_too(core: Core) -> None:
    def told(method: str, path: str, body: Any = None, **headers: str) -> tuple[int, str]:
        answer = core.ask(method, path, body, **headers)
        assert answer.headers["x-core-epoch"] == "1"
        return answer.status, answer.body["type"].removeprefix("/problems/")

    transactions = "/api/ledger/transactions"
    assert told("POST", transactions, b'{"date"') == (400, "malformed-json")
    assert told("POST", transactions, b" " * ((1 << 20) + 1)) == (413, "body-too-large")
    assert told("POST", transactions, moving(1, "a", "b"), Idempotency_Key="two words") == (
        400,
        "invalid-key",
    )
    assert told("GET", transactions + "?limit=501&from=today&as=x") == (400, "invalid-parameter")
    assert told("GET", "/api/ledger/nothing") == (404, "not-found")
    assert told("GET", transactions + "/") == (404, "not-found")
    assert told("GET", transactions + "/x") == (404, "transaction-not-found")
    assert told("GET", "/api/ledger/accounts/nobody") == (404, "account-not-found")
    assert told("DELETE", "/api/ledger/accounts") == (405, "method-not-allowed")
    assert told("POST", "/api/ledger/accounts/nobody/close") == (422, "unknown-account")


def test_a_body_without_a_length_is_limited_as_well(core: Core) -> None:
    connection = core.connect()
    chunks = (b" " * 65_536 for _ in range(17))
    connection.request(
        "POST", "/api/ledger/transactions", chunks, {"Transfer-Encoding": "chunked"}, encode_chunked=True
    )
    response = connection.getresponse()
    assert response.status == 413


def test_an_account_exists_once_and_closes_once(core: Core) -> None:
    assert core.open("a").status == 201
    assert (core.open("a").status, core.open("a").body["type"]) == (409, "/problems/account-exists")
    closed = core.ask("POST", "/api/ledger/accounts/a/close", Idempotency_Key="c")
    assert (closed.status, closed.body["closed"]) == (200, True)
    assert core.ask("POST", "/api/ledger/accounts/a/close", {}).body["type"] == "/problems/account-closed"
    assert core.ask("POST", "/api/ledger/accounts/a/close", Idempotency_Key="c").body == closed.body


def test_lists_go_backwards_page_by_page_without_shifting(core: Core) -> None:
    core.open("a")
    core.open("b")
    booked = [core.move(n, "a", "b").body["id"] for n in range(1, 6)]
    path = "/api/ledger/transactions?account=a&from=2026-11-01&to=2026-11-30&q=MOV&limit=2"
    seen: list[str] = []
    cursor = None
    while True:
        page = core.ask("GET", path + (f"&cursor={cursor}" if cursor else "")).body
        seen += [item["id"] for item in page["items"]]
        core.move(100, "a", "b")
        cursor = page["next_cursor"]
        if cursor is None:
            break
    assert seen == booked[::-1]
    assert core.ask("GET", "/api/ledger/transactions?to=2026-11-20").body["items"] == []


def test_events_can_be_followed_from_any_sequence(core: Core) -> None:
    core.open("a")
    core.open("b")
    core.move(1, "a", "b", Idempotency_Key="k")
    page = core.ask("GET", "/api/ledger/events?after=1&limit=1").body
    assert [item["seq"] for item in page["items"]] == [2]
    rest = core.ask("GET", f"/api/ledger/events?after={page['next_cursor']}").body
    assert [(item["kind"], item["key"]) for item in rest["items"]] == [("transaction.posted", "k")]
    assert rest["next_cursor"] is None


def test_the_core_can_prove_its_book_while_it_works_and_after(core: Core, data: Path) -> None:
    core.open("a")
    core.open("b", currency="KRW")
    core.move(1, "a", "b")
    shown = core.ask("GET", "/api/ledger/verify").body
    assert (shown["ok"], shown["events"], shown["trial_balance"]) == (True, 3, {"KRW": "0"})
    beside = verify(data, "--json")
    assert (beside.returncode, json.loads(beside.stdout)) == (0, shown)
    core.process.terminate()
    assert core.ends_with() == 0
    assert verify(data).returncode == 0


def test_healthz_and_the_description_answer_without_a_slot(core: Core) -> None:
    core.open("a")
    assert core.ask("GET", "/healthz").body == {"epoch": 1, "seq": 1, "safe": None, "checkpoint": None}
    assert core.ask("GET", "/api/openapi.json").body["openapi"] == "3.1.0"
    assert core.ask("HEAD", "/healthz").status == 200


def test_term_and_ctrl_c_end_a_lone_core_cleanly_and_the_next_one_knows_everything(data: Path) -> None:
    for number, signal_sent in enumerate((signal.SIGTERM, signal.SIGINT), start=1):
        with started(data) as core:
            ready(core)
            assert core.open(f"a{number}").body["epoch"] == number
            core.process.send_signal(signal_sent)
            assert core.ends_with() == 0
            assert not (data / "ledger.db-wal").exists(), "a ledger at rest is one file"
    with started(data) as core:
        listed = ready(core).ask("GET", "/api/ledger/accounts").body["items"]
        assert [account["id"] for account in listed] == ["a1", "a2"]


def test_after_kill_9_every_acknowledged_transaction_is_there_once(data: Path) -> None:
    acknowledged: dict[str, str] = {}
    with started(data) as core:
        ready(core).open("a")
        core.open("b")

        def send(worker: int) -> None:
            for number in range(1_000):
                key = f"{worker}-{number}"
                try:
                    answer = core.move(1, "a", "b", Idempotency_Key=key)
                except (OSError, http.client.HTTPException):
                    return
                acknowledged[key] = answer.body["id"]

        workers = [threading.Thread(target=send, args=(worker,)) for worker in range(4)]
        for worker in workers:
            worker.start()
        waiting.until(lambda: len(acknowledged) >= 40, "some transactions to be acknowledged")
        core.process.kill()
        for worker in workers:
            worker.join()
    with started(data) as core:
        ready(core)
        for key, transaction_id in acknowledged.items():
            again = core.move(1, "a", "b", Idempotency_Key=key)
            assert again.body["id"] == transaction_id
            assert again.headers["idempotent-replayed"] == "true"
        assert core.ask("GET", "/api/ledger/verify").body["ok"]


def test_a_second_core_alone_is_turned_away_with_one_sentence(core: Core, data: Path) -> None:
    with started(data) as second:
        assert second.ends_with() == 78
        assert "Another core is already at work" in second.said()
        assert "Traceback" not in second.said()
    assert core.ask("GET", "/healthz").body["epoch"] == 1


def test_what_cannot_work_is_told_in_one_sentence(data: Path, tmp_path: Path) -> None:
    taken = socket.socket()
    taken.bind(("127.0.0.1", 0))
    taken.listen()
    occupied = tmp_path / "file"
    occupied.write_text("")
    refusals = [
        (started(data, arguments=["--port", str(taken.getsockname()[1])]), "choose another one with --port"),
        (started(occupied), "choose another with --data"),
        (started(data, CORE_READERS="none"), "CORE_READERS must be a whole number"),
        (started(data, HARDCORE_EPOCH="x"), "HARDCORE_EPOCH must be a whole number"),
        (started(data, HARDCORE_RECORDER=str(tmp_path / "absent")), "could not be opened"),
    ]
    for refused, sentence in refusals:
        with refused as core:
            assert core.ends_with() == 78
            assert sentence in core.said()
            assert "Traceback" not in core.said()
    taken.close()
    assert not (data / "ledger.db").exists(), "nothing was begun"
    assert verify(data).returncode == 78


def test_a_guarded_core_says_its_epoch_before_it_says_ready(data: Path, tmp_path: Path) -> None:
    notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    notify.bind(str(tmp_path / "notify"))
    notify.settimeout(waiting.WAIT_S)
    sock = tmp_path / "core.sock"
    with started(data, sock=sock, NOTIFY_SOCKET=str(tmp_path / "notify")) as core:
        assert notify.recv(4_096) == b"X_EPOCH=1"
        said = dict(line.split("=", 1) for line in notify.recv(4_096).decode().splitlines())
        assert said == {
            "READY": "1",
            "X_EPOCH": "1",
            "X_SEQ": "0",
            "X_HASH": "0" * 64,
            "X_PROOF": "chain",
            "X_TAIL": "0",
        }
        assert sock.stat().st_mode & 0o777 == 0o600
        assert core.ask("GET", "/healthz").status == 200
        core.process.send_signal(signal.SIGINT)
        core.process.send_signal(signal.SIGHUP)
        assert core.ask("GET", "/healthz").status == 200
        core.process.terminate()
        assert core.ends_with() == 0
        told = [notify.recv(4_096) for _ in range(2)]
        assert told == [f"X_TERM={os.getpid()}".encode(), b"STOPPING=1"]
    notify.close()


def test_a_core_behind_a_fence_leaves_without_an_answer(data: Path, tmp_path: Path) -> None:
    with started(data, sock=tmp_path / "old.sock") as old:
        ready(old).open("a")
        with started(data, sock=tmp_path / "new.sock", HARDCORE_EPOCH="1") as new:
            assert ready(new).open("b").headers["x-core-epoch"] == "2"
            with pytest.raises((OSError, http.client.HTTPException)):
                old.open("c")
            assert old.ends_with() == 75
            names = [account["id"] for account in new.ask("GET", "/api/ledger/accounts").body["items"]]
            assert names == ["a", "b"]


def test_an_old_epoch_or_a_store_that_went_back_is_never_served(data: Path, tmp_path: Path) -> None:
    with started(data) as core:
        ready(core)
    for expected, code in (("0", 75), ("7", 65)):
        with started(data, sock=tmp_path / f"{expected}.sock", HARDCORE_EPOCH=expected) as core:
            assert core.ends_with() == code


def test_a_ledger_that_lost_what_somebody_saw_is_never_served(data: Path, tmp_path: Path) -> None:
    with started(data) as core:
        ready(core).open("a")
        seen = core.open("b").body
        core.process.terminate()
        assert core.ends_with() == 0
    witnesses = [
        (f"2:1:{seen['hash']}", None),
        (f"2:1:{'0' * 64}", "event 2"),
        (f"2:2:{seen['hash']}", None),  # seen again by a later core that committed nothing
        (f"3:1:{seen['hash']}", "ends at event 2"),
    ]
    for number, (witness, place) in enumerate(witnesses):
        with started(data, sock=tmp_path / f"{number}.sock", HARDCORE_WITNESS=witness) as core:
            if place is None:
                ready(core)
            else:
                assert core.ends_with() == 65
                assert place in core.said()


def test_a_locked_store_is_waited_for_and_then_named(data: Path, tmp_path: Path) -> None:
    with started(data) as core:
        ready(core)
    notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    notify.bind(str(tmp_path / "notify"))
    notify.settimeout(waiting.WAIT_S)
    where = str(tmp_path / "notify")
    with (
        stores.locked(data),
        started(data, sock=tmp_path / "core.sock", NOTIFY_SOCKET=where, CORE_FENCE_BUSY_MS="50") as core,
    ):
        assert core.ends_with() == 69
        assert notify.recv(4_096) == b"X_FENCE=BLOCKED"
    notify.close()


def test_a_store_locked_by_somebody_else_costs_a_503_and_nothing_more(data: Path) -> None:
    with started(data, CORE_WRITE_BUSY_MS="50") as core:
        ready(core).open("a")
        with stores.locked(data):
            busy = core.open("b")
        assert (busy.status, busy.body["type"], busy.body["outcome"]) == (
            503,
            "/problems/store-busy",
            "not_done",
        )
        assert busy.headers["retry-after"] == "1"
        assert core.open("b").status == 201


def test_whoever_asks_for_a_proof_of_a_core_that_leaves_is_told_that_it_leaves(
    data: Path, tmp_path: Path
) -> None:
    make_page(tmp_path / "page", "nonce-1", BOOT_ID)
    recorder = PageReader(tmp_path / "page")
    with started(
        data,
        sock=tmp_path / "s",
        HARDCORE_RECORDER=str(tmp_path / "page"),
        CORE_WRITE_BUSY_MS="60000",
        CORE_DRAIN_MS="60000",
    ) as core:
        ready(core).open("a")
        asking = core.connect()
        asking.connect()

        def ask(path: str) -> tuple[int, str | None, Any]:
            asking.request("GET", path)
            response = asking.getresponse()
            body = json.loads(response.read())
            return response.status, response.headers["X-Core-Draining"], body.get("type")

        leaving = (503, "1", "/problems/leaving")
        with stores.locked(data):
            waits = threading.Thread(target=core.open, args=("b",))
            waits.start()
            waiting.until(recorder.in_flight, "the core to have taken the command")
            core.process.terminate()
            waiting.until(lambda: ask("/api/ledger/accounts") == leaving, "the core to leave")
            assert ask("/api/ledger/verify") == leaving
        waits.join()
        assert core.ends_with() == 0
    recorder.close()


@pytest.mark.in_a_file  # which may not grow any more
def test_a_failed_commit_is_answered_unknown_and_ends_the_core(data: Path) -> None:
    with started(data, file_bytes_max=300_000) as core:
        ready(core).open("a")
        core.open("b")
        last = core.move(1, "a", "b")
        while last.status == 201:
            last = core.move(1, "a", "b", Idempotency_Key=f"k{last.body['seq']}")
        assert (last.status, last.body["outcome"]) == (503, "unknown")
        assert core.ends_with() == 74
    with started(data) as core:
        assert ready(core).ask("GET", "/api/ledger/verify").body["ok"]


def test_a_falsified_book_is_told_with_its_place(data: Path) -> None:
    with started(data) as core:
        ready(core).open("a")
        core.process.terminate()
        assert core.ends_with() == 0
    stores.tamper(data, "UPDATE event SET booked_ns = booked_ns + 1")
    told = verify(data)
    assert told.returncode == 65
    assert b"event 1" in told.stderr
    with started(data) as core:
        assert core.ends_with() == 65
        assert "event 1" in core.said()
