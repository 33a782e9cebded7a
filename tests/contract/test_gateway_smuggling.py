"""Raw bytes that two servers might read differently: each is refused with an answer, or has one meaning only.

Every case is sent with another request behind it. What must not happen is that a core sees that one, or anything at
all of what was refused, and that a connection ends without a word.
"""

from pathlib import Path

import pytest

from tests.contract.gateway_world import Client, Response, world

HOST = b"Host: localhost\r\n"
HIDDEN = b"GET /smuggled HTTP/1.1\r\nHost: localhost\r\n\r\n"
CHUNKED = b"POST /t HTTP/1.1\r\n" + HOST + b"Transfer-Encoding: chunked\r\n\r\n"


def _post(*lines: bytes, body: bytes = b"") -> bytes:
    return b"POST /t HTTP/1.1\r\n" + HOST + b"".join(line + b"\r\n" for line in lines) + b"\r\n" + body


def _get(*lines: bytes, target: bytes = b"/t") -> bytes:
    return b"GET " + target + b" HTTP/1.1\r\n" + HOST + b"".join(line + b"\r\n" for line in lines) + b"\r\n"


REFUSED = {
    # how long is it?
    "length and chunks": _post(b"Content-Length: 5", b"Transfer-Encoding: chunked", body=b"0\r\n\r\n"),
    "a length of nothing and chunks": _post(
        b"Content-Length: 0", b"Transfer-Encoding: chunked", body=b"0\r\n\r\n"
    ),
    "the same length twice": _post(b"Content-Length: 3", b"content-length: 3", body=b"abc"),
    "two lengths in one line": _post(b"Content-Length: 3,4", body=b"abc"),
    "an empty length": _post(b"Content-Length:", body=b"abc"),
    "a negative length": _post(b"Content-Length: -1", body=b"abc"),
    "a length in hex": _post(b"Content-Length: 0x3", body=b"abc"),
    "a length with a point": _post(b"Content-Length: 3.0", body=b"abc"),
    "a length of other digits": _post("Content-Length: ٣".encode(), body=b"abc"),
    "a length that wraps": _post(b"Content-Length: 18446744073709551619", body=b"abc"),
    "a length with an underscore": _post(b"Content-Length: 1_0", body=b"0123456789"),
    "a length over two lines": _post(b"Content-Length: 1\r\n 0", body=b"0123456789"),
    # which coding is it in?
    "another coding": _post(b"Transfer-Encoding: identity", b"Content-Length: 3", body=b"abc"),
    "another coding alone": _post(b"Transfer-Encoding: xchunked", body=b"0\r\n\r\n"),
    "chunked is not the last coding": _post(b"Transfer-Encoding: chunked, gzip", body=b"0\r\n\r\n"),
    "codings in two lines": _post(
        b"Transfer-Encoding: gzip", b"Transfer-Encoding: chunked", body=b"0\r\n\r\n"
    ),
    "a coding in quotes": _post(b'Transfer-Encoding: "chunked"', body=b"0\r\n\r\n"),
    "a coding behind a vertical tab": _post(b"Transfer-Encoding: \x0bchunked", body=b"0\r\n\r\n"),
    "a coding with a control byte": _post(b"Transfer-Encoding: chunked\x00", body=b"0\r\n\r\n"),
    "a space before the colon of a coding": _post(b"Transfer-Encoding : chunked", body=b"0\r\n\r\n"),
    "a folded coding": _post(b"Transfer-Encoding:\r\n chunked", body=b"0\r\n\r\n"),
    # where does a chunk end?
    "a chunk with a bare line feed": CHUNKED + b"3\nabc\r\n0\r\n\r\n",
    "chunk data without its end": CHUNKED + b"3\r\nabcd\r\n0\r\n\r\n",
    "chunk data that ends in a bare line feed": CHUNKED + b"3\r\nabc\n0\r\n\r\n",
    "a negative chunk": CHUNKED + b"-3\r\nabc\r\n0\r\n\r\n",
    "a chunk in 0x": CHUNKED + b"0x3\r\nabc\r\n0\r\n\r\n",
    "a chunk that wraps": CHUNKED + b"10000000000000003\r\nabc\r\n0\r\n\r\n",
    "a chunk without a size": CHUNKED + b"\r\nabc\r\n0\r\n\r\n",
    "a chunk size behind a space": CHUNKED + b" 3\r\nabc\r\n0\r\n\r\n",
    "a chunk extension with a bare line feed": CHUNKED + b"3;a=b\nabc\r\n0\r\n\r\n",
    "a length behind the last chunk": CHUNKED + b"3\r\nabc\r\n0\r\nContent-Length: 9\r\n\r\n",
    "a coding behind the last chunk": CHUNKED + b"3\r\nabc\r\n0\r\nTransfer-Encoding: chunked\r\n\r\n",
    # where does a line end?
    "line feeds alone": b"GET /t HTTP/1.1\nHost: localhost\n\n",
    "a carriage return alone": b"GET /t HTTP/1.1\r\n" + HOST + b"X: a\rY: b\r\n\r\n",
    "a folded line": _get(b"X: a\r\n b"),
    "a folded first line": b"GET /t HTTP/1.1\r\n X: a\r\n" + HOST + b"\r\n",
    "a zero byte in a value": _get(b"X: a\x00b"),
    "a zero byte in a name": _get(b"X\x00: a"),
    "a name with a space": _get(b"X Y: a"),
    "a name that is empty": _get(b": a"),
    "a name of other letters": _get("Ｘ: a".encode()),
    "a line without a colon": _get(b"Content-Length"),
    # for whom is it?
    "no host": b"GET /t HTTP/1.1\r\n\r\n",
    "two hosts": _get(b"Host: localhost"),
    "an absolute target": _get(target=b"http://localhost/t"),
    "a target of another scheme": _get(target=b"file:///etc/passwd"),
    "an authority": b"CONNECT localhost:80 HTTP/1.1\r\n" + HOST + b"\r\n",
    "a target without a slash": _get(target=b"t"),
    "a target with a space": _get(target=b"/t x"),
    "a target with a control byte": _get(target=b"/t\x01"),
    "a target with a tab": _get(target=b"/\tt"),
    # which protocol is it?
    "no version": b"GET /t\r\n\r\n",
    "a version of old": b"GET /t HTTP/0.9\r\n" + HOST + b"\r\n",
    "a version to come": b"GET /t HTTP/1.2\r\n" + HOST + b"\r\n",
    "a version in small letters": b"GET /t http/1.1\r\n" + HOST + b"\r\n",
    "the preface of HTTP/2": b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    "chunks in HTTP/1.0": b"POST /t HTTP/1.0\r\n" + HOST + b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
    "an upgrade with a body": _post(
        b"Connection: Upgrade", b"Upgrade: h2c", b"Content-Length: 3", body=b"abc"
    ),
    "a socket with a body": _get(
        b"Connection: Upgrade",
        b"Upgrade: websocket",
        b"Sec-WebSocket-Version: 13",
        b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        b"Content-Length: 3",
    ),
    "a method of no letters": b"\x80\x81 /t HTTP/1.1\r\n" + HOST + b"\r\n",
    "a TLS greeting": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
}


