"""The page of alerts: who would be told, what came of it last, what is sent; a try and a while of silence.

What is shown of a channel comes from the guard, which names neither its address nor its secret; what came of the messages
stands in the sender's book. Adding a channel is the policy file's: what may reach out of this machine is not decided by
whoever has this page open.
"""

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from frontend.admin_paper import moment
from frontend.catalogue_alerts import alert_text, cause_text, failure_text, held_text, title_text
from frontend.render import Language
from postmortem.incident import mapping, mappings, number, optional_text, text
from postmortem.placing import read_up_to
from postmortem.views import Filter
from postmortem.web.lobby import Lobby, field, lead_to, reader_of, words_of

BOOK_BYTES_MAX: Final = 4 << 20
LATELY_MAX: Final = 30
CHANNELS_MAX: Final = 16
#: How long a person may be silent about it, in seconds.
SILENCES: Final = ("3600", "28800", "86400")
_HERE: Final = "/admin/alerts"


async def alerts(lobby: Lobby, request: Request) -> Response:
    """GET /admin/alerts."""
    answer = mapping(await lobby.places.ask_guard({"verb": "policy"}))
    book = await lobby.read(lambda: _read(lobby.places.data / "state" / "alerts.json"))
    muted = await lobby.read(lambda: _read(lobby.places.data / "state" / "alerts_muted.json"))
    lang = reader_of(request).lang
    named = _named(answer)
    known = mappings(book.get("channels"))[:CHANNELS_MAX]
    shown = known if named is None else [_beside(one, known) for one in named]
    words = words_of(request)
    return lobby.show(
        request,
        "alerts.html.j2",
        _HERE,
        away=named is None,
        nobody=named == [],
        untold=(await lobby.read(lambda: lobby.reads.incidents(Filter(), 1))).total if named == [] else 0,
        channels=[_channel(words, one, lang) for one in shown],
        muted=_still(optional_text(muted.get("until"))),
        silences=SILENCES,
        lately=[_entry(words, one, lang) for one in mappings(book.get("last"))[: -LATELY_MAX - 1 : -1]],
        previews=_previews(),
    )


async def test(lobby: Lobby, request: Request) -> Response:
    """POST /admin/alerts/test."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    told = await lobby.places.ask_guard({"verb": "alerts-test"})
    if told is None:
        # A channel that hangs takes longer than a page waits for; a guard that is away says nothing either way.
        here = await lobby.places.ask_guard({"verb": "status"}) is not None
        outcome, code = ("asked for", "alerts_trying") if here else ("guard away", "guard_away")
    elif all(one.get("ok") is True for one in mappings(told.get("results"))) and told.get("ok") is True:
        outcome, code = "arrived", "alerts_tested"
    else:
        outcome, code = "did not arrive", "refused_alerts_test"
    await lobby.places.write_down("alerts test", "", "", outcome)
    return lead_to(_HERE, code)


async def mute(lobby: Lobby, request: Request) -> Response:
    """POST /admin/alerts/mute: for one of the times that the page offers, or with none of them no longer."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    given = field(form, "seconds")
    seconds = int(given) if given in SILENCES else 0
    told = await lobby.places.ask_guard({"verb": "alerts-mute", "seconds": seconds})
    if told is None or told.get("ok") is not True:
        outcome, code = ("guard away", "guard_away") if told is None else ("refused", "guard_refused")
    else:
        outcome, code = "done", "alerts_muted" if seconds else "alerts_unmuted"
    await lobby.places.write_down("alerts mute" if seconds else "alerts unmute", given, "", outcome)
    return lead_to(_HERE, code)


def _read(path: Path) -> Mapping[str, Any]:
    """Return the object in a file of the sender's; empty when there is none."""
    try:
        with path.open("rb") as file:
            return mapping(json.loads(read_up_to(file.fileno(), BOOK_BYTES_MAX)))
    except (OSError, ValueError, RecursionError):
        return {}


def _named(answer: Mapping[str, Any]) -> list[Mapping[str, Any]] | None:
    """Return the channels of the policy in force; None: nobody says."""
    found = answer.get("alerts")
    return list(mappings(found))[:CHANNELS_MAX] if isinstance(found, list) else None


def _beside(channel: Mapping[str, Any], known: list[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return a channel with what is on record of it."""
    same = (one for one in known if one.get("number") == channel.get("number"))
    return {**next(same, {}), **channel}


def _channel(words: Any, one: Mapping[str, Any], lang: Language) -> Mapping[str, Any]:
    facts = [(words("alerts_last"), _last(words, one, lang), one.get("ok") is False)]
    if (interval := number(one.get("min_interval_s"))) is not None:
        facts.append((words("alerts_floor"), words("alerts_floor_n", n=interval), False))
        facts.append((words("alerts_quiet"), optional_text(one.get("quiet_hours")) or words("none"), False))
        langs = one.get("lang")
        spoken = ", ".join(str(tongue) for tongue in langs) if isinstance(langs, list) else ""
        facts.append((words("alerts_lang"), spoken, False))
    return {
        "number": number(one.get("number")) or 0,
        "name": text(one.get("name")),
        "kind": text(one.get("kind")),
        "place": text(one.get("place")),
        "facts": facts,
    }


def _last(words: Any, one: Mapping[str, Any], lang: Language) -> str:
    if (at := optional_text(one.get("at"))) is None:
        return str(words("alerts_never"))
    became = (
        words("alerts_arrived")
        if one.get("ok") is True
        else words("alerts_failed", why=failure_text(text(one.get("why")), lang))
    )
    sent, failed = number(one.get("sent")) or 0, number(one.get("failed")) or 0
    counts = words("alerts_counts", sent=sent, failed=failed)
    return f"{became}, {moment(at, lang=lang)} ({counts})"


def _entry(words: Any, one: Mapping[str, Any], lang: Language) -> Mapping[str, Any]:
    held, tried = optional_text(one.get("held")), mappings(one.get("attempts"))
    if optional_text(one.get("delivered_at")) is not None:
        became, wrong = words("alerts_delivered"), False
    elif held is not None:
        became, wrong = words("alerts_not_sent", why=held_text(held, lang)), False
    elif not tried or tried[-1].get("ok") is None:
        became, wrong = words("alerts_under_way"), False
    else:
        became, wrong = words("alerts_undelivered"), True
    return {
        "at": optional_text(one.get("at")),
        "title": title_text(text(one.get("stage")), text(one.get("diagnosis")), lang),
        "incident": optional_text(one.get("incident")),
        "became": became,
        "wrong": wrong,
    }


def _still(until: str | None) -> str | None:
    """Return until when alerts are muted, if that is not over."""
    try:
        ahead = until is not None and datetime.fromisoformat(until) > datetime.now(UTC)
    except (ValueError, TypeError):
        return None
    return until if ahead else None


def _previews() -> list[tuple[str, str]]:
    """Return what is sent at the beginning and at the end of a death, in both languages."""
    shown = []
    for lang in ("ko", "en"):
        cause = cause_text("OUT_OF_MEMORY", lang)
        graded = alert_text("cause", lang, grade=alert_text("likely", lang), cause=cause)
        beginning = (alert_text("opened", lang, cause=cause), alert_text("told_when_over", lang))
        took = alert_text("seconds", lang, n="4.1")
        end = (alert_text("recovered", lang, took=took), graded, alert_text("nothing_lost", lang))
        shown += [(lang, "\n".join(beginning)), (lang, "\n".join(end))]
    return shown
