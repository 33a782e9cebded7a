"""The first page: how the ledger is at this moment, and the two things a person may do to it.

What is shown comes from the guard where it answers, else from the archive alone, and then says so. The page is drawn
here each time it is asked for; its script asks for the same page again and takes over the parts that changed.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, Final

import psutil
from starlette.requests import Request
from starlette.responses import Response

from frontend.admin_paper import moment, took
from frontend.render import Language
from postmortem.incident import duration, mapping, mappings, number, optional_text, text, texts
from postmortem.reports import evidence_words
from postmortem.reports.drawings import DAY_S, Drawing, Span, draw_day
from postmortem.views import Drill, Filter, IncidentLine
from postmortem.web.lobby import Lobby, Question, field, is_sure, lead_to, reader_of, words_of
from postmortem.web.outlook import forecasts, memory_curve
from postmortem.web.proofs import drills

STATES: Final = (
    "OPERATIONAL", "STARTING", "DEGRADED", "RECOVERY", "SAFE_MODE", "MANUAL_INTERVENTION", "SHUTDOWN", "UNKNOWN",
)  # fmt: skip
TONES: Final[Mapping[str, str]] = {
    "OPERATIONAL": "good",
    "STARTING": "warn",
    "DEGRADED": "warn",
    "SAFE_MODE": "warn",
    "RECOVERY": "bad",
    "MANUAL_INTERVENTION": "bad",
    "SHUTDOWN": "quiet",
    "UNKNOWN": "quiet",
}
#: The drills that a page offers; the command line has them all.
FAULTS: Final = ("crash", "segv", "exit", "freeze", "block", "deadlock", "spare", "poison")
DAY_INCIDENTS_MAX: Final = 200
MODES: Final = ("act", "assist", "observe")
PARTS: Final = ("importer", "exporter", "notifier", "auditor")
PARTS_MAX: Final = 16
#: Changes of the state that are shown, the newest first.
HISTORY_MAX: Final = 12
RESTART_WORD: Final = "restart"
_HERE: Final = "/admin/"

Fact = tuple[str, str, str]


async def now(lobby: Lobby, request: Request) -> Response:
    """GET /admin/."""
    status = mapping(await lobby.places.ask_guard({"verb": "status"}))
    answer = mapping(await lobby.places.ask_guard({"verb": "policy"})) if status else {}
    limit_mib = number(mapping(answer.get("policy")).get("memory_limit_mb"))
    curve = await lobby.places.ask_guard({"verb": "curve"}) if status else None
    at = datetime.now(UTC)
    lang = reader_of(request).lang
    known = await lobby.read(lambda: lobby.reads.incidents(Filter(drills=False), 1))
    lately = await lobby.read(lambda: lobby.reads.incidents(Filter(), DAY_INCIDENTS_MAX))
    watched_s = await lobby.read(lambda: _watched_s(status, at))
    drilled = await lobby.read(lambda: drills(lobby.reads, 1))
    counts = await lobby.read(lobby.reads.counts)
    lines: Sequence[IncidentLine] = known.items
    state = text(status.get("state"))
    state = state if state in STATES else "UNKNOWN"
    return lobby.show(
        request,
        "now.html.j2",
        _HERE,
        state=state,
        tone=TONES[state],
        since=optional_text(status.get("since")),
        open=optional_text(status.get("incident")),
        nobody=answer.get("alerts") == [],
        worries=[evidence_words.told(one, lang) for one in texts(status.get("worries"))[:10]],
        calm=_calm(words_of(request), lines, at, drilled=bool(lately.items)),
        proof=_proof(words_of(request), drilled[0] if drilled else None, lang),
        day=_day(lately.items, at, lang, watched_s),
        last=lines[0] if lines else None,
        curve=memory_curve(curve, lang),
        forecasts=forecasts(words_of(request), status, lang),
        guarding=_guarding(words_of(request), status, lang),
        facts=_facts(words_of(request), status, sum(counts.values()), limit_mib, lang),
        faults=FAULTS,
    )


async def restart(lobby: Lobby, request: Request) -> Response:
    """POST /admin/restart: asked about with a word that has to be typed."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    words = words_of(request)
    if is_sure(form) and field(form, "word").lower() == RESTART_WORD:
        return await _order(lobby, {"verb": "restart", "reason": "dashboard"}, "restart", "core", "restarted")
    status = mapping(await lobby.places.ask_guard({"verb": "status"}))
    held = number(mapping(status.get("gateway")).get("held_requests")) or 0
    question = Question(
        title=words("restart_title"),
        action="/admin/restart",
        sure=words("act_restart"),
        back=_HERE,
        keep=words("cancel"),
        lines=(words("restart_held", n=held), words("act_restart_more")),
        typed=("word", words("restart_type"), 20),
        fault=words("restart_wrong") if is_sure(form) else "",
    )
    return lobby.ask(request, _HERE, question)


