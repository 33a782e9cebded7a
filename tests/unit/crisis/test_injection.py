"""The script's tag: where a browser reads it as one, in pages for a tab, and nowhere else."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardcore.crisis.heads import AnswerHead, Header, RequestHead, read_answer, read_request
from hardcore.crisis.injection import TAG, WITHIN_BYTES, fitted, is_page, with_tag

PAGE = b"<!doctype html><html><head><title>t</title></head><body>b</body></html>"
TAGGED = PAGE.replace(b"</head>", TAG + b"</head>")
A_TAB = ((b"Sec-Fetch-Mode", b"navigate"), (b"Sec-Fetch-Dest", b"document"))


def _request(*lines: Header, method: str = "GET") -> RequestHead:
    head = read_request(
        method, b"/", "1.1", ((b"Host", b"localhost"), *lines), {"localhost"}, keep_alive=True, upgrade=False
    )
    assert isinstance(head, RequestHead)
    return head


def _answer(*lines: Header, status: int = 200, body: bytes = PAGE) -> AnswerHead:
    length = (b"Content-Length", str(len(body)).encode())
    return read_answer(status, b"OK", ((b"Content-Type", b"text/html; charset=utf-8"), length, *lines))


@pytest.mark.parametrize("end", [b"</head>", b"</HEAD>", b"</Head >", b"</head\n>"])
def test_the_tag_stands_before_the_end_of_the_head(end: bytes) -> None:
    assert with_tag(b"<head>" + end + b"</head>") == b"<head>" + TAG + end + b"</head>"


@pytest.mark.parametrize(
    "text",
    [
        b"<!-- </head> -->",
        b"<!-- </head> --!>",
        b"<!-->",
        b"<!--->",
        b"<!-- --! </head> -->",
        b'<meta content="</head><body>">',
        b"<meta content = '<body>'>",
        b"<script>'</head>'</script>",
        b"<SCRIPT src=a></head></Script >",
        b"<title></head></title>",
        b"<style></head></style>",
        b"<noscript></head></noscript>",
        b"</header>",
    ],
)
def test_a_head_that_only_seems_to_end_is_passed_over(text: bytes) -> None:
    assert with_tag(b"<head>" + text + b"</head>") == b"<head>" + text + TAG + b"</head>"


@pytest.mark.parametrize("body", [b"<body>", b"<BODY class=a>", b"<body\n>", b"<body/>"])
def test_where_the_end_of_the_head_is_left_out_the_tag_stands_before_the_body(body: bytes) -> None:
    page = b"<title><body></title>%b<p>x"
    assert with_tag(page % body) == page % (TAG + body)


@pytest.mark.parametrize(
    "page",
    [b"", b"<p>no head", b"<!-- </head>", b"<script></head>", b"</hea", b"<bodyguard>", b'<meta a="</head>'],
)
def test_a_page_whose_head_does_not_end_stays_as_it_is(page: bytes) -> None:
    assert with_tag(page) == page


def test_the_end_of_a_head_is_looked_for_in_the_beginning_of_a_page_only() -> None:
    far = b" " * WITHIN_BYTES + b"</head>"
    assert with_tag(far) == far


@given(st.binary(max_size=200))
def test_no_page_loses_a_byte(page: bytes) -> None:
    assert with_tag(page).replace(TAG, b"", 1) == page


@pytest.mark.parametrize(
    "lines",
    [
        A_TAB,
        ((b"Sec-Fetch-Mode", b"navigate"),),
        ((b"Accept", b"text/html,*/*;q=0.8"),),
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_tab_that_waits_for_a_page_is_known_by_what_its_browser_says(
    lines: tuple[Header, ...], method: str
) -> None:
    assert _request(*lines, method=method).navigation


@pytest.mark.parametrize(
    "lines",
    [
        (),
        ((b"Accept", b"*/*"),),
        ((b"Sec-Fetch-Mode", b"cors"), (b"Accept", b"text/html")),
        ((b"Sec-Fetch-Site", b"same-origin"), (b"Accept", b"text/html")),
        ((b"Sec-Fetch-Mode", b"navigate"), (b"Sec-Fetch-Dest", b"iframe")),
    ],
)
def test_a_program_a_script_and_a_frame_wait_for_no_page(lines: tuple[Header, ...]) -> None:
    assert not _request(*lines).navigation
    assert not _request((b"Accept", b"text/html"), method="HEAD").navigation
    assert not _request((b"Accept", b"text/html"), method="DELETE").navigation


def test_a_page_is_asked_for_plain_and_whole() -> None:
    asked = (b"Accept-Encoding", b"gzip"), (b"If-None-Match", b'"a"'), (b"If-Modified-Since", b"x")
    assert _request(*A_TAB, *asked).headers == A_TAB
    assert _request(*asked).headers == asked


@pytest.mark.parametrize("status", [200, 404, 422, 500, 503])
def test_a_page_is_known_whatever_its_status_says(status: int) -> None:
    assert is_page(_request(*A_TAB), _answer(status=status))


def test_what_is_no_page_for_a_tab_is_left_alone() -> None:
    assert not is_page(_request(), _answer())
    assert not is_page(_request(*A_TAB), _answer((b"Content-Encoding", b"gzip")))
    assert not is_page(_request(*A_TAB), _answer(status=206))
    assert not is_page(_request(*A_TAB), _answer(status=304))
    assert not is_page(_request(*A_TAB), read_answer(200, b"OK", ((b"Content-Type", b"text/csv"),)))


def test_a_changed_page_has_its_own_length_and_no_tag_or_digest_of_the_other() -> None:
    lines = (b"ETag", b'"a"'), (b"Last-Modified", b"x"), (b"Set-Cookie", b"s=1"), (b"Repr-Digest", b"d")
    head, body = fitted(_request(*A_TAB), _answer(*lines), PAGE, b"new")
    assert body == TAGGED
    assert head.length == len(TAGGED)
    assert [name for name, _ in head.headers] == [b"Content-Type", b"Set-Cookie", b"Set-Cookie"]
    assert head.headers[-1] == (b"Set-Cookie", b"__hc=new; Path=/; HttpOnly; SameSite=Lax")


def test_a_page_that_stays_as_it_is_keeps_its_tags() -> None:
    head, body = fitted(
        _request(*A_TAB, (b"Cookie", b"__hc=old")), _answer((b"ETag", b'"a"')), b"<p>", b"new"
    )
    assert body == b"<p>"
    assert (b"ETag", b'"a"') in head.headers
    assert all(name != b"Set-Cookie" for name, _ in head.headers)


@pytest.mark.parametrize(
    ("accepted", "takes"),
    [
        (b"gzip, deflate, br", True),
        (b"br;q=1.0, GZIP;q=0.5", True),
        (b"gzip;q=0", False),
        (b"gzip; q=0.000", False),
        (b"identity", False),
        (b"", False),
    ],
)
def test_gzip_is_used_where_it_is_taken(accepted: bytes, takes: bool) -> None:
    assert _request((b"Accept-Encoding", accepted)).gzip is takes


@pytest.mark.parametrize(
    ("cookie", "spoken"), [(b"lang=ko", "ko"), (b"a=b; lang=en", "en"), (b"lang=fr", "de"), (b"", "de")]
)
def test_the_language_chosen_on_a_page_goes_before_the_browsers_own(cookie: bytes, spoken: str) -> None:
    assert _request((b"Cookie", cookie), (b"Accept-Language", b"de")).accept_language == spoken
