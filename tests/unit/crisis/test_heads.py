"""Heads: judged once, written anew, and nothing of the hop between in them."""

import hashlib
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frontend.catalogue_gateway import PROBLEMS
from hardcore.crisis.heads import (
    Header,
    RequestHead,
    answer_bytes,
    browser_of,
    host_name,
    read_answer,
    read_request,
    request_bytes,
)
from hardcore.crisis.limits import GatewayLimits, limits_from
from hardcore.crisis.pages import problem
from hardcore.crisis.problems import RETRY_AFTER_S, STATUS, Outcome, Problem
from hardcore.crisis.routing import Route, route
from hardcore.model.phases import Face

HOSTS = {"localhost"}


def _read(
    *lines: Header, method: str = "POST", target: bytes = b"/x?y", version: str = "1.1"
) -> RequestHead | Problem:
    head = (b"Host", b"localhost"), *lines
    return read_request(method, target, version, head, HOSTS, keep_alive=True, upgrade=False)


def _head(*lines: Header, method: str = "POST") -> RequestHead:
    head = _read(*lines, method=method)
    assert isinstance(head, RequestHead)
    return head


def test_what_is_written_to_the_core_is_made_of_judged_parts() -> None:
    head = _head(
        (b"X-Stays", b"1"), (b"Connection", b"x-named"), (b"X-Named", b"2"), (b"Content-Length", b"3")
    )
    assert request_bytes(head, length=3) == (
        b"POST /x?y HTTP/1.1\r\nHost: localhost\r\nX-Stays: 1\r\nContent-Length: 3\r\n\r\n"
    )
    assert b"Transfer-Encoding: chunked" in request_bytes(head, length=None)


def test_a_request_without_a_body_says_so_only_where_one_could_be_expected() -> None:
    assert b"Content-Length: 0" in request_bytes(_head(method="POST"), length=0)
    assert b"Content-Length" not in request_bytes(_head(method="GET"), length=0)


@pytest.mark.parametrize("key", [b"", b"k" * 256, b"a b", "é".encode(), b"\x7f"])
def test_a_key_that_nobody_could_look_up_is_passed_on_but_counts_as_none(key: bytes) -> None:
    head = _head((b"Idempotency-Key", key))
    assert head.key is None
    assert (b"Idempotency-Key", key) in head.headers


def test_a_key_that_the_connection_names_goes_no_further_and_counts_as_none() -> None:
    head = _head((b"Idempotency-Key", b"k"), (b"Connection", b"Idempotency-Key"))
    assert (head.key, head.headers) == (None, ())


def test_a_key_goes_by_the_first_half_of_its_sha_256() -> None:
    assert _head((b"Idempotency-Key", b"k1")).key_hash == hashlib.sha256(b"k1").hexdigest()[:32]
    assert _head().key_hash is None


@given(st.binary(max_size=40))
def test_no_host_can_break_the_judgement(host: bytes) -> None:
    host_name(host)


@pytest.mark.parametrize(
    ("host", "name"),
    [(b"A.b:80", "a.b"), (b"[::1]:3000", "[::1]"), (b"[::1]", "[::1]"), (b"a:b", ""), (b"a:", ""), (b"", "")],
)
def test_a_host_is_its_name_without_the_port(host: bytes, name: str) -> None:
    assert host_name(host) == name


@pytest.mark.parametrize(
    ("cookie", "browser"),
    [(b"__hc=1", b"1"), (b"a=b; __hc=2; c=d", b"2"), (b"x__hc=3", None), (b"__hc=", None), (b"", None)],
)
def test_a_browser_is_whoever_carries_the_gateways_cookie(cookie: bytes, browser: bytes | None) -> None:
    assert browser_of(cookie) == browser


def test_an_answer_keeps_its_headers_and_their_order_but_not_ours() -> None:
    lines = [(b"Set-Cookie", b"a"), (b"X-Core-Epoch", b"7"), (b"Set-Cookie", b"b"), (b"Connection", b"close")]
    head = read_answer(200, b"OK", lines)
    assert head.headers == ((b"Set-Cookie", b"a"), (b"Set-Cookie", b"b"))
    assert (head.epoch, head.framed) == (7, False)


@pytest.mark.parametrize("epoch", [b"", b"x", b"-1", b"7 8", "٧".encode()])
def test_an_epoch_that_is_no_number_is_none(epoch: bytes) -> None:
    assert read_answer(200, b"OK", [(b"X-Core-Epoch", epoch)]).epoch is None


