"""A form's wish: what a page carries of it is what comes back, and nothing else is taken for it."""

import re
from html import unescape
from urllib.parse import urlencode

import pytest

from frontend import crisis_paper
from hardcore.crisis import shelf
from hardcore.crisis.heads import RequestHead, read_request
from hardcore.crisis.receipts_form import (
    FORM_TYPE,
    KeptForm,
    form_in,
    hidden_fields,
    posted_bytes,
    read_kept,
    request_digest,
    wish_of_form,
    wish_of_request,
)

BODY = 'description=김밥 & "차" <b>&_idempotency_key=k1'.encode()


def a_head(method: str = "POST", target: bytes = b"/entries?a=%22", kind: str = FORM_TYPE) -> RequestHead:
    lines = (
        (b"Host", b"localhost"),
        (b"Accept", b"text/html"),
        (b"Content-Type", kind.encode()),
        (b"Cookie", b"lang=ko"),
        (b"Prefer", b"respond-async"),
    )
    head = read_request(method, target, "1.1", lines, {"localhost"}, keep_alive=True, upgrade=False)
    assert isinstance(head, RequestHead)
    return head


def a_form() -> KeptForm:
    form = form_in(a_head(), BODY, "/register?q=<a>")
    assert form is not None
    return form


def pressed(page: bytes) -> bytes:
    """What a browser sends when the button beside these fields is pressed."""
    found = re.findall(r'name="([a-z]+)" value="([^"]*)"', page.decode())
    return urlencode([(name, unescape(value)) for name, value in found]).encode()


def test_what_a_page_carries_comes_back_as_it_was() -> None:
    form = a_form()
    sent = pressed(hidden_fields(form))
    assert read_kept(a_head(), sent) == form
    assert posted_bytes(form) == len(sent)


def test_nothing_of_a_form_can_end_the_field_that_carries_it() -> None:
    form = KeptForm('"><script>', '/"><script>', FORM_TYPE, b'"><script>', '/"><script>')
    assert hidden_fields(form).count(b"<") == hidden_fields(form).count(b"<input") == 5


@pytest.mark.parametrize(
    ("head", "body"),
    [
        pytest.param(a_head("GET"), BODY, id="only reads"),
        pytest.param(a_head(kind="multipart/form-data; boundary=x"), BODY, id="may have a file in it"),
        pytest.param(a_head(), b"description=a", id="no key"),
        pytest.param(a_head(), BODY + b"&_idempotency_key=k2", id="two keys"),
        pytest.param(a_head(), b"_idempotency_key=k%201", id="no key that the ledger takes"),
        pytest.param(a_head(), b"\xff" + BODY, id="no text"),
        pytest.param(a_head(target=b"/__hc/keep"), BODY, id="the gateway's own"),
    ],
)
def test_what_could_not_be_done_once_is_not_offered(head: RequestHead, body: bytes) -> None:
    assert form_in(head, body, "/") is None


def test_a_way_back_that_leaves_this_origin_leads_home() -> None:
    form = form_in(a_head(), BODY, "//elsewhere.example")
    assert form is not None
    assert form.back == "/"


def test_a_kept_form_is_sent_as_the_pages_own_script_would_under_the_name_of_the_very_request() -> None:
    wish = wish_of_form(a_form(), a_head(target=b"/__hc/keep"), b"me")
    headers = dict(wish.headers)
    assert (headers[b"Accept"], headers[b"Idempotency-Key"]) == (b"application/json", b"k1")
    assert (headers[b"Accept-Language"], b"Prefer" in headers) == (b"ko", False)
    assert wish.digest == request_digest(a_head(), [BODY])
    assert wish.target == b"/entries?a=%22"


def test_what_opens_doors_is_no_part_of_a_promise() -> None:
    lines = (
        (b"Host", b"localhost"),
        (b"Idempotency-Key", b"k1"),
        (b"Authorization", b"Bearer secret"),
        (b"Cookie", b"session=secret; lang=en"),
        (b"Proxy-Authorization", b"Basic secret"),
        (b"If-Match", b'"7"'),
    )
    head = read_request("POST", b"/t", "1.1", lines, {"localhost"}, keep_alive=True, upgrade=False)
    assert isinstance(head, RequestHead)
    wish = wish_of_request(head, [b"{}"], b"me", back="/")
    assert b"secret" not in repr(wish).encode()
    headers = dict(wish.headers)
    assert (headers[b"If-Match"], headers[b"Accept-Language"]) == (b'"7"', b"en")


def test_the_marks_that_are_filled_in_are_those_that_are_printed() -> None:
    assert shelf.FIELDS_MARK.decode() == crisis_paper.FIELDS_MARK
    assert shelf.KEY_MARK.decode() == crisis_paper.KEY_MARK
    assert shelf.NUMBER_MARK.decode() == crisis_paper.NUMBER_MARK
    assert shelf.WHY_MARK.decode() == crisis_paper.WHY_MARK
