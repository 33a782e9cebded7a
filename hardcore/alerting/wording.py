"""From a notice and what is on record of its incident to the message that somebody reads. Pure.

Each line stands on a fact: the verdict on the money is only said where the report gives it, the cause with its grade.
The guard's own sentence stays English, because it may say anything; the title and the lines around it are in the
reader's language.
"""

import datetime as dt
from collections.abc import Mapping
from typing import Any

import msgspec

from frontend.catalogue_alerts import alert_text, cause_text, took_text
from hardcore.alerting.as_read import bounded_number
from hardcore.alerting.notices import Notice
from hardcore.recovery.channels import Stage

_ENDINGS = frozenset({"safe_mode", "manual", "assist", "abandoned"})
_GRADES = frozenset({"certain", "likely"})


class Message(msgspec.Struct, frozen=True):
    """What is sent: a title, and lines below it. `link` leads to the incident; empty: nowhere."""

    notice: Notice
    title: str
    lines: tuple[str, ...]
    link: str
    left_out: int = 0

    @property
    def body(self) -> str:
        """The lines as one text."""
        return "\n".join(self.lines)

    @property
    def urgent(self) -> bool:
        """Whether a person is needed."""
        return self.notice.stage in {Stage.WAITS, Stage.OVERDUE} or self.notice.outcome == "manual"


def compose(notice: Notice, facts: Mapping[str, Any], lang: tuple[str, ...], left_out: int = 0) -> Message:
    """Return the message for these languages. `facts`: the incident's report or its facts; empty: neither is there."""
    titles = [_title(notice, facts, one) for one in lang]
    lines: list[str] = []
    for number, one in enumerate(lang):
        if number:
            lines += ["", titles[number]]
        lines += _lines(notice, facts, one)
        if left_out:
            lines.append(alert_text("left_out", one, n=left_out))
    link = _link(notice)
    if link:
        lines.append(alert_text("details", lang[0], url=link))
    return Message(notice, titles[0], tuple(lines), link, left_out)


def _title(notice: Notice, facts: Mapping[str, Any], lang: str) -> str:
    cause = cause_text(_diagnosis(notice, facts), lang)
    if notice.stage is not Stage.CLOSED:
        return alert_text(notice.stage, lang, cause=cause)
    if notice.outcome in _ENDINGS:
        return alert_text(notice.outcome, lang)
    length_ms = _outage_ms(notice, facts)
    if length_ms is None:
        return alert_text("recovered_unmeasured", lang, cause=cause)
    return alert_text("recovered", lang, took=took_text(length_ms, lang))


def _lines(notice: Notice, facts: Mapping[str, Any], lang: str) -> list[str]:
    lines = [alert_text("at", lang, at=local(notice.at))]
    match notice.stage:
        case Stage.TEST:
            lines.append(alert_text("test_line", lang))
        case Stage.CLOSED:
            lines += _closing(notice, facts, lang)
        case Stage.FORECAST:
            lines += [*_observed(notice, lang), alert_text("nothing_yet", lang)]
        case Stage.OPENED:
            over = [alert_text("told_when_over", lang)] if notice.incident else []
            lines += [*_observed(notice, lang), *over]
        case Stage.WAITS | Stage.OVERDUE:
            cause = alert_text(
                "cause", lang, grade=_grade(facts, lang), cause=cause_text(_diagnosis(notice, facts), lang)
            )
            lines += [cause, *_observed(notice, lang), alert_text("resume", lang)]
    return lines


def _observed(notice: Notice, lang: str) -> list[str]:
    return [alert_text("observed", lang, text=notice.text)] if notice.text else []


def _closing(notice: Notice, facts: Mapping[str, Any], lang: str) -> list[str]:
    cause = cause_text(_diagnosis(notice, facts), lang)
    lines = [alert_text("cause", lang, grade=_grade(facts, lang), cause=cause), _money(facts, lang)]
    if letters := _letters(facts):
        lines.append(alert_text("letters", lang, n=letters))
    if notice.outcome in {"manual", "assist"}:
        lines.append(alert_text("resume", lang))
    return lines


def _diagnosis(notice: Notice, facts: Mapping[str, Any]) -> str:
    known = facts.get("diagnosis")
    closing = notice.stage is Stage.CLOSED and isinstance(known, str)
    return str(known) if closing else notice.diagnosis


def _grade(facts: Mapping[str, Any], lang: str) -> str:
    grade = facts.get("grade")
    return alert_text(grade if isinstance(grade, str) and grade in _GRADES else "unknown", lang)


def _outage_ms(notice: Notice, facts: Mapping[str, Any]) -> float | None:
    told = bounded_number(facts.get("outage_ms"))
    return told if told is not None else notice.outage_ms


def _money(facts: Mapping[str, Any], lang: str) -> str:
    """Return the verdict on the money, as the report has it; without one nothing is promised."""
    audit, money = facts.get("audit"), facts.get("money")
    if isinstance(audit, dict) and audit.get("ok") is False:
        return alert_text("ledger_wrong", lang)
    if not isinstance(money, dict) or money.get("verified") is not True:
        return alert_text("unverified", lang)
    if money.get("lost") == 0 and money.get("doubled") == 0:
        return alert_text("nothing_lost", lang)
    return alert_text("ledger_wrong" if money.get("lost") or money.get("doubled") else "unverified", lang)


def _letters(facts: Mapping[str, Any]) -> int:
    trials = facts.get("trials")
    if not isinstance(trials, list):
        return 0
    return sum(isinstance(trial, dict) and bool(trial.get("letter")) for trial in trials)


def _link(notice: Notice) -> str:
    if not notice.url:
        return ""
    page = f"incidents/{notice.incident}" if notice.incident else ""
    return f"{notice.url.rstrip('/')}/admin/{page}"


def local(at: str) -> str:
    """Return a time as this machine's clock shows it; what is no time stays."""
    try:
        return f"{dt.datetime.fromisoformat(at).astimezone():%Y-%m-%d %H:%M:%S}"
    except (ValueError, OverflowError):
        return at
