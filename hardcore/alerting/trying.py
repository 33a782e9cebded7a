"""A person's own try: one message to each channel, now, and what came of each."""

import queue
import threading
import time
from typing import Any, Final

from hardcore.alerting import book as on_record
from hardcore.alerting.addresses import channels_in_force
from hardcore.alerting.book import Book, at_text
from hardcore.alerting.notices import Notice
from hardcore.alerting.outcomes import Sent, failed
from hardcore.alerting.ways import send
from hardcore.alerting.wording import compose
from hardcore.host.folders import Folders
from hardcore.host.ids import new_id
from hardcore.recovery.channels import Channel, Stage

#: All channels are tried beside each other; whoever has not answered by then has not.
TRY_S: Final = 15.0


def try_channels(folders: Folders, only: int | None = None, url: str = "") -> list[dict[str, Any]]:
    """Send a test to each channel of the policy in force, or to the one with this number; return what came of it."""
    channels = [one for one in channels_in_force(folders) or () if only in {None, one.number}]
    landed: queue.SimpleQueue[tuple[int, Sent]] = queue.SimpleQueue()
    for channel in channels:
        threading.Thread(target=_try, args=(channel, url, landed), daemon=True).start()
    came: dict[int, Sent] = {}
    give_up_at = time.monotonic() + TRY_S
    while len(came) < len(channels):
        try:
            number, sent = landed.get(timeout=max(0.0, give_up_at - time.monotonic()))
        except queue.Empty:
            break
        came[number] = sent
    return _written_down(folders, channels, came)


def _try(channel: Channel, url: str, landed: "queue.SimpleQueue[tuple[int, Sent]]") -> None:
    at = at_text(time.time_ns() // 1_000_000)
    notice = Notice(new_id(), at, Stage.TEST, "TEST", "test", url=url)
    try:
        sent = send(channel, compose(notice, {}, channel.lang))
    except Exception:  # noqa: BLE001  # a bug on one way must not keep the others from being told of
        sent = failed("fault")
    landed.put((channel.number, sent))


def _written_down(folders: Folders, channels: list[Channel], came: dict[int, Sent]) -> list[dict[str, Any]]:
    at = at_text(time.time_ns() // 1_000_000)
    results = []
    book = Book(folders)
    for channel in channels:
        sent = came.get(channel.number, failed("timeout"))
        book.change(lambda v, c=channel, s=sent: on_record.note_channel(v, c, s, at))  # type: ignore[misc]
        results.append(
            {
                "channel": channel.number,
                "kind": str(channel.kind),
                "name": channel.name,
                "place": channel.place,
                "ok": sent.ok,
                "status": sent.status,
                "why": sent.why,
            }
        )
    return results
