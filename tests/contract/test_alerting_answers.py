"""What an answer means: delivered is what was taken, and an answer that does not end is none."""

import socket
import threading

import pytest

from hardcore.alerting import bounded
from hardcore.alerting.notices import Notice
from hardcore.alerting.outcomes import Sent
from hardcore.alerting.ways import send
from hardcore.alerting.wording import compose
from hardcore.recovery.channels import Stage, read_channels
from tests.contract.alert_targets import listening, post, web

ENDLESS = 4 << 10


def sent(url: str, kind: str = "webhook", text: str = "the core ended") -> Sent:
    channels = read_channels([{"kind": kind, "url": url}])
    assert isinstance(channels, tuple), channels
    notice = Notice("0190", "2026-01-01T00:00:00Z", Stage.OPENED, "CRASHED", "CRASHED", "i1", text)
    return send(channels[0], compose(notice, {}, ("en",)))


def mail(port: int) -> str:
    return f"smtp://127.0.0.1:{port}/?from=a@home.example&to=b@home.example&to=wife@home.example"


@pytest.mark.parametrize(
    "head", [b"Content-Length: 20\r\n\r\nshort", b"Transfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n"]
)
def test_a_message_is_delivered_when_its_status_says_so_whatever_becomes_of_the_body(head: bytes) -> None:
    with web(b"HTTP/1.1 200 OK\r\n" + head) as target:
        assert sent(target.url) == Sent(ok=True, status=200)


def test_a_mail_that_was_taken_is_delivered_however_the_server_takes_its_leave() -> None:
    with post() as target:
        target.leaves = b"421 closing\r\n"
        assert sent(mail(target.port), "smtp") == Sent(ok=True)
        assert len(target.mails) == 1


def test_a_mail_that_one_of_two_does_not_get_is_told_as_that_and_not_sent_twice() -> None:
    with post("RCPT TO:<WIFE") as target:
        came = sent(mail(target.port), "smtp")
    assert (came.ok, came.why, came.final) == (True, "partly", True)


def test_text_that_no_encoding_has_is_sent_without_it() -> None:
    with web() as target:
        assert sent(target.url, text="bad \udcff text").ok


@pytest.mark.parametrize(
    ("kind", "piece"), [("smtp", b"220-more\r\n"), ("webhook", b"HTTP/1.1 100 Continue\r\n\r\n")]
)
def test_an_answer_without_an_end_is_left(kind: str, piece: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded, "ANSWER_BYTES_MAX", ENDLESS)

    def talk(server: socket.socket, open_ones: list[socket.socket]) -> None:
        line, _ = server.accept()
        open_ones.append(line)
        try:
            while True:
                line.sendall(piece)
        except OSError:
            return  # it was left: that is what is asked here

    with listening() as (server, open_ones):
        threading.Thread(target=talk, args=(server, open_ones), daemon=True).start()
        port = server.getsockname()[1]
        came = sent(mail(port) if kind == "smtp" else f"http://127.0.0.1:{port}/x", kind)
    assert (came.ok, came.why) == (False, "connection")