@pytest.mark.parametrize("known", [False, True], ids=["at first", "after a good request"])
def test_a_request_that_two_servers_could_read_differently_is_refused_with_all_that_follows(
    tmp_path: Path, *, known: bool
) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        for name, data in REFUSED.items():
            client = w.client()
            if known:
                assert client.ask("GET", "/good").read().status == 200
            answer = client.send(data + HIDDEN).read()
            assert answer.status in {400, 405, 501}, f"{name}: {answer.status}"
            assert answer.header("Connection") == "close", name
            assert answer.json().get("outcome", "not_done") == "not_done", name
            assert client.closed(), name
            client.close()
        assert set(core.targets()) <= {"/good"}


def test_a_broken_end_of_a_streamed_body_never_reaches_the_core_as_an_end(tmp_path: Path) -> None:
    with world(tmp_path, replay_body_bytes_max=2) as w:
        core = w.serving()
        client = w.client().send(CHUNKED + b"a\r\n0123456789\r\nzz\r\n" + HIDDEN)
        answer = client.read()
        assert (answer.status, answer.json()["outcome"]) == (400, "not_done")
        assert client.closed()
        assert core.targets() == []


ONE_MEANING = {
    "an extension of a chunk": CHUNKED + b"3;name=value\r\nabc\r\n0\r\n\r\n",
    "a quoted extension": CHUNKED + b'3;name="a;b"\r\nabc\r\n0\r\n\r\n',
    "trailers": CHUNKED + b"3\r\nabc\r\n0\r\nX-Actor: admin\r\nHost: evil\r\nCookie: a=b\r\n\r\n",
    "zeros before a size": CHUNKED + b"0003\r\nabc\r\n0\r\n\r\n",
    "zeros before a length": _post(b"Content-Length: 0003", body=b"abc"),
    "a coding in capitals": _post(b"TRANSFER-ENCODING: CHUNKED", body=b"3\r\nabc\r\n0\r\n\r\n"),
    "empty lines before it": b"\r\n\r\n" + _post(b"Content-Length: 3", body=b"abc"),
}


