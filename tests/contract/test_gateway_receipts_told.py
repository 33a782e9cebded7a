"""What a core's answers and a person's words mean for a promise: nothing is said of it that the ledger has not said."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.contract.gateway_world import Call, World
from tests.contract.receipts_world import (
    ASYNC,
    COOKIE,
    LOOK_UP,
    Ledger,
    becomes,
    hangs_up,
    has_read,
    hold,
    name_of,
    promised,
    promising,
    receipt,
    saying,
    sent,
    serve,
    wish,
)

PATH = "/api/ledger/t"


@pytest.fixture
def w(tmp_path: Path) -> Iterator[World]:
    """A world in an outage."""
    with promising(tmp_path) as made:
        hold(made)
        yield made


# -- a core's answer -------------------------------------------------------------------------------------


def test_a_core_that_says_neither_three_times_is_looked_up_and_a_person_is_asked(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger(before=saying(500, {}))
    core = serve(w, ledger, 2)
    assert becomes(w, "k1", "ask")["status"] is None
    assert len(sent(core, "k1")) == 3
    ledger.before = lambda _: False
    assert w.ask("POST", "/__hc/receipts/k1/run", body=b"").status == 202
    becomes(w, "k1", "done")
    assert ledger.booked == ["k1"]


def test_what_was_booked_under_odd_answers_is_found_however_many_there_were(w: World) -> None:
    promised(w, "k1")
    ledger = Ledger(before=saying(507, {}))
    first = serve(w, ledger, 2)
    becomes(w, "k1", "ask")
    w.die(first)
    ledger.kept["k1"] = (name_of("POST", PATH, b'{"a":1}'), 201, {"id": "t"})
    serve(w, ledger, 3)
    assert becomes(w, "k1", "done")["answer"] == {"id": "t"}


@pytest.mark.parametrize(("status", "said"), [(500, "not_done"), (507, "not_done"), (503, "not_done")])
def test_a_cores_own_word_that_it_was_not_done_sends_it_again(w: World, status: int, said: str) -> None:
    promised(w, "k1")
    ledger = Ledger(before=saying(status, {"outcome": said}))
    core = serve(w, ledger, 2)
    core.wait(PATH, 5)
    assert receipt(w, "k1")["outcome"] == "waiting"
    ledger.before = lambda _: False
    becomes(w, "k1", "done")


@pytest.mark.parametrize("status", [303, 401, 403, 404, 405, 409])
def test_an_answer_that_may_not_mean_the_wish_is_final_only_if_the_ledger_says_so(
    w: World, status: int
) -> None:
    promised(w, "k1")
    promised(w, "k2")
    ledger = Ledger(before=saying(status, {"detail": "who are you?"}))
    ledger.kept["k2"] = (name_of("POST", PATH, b'{"a":1}'), 409, {"detail": "no"})
    core = serve(w, ledger, 2)
    asked = becomes(w, "k1", "ask")
    assert (asked["status"], asked["answer"], len(sent(core, "k1"))) == (
        status,
        {"detail": "who are you?"},
        1,
    )
    assert becomes(w, "k2", "refused")["answer"] == {"detail": "no"}
    ledger.before = lambda _: False
    assert w.ask("POST", "/__hc/receipts/k1/run", body=b"").json()["status"] is None
    becomes(w, "k1", "done")
    assert ledger.booked == ["k1"]


def test_a_forms_booking_is_done_where_the_answer_names_its_commit(w: World) -> None:
    promised(w, "k1")

    def booked(call: Call) -> bool:
        call.answer(303, b"", headers=("Location: /", f"X-Core-Commit: 7:{'a' * 64}"))
        return True

    core = serve(w, Ledger(before=booked), 2)
    assert becomes(w, "k1", "done")["status"] == 303
    assert len(sent(core, "k1")) == 1
    w.feed.wait("witness")


# -- a core that hangs up and lives ----------------------------------------------------------------------


def once(*keys: str) -> Callable[[Call], bool]:
    """A core that hangs up on the first request under each of these keys, and lives."""
    left = set(keys)

    def hang(call: Call) -> bool:
        key = call.request.header("Idempotency-Key")
        if key not in left:
            return False
        left.discard(key)
        return hangs_up(call)

    return hang


def test_a_core_that_hangs_up_and_lives_holds_nobody_up_for_ever(tmp_path: Path) -> None:
    with promising(tmp_path, upstream_deadline_ms=500) as w:
        hold(w)
        promised(w, "k1")
        promised(w, "k2")
        ledger = Ledger(before=once("k1"))
        core = serve(w, ledger, 2)
        becomes(w, "k2", "done")
        assert receipt(w, "k1")["outcome"] == "done"
        assert (ledger.booked, len(sent(core, "k1"))) == (["k1", "k2"], 2)
        assert core.targets().count(f"{LOOK_UP}k1") > 1


def test_whoever_has_no_cookie_of_ours_waits_for_no_other(w: World) -> None:
    for key in ("n1", "n2"):
        assert w.client().ask("POST", PATH, f"Idempotency-Key: {key}", ASYNC, body=b"{}").read().status == 202
    ledger = Ledger(before=once("n1"))
    serve(w, ledger, 2)
    becomes(w, "n2", "done")
    assert ledger.booked == ["n2"]


def test_what_a_core_had_when_it_was_promised_is_not_sent_to_that_core_again(tmp_path: Path) -> None:
    with promising(tmp_path, hold_ms=300) as w:
        ledger = Ledger(before=hangs_up)
        core = w.serving(ledger)
        has_read(w)
        assert wish(w, "k1").read().status == 202
        ledger.before = lambda _: False
        core.wait(f"{LOOK_UP}k1", 3)
        assert len(sent(core, "k1")) == 1
        w.die(core)
        serve(w, ledger, 2)
        becomes(w, "k1", "done")
        assert ledger.booked == ["k1"]


# -- a person's word -------------------------------------------------------------------------------------


def test_what_was_booked_meanwhile_is_not_cancelled(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0) as w:
        hold(w)
        promised(w, "k1")
        ledger = Ledger()
        serve(w, ledger, 2)
        becomes(w, "k1", "ask")
        ledger.kept["k1"] = (name_of("POST", PATH, b'{"a":1}'), 201, {"id": "t"})
        told = w.ask("POST", "/__hc/receipts/k1/cancel", body=b"")
        assert (told.status, told.json()["outcome"], told.json()["answer"]) == (
            202,
            "already_done",
            {"id": "t"},
        )


def test_without_a_core_nothing_is_cancelled_and_nothing_is_said_to_be_not_done(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0) as w:
        hold(w)
        promised(w, "k1")
        ledger = Ledger()
        core = serve(w, ledger, 2)
        becomes(w, "k1", "ask")
        w.die(core)
        told = w.ask("POST", "/__hc/receipts/k1/cancel", body=b"")
        assert (told.status, told.json()["type"]) == (503, "/problems/receipts-away")
        assert receipt(w, "k1")["outcome"] == "ask"
        serve(w, ledger, 3)
        assert w.ask("POST", "/__hc/receipts/k1/cancel", body=b"").json()["outcome"] == "not_done"


def test_what_a_core_may_be_running_is_not_said_to_be_not_done(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=1_000) as w:
        hold(w)
        promised(w, "k1")
        ledger = Ledger(before=hangs_up)
        core = serve(w, ledger, 2)
        becomes(w, "k1", "ask")
        assert len(sent(core, "k1")) == 1
        assert w.ask("POST", "/__hc/receipts/k1/cancel", body=b"").status == 503
        assert receipt(w, "k1")["outcome"] == "ask"
        w.die(core)
        serve(w, ledger, 3)
        assert w.ask("POST", "/__hc/receipts/k1/cancel", body=b"").json()["outcome"] == "not_done"


def test_a_copy_of_what_was_promised_goes_to_no_core_past_its_receipt(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0) as w:
        hold(w)
        promised(w, "k1")
        core = serve(w, Ledger(), 2)
        becomes(w, "k1", "ask")
        copy = w.ask("POST", PATH, "Idempotency-Key: k1", COOKIE, body=b'{"a":1}')
        assert (copy.status, copy.json()["outcome"]) == (503, "unknown")
        assert copy.header("Location") == "/__hc/receipts/k1"
        assert sent(core, "k1") == []


def test_one_that_waits_for_a_person_is_looked_up_by_each_core_until_it_answers(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0) as w:
        hold(w)
        promised(w, "k1")
        ledger = Ledger()
        core = serve(w, ledger, 2)
        becomes(w, "k1", "ask")
        w.die(core)
        ledger.kept["k1"] = (name_of("POST", PATH, b'{"a":1}'), 201, {"id": "t"})
        deaf = iter([True, True])

        def hard_of_hearing(call: Call) -> None:
            if call.request.target.startswith(LOOK_UP) and next(deaf, False):
                call.hang_up()
            else:
                ledger(call)

        serve(w, hard_of_hearing, 3)
        becomes(w, "k1", "already_done")


def test_what_nobody_answered_for_a_day_is_looked_up_before_it_is_given_up(tmp_path: Path) -> None:
    with promising(tmp_path, receipt_ask_after_ms=0, receipt_keep_ms=2_000) as w:
        hold(w)
        promised(w, "k1")
        ledger = Ledger()
        serve(w, ledger, 2)
        becomes(w, "k1", "ask")
        ledger.kept["k1"] = (name_of("POST", PATH, b'{"a":1}'), 201, {"id": "t"})
        becomes(w, "k1", "already_done")
