"""What came of one attempt, as a value. Its reason is a word of ours: what the other side said is never repeated."""

import smtplib
import socket
import ssl
from http.client import HTTPException

import msgspec

#: Answers after which the same question is worth another try.
_PASSING = frozenset({408, 425, 429})


class Sent(msgspec.Struct, frozen=True):
    """`why` is a code of the catalogue, empty once it has arrived with everybody; `final`: another try would end the same way."""

    ok: bool
    why: str = ""
    status: int | None = None
    final: bool = False


ARRIVED = Sent(ok=True)
#: Some of those who were named are told, and the others never will be.
PARTLY = Sent(ok=True, why="partly", final=True)


def failed(why: str, *, status: int | None = None, final: bool = False) -> Sent:
    """It did not arrive."""
    return Sent(ok=False, why=why, status=status, final=final)


def of_status(status: int) -> Sent:
    """What an HTTP status means. Redirects are not followed: where they lead nobody has agreed to send anything."""
    if 200 <= status < 300:
        return Sent(ok=True, status=status)
    if 300 <= status < 400:
        return failed("redirect", status=status, final=True)
    return failed("status", status=status, final=400 <= status < 500 and status not in _PASSING)


def of_error(error: Exception) -> Sent:
    """What an exception on the way means."""
    match error:
        case ssl.SSLCertVerificationError():
            return failed("tls", final=True)
        case ssl.SSLError():
            return failed("tls")
        case smtplib.SMTPAuthenticationError():
            return failed("login", status=error.smtp_code, final=error.smtp_code >= 500)
        case smtplib.SMTPRecipientsRefused() | smtplib.SMTPSenderRefused():
            return failed("recipient")
        case smtplib.SMTPNotSupportedError():
            return failed("no_tls", final=True)
        case smtplib.SMTPResponseException():
            return failed("status", status=error.smtp_code, final=error.smtp_code >= 500)
        case TimeoutError():
            return failed("timeout")
        case socket.gaierror():
            return failed("name")
        case smtplib.SMTPServerDisconnected() | OSError():
            return failed("connection")
        case HTTPException() | ValueError():
            return failed("garbled")
        case _:
            return failed("fault")