def test_an_answer_has_one_length_or_chunks() -> None:
    head = read_answer(200, b"OK", [(b"Content-Length", b"5"), (b"Transfer-Encoding", b"chunked")])
    plain = answer_bytes(head, length=5, chunked=False, close=False, http10=False)
    chunked = answer_bytes(head, length=5, chunked=True, close=True, http10=False)
    assert plain.lower().count(b"content-length") == 1
    assert b"Content-Length" not in chunked
    assert b"Connection: close" in chunked


def test_every_problem_has_a_status_and_its_texts_in_both_languages() -> None:
    assert set(STATUS) == set(Problem) == set(PROBLEMS)
    assert set(RETRY_AFTER_S) == {one for one in Problem if STATUS[one] in {429, 503}}
    for slug, texts in PROBLEMS.items():
        assert set(texts) == {"ko", "en"}, slug
        assert all(title and detail for title, detail in texts.values()), slug


@pytest.mark.parametrize("what", list(Problem))
@pytest.mark.parametrize("outcome", [None, *Outcome])
def test_a_problem_says_its_outcome_only_where_there_is_one(what: Problem, outcome: Outcome | None) -> None:
    answer = problem(what, "ko", outcome)
    assert (b'"outcome"' in answer.body) is (outcome is not None)
    assert answer.head.length == len(answer.body)


@pytest.mark.parametrize("posture", list(Face))
@pytest.mark.parametrize("leaves", [True, False])
def test_health_is_answered_in_every_phase(posture: Face, leaves: bool) -> None:
    assert route(b"/livez", posture, leaving=leaves) is Route.LIVE
    assert route(b"/readyz", posture, leaving=leaves) is Route.READY
    assert route(b"/livez/", posture, leaving=leaves) not in {Route.LIVE, Route.READY}


@pytest.mark.parametrize("posture", list(Face))
@pytest.mark.parametrize("leaves", [True, False])
def test_what_is_the_gateways_own_is_answered_in_every_phase_and_by_nobody_else(
    posture: Face, leaves: bool
) -> None:
    assert route(b"/__hc/client.js", posture, leaving=leaves) is Route.OWN
    assert route(b"/__hc/", posture, leaving=leaves) is Route.OWN
    assert route(b"/__hc/drill/crash", posture, leaving=leaves) is Route.DRILL


def test_a_gateway_that_leaves_takes_nothing_more() -> None:
    assert {route(b"/", face, leaving=True) for face in Face} == {Route.CLOSE}
    assert len({route(b"/", face, leaving=False) for face in Face}) == len(Face)


def test_limits_come_as_json_or_say_everything_that_is_wrong() -> None:
    assert limits_from("") == GatewayLimits()
    limits = limits_from('{"hold_ms": 5, "probe_ms": 6}')
    assert isinstance(limits, GatewayLimits)
    assert (limits.hold_ms, limits.probe_ms) == (5, 6)
    for text in ("{", "[]"):
        assert isinstance(limits_from(text), list)
    faults = limits_from('{"hold_ms": "5", "nonsense": 1}')
    assert isinstance(faults, list)
    assert {fault.name for fault in faults} == {"hold_ms", "nonsense"}


def test_texts_of_different_problems_differ() -> None:
    titles = sorted(texts["en"][0] for texts in PROBLEMS.values())
    assert all(a != b for a, b in pairwise(titles))


@pytest.mark.parametrize(
    "lines",
    [
        [(b"Origin", b"https://evil.example")],
        [(b"Origin", b"http://localhost:8080")],
        [(b"Origin", b"null")],
        [(b"Sec-Fetch-Site", b"cross-site")],
        [(b"Sec-Fetch-Site", b"same-site")],
        [(b"Origin", b"http://localhost"), (b"Sec-Fetch-Site", b"cross-site")],
    ],
)
def test_a_page_of_another_origin_changes_nothing(lines: list[Header]) -> None:
    assert _read(*lines) is Problem.FOREIGN_PAGE
    assert isinstance(_read(*lines, method="GET"), RequestHead)


@pytest.mark.parametrize(
    "lines",
    [
        [],
        [(b"Origin", b"http://LOCALHOST")],
        [(b"Origin", b"http://localhost"), (b"Sec-Fetch-Site", b"same-origin")],
        [(b"Sec-Fetch-Site", b"none")],
    ],
)
def test_a_program_and_a_page_of_ours_may_change_the_ledger(lines: list[Header]) -> None:
    assert isinstance(_read(*lines), RequestHead)
