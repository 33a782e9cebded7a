"""Taking a request apart: body, key and parameters, each bounded, each refused with the place of the fault.

Bodies are decoded into typed structs in one step, so wrong types, missing and unknown members are found by the
decoder; its English sentence is turned into a pointer and a reason here, the only place that knows how it
words them. A library of forms was not chosen: three kinds of bodies and six parameters need none.
"""

import hashlib
import json
import re
from typing import Final, TypeVar

import msgspec
from starlette.requests import Request

from core.guarded.poison import is_name
from core.ledger.accounts import is_account_id
from core.ledger.fields import is_date
from core.ledger.reasons import Fault, Reason
from core.web.problems import Problem, ProblemError

B = TypeVar("B", bound=msgspec.Struct)

WORDS_CHARACTERS_MAX: Final = 200
DISCARDED_BYTES_MAX: Final = 16 << 20
LIMIT_DEFAULT: Final = 50
LIMIT_MAX: Final = 500
SEQ_DIGITS_MAX: Final = 18
NAMED_MAX: Final = 128  # characters of somebody's text that a sentence repeats

_DIGEST: Final = re.compile(r"[0-9a-f]{64}")
_KEY: Final = re.compile(r"[\x21-\x7e]{1,255}")
_BYTE: Final = re.compile(r"\(byte ([0-9]+)\)")
_MEMBER: Final = re.compile(r"Object (missing required|contains unknown) field `(.*)`", re.DOTALL)
_PLACE: Final = re.compile(r" - at `\$(.*)`\Z", re.DOTALL)
_CURSOR: Final = re.compile(r"s([0-9]{1,18})")
_POSITION: Final = re.compile(r"([0-9]{4}-[0-9]{2}-[0-9]{2})[.]([0-9]{1,18})[.]([0-9]{1,3})")
_SERVER_ID: Final = re.compile(r"[0-9a-f-]{36}")
_VERSION: Final = re.compile(r'"([0-9]{1,18})"')
_MONTH: Final = re.compile(r"[0-9]{4}-[0-9]{2}")


async def read_body(request: Request, bytes_max: int) -> bytes:
    """Return the body, or end the request once it is larger than it may be.

    Some of what is too much is read and thrown away, because a client that is still sending when its
    connection closes never sees the answer.
    """
    announced = request.headers.get("content-length", "0")
    most = bytes_max + DISCARDED_BYTES_MAX
    if announced.isdigit() and (len(announced) > SEQ_DIGITS_MAX or int(announced) > most):
        raise _too_large(bytes_max, closing=True)
    body = bytearray()
    seen = 0
    async for chunk in request.stream():
        seen += len(chunk)
        if seen <= bytes_max:
            body += chunk
        elif seen > most:
            raise _too_large(bytes_max, closing=True)
    if seen > bytes_max:
        raise _too_large(bytes_max, closing=False)
    return bytes(body)


def decode_body(body: bytes, shape: type[B]) -> B:
    """Return the body as a value of this shape, or end the request with what is wrong with it."""
    try:
        text = body.decode()
        value = msgspec.json.decode(body, type=shape)
        # The typed decoder lets the last of two equal names win: an amount said twice would be booked as either.
        _TWINS.decode(text)
        return value
    except UnicodeDecodeError as error:
        raise _malformed(error.start) from None
    except msgspec.ValidationError as error:
        _refuse_malformed(body)
        raise ProblemError(Problem("invalid-body", (_fault(str(error)),))) from None
    except msgspec.DecodeError as error:
        raise _malformed(_position(str(error), body)) from None
    except RecursionError:
        raise ProblemError(Problem("invalid-body", (Fault("", Reason.WRONG_TYPE),))) from None


def _refuse_twins(pairs: list[tuple[str, object]]) -> None:
    if len(dict(pairs)) == len(pairs):
        return
    names = [name for name, _value in pairs]
    twin = next(name for name in names if names.count(name) > 1)
    raise ProblemError(Problem("invalid-body", (Fault(f"/{twin}", Reason.NAMED_TWICE),)))