async def safe_mode(lobby: Lobby, request: Request) -> Response:
    """POST /admin/safe-mode: asked about first, because everybody who uses the ledger notices it."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    wish = field(form, "wish")
    if wish not in {"on", "off"}:
        return lobby.lost(request, _HERE, _HERE)
    if is_sure(form):
        order = {"verb": "safe-mode", "on": wish == "on", "reason": "dashboard"}
        return await _order(lobby, order, "safe-mode", wish, f"safe_{wish}")
    words = words_of(request)
    question = Question(
        title=words(f"safe_{wish}_title"),
        action="/admin/safe-mode",
        sure=words(f"act_safe_{wish}"),
        back=_HERE,
        keep=words("cancel"),
        lines=(words(f"safe_{wish}_told"),),
        fields=(("wish", wish),),
    )
    return lobby.ask(request, _HERE, question)


async def drill(lobby: Lobby, request: Request) -> Response:
    """POST /admin/drill."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    fault = field(form, "fault")
    if fault not in FAULTS:
        return lobby.lost(request, _HERE, _HERE)
    if is_sure(form):
        return await _order(lobby, {"verb": "drill", "fault": fault, "yes": True}, "drill", fault, "drilled")
    words = words_of(request)
    question = Question(
        title=words("drill_title"),
        action="/admin/drill",
        sure=words("drill_sure"),
        back=_HERE,
        keep=words("cancel"),
        lines=(words(f"drill_{fault}"), words("act_drill_more")),
        fields=(("fault", fault),),
    )
    return lobby.ask(request, _HERE, question)


async def _order(lobby: Lobby, order: Mapping[str, Any], verb: str, what: str, done: str) -> Response:
    told = await lobby.places.ask_guard(order)
    if told is None:
        outcome, code = "guard away", "guard_away"
    elif told.get("ok") is True:
        outcome, code = "asked for", done
    else:
        outcome, code = text(told.get("code")) or "refused", "guard_refused"
    await lobby.places.write_down(verb, what, "", outcome)
    return lead_to(_HERE, code)


def _facts(
    words: Any, status: Mapping[str, Any], letters: int, limit_mib: int | None, lang: Language
) -> list[Fact]:
    """Return what is known at this moment: name, value, where it leads. What nobody knows is left out."""
    gateway, core = mapping(status.get("gateway")), mapping(status.get("core"))
    budget, spare = mapping(status.get("budget")), status.get("spare")
    facts: list[Fact] = [(words("now_letters"), words("now_letters_n", n=letters), "/admin/dlq")]
    if (beat := duration(core.get("heartbeat_age_ms"))) is not None:
        facts.append((words("now_beat"), words("now_beat_ms", n=round(beat)), ""))
    if (rss := number(core.get("rss_bytes"))) is not None:
        held = f"{rss / (1 << 20):.0f} MiB"
        told = held if limit_mib is None else words("now_memory_of", held=held, limit=f"{limit_mib} MiB")
        facts.append((words("now_memory"), told, ""))
    if (pid := number(core.get("pid"))) is not None:
        epoch = number(core.get("epoch"))
        told = words("now_core_of", pid=str(pid), epoch="?" if epoch is None else str(epoch))
        facts.append((words("now_core"), told, ""))
    for name, key in (("now_held", "held_requests"), ("now_tabs", "websockets")):
        if (count := number(gateway.get(key))) is not None:
            facts.append((words(name), str(count), ""))
    if isinstance(spare, dict):
        ready = "now_spare_ready" if spare.get("ready") is True else "now_spare_not"
        facts.append((words("now_spare"), words(ready), ""))
    if (limit := number(budget.get("limit"))) is not None:
        told = words(
            "now_budget_of",
            used=number(budget.get("used")) or 0,
            limit=limit,
            window=number(budget.get("window_s")) or 0,
        )
        facts.append((words("now_budget"), told, ""))
    if (checked := optional_text(status.get("ledger_verified_at"))) is not None:
        facts.append((words("now_checked"), moment(checked, lang=lang), ""))
    return facts


