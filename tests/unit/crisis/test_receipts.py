"""Promises as values: who may have one, whose turn it is, and what a core's word means for them."""

import itertools
import json

import pytest
from msgspec.structs import replace

from hardcore.crisis.receipts import (
    OPEN,
    RUNNING_MAX,
    SETTLED_MAX,
    Book,
    Case,
    Moment,
    Outcome,
    Receipt,
    Reply,
    Settled,
    Sign,
    Turn,
    Wish,
    Word,
    after_look_up,
    after_withdrawal,
    after_word,
    age_ms,
    found,
    is_old,
    learn,
    read_answer,
    read_look_up,
    settle,
)
from hardcore.settings import Limits

MINUTE_MS = 60_000
DAY_MS = 24 * 60 * MINUTE_MS
START = Moment("boot-1", 1_000_000_000, 1_000_000_000_000)


def later(ms: int, *, slept_ms: int = 0, boot: str = "boot-1") -> Moment:
    return Moment(boot, START.awake_ns + ms * 1_000_000, START.wall_ns + (ms + slept_ms) * 1_000_000)


def a_wish(key: str, browser: bytes | None = b"me", size_bytes: int = 100) -> Wish:
    return Wish(key, "0" * 32, "d", browser, "POST", b"/t", b"localhost", (), size_bytes)


def a_receipt(number: int, browser: bytes | None = b"me", outcome: Outcome = Outcome.WAITING) -> Receipt:
    return Receipt(number, a_wish(f"k{number}", browser), START, START, START, outcome)


def said(**fields: object) -> bytes:
    return json.dumps(fields).encode()


# -- age -------------------------------------------------------------------------------------------------


def test_a_machine_that_sleeps_makes_no_promise_old() -> None:
    assert age_ms(START, later(1000, slept_ms=DAY_MS)) == 1000
    assert not is_old(START, later(1000, slept_ms=DAY_MS), 15 * MINUTE_MS)


def test_over_a_reboot_the_wall_clock_counts_and_one_that_ran_backwards_proves_no_youth() -> None:
    assert not is_old(START, later(14 * MINUTE_MS, boot="boot-2"), 15 * MINUTE_MS)
    assert is_old(START, later(15 * MINUTE_MS, boot="boot-2"), 15 * MINUTE_MS)
    backwards = Moment("boot-2", 5, START.wall_ns - 1)
    assert is_old(START, backwards, 15 * MINUTE_MS)
    assert age_ms(START, backwards) == 0


# -- what a look-up leads to -----------------------------------------------------------------------------


CASES = [
    Case(old=old, suspected=suspected, sendable=sendable, weary=weary, aside=aside, dropped=dropped)
    for old, suspected, sendable, weary, aside, dropped in itertools.product((False, True), repeat=6)
]


@pytest.mark.parametrize("sign", [Sign.ABSENT, Sign.TAKEN, Sign.SILENT])
@pytest.mark.parametrize("case", CASES)
def test_nothing_is_sent_to_a_core_that_may_still_be_running_it(sign: Sign, case: Case) -> None:
    if not case.sendable:
        assert after_look_up(sign, case) is not Turn.SEND


@pytest.mark.parametrize("case", CASES)
def test_what_is_absent_and_old_or_suspected_is_never_sent(case: Case) -> None:
    turn = after_look_up(Sign.ABSENT, case)
    doubted = case.old or case.suspected or case.weary or case.aside or case.dropped
    assert (turn is Turn.SEND) is (case.sendable and not doubted)
    if case.aside:
        assert turn is Turn.SET_ASIDE
    elif case.suspected:
        assert turn is Turn.TRY
    elif case.old or case.weary or case.dropped:
        assert turn is Turn.ASK  # also where a core may be running it: nobody waits behind it for ever


@pytest.mark.parametrize("case", CASES)
def test_a_look_up_that_taught_nothing_changes_nothing(case: Case) -> None:
    assert after_look_up(Sign.SILENT, case) is Turn.WAIT