_TWINS: Final = json.JSONDecoder(object_pairs_hook=_refuse_twins)


def idempotency_key(request: Request) -> str | None:
    """Return the key of the request, None if it has none."""
    keys = request.headers.getlist("idempotency-key")
    if not keys:
        return None
    if len(keys) > 1:
        raise ProblemError(Problem("invalid-key"))
    return check_key(keys[0])


def account_in_path(request: Request) -> str:
    """Return the account that the path names, or end the request where no account can be called so."""
    account_id: str = request.path_params["id"]
    if not is_account_id(account_id):
        raise ProblemError(Problem("account-not-found", values={"account": account_id[:NAMED_MAX]}))
    return account_id


def version_tag(version: int) -> str:
    """Return the ETag of an account: its version."""
    return f'"{version}"'


def expected_version(request: Request) -> int | None:
    """Return the version in `If-Match`, None where none is asked for (`*`: any that there is)."""
    tags = request.headers.getlist("if-match")
    if not tags or tags == ["*"]:
        return None
    match = _VERSION.fullmatch(tags[0].strip()) if len(tags) == 1 else None
    if match is None:
        raise ProblemError(Problem("invalid-parameter", (Fault("If-Match", Reason.MALFORMED),)))
    return int(match[1])


def request_name(request: Request) -> str:
    """Return the name that the gateway has made for a request without a key; empty where it made none."""
    names = request.headers.getlist("x-request-name")
    return names[0] if len(names) == 1 and is_name(names[0]) else ""


def check_key(text: str) -> str:
    """Return the text if it may be a key."""
    if _KEY.fullmatch(text) is None:
        raise ProblemError(Problem("invalid-key"))
    return text


def digest_of(request: Request, body: bytes) -> bytes:
    """Return the digest by which a look-up can name this very request (docs/wires.md, section 5)."""
    path: bytes = request.scope.get("raw_path") or b""
    line = b"%b %b\n" % (request.method.encode(), path)
    return hashlib.sha256(line + body).digest()


def asked_digest(request: Request) -> bytes | None:
    """Return the digest of the request that a look-up means, None if it names none."""
    text = request.headers.get("x-request-digest")
    if text is None:
        return None
    return bytes.fromhex(text) if _DIGEST.fullmatch(text) else b""  # b"": nobody's