def test_what_has_one_meaning_is_written_anew_for_the_core(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        for name, data in ONE_MEANING.items():
            client = w.client().send(data + HIDDEN.replace(b"smuggled", b"next"))
            assert client.read().status == 200, name
            assert client.read().json()["target"] == "/next", name
        for call in core.wait("/t", len(ONE_MEANING)):
            assert call.request.body == b"abc"
            names = [line.lower() for line, _ in call.request.headers]
            assert names == ["host", "x-request-name", "content-length"]


def test_a_client_that_names_no_websocket_is_never_given_the_line_to_the_core(tmp_path: Path) -> None:
    """h2c, TLS over HTTP, anything: answered as a plain request, and nothing after it is listened to."""
    with world(tmp_path) as w:
        core = w.serving()
        for kind in (b"h2c", b"TLS/1.0", b"websocket2", b"HTTP/2.0, websocket"):
            client = w.client().send(
                _get(b"Connection: Upgrade, HTTP2-Settings", b"Upgrade: " + kind) + HIDDEN
            )
            answer = client.read()
            assert (answer.status, answer.header("Upgrade"), answer.header("Connection")) == (
                200,
                None,
                "close",
            )
            assert client.closed(), kind
        assert set(core.targets()) == {"/t"}
        assert all(call.request.header("Upgrade") is None for call in core.calls.all())


def test_a_header_that_a_connection_names_never_reaches_the_core_as_a_fact(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        named = b"Connection: close, Cookie, Authorization"
        assert w.client().send(_get(named, b"Cookie: a=b", b"Authorization: x")).read().status == 200
        (call,) = core.wait("/t")
        assert [name for name, _ in call.request.headers] == ["Host"]


def _expecting(client: Client, length: int) -> Response:
    return client.send(_post(b"Expect: 100-continue", b"Content-Length: %d" % length)).read()


def test_whoever_waits_to_be_asked_for_a_body_is_asked_or_answered(tmp_path: Path) -> None:
    with world(tmp_path, body_bytes_max=1000) as w:
        core = w.serving()
        client = w.client()
        assert _expecting(client, 3).status == 100
        assert client.send(b"abc").read().status == 200
        assert _expecting(client, 0).status == 200
        assert _expecting(client, 5000).status == 413
        assert client.closed()
        old = w.client().send(
            b"POST /t HTTP/1.0\r\n" + HOST + b"Expect: 100-continue\r\nContent-Length: 3\r\n\r\n"
        )
        assert old.send(b"abc").read().status == 200
        assert [call.request.body for call in core.wait("/t", 3)] == [b"abc", b"", b"abc"]