@pytest.mark.parametrize(
    ("status", "body", "meant"),
    [
        (404, said(outcome="not_done"), Sign.ABSENT),
        (404, b"no such page", Sign.SILENT),
        (200, said(outcome="unknown"), Sign.TAKEN),
        (200, said(outcome="done", status=201, answer={"id": 1}), found(201, {"id": 1}, sent=False)),
        (
            200,
            said(outcome="done", status=422, answer={"detail": "no"}),
            Settled(Outcome.REFUSED, 422, {"detail": "no"}),
        ),
        (200, said(outcome="done", status=99), Sign.SILENT),
        (200, b"[" * 100_000, Sign.SILENT),
        (503, said(outcome="unknown"), Sign.SILENT),
        (503, said(outcome="not_done"), Sign.SILENT),
    ],
)
def test_only_the_two_answers_of_the_contract_are_believed(
    status: int, body: bytes, meant: Settled | Sign
) -> None:
    assert read_look_up(status, body) == meant


def test_what_this_gateway_had_sent_is_done_and_not_done_already() -> None:
    assert found(201, None, sent=True).outcome is Outcome.DONE
    assert found(201, None, sent=False).outcome is Outcome.ALREADY_DONE
    assert found(409, None, sent=True).outcome is Outcome.REFUSED


# -- what an answer means --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("status", "body", "meant"),
    [
        (201, said(id=1), Settled(Outcome.DONE, 201, {"id": 1})),
        (303, b"", Reply.CHECK),
        (422, said(detail="no"), Settled(Outcome.REFUSED, 422, {"detail": "no"})),
        *((status, said(detail="no"), Reply.CHECK) for status in (401, 403, 404, 405, 409)),
        (425, b"", Reply.LATER),
        (429, b"", Reply.LATER),
        (503, said(outcome="not_done"), Reply.LATER),
        (503, said(outcome="unknown"), Reply.DOUBTFUL),
        (504, b"", Reply.ODD),
        (500, said(outcome="not_done"), Reply.LATER),
        (507, b"", Reply.ODD),
    ],
)
def test_an_answer_settles_only_what_it_says(status: int, body: bytes, meant: Settled | Reply) -> None:
    assert read_answer(status, body, committed=False) == meant


def test_a_page_after_a_booking_is_done_only_with_its_commit() -> None:
    assert read_answer(303, b"", committed=True) == Settled(Outcome.DONE, 303)
    assert read_answer(409, b"", committed=True) is Reply.CHECK


# -- nobody wants it any more ----------------------------------------------------------------------------


def test_not_done_is_said_only_of_what_was_looked_up_where_nobody_can_be_running_it() -> None:
    signs = (Sign.ABSENT, Sign.TAKEN, Sign.SILENT)
    for sign, in_parts, certain in itertools.product(signs, (False, True), (False, True)):
        fact = after_withdrawal(sign, in_parts=in_parts, certain=certain)
        not_done = sign is Sign.ABSENT and certain and not in_parts
        assert (fact == Settled(Outcome.NOT_DONE)) is not_done
    assert after_withdrawal(Sign.TAKEN, in_parts=False, certain=True) == Settled(Outcome.UNKNOWN)
    assert after_withdrawal(Sign.SILENT, in_parts=False, certain=True) is None


def test_of_a_form_that_a_core_had_its_own_key_alone_does_not_say_that_nothing_was_done() -> None:
    form = replace(
        a_wish("k1"), headers=((b"Content-Type", b"application/x-www-form-urlencoded; charset=utf-8"),)
    )
    assert form.in_parts
    assert not a_wish("k1").in_parts
    assert after_withdrawal(Sign.ABSENT, in_parts=True, certain=True) == Settled(Outcome.UNKNOWN)


# -- a person's word -------------------------------------------------------------------------------------


@pytest.mark.parametrize("outcome", Outcome)
def test_a_word_counts_only_where_it_fits(outcome: Outcome) -> None:
    one = a_receipt(1, outcome=outcome)
    ran, cancelled, seen = (after_word(one, word, later(5)) for word in (Word.RUN, Word.CANCEL, Word.SEEN))
    assert (ran is not None) is (outcome is Outcome.ASK)
    assert cancelled is None  # the ledger is asked first
    assert (seen is not None) is (outcome not in OPEN)


def test_what_runs_again_is_young() -> None:
    one = replace(a_receipt(1, outcome=Outcome.ASK), status=401, answer={})
    ran = after_word(one, Word.RUN, later(DAY_MS))
    assert ran is not None
    assert (ran.outcome, ran.since, ran.kept) == (Outcome.WAITING, later(DAY_MS), START)
    assert (ran.status, ran.answer) == (None, None)