class Parameters:
    """The parameters of a query, read by name; what nobody asked for and what is unusable is refused at once."""

    def __init__(self, request: Request, names: frozenset[str]) -> None:
        self._given = request.query_params
        self._faults = [Fault(f"?{name}", Reason.UNKNOWN_FIELD) for name in sorted(set(self._given) - names)]

    def check(self) -> None:
        """End the request if anything was wrong with what was read."""
        if self._faults:
            raise ProblemError(Problem("invalid-parameter", tuple(self._faults)))

    def limit(self, default: int = LIMIT_DEFAULT, most: int = LIMIT_MAX) -> int:
        """Return how many items a page may have."""
        text = self._given.get("limit")
        if text is None:
            return default
        if text.isascii() and text.isdigit() and len(text) <= SEQ_DIGITS_MAX and 1 <= int(text) <= most:
            return int(text)
        self._faults.append(Fault("?limit", Reason.OUT_OF_RANGE))
        return default

    def cursor(self) -> int | None:
        """Return the sequence that a cursor of ours names."""
        text = self._given.get("cursor")
        if text is None:
            return None
        match = _CURSOR.fullmatch(text)
        if match is None:
            self._faults.append(Fault("?cursor", Reason.MALFORMED))
            return None
        return int(match[1])

    def position(self, name: str) -> tuple[str, int, int] | None:
        """Return the day, the sequence and the line that a cursor of ours names."""
        text = self._given.get(name)
        if text is None:
            return None
        place = read_position(text)
        if place is None:
            self._faults.append(Fault(f"?{name}", Reason.MALFORMED))
        return place

    def month(self, name: str) -> str | None:
        """Return a month of the calendar."""
        text = self._given.get(name)
        if text is not None and (_MONTH.fullmatch(text) is None or not is_date(f"{text}-01")):
            self._faults.append(Fault(f"?{name}", Reason.MALFORMED))
            return None
        return text

    def sequence(self, name: str) -> int:
        """Return a sequence, 0 if none is given."""
        text = self._given.get(name, "0")
        if text.isascii() and text.isdigit() and len(text) <= SEQ_DIGITS_MAX:
            return int(text)
        self._faults.append(Fault(f"?{name}", Reason.MALFORMED))
        return 0

    def day(self, name: str) -> str | None:
        """Return a day of the calendar."""
        text = self._given.get(name)
        if text is not None and not is_date(text):
            self._faults.append(Fault(f"?{name}", Reason.MALFORMED))
        return text

    def account(self, name: str = "account") -> str | None:
        """Return the id of an account."""
        text = self._given.get(name)
        if text is not None and not is_account_id(text):
            self._faults.append(Fault(f"?{name}", Reason.MALFORMED))
        return text

    def item(self, name: str) -> str | None:
        """Return an id that the server has given."""
        text = self._given.get(name)
        if text is not None and _SERVER_ID.fullmatch(text) is None:
            self._faults.append(Fault(f"?{name}", Reason.MALFORMED))
        return text

    def choice(self, name: str, choices: frozenset[str]) -> str | None:
        """Return one of the words that may stand here."""
        text = self._given.get(name)
        if text is not None and text not in choices:
            self._faults.append(Fault(f"?{name}", Reason.UNKNOWN_VALUE))
        return text

    def words(self, name: str) -> str | None:
        """Return words to look for."""
        text = self._given.get(name) or None
        if text is not None and len(text) > WORDS_CHARACTERS_MAX:
            self._faults.append(Fault(f"?{name}", Reason.TOO_LONG))
        return text


def make_cursor(seq: int) -> str:
    """Return the cursor that goes on after this sequence."""
    return f"s{seq}"


def read_position(text: str) -> tuple[str, int, int] | None:
    """Return the day, the sequence and the line that a cursor of ours names, None for anything else."""
    match = _POSITION.fullmatch(text)
    if match is None or not is_date(match[1]):
        return None
    return match[1], int(match[2]), int(match[3])


def make_position(date: str, seq: int, line: int) -> str:
    """Return the cursor that goes on after this place in a list by days."""
    return f"{date}.{seq}.{line}"


def _too_large(bytes_max: int, *, closing: bool) -> ProblemError:
    headers = {"Connection": "close"} if closing else {}
    return ProblemError(Problem("body-too-large", values={"limit_bytes": bytes_max}, headers=headers))


def _malformed(position: int) -> ProblemError:
    return ProblemError(Problem("malformed-json", values={"position": position}))


def _refuse_malformed(body: bytes) -> None:
    # The typed decoder stops at the first member that does not fit, before it has seen whether the rest is
    # JSON at all; a body that is none must be told so.
    try:
        msgspec.json.decode(body)
    except (msgspec.ValidationError, RecursionError):
        return  # JSON, though with a number or a depth that nothing here has
    except msgspec.DecodeError as error:
        raise _malformed(_position(str(error), body)) from None


def _position(message: str, body: bytes) -> int:
    found = _BYTE.search(message)
    return int(found[1]) if found else len(body)


def _fault(message: str) -> Fault:
    place = _PLACE.search(message)
    pointer = _pointer(place[1]) if place else ""
    sentence = message[: place.start()] if place else message
    member = _MEMBER.fullmatch(sentence)
    if member is not None:
        reason = Reason.MISSING if member[1].startswith("missing") else Reason.UNKNOWN_FIELD
        name = member[2].replace("~", "~0").replace("/", "~1")
        return Fault(f"{pointer}/{name}", reason)
    return Fault(pointer, Reason.WRONG_TYPE)


def _pointer(path: str) -> str:
    return path.replace("[", "/").replace("]", "").replace(".", "/")
