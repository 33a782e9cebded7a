"""A message as a mail. Encrypted from the first byte (smtps) or before the first word (smtp, STARTTLS), or not at all.

Only to this machine itself a mail goes in the open: there a relay is what a household's machine has. A mail is taken when
the server has said so after its last line; it may look into it for a while first, and how it then takes its leave is its
own affair.
"""

import smtplib
import ssl
from contextlib import suppress
from email.message import EmailMessage
from email.utils import formatdate
from typing import Any, Final
from urllib.parse import SplitResult, parse_qs, unquote, urlsplit

from hardcore.alerting.bounded import Bounded
from hardcore.alerting.outcomes import ARRIVED, PARTLY, Sent, of_error
from hardcore.alerting.wording import Message
from hardcore.recovery.channels import Channel, is_loopback

WAIT_S: Final = 5.0
#: For the word that a mail is taken: it may be looked into, or put off, before.
TAKEN_WAIT_S: Final = 40.0
_PORTS: Final = {"smtp": 587, "smtps": 465}


def to_mailbox(channel: Channel, message: Message, secret: str) -> Sent:
    """Hand it to the mail server that the address names; `secret` is the password of the user in it."""
    parts = urlsplit(channel.url)
    try:
        server = _server(parts)
    except (OSError, ValueError, smtplib.SMTPException) as error:
        return of_error(error)
    try:
        if parts.username:
            server.login(unquote(parts.username), secret or unquote(parts.password or ""))
        if server.sock is not None:
            server.sock.settimeout(TAKEN_WAIT_S)
        refused = server.send_message(as_mail(parts, message))
        _leave(server)
    except (OSError, ValueError, smtplib.SMTPException) as error:
        return of_error(error)
    finally:
        server.close()
    return PARTLY if refused else ARRIVED


def _leave(server: smtplib.SMTP) -> None:
    """Say goodbye. The mail is taken: whatever is answered changes nothing."""
    with suppress(OSError, ValueError, smtplib.SMTPException):
        if server.sock is not None:
            server.sock.settimeout(WAIT_S)
        server.quit()


class _Answers(smtplib.SMTP):
    """A server whose answers end."""

    file: Any

    def getreply(self) -> tuple[int, bytes]:
        """Read an answer, each of its own measure."""
        if self.sock is not None:
            file = self.sock.makefile("rb") if self.file is None else self.file
            self.file = Bounded(file.file if isinstance(file, Bounded) else file)
        return super().getreply()


class _EncryptedAnswers(_Answers, smtplib.SMTP_SSL):
    """The same, encrypted from the first byte."""


def _server(parts: SplitResult) -> smtplib.SMTP:
    assert parts.hostname is not None, "the policy was judged"
    port = parts.port or _PORTS[parts.scheme]
    if parts.scheme == "smtps":
        context = ssl.create_default_context()
        return _EncryptedAnswers(parts.hostname, port, timeout=WAIT_S, context=context)
    server = _Answers(parts.hostname, port, timeout=WAIT_S)
    if not is_loopback(parts.hostname):
        try:
            server.starttls(context=ssl.create_default_context())  # raises where the server offers none
        except BaseException:
            server.close()
            raise
    return server


def as_mail(parts: SplitResult, message: Message) -> EmailMessage:
    """Return the mail. Its id is the notice's, so that one that comes twice is known by it."""
    asked = parse_qs(parts.query)
    mail = EmailMessage()
    mail["Subject"] = " ".join(message.title.split())
    mail["From"] = asked["from"][0]
    mail["To"] = ", ".join(asked["to"])
    mail["Date"] = formatdate()
    mail["Message-ID"] = f"<{message.notice.id}@hardcore.invalid>"
    mail["Auto-Submitted"] = "auto-generated"
    mail.set_content(message.body + "\n")
    return mail
