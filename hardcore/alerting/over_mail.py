"""A message as a mail. Encrypted from the first byte (smtps) or before the first word (smtp, STARTTLS), or not at all.

Only to this machine itself a mail goes in the open: there a relay is what a household's machine has.
"""

import smtplib
import ssl
from email.message import EmailMessage
from email.utils import formatdate
from typing import Final
from urllib.parse import SplitResult, parse_qs, unquote, urlsplit

from hardcore.alerting.outcomes import ARRIVED, Sent, of_error
from hardcore.alerting.wording import Message
from hardcore.recovery.channels import Channel, is_loopback

WAIT_S: Final = 5.0
_PORTS: Final = {"smtp": 587, "smtps": 465}


def to_mailbox(channel: Channel, message: Message, secret: str) -> Sent:
    """Hand it to the mail server that the address names; `secret` is the password of the user in it."""
    parts = urlsplit(channel.url)
    try:
        with _server(parts) as server:
            if parts.username:
                server.login(unquote(parts.username), secret or unquote(parts.password or ""))
            server.send_message(as_mail(parts, message))
    except (OSError, ValueError, smtplib.SMTPException) as error:
        return of_error(error)
    return ARRIVED


def _server(parts: SplitResult) -> smtplib.SMTP:
    assert parts.hostname is not None, "the policy was judged"
    port = parts.port or _PORTS[parts.scheme]
    if parts.scheme == "smtps":
        return smtplib.SMTP_SSL(parts.hostname, port, timeout=WAIT_S, context=ssl.create_default_context())
    server = smtplib.SMTP(parts.hostname, port, timeout=WAIT_S)
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
