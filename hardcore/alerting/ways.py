"""One attempt to reach one channel: whichever way it goes, what comes of it is a value."""

import time
from typing import assert_never

from hardcore.alerting.addresses import SecretMissingError, secret_of
from hardcore.alerting.outcomes import Sent, failed
from hardcore.alerting.over_apprise import to_service
from hardcore.alerting.over_http import to_ntfy, to_webhook
from hardcore.alerting.over_mail import to_mailbox
from hardcore.alerting.wording import Message
from hardcore.recovery.channels import Channel, Kind


def send(channel: Channel, message: Message) -> Sent:
    """Send a message; return what came of it. Takes as long as the other side makes it take."""
    try:
        secret = secret_of(channel)
    except SecretMissingError:
        return failed("secret")
    match channel.kind:
        case Kind.WEBHOOK:
            return to_webhook(channel, message, secret, int(time.time()))
        case Kind.NTFY:
            return to_ntfy(channel, message, secret)
        case Kind.SMTP:
            return to_mailbox(channel, message, secret)
        case Kind.APPRISE:
            return to_service(channel, message)
        case _:
            assert_never(channel.kind)