def _guarding(words: Any, status: Mapping[str, Any], lang: Language) -> Mapping[str, Any]:
    """Return what is known of the guarding itself: mode, safe mode, the policy's file, parts, changes of the state."""
    mode, needs = text(status.get("mode")), optional_text(status.get("needs_since"))
    return {
        "away": not status,
        "mode": mode if mode in MODES else "",
        "needs": None if needs is None else moment(needs, lang=lang),
        "safe": status.get("wanted") == "SAFE",
        "why": text(status.get("safe_reason")),
        "fault": text(status.get("policy_fault")),
        "parts": [_part(words, one) for one in mappings(status.get("components"))[:PARTS_MAX]],
        "history": [
            (moment(text(one.get("at")), lang=lang), _state_word(one.get("after")), text(one.get("reason")))
            for one in mappings(status.get("history"))[: -HISTORY_MAX - 1 : -1]
        ],
    }


def _part(words: Any, one: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return one part of the core: its name, how it is, and how much it has done."""
    name, age, limit = text(one.get("name")), number(one.get("beat_age_ms")), number(one.get("limit_ms"))
    shown = words(f"part_{name}") if name in PARTS else name
    done = words("part_done", n=number(one.get("done")) or 0)
    if age is None:
        return shown, words("part_rests"), done
    silent = bool(limit) and age > (limit or 0)
    return shown, words("part_silent" if silent else "part_works", n=age), done


def _state_word(state: object) -> str:
    named = text(state)
    return named if named in STATES else "UNKNOWN"


def _calm(words: Any, lines: Sequence[IncidentLine], at: datetime, *, drilled: bool) -> str:
    if not lines:
        return str(words("now_only_drills" if drilled else "now_never"))
    began = _instant(lines[0].opened_at)
    days = 0 if began is None else (at - began).days
    return str(words("now_calm", n=days) if days >= 1 else words("now_calm_hours"))


def _proof(words: Any, last: Drill | None, lang: Language) -> str:
    if last is None:
        return str(words("now_unproven"))
    at = moment(last.at, lang=lang)
    if not last.ok:
        return str(words("now_proof_failed", at=at))
    if last.outage_ms is None:
        return str(words("now_proof_untimed", at=at))
    return str(words("now_proof", at=at, took=took(last.outage_ms, lang=lang)))


def _watched_s(status: Mapping[str, Any], at: datetime) -> float:
    """Return for how long a guard has watched without a break; 0: none answers, or nobody can tell.

    The launcher stays while guards come and go, so its age is theirs.
    """
    for name in ("launcher", "sentinel"):
        pid = number(mapping(status.get(name)).get("pid"))
        if pid is None or pid <= 0:
            continue
        try:
            return max(0.0, at.timestamp() - psutil.Process(pid).create_time())
        except psutil.Error:
            continue
    return 0.0


def _day(lines: Sequence[IncidentLine], at: datetime, lang: Language, watched_s: float) -> Drawing | None:
    """Return the strip of the last day: what no incident covers was served, for as long as somebody watched it."""
    spans = [Span(max(0.0, DAY_S - watched_s), float(DAY_S), "up")] if watched_s else []
    for line in lines:
        began, ended = _instant(line.opened_at), _instant(line.closed_at)
        if began is None:
            continue
        from_s = DAY_S - (at - began).total_seconds()
        kind = _kind(line)
        if line.outage_ms is not None:
            to_s = from_s + line.outage_ms / 1_000
        else:
            to_s = float(DAY_S) if ended is None else DAY_S - (at - ended).total_seconds()
        if to_s > 0 and kind:
            spans.append(Span(from_s, to_s, kind, line.summary.get(lang, line.diagnosis)))
    return draw_day(spans, lang)


def _kind(line: IncidentLine) -> str:
    """Return what an incident was for whoever used the ledger; empty: it went on, and nobody noticed."""
    if line.outage_ms is not None or line.closed_at is None:
        return "down"
    if line.outcome == "safe_mode":
        return "reads"
    return "" if line.outcome == "recovered" else "unknown"


def _instant(at: str | None) -> datetime | None:
    try:
        instant = datetime.fromisoformat(at or "")
    except ValueError:
        return None
    return instant if instant.tzinfo else instant.replace(tzinfo=UTC)
