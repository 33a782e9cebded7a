"""A message over HTTP: to a webhook, signed if there is a secret, and to a topic of ntfy.

The connection is made here by hand: the standard library's opener would follow redirects and proxies, and both would
carry what is said, and the token in the address, to somebody whom nobody has named. Of the answer only the status counts:
what comes after it is not even read, because a body that stops half-way would make undelivered what was delivered.
"""

import hashlib
import hmac
import http.client
import json
import ssl
from collections.abc import Mapping
from typing import Any, Final
from urllib.parse import SplitResult, urlsplit

from hardcore.alerting.bounded import Bounded
from hardcore.alerting.outcomes import Sent, of_error, of_status
from hardcore.alerting.wording import Message
from hardcore.recovery.channels import Channel, Stage

WAIT_S: Final = 5.0
#: Discord takes no longer text.
TEXT_CHARACTERS_MAX: Final = 2_000
_PRIORITIES: Final = {True: 5, False: 3}


def to_webhook(channel: Channel, message: Message, secret: str, now_s: int) -> Sent:
    """POST it as JSON. The signature covers the time and the body, so that an old one can't be sent again."""
    body = json.dumps(webhook_value(message), ensure_ascii=False).encode(errors="replace")
    headers = {"X-Hardcore-Id": message.notice.id, "X-Hardcore-Timestamp": str(now_s)}
    if secret:
        headers["X-Hardcore-Signature"] = signature(secret, now_s, body)
    return _post(urlsplit(channel.url), _target(urlsplit(channel.url)), body, headers)


def signature(secret: str, now_s: int, body: bytes) -> str:
    """Return `v1=` and the HMAC-SHA256 of "<seconds>.<body>" in hex."""
    return "v1=" + hmac.new(secret.encode(), f"{now_s}.".encode() + body, hashlib.sha256).hexdigest()


def webhook_value(message: Message) -> dict[str, Any]:
    """Return what a webhook is told. `text` and `content` are what chat services show of a message."""
    notice = message.notice
    text = f"{message.title}\n{message.body}"[:TEXT_CHARACTERS_MAX]
    return {
        "version": 1,
        "id": notice.id,
        "at": notice.at,
        "stage": str(notice.stage),
        "diagnosis": notice.diagnosis,
        "incident": notice.incident,
        "fingerprint": notice.fingerprint,
        "outcome": notice.outcome or None,
        "outage_ms": notice.outage_ms,
        "left_out": message.left_out,
        "title": message.title,
        "url": message.link or None,
        "text": text,
        "content": text,
    }


def to_ntfy(channel: Channel, message: Message, secret: str) -> Sent:
    """Publish it under the topic that the address ends in; `secret` is an access token."""
    parts = urlsplit(channel.url)
    path, _, topic = parts.path.rstrip("/").rpartition("/")
    value: dict[str, Any] = {
        "topic": topic,
        "title": message.title,
        "message": message.body,
        "priority": _PRIORITIES[message.urgent],
        "tags": [_tag(message)],
    }
    if message.link:
        value["click"] = message.link
    headers = {"Authorization": f"Bearer {secret}"} if secret else {}
    return _post(parts, f"{path}/", json.dumps(value).encode(), headers)


def _tag(message: Message) -> str:
    if message.notice.stage is Stage.CLOSED and not message.urgent:
        return "white_check_mark"
    return "information_source" if message.notice.stage is Stage.TEST else "warning"


def _target(parts: SplitResult) -> str:
    return (parts.path or "/") + (f"?{parts.query}" if parts.query else "")


def _post(parts: SplitResult, target: str, body: bytes, headers: Mapping[str, str]) -> Sent:
    connection = _connection(parts)
    try:
        told = {"Content-Type": "application/json", "User-Agent": "hardcore-alerting", "Connection": "close"}
        connection.request("POST", target, body, {**told, **headers})
        return of_status(connection.getresponse().status)
    except (OSError, http.client.HTTPException, ValueError) as error:
        return of_error(error)
    finally:
        connection.close()


class _Answer(http.client.HTTPResponse):
    """An answer whose head ends."""

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        self.fp: Any = Bounded(self.fp)


def _connection(parts: SplitResult) -> http.client.HTTPConnection:
    assert parts.hostname is not None, "the policy was judged"
    made: http.client.HTTPConnection
    if parts.scheme == "https":
        context = ssl.create_default_context()
        made = http.client.HTTPSConnection(parts.hostname, parts.port, timeout=WAIT_S, context=context)
    else:
        made = http.client.HTTPConnection(parts.hostname, parts.port, timeout=WAIT_S)
    made.response_class = _Answer
    return made
