"""The recovery page of a form leads back to the page that the form stood on, and nowhere else."""

import gzip

import pytest

from hardcore.crisis import pages
from hardcore.crisis.heads import RequestHead
from hardcore.crisis.problems import Problem
from hardcore.crisis.shelf import Sheet


def a_form(referer: bytes | None, method: str = "POST") -> RequestHead:
    headers = () if referer is None else ((b"Referer", referer),)
    return RequestHead(
        method, b"/entries", b"/entries", b"home.test:3000", headers,
        0, None, True, True, False, True, False, "en", b"",
    )  # fmt: skip


def link(head: RequestHead) -> bytes:
    plain = b'<p><a href="/">Open</a></p>'
    sheet = Sheet(gzip.compress(plain), b"text/html", "tag", "policy")
    answer = pages.recovery(sheet, Problem.RECOVERING, head)
    packed = (b"Content-Encoding", b"gzip") in answer.head.headers
    return gzip.decompress(answer.body) if packed else answer.body


def test_a_form_leads_back_to_its_own_page() -> None:
    assert b'<a href="/register?q=a&amp;b=1">' in link(a_form(b"http://home.test:3000/register?q=a&b=1"))


@pytest.mark.parametrize(
    "referer",
    [
        None,
        b"http://elsewhere.test/register",
        b"http://home.test:3000//elsewhere.test",
        b"http://home.test:3000/\\elsewhere.test",
        b"javascript://home.test:3000/%0aalert(1)",
        b"http://[",
        b"http://home.test:3000/\xff",
    ],
)
def test_any_other_address_leads_to_the_first_page(referer: bytes | None) -> None:
    assert b'<a href="/">' in link(a_form(referer))


def test_a_page_that_only_reads_is_the_same_for_everybody() -> None:
    assert b'<a href="/">' in link(a_form(b"http://home.test:3000/register", "GET"))
