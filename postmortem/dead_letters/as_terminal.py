"""Prints dead letters on a terminal, as incidents are printed: in cells, and with everybody's text made harmless.

A letter's payload is whatever somebody sent; each of its lines passes `visible` and is cut, and only so many are shown.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from frontend import catalogue_letters as texts
from postmortem.dead_letters.ordeals import answered, read_dry_run, was_refused
from postmortem.reports.as_terminal import Look, Write, cells, cut, milliseconds, pad
from postmortem.reports.evidence_words import command_word
from postmortem.reports.visible import visible

PAYLOAD_LINES_MAX: Final = 40
HISTORY_MAX: Final = 20
#: Lines of one fact.
LINES_MAX: Final = 8
_ID_MIN: Final = 8
_LABEL: Final = 18
_STYLES: Final = {
    "QUARANTINED": "warn",
    "HELD": "warn",
    "RETRYING": "bold",
    "RESOLVED": "good",
    "DISCARDED": "dim",
}


def print_list(items: Sequence[Mapping[str, Any]], total: int, lang: str, write: Write, look: Look) -> None:
    """Print letters, two lines each: which and where it is, then why."""
    short = _short_ids([str(one["id"]) for one in items])
    for one in items:
        state = texts.told("state", one["state"], lang)
        what = f"{command_word(one['kind'], lang) or one['method']} · {', '.join(one['accounts']) or '-'}"
        head = f"{_day(one['quarantined_at'])}  {short[one['id']]}  "
        write(f"{look.style(head, 'dim')}{look.style(state, _STYLES.get(one['state'], 'bold'))}  ")
        write(cut(visible(what), max(10, look.width - cells(head) - cells(state) - 2)) + "\n")
        write(f"    {cut(visible(_why(one, lang)), look.width - 4)}\n")
    if total > len(items):
        write(texts.word("counted", lang, shown=len(items), total=total) + "\n")


def print_letter(one: Mapping[str, Any], lang: str, write: Write, look: Look) -> None:
    """Print all that is known of a letter."""
    state = texts.told("state", one["state"], lang)
    write(
        f"{look.style(visible(one['id']), 'bold')}  {look.style(state, _STYLES.get(one['state'], 'bold'))}\n"
    )
    for label, value in _facts(one, lang):
        if value:
            name = pad(texts.word(label, lang), _LABEL)
            behind = "\n" + " " * _LABEL
            lines = _folded(visible(value), max(20, look.width - _LABEL))
            write(f"{look.style(name, 'dim')}{behind.join(lines)}\n")
    _print_payload(one, lang, write, look)
    if one["history"]:
        write(f"\n{look.style(texts.word('history', lang), 'bold')}\n")
    for attempt in one["history"][-HISTORY_MAX:]:
        what = texts.told("attempt", attempt["what"], lang)
        outcome = texts.told("ordeal", attempt["outcome"], lang)
        line = f"{_day(attempt['at'])}  {what}: {outcome} {attempt['detail']}"
        write(f"  {cut(visible(line), look.width - 2)}\n")


def _facts(one: Mapping[str, Any], lang: str) -> list[tuple[str, str]]:
    row, dry = one["row"] or {}, one["dry_run"]
    tried = texts.word("dry_run_none", lang, id=one["id"])
    if dry is not None:
        found = read_dry_run(dry)
        end = texts.told("ordeal", "refused" if was_refused(found) else found.ordeal, lang)
        facts = (end, answered(found), milliseconds(found.took_ms, "-"), _day(found.at), found.why)
        tried = " · ".join(fact for fact in facts if fact)
    return [
        ("reason", f"{one['reason']}: {_why(one, lang)}"),
        ("next", _next(one, lang)),
        ("head_since", _day(one["quarantined_at"])),
        ("head_deaths", str(one["deaths"])),
        ("head_what", f"{one['kind']} {one['method']} {one['path']}".strip()),
        ("head_accounts", ", ".join(one["accounts"])),
        ("sums", ", ".join(one["sums"])),
        ("source", one["source"]),
        ("key", one["idempotency_key"] or ""),
        ("fingerprint", one["fingerprint"] or ""),
        ("incidents", ", ".join(one["incident_ids"])),
        ("row", " ".join(f"{name}={value}" for name, value in row.items())),
        ("event", str(one["seq"]) if one["seq"] is not None else ""),
        ("dry_run", tried),
        ("discarded", one["discarded_because"] or ""),
        ("corrected_by", one["corrected_by"]),
        ("note", one["note"]),
    ]


def _next(one: Mapping[str, Any], lang: str) -> str:
    if one["state"] not in ("QUARANTINED", "HELD"):
        return ""
    refused = one["dry_run"] is not None and was_refused(read_dry_run(one["dry_run"]))
    return texts.word("next_refused", lang) if refused else str(one["next_step"])


def _print_payload(one: Mapping[str, Any], lang: str, write: Write, look: Look) -> None:
    payload = one["payload"]
    if payload is None:
        return
    write(f"\n{look.style(texts.word('payload', lang), 'bold')}\n")
    told = payload if isinstance(payload, str) else json.dumps(payload, ensure_ascii=False, indent=1)
    lines = told.split("\n")
    for line in lines[:PAYLOAD_LINES_MAX]:
        write(f"  {cut(visible(line[: look.width * 4]), look.width - 2)}\n")
    if len(lines) > PAYLOAD_LINES_MAX:
        write(f"  … +{len(lines) - PAYLOAD_LINES_MAX}\n")


def _why(one: Mapping[str, Any], lang: str) -> str:
    return texts.told("reason", one["reason"], lang)


def _day(at: str) -> str:
    return visible(at[:19].replace("T", " "))


def _folded(text: str, width: int) -> list[str]:
    """Break a text between its words, or within one that is too long; only so many lines of it."""
    lines = [""]
    for word in text.split(" "):
        joined = f"{lines[-1]} {word}" if lines[-1] else word
        if cells(joined) <= width:
            lines[-1] = joined
            continue
        rest = word
        while cells(rest) > width:
            head = cut(rest, width + 1)[:-1]
            lines.append(head)
            rest = rest[len(head) :]
        lines.append(rest)
    kept = [line for line in lines if line]
    return [*kept[:LINES_MAX], "…"] if len(kept) > LINES_MAX else kept


def _short_ids(ids: Sequence[str]) -> dict[str, str]:
    """For each id the shortest beginning that no other one shares, all of one length."""
    longest = max(map(len, ids), default=_ID_MIN)
    lengths = range(_ID_MIN, longest + 1)
    length = next((n for n in lengths if len({one[:n] for one in ids}) == len(set(ids))), longest)
    return {one: pad(visible(one[:length]), length) for one in ids}
