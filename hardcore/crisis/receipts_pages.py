"""A receipt as it is told: as JSON to a program, as a page to a tab, as a frame to an open page. Texts from values.

One receipt, three readings, made here and nowhere else, so that they can't contradict each other. The pages were drawn
in peace, one for each outcome; what is a reader's own (key, number, the ledger's sentence) is put into its marks.
"""

import datetime as dt
import html
import json
import re
from urllib.parse import quote

from hardcore.crisis.heads import RequestHead
from hardcore.crisis.pages import NUMBER_CHARACTERS, Answer, filled, whole
from hardcore.crisis.receipts import Moment, Receipt, age_ms, letter_of
from hardcore.crisis.routing import RECEIPT_PREFIX
from hardcore.crisis.shelf import KEY_MARK, LETTER_MARK, NUMBER_MARK, WHY_MARK, Sheet

#: Characters of the ledger's own sentence that are repeated.
WHY_CHARACTERS_MAX = 400
_JSON = b"application/json"
_HOME = b' href="/">'


def address(key: str) -> str:
    """Where a receipt can be asked for."""
    return RECEIPT_PREFIX.decode() + quote(key, safe="")


def promised(receipt: Receipt) -> Answer:
    """The promise: what whoever takes one for an answer gets."""
    extra = [(b"Location", address(receipt.wish.key).encode()), (b"Preference-Applied", b"respond-async")]
    body = _text({"receipt": receipt.wish.key, "outcome": receipt.outcome})
    return whole(202, _JSON, body, extra)


def shown_at(key: str) -> Answer:
    """Lead a tab to the page of a receipt."""
    return whole(303, b"text/plain", b"", [(b"Location", address(key).encode())])


def as_json(receipt: Receipt, now: Moment, status: int = 200) -> Answer:
    """All that is known of a receipt."""
    kept_at = dt.datetime.fromtimestamp(receipt.kept.wall_ns / 1e9, tz=dt.UTC)
    fields = {
        "key": receipt.wish.key,
        "method": receipt.wish.method,
        "path": receipt.wish.target.decode("latin-1"),
        "outcome": receipt.outcome,
        "status": receipt.status,
        "answer": receipt.answer,
        "letter": letter_of(receipt),
        "kept_at": kept_at.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
        "age_ms": age_ms(receipt.since, now),
        "seen": receipt.seen,
    }
    return whole(status, _JSON, _text(fields))


def as_page(receipt: Receipt, sheet: Sheet, head: RequestHead) -> Answer:
    """The page of a receipt."""
    fills = {
        KEY_MARK: quote(receipt.wish.key, safe=""),
        NUMBER_MARK: html.escape(receipt.wish.key[-NUMBER_CHARACTERS:]),
        WHY_MARK: html.escape(_why(receipt.answer)),
        LETTER_MARK: html.escape((letter_of(receipt) or receipt.wish.key)[-NUMBER_CHARACTERS:]),
    }
    body = _filled(sheet.plain, fills)
    body = body.replace(_HOME, b' href="%s">' % html.escape(receipt.wish.back).encode())
    return filled(sheet, head, body)


def frame_fields(receipt: Receipt) -> dict[str, object]:
    """What an open page is told."""
    outcome, status = receipt.outcome, receipt.status
    return {"v": 1, "type": "receipt", "key": receipt.wish.key, "outcome": outcome, "status": status}


def _filled(page: bytes, fills: dict[bytes, str]) -> bytes:
    """In one pass: what was filled in is never looked through for marks."""
    marks = b"|".join(re.escape(mark) for mark in fills)
    return re.sub(marks, lambda mark: fills[mark[0]].encode(), page)


def _why(answer: object) -> str:
    """The ledger's own sentence about a refusal."""
    told = answer.get("detail") if isinstance(answer, dict) else None
    return told[:WHY_CHARACTERS_MAX] if isinstance(told, str) else ""


def _text(fields: dict[str, object]) -> bytes:
    return json.dumps(fields, ensure_ascii=False, separators=(",", ":")).encode()