def test_what_was_only_needed_to_send_it_is_let_go_of_with_the_outcome() -> None:
    one = replace(a_receipt(1), wish=replace(a_wish("k1"), headers=((b"X-Pin", b"1234"),)))
    assert settle(one, Settled(Outcome.DONE, 201), later(1)).wish.headers == ()


# -- the book --------------------------------------------------------------------------------------------


def test_a_promise_takes_its_room_from_the_moment_it_is_being_stored() -> None:
    book = Book(Limits(receipts_max=1))
    book.expect(a_wish("k1"))
    assert not book.admits(a_wish("k2"))
    book.expected_no_more("k1")
    assert book.admits(a_wish("k2"))


def test_one_browser_and_all_bytes_have_bounds_and_what_is_settled_takes_none() -> None:
    book = Book(Limits(receipts_per_browser_max=1, receipt_bytes_max=1024), [a_receipt(1)])
    assert not book.admits(a_wish("k2", b"me"))
    assert book.admits(a_wish("k2", b"you"))
    assert book.admits(a_wish("k2", None))
    assert not book.admits(a_wish("k2", b"you", 1000))
    book.put(a_receipt(1, outcome=Outcome.DONE))
    assert book.admits(a_wish("k2", b"me", 1000))


def test_the_oldest_of_each_browser_has_its_turn_and_holds_the_next_back() -> None:
    book = Book(Limits(), [a_receipt(3, b"b"), a_receipt(1, b"a"), a_receipt(2, b"a")])
    assert [one.number for one in book.turns((), ())] == [1, 3]
    assert [one.number for one in book.turns(("k1",), ())] == [3]
    assert [one.number for one in book.turns((), ("k1",))] == [3]
    book.put(a_receipt(1, b"a", Outcome.ASK))
    assert [one.number for one in book.turns((), ())] == [2, 3]


def test_whoever_has_no_cookie_of_ours_holds_nobody_back() -> None:
    book = Book(Limits(), [a_receipt(1, None), a_receipt(2, None)])
    assert [one.number for one in book.turns(("k1",), ())] == [2]


def test_what_another_gateway_has_written_is_learned_and_a_fact_is_never_forgotten_for_it() -> None:
    book = Book(Limits(), [a_receipt(1), a_receipt(2, outcome=Outcome.DONE)])
    assert not learn(book, a_receipt(1))
    assert not learn(book, a_receipt(2))
    assert learn(book, a_receipt(3))
    assert learn(book, replace(a_receipt(1, outcome=Outcome.NOT_DONE), changed=later(1)))
    assert {one.number for one in book.open()} == {3}


def test_no_more_run_than_may() -> None:
    book = Book(Limits(), [a_receipt(n, b"%d" % n) for n in range(RUNNING_MAX + 3)])
    assert len(list(book.turns((), ()))) == RUNNING_MAX
    assert list(book.turns([f"k{n}" for n in range(RUNNING_MAX)], ())) == []


def test_a_page_that_opens_is_told_what_is_open_or_was_not_seen() -> None:
    seen = replace(a_receipt(3, outcome=Outcome.DONE), seen=True)
    book = Book(Limits(), [a_receipt(1), a_receipt(2, outcome=Outcome.REFUSED), seen, a_receipt(4, b"you")])
    assert [one.number for one in book.untold(b"me")] == [1, 2]


def test_what_is_settled_is_kept_for_a_day_and_what_nobody_answered_is_given_up_then() -> None:
    book = Book(Limits(), [a_receipt(n, outcome=outcome) for n, outcome in enumerate(Outcome)])
    assert book.stale(later(DAY_MS - 1), DAY_MS) == ([], [])
    unanswered, settled = book.stale(later(DAY_MS), DAY_MS)
    assert {one.outcome for one in settled} == set(Outcome) - OPEN
    assert {one.outcome for one in unanswered} == {Outcome.ASK, Outcome.SET_ASIDE}


def test_the_oldest_settled_ones_make_room() -> None:
    many = [replace(a_receipt(n, outcome=Outcome.DONE), changed=later(n)) for n in range(SETTLED_MAX + 2)]
    _, settled = Book(Limits(), many).stale(later(0), DAY_MS)
    assert [one.number for one in settled] == [0, 1]
