"""`hardcore alerts`: who would be told, what came of it last, a try, and a while of silence.

All of it works with everything stopped: the channels are read from the last good policy, and a try is made from here. No
address is ever printed. Channels are added in the policy file: what may reach out of this machine is decided there.
"""

import re
import sys
from collections.abc import Mapping
from typing import Any, Final

import click

from frontend.catalogue_alerts import failure_text, held_text, title_text, word
from hardcore.alerting.addresses import channels_in_force
from hardcore.alerting.book import Book, Entry, at_text, channels, entries
from hardcore.alerting.trying import try_channels
from hardcore.alerting.wording import local
from hardcore.asked import Asked, keep, operator, options, status_of
from hardcore.host import muting
from hardcore.lines import wrapped
from hardcore.recovery.channels import Channel, as_shown

LISTED: Final = 10
_TIME = re.compile(r"([1-9][0-9]{0,5})([smhd])")
_UNITS_S: Final = {"s": 1, "m": 60, "h": 3600, "d": 86_400}
USAGE: Final = 2


@click.group(invoke_without_command=True)
@options
@click.pass_context
def alerts(context: click.Context, /, **given: object) -> None:
    """Who is told when something happens: list, test, mute, unmute."""
    keep(context, given)
    if context.invoked_subcommand is None:
        context.invoke(alerts_list, data=None, as_json=False, lang=None)


@alerts.command("list")
@operator
def alerts_list(asked: Asked) -> None:
    """Show the channels, what came of the last message to each, and the last alerts."""
    folders, lang = asked.folders, asked.lang
    book, read = Book(folders).read(), channels_in_force(folders)
    found = read or ()
    muted_ms = muting.muted_until_ms(folders)
    known = channels(book)
    asked.tell(
        {
            "channels": [as_shown(one) | _last(known.get(one.number)) for one in found],
            "muted_until": at_text(muted_ms) if muted_ms else None,
            "last": entries(book)[::-1],
        }
    )
    if asked.json:
        return
    lines = [line for one in found for line in _channel_lines(one, known.get(one.number), lang)]
    if muted_ms:
        lines.append(word("muted", lang, until=local(at_text(muted_ms))))
    lately = [_entry_line(one, lang) for one in entries(book)[: -LISTED - 1 : -1]]
    more = ["", word("last", lang), *lately] if lately else []
    click.echo(
        "\n".join(
            wrapped(line)
            for line in (*(lines or [word("none" if read is not None else "not_read", lang)]), *more)
        )
    )


def _last(known: Entry | None) -> dict[str, Any]:
    return {name: (known or {}).get(name) for name in ("ok", "at", "why", "sent", "failed")}


def _channel_lines(channel: Channel, known: Entry | None, lang: str) -> list[str]:
    quiet = str(channel.quiet) if channel.quiet else word("no_quiet", lang)
    return [
        word(
            "channel", lang, number=channel.number, name=channel.name, kind=channel.kind, place=channel.place
        ),
        f"   {word('manners', lang, n=channel.min_interval_s, quiet=quiet)}",
        f"   {_last_line(known, lang)}",
    ]


def _last_line(known: Entry | None, lang: str) -> str:
    if known is None:
        return word("never", lang)
    at = local(str(known.get("at")))
    if known.get("ok") is True and known.get("why"):
        return word("arrived_partly", lang, at=at, why=failure_text(str(known["why"]), lang))
    if known.get("ok") is True:
        return word("arrived", lang, at=at)
    return word("failed", lang, at=at, why=failure_text(str(known.get("why")), lang))


def _entry_line(entry: Mapping[str, Any], lang: str) -> str:
    title = title_text(str(entry.get("stage")), str(entry.get("diagnosis")), lang)
    at = local(str(entry.get("at")))
    if entry.get("delivered_at"):
        return word("line_delivered", lang, at=at, title=title)
    if entry.get("again_at") and not entry.get("attempts"):
        return word(
            "line_later",
            lang,
            at=at,
            title=title,
            why=held_text(str(entry.get("held")), lang),
            until=local(str(entry["again_at"])),
        )
    if entry.get("held"):
        return word("line_held", lang, at=at, title=title, why=held_text(str(entry["held"]), lang))
    return word("line_failed", lang, at=at, title=title)


@alerts.command("test")
@click.option("--channel", type=click.IntRange(1), help="Only this one, by its number.")
@operator
def alerts_test(asked: Asked, channel: int | None) -> None:
    """Send a test to each channel now. Exit code 1: one did not arrive, or there is none."""
    found, lang = channels_in_force(asked.folders), asked.lang
    if not found:
        asked.fail(word("none" if found is not None else "not_read", lang))
    if channel is not None and channel not in {one.number for one in found}:
        asked.fail(word("no_channel", lang, n=channel), USAGE)
    results = try_channels(asked.folders, channel, str(status_of(asked).get("url") or ""))
    asked.tell({"ok": all(one["ok"] for one in results), "results": results})
    if not asked.json:
        for one in results:
            why = failure_text(one["why"], lang)
            click.echo(
                wrapped(
                    word(
                        _tried(one),
                        lang,
                        **{**one, "number": one["channel"], "why": why},
                    )
                )
            )
    if not all(one["ok"] for one in results):
        sys.exit(1)


def _tried(result: Mapping[str, Any]) -> str:
    if not result["ok"]:
        return "tried_in_vain"
    return "tried_partly" if result["why"] else "tried"


@alerts.command("mute")
@click.option("--for", "for_time", required=True, metavar="TIME", help="How long: 30m, 2h, 1d.")
@operator
def alerts_mute(asked: Asked, for_time: str) -> None:
    """Send nothing for a while. What happens is written down all the same."""
    found = _TIME.fullmatch(for_time)
    seconds = int(found[1]) * _UNITS_S[found[2]] if found else 0
    if not 0 < seconds <= muting.MUTED_S_MAX:
        asked.fail(word("bad_time", asked.lang), USAGE)
    try:
        until = muting.mute(asked.folders, seconds)
    except OSError as error:
        asked.fail(word("not_stored", asked.lang, why=error.strerror))
    asked.tell({"ok": True, "muted_until": until})
    if not asked.json:
        click.echo(word("muted", asked.lang, until=local(until)))


@alerts.command("unmute")
@operator
def alerts_unmute(asked: Asked) -> None:
    """Send alerts again."""
    try:
        muting.unmute(asked.folders)
    except OSError as error:
        asked.fail(word("not_stored", asked.lang, why=error.strerror))
    asked.tell({"ok": True, "muted_until": None})
    if not asked.json:
        click.echo(word("unmuted", asked.lang))
