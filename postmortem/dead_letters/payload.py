"""What a letter's request says: its body for people, the amounts it moves, and what of it may be kept.

Pure, and total over whatever an attacker sent: a body that is no JSON is text, one that is no text is not shown. The
headers that are kept are named here; all others are dropped before anything is stored, so that no letter ever holds
a secret that a header carried.
"""

import base64
import json
from collections.abc import Iterator, Mapping
from decimal import Decimal, InvalidOperation
from math import isfinite
from typing import Any, Final
from urllib.parse import parse_qsl, urlencode

#: The headers of a request that its second run needs. Everything else says who somebody is, or nothing.
KEPT_HEADERS: Final = frozenset({"content-type", "idempotency-key", "accept-language", "accept"})
#: Amounts that are added up for one letter, and the digits of one.
AMOUNTS_MAX: Final = 10_000
DIGITS_MAX: Final = 40
CURRENCIES_MAX: Final = 8
FIELDS_MAX: Final = 1_000
#: The field in which a page without a script carries its key.
FORM_KEY: Final = "_idempotency_key"


def without_secrets(case: Mapping[str, Any]) -> dict[str, Any]:
    """The case with the headers that may be kept; the shape of what is not a request stays as it is."""
    request = case.get("request")
    if not isinstance(request, Mapping):
        return dict(case)
    kept = [[name, value] for name, value in headers(request) if name.lower() in KEPT_HEADERS]
    return {**case, "request": {**request, "headers": kept}}


def headers(request: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The headers of a case's request; what has not their shape is none."""
    given = request.get("headers")
    return [
        (one[0], one[1])
        for one in (given if isinstance(given, list) else [])
        if isinstance(one, list) and len(one) == 2 and isinstance(one[0], str) and isinstance(one[1], str)
    ]


def body_of(case: Mapping[str, Any]) -> bytes | None:
    """The bytes that were sent; None: nobody has them."""
    request = case.get("request")
    body = request.get("body") if isinstance(request, Mapping) else None
    if not isinstance(body, str):
        return None
    try:
        return base64.b64decode(body, validate=True)
    except ValueError:
        return None


def decoded(case: Mapping[str, Any]) -> Any:
    """The body as a person reads it: JSON's value, a form's fields, text, or None where nobody has it."""
    body = body_of(case)
    if body is None:
        return None
    try:
        text = body.decode()
    except UnicodeDecodeError:
        return f"({len(body)} bytes that are no text)"
    if _is_form(case):
        try:
            return dict(parse_qsl(text, keep_blank_values=True, max_num_fields=FIELDS_MAX))
        except ValueError:
            return text
    try:
        return json.loads(text, parse_float=_number, parse_constant=str)
    except (ValueError, RecursionError):
        return text


def corrected(case: Mapping[str, Any], text: str) -> dict[str, Any] | None:
    """The case with other contents, in the form in which it was sent; None: `text` is not JSON that can take their place."""
    try:
        value = json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError):
        return None
    if _is_form(case):
        if not isinstance(value, dict) or not all(isinstance(one, str) for one in value.values()):
            return None
        body = urlencode({name: one for name, one in value.items() if name != FORM_KEY})
    elif isinstance(value, dict):
        body = json.dumps(value)
    else:
        return None
    # A lone surrogate can't be sent; said as an escape it is refused where everybody can see why.
    data = body.encode("utf-8", "backslashreplace")
    return {**case, "request": {**case["request"], "body": base64.b64encode(data).decode()}}


def _no_number(text: str) -> float:
    raise ValueError(text)


def _number(text: str) -> float | str:
    """A number, or its text where it is too large to be one: JSON has no infinity to write it back with."""
    value = float(text)
    return value if isfinite(value) else text


def _is_form(case: Mapping[str, Any]) -> bool:
    return any(
        name.lower() == "content-type" and value.lower().startswith("application/x-www-form-urlencoded")
        for name, value in headers(case["request"])
    )


def sums(payload: object) -> tuple[str, ...]:
    """What a request would move, one text for each currency (`12000 KRW`): the sum of what goes in somewhere."""
    totals: dict[str, Decimal] = {}
    for amount, currency in _amounts(payload):
        if currency in totals or len(totals) < CURRENCIES_MAX:
            totals[currency] = totals.get(currency, Decimal(0)) + amount
    return tuple(f"{total:f} {currency}".strip() for currency, total in sorted(totals.items()) if total)


def _amounts(payload: object) -> Iterator[tuple[Decimal, str]]:
    if not isinstance(payload, dict):
        return
    many = payload.get("transactions")
    for one in many[:AMOUNTS_MAX] if isinstance(many, list) else [payload]:
        postings = one.get("postings") if isinstance(one, dict) else None
        if isinstance(postings, list):
            found = [_amount(posting) for posting in postings[:AMOUNTS_MAX]]
            yield from (amount for amount in found if amount is not None and amount[0] > 0)
        elif (entry := _amount(one)) is not None:
            yield abs(entry[0]), entry[1]


def _amount(given: object) -> tuple[Decimal, str] | None:
    if not isinstance(given, dict):
        return None
    amount, currency = given.get("amount"), given.get("currency", "")
    if not isinstance(amount, str) or len(amount) > DIGITS_MAX or not isinstance(currency, str):
        return None
    try:
        value = Decimal(amount)
    except InvalidOperation:
        return None
    # An exponent makes a short text a number of a million digits.
    if not value.is_finite() or abs(value.adjusted()) > DIGITS_MAX:
        return None
    return value, currency[:16]
