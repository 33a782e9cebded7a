"""Prints incidents on a terminal: calm, readable, as wide as the window, in Korean and English.

Widths are counted in cells, because a Korean syllable takes two; a library for it was not needed, the
Unicode tables of the standard library know. Every text passes `visible`, so nothing that was typed into the
ledger can move the cursor of whoever reads about it. Colour only underlines what the words say already.
"""

import unicodedata
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from typing import Any

import msgspec

from frontend import catalogue_prevention as prevention
from frontend import catalogue_reports as texts
from postmortem.incident import ending
from postmortem.reports.evidence_words import command_word, kind_word, ordeal_word, stage_word, told
from postmortem.reports.visible import visible

Write = Callable[[str], object]

WIDTH_MIN, WIDTH_MAX = 56, 110
#: Below it a row of the list takes two lines.
_WIDE = 90
_ID_MIN = 8
_LABEL = 16
#: Lines of one section; what is left out is counted.
LINES_MAX = 50

_STYLES = {"bold": "1", "dim": "2", "good": "32", "warn": "33", "bad": "31"}
_OUTCOME_STYLES = {
    "recovered": "good",
    "open": "warn",
    "assist": "warn",
    "safe_mode": "warn",
    "manual": "bad",
    "served": "good",
    "untold": "warn",
    "taken_over": "good",
}


class Look(msgspec.Struct, frozen=True):
    """How to print: width in cells, and whether colour is wanted."""

    width: int = 80
    colour: bool = False

    def style(self, text: str, name: str) -> str:
        """Return `text` in a style, or as it is where colour is not wanted."""
        return f"\x1b[{_STYLES[name]}m{text}\x1b[0m" if self.colour and text else text


def print_list(items: list[dict[str, Any]], language: str, write: Write, look: Look) -> None:
    """Print the list of incidents, one row each."""
    if not items:
        write(_word("no_incidents", language) + "\n")
        return
    short = _short_ids([item["id"] for item in items])
    for item in items:
        outcome = _outcome(item, language)
        head = f"{_local(item['opened_at'], language)}  {short[item['id']]}  "
        outage = milliseconds(item["outage_ms"], "-")
        state = look.style(pad(outcome, 11), _OUTCOME_STYLES[_ending(item)])
        row = f"{look.style(head, 'dim')}{state}{pad(outage, 9, right=True)}"
        used = cells(head) + 11 + 9 + 2
        if look.width >= _WIDE:
            write(f"{row}  {cut(visible(item['summary']), look.width - used)}\n")
        else:
            write(row + "\n")
            write(_wrapped(item["summary"], look.width, 4))


def print_show(story: Mapping[str, Any], language: str, write: Write, look: Look) -> None:
    """Print everything about one incident."""
    write(f"{look.style(_word('incident', language), 'dim')} {look.style(visible(story['id']), 'bold')}\n")
    write(_wrapped(story["summaries"][language], look.width, 0))
    write("\n")
    _facts(story, language, write, look)
    for title, lines in (
        ("timeline", _timeline(story, language)),
        ("evidence", _evidence(story, language)),
        ("findings", _findings(story, language)),
        ("culprit", _culprit(story, language)),
        ("trials", _trials(story, language)),
        ("proposals", _proposals(story, language)),
        ("repetition", _repetition(story, language)),
        ("in_flight", _in_flight(story, language)),
        ("requests", _requests(story, language)),
        ("deaths", _deaths(story, language)),
        ("files", _files(story, language)),
    ):
        _section(title, list(lines), language, write, look)


def _facts(story: Mapping[str, Any], language: str, write: Write, look: Look) -> None:
    nothing = _word("nothing_recorded", language)
    # A recorder that was read and shows no command is knowledge, not a gap.
    idle = nothing if story["closed_at"] is None else _word("none_in_flight", language)
    rows = [
        ("diagnosis", f"{story['diagnosis']} ({texts.GRADES[story['grade']][language]})"),
        ("outcome", _outcome(story, language)),
        ("opened", _local(story["opened_at"], language)),
        ("detection", milliseconds(story["detected_ms"], nothing)),
        ("outage", milliseconds(story["outage_ms"], story["no_outage"][language])),
        ("accounts", ", ".join(story["account_ids"]) or idle),
        ("transactions", ", ".join(story["transaction_ids"]) or idle),
        ("money", story["money_line"][language]),
    ]
    if again_at := story["served_again_at"]:
        rows.insert(2, ("served_again", _local(again_at, language)))
    if words := story["core"]["last_words"]:
        rows.append(("last_words", f"{words['code']}: {words['text']}"))
    if step := story["next_step"][language]:
        rows.append(("next_step", step))
    for label, value in rows:
        name = look.style(pad(_word(label, language), _LABEL), "dim")
        body = _wrapped(value, look.width, 2 + _LABEL).lstrip(" ")
        write(f"  {name}{body}")


def _outcome(item: Mapping[str, Any], language: str) -> str:
    return texts.OUTCOME_WORDS[_ending(item)][language]


def _ending(item: Mapping[str, Any]) -> str:
    return ending(item["outcome"], item["closed_at"], item["served_again_at"])


def _timeline(story: Mapping[str, Any], language: str) -> Iterable[str]:
    for step in story["timeline"]:
        name = texts.STEPS[step["step"]][language] if step["step"] in texts.STEPS else step["step"]
        yield f"{pad(milliseconds(step['offset_ms'], '-'), 10, right=True)}  {name}"


def _evidence(story: Mapping[str, Any], language: str) -> Iterable[str]:
    for line in story["evidence"]:
        yield f"{kind_word(line['kind'], language)}: {told(line['text'], language)}"


def _findings(story: Mapping[str, Any], language: str) -> Iterable[str]:
    for finding in story["findings"]:
        yield f"{finding['sentence'][language]} ({texts.GRADES[finding['confidence']][language]})"
        yield from (f"  {told(line, language)}" for line in finding["evidence"])


def _culprit(story: Mapping[str, Any], language: str) -> Iterable[str]:
    culprit = story["culprit"]
    if culprit["confidence"] is not None:
        kind = command_word(culprit["kind"], language) or _word("command", language)
        yield f"{kind} {culprit['command_id']} ({texts.GRADES[culprit['confidence']][language]})"
        if culprit["transaction_id"]:
            yield f"  {_word('transaction', language)} {culprit['transaction_id']}"
        if culprit["account_ids"]:
            yield f"  {_word('account', language)} {', '.join(culprit['account_ids'])}"
    yield culprit["why"][language]


def _trials(story: Mapping[str, Any], language: str) -> Iterable[str]:
    for trial in story["trials"]:
        name = trial["command_id"] or trial["name"]
        parts = [name, ordeal_word(trial["ordeal"], language), milliseconds(trial["took_ms"], "-")]
        yield " · ".join([*parts, trial["letter"]] if trial["letter"] else parts)


def _proposals(story: Mapping[str, Any], language: str) -> Iterable[str]:
    return (proposal["text"][language] for proposal in story["proposals"])


def _repetition(story: Mapping[str, Any], language: str) -> Iterable[str]:
    if story["repetition"] is not None:
        yield story["repetition_line"][language]
        yield from (change["text"][language] for change in story["changes"])


def _in_flight(story: Mapping[str, Any], language: str) -> Iterable[str]:
    if not story["in_flight"] and story["closed_at"] is None:
        yield _word("nothing_recorded", language)
        return
    if not story["in_flight"]:
        yield _word("nothing_in_flight", language)
    for command in story["in_flight"]:
        age = milliseconds(command["age_ms"], "-")
        suspect = f" · {_word('suspect', language)}" if command["key_hash"] in story["suspects"] else ""
        blamed = f" · {_word('blamed', language)}" if command["command_id"] in story["blamed"] else ""
        kind = command_word(command["kind"], language) or _word("command", language)
        yield f"{kind} · {stage_word(command['stage'], language)} · {age}{blamed}{suspect}"
        if command["transaction_id"]:
            yield f"  {_word('transaction', language)} {command['transaction_id']}"
        if command["account_ids"]:
            yield f"  {_word('account', language)} {', '.join(command['account_ids'])}"


def _requests(story: Mapping[str, Any], language: str) -> Iterable[str]:
    if not story["requests"]:
        yield story["no_requests"][language]
    for request in story["requests"]:
        parts = [f"{request['method']} {request['path']}", request["told"][language]]
        parts += [str(request["status"])] if request["status"] else []
        if request["held_ms"] is not None:
            parts.append(f"{_word('held', language)} {milliseconds(request['held_ms'], '-')}")
        yield " · ".join(parts)


def _deaths(story: Mapping[str, Any], language: str) -> Iterable[str]:
    for death in story["deaths"]:
        ended = death["exit"]
        how = [
            f"{_word(name, language)} {ended[name]}" for name in ("signal", "code") if ended[name] is not None
        ]
        yield " · ".join([death["at"] or "-", death["diagnosis"], *how])


def _files(story: Mapping[str, Any], language: str) -> Iterable[str]:
    contents = story["bundle"]
    yield story["folder"]
    if contents["partial"]:
        yield _word("partial", language)
    yield from (f"{size:>9,} B  {name}" for name, size in contents["files"].items())
    for name, reason in contents["missing"].items():
        yield f"{_word('missing', language)}: {name} ({reason})"
    for fault in contents["faults"]:
        yield f"{_word('faults', language)}: {fault}"


def _section(title: str, lines: list[str], language: str, write: Write, look: Look) -> None:
    if not lines:
        return
    write(f"\n{look.style(_word(title, language), 'bold')}\n")
    for line in lines[:LINES_MAX]:
        indent = 2 + len(line) - len(line.lstrip(" "))
        write(_wrapped(line.lstrip(" "), look.width, indent))
    if len(lines) > LINES_MAX:
        write(f"  … +{len(lines) - LINES_MAX}\n")


def cells(text: str) -> int:
    """Return how many cells of a terminal `text` takes."""
    return sum(_cells_of(character) for character in text)


def pad(text: str, width: int, *, right: bool = False) -> str:
    """Return `text` filled with spaces to `width` cells, on the left if it is to stand `right`."""
    spaces = " " * (width - cells(text))
    return spaces + text if right else text + spaces


def cut(text: str, width: int) -> str:
    """Return as much of `text` as `width` cells hold, with an ellipsis if that is not all."""
    if cells(text) <= width:
        return text
    kept, used = [], 1
    for character in text:
        used += _cells_of(character)
        if used > width:
            break
        kept.append(character)
    return "".join(kept) + "…"


def _cells_of(character: str) -> int:
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


def _wrapped(text: str, width: int, indent: int) -> str:
    """Return `text` as lines of at most `width` cells behind `indent` spaces, each ended."""
    room = max(10, width - indent)
    lines, line = [], ""
    for word in visible(text).split(" "):
        joined = f"{line} {word}" if line else word
        if cells(joined) <= room:
            line = joined
            continue
        if line:
            lines.append(line)
        line = word
        while cells(line) > room:  # an id longer than the window: it goes on in the next line
            head = cut(line, room + 1)[:-1]
            lines.append(head)
            line = line[len(head) :]
    return "".join(f"{' ' * indent}{one}\n" for one in [*lines, line])


def _short_ids(ids: list[str]) -> dict[str, str]:
    """Return for each id the shortest beginning that no other one shares, all of one length."""
    longest = max(map(len, ids))
    lengths = range(_ID_MIN, longest + 1)
    length = next((n for n in lengths if len({one[:n] for one in ids}) == len(set(ids))), longest)
    return {one: pad(visible(one[:length]), length) for one in ids}


def _local(at: str | None, language: str) -> str:
    if at is None:
        return pad(_word("nothing_recorded", language), 19)
    try:
        return datetime.fromisoformat(at).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    except (ValueError, OverflowError):  # the form of a time, but no such day
        return pad(cut(at, 19), 19)


def milliseconds(value: float | None, otherwise: str) -> str:
    """Return a duration in words: a tenth counts below ten milliseconds, seconds above ten of them."""
    if value is None:
        return otherwise
    if value >= 10_000:
        return f"{value / 1000:.1f} s"
    return f"{value:.1f} ms" if value < 10 and value % 1 else f"{value:.0f} ms"


def _word(key: str, language: str) -> str:
    return (texts.WORDS.get(key) or prevention.WORDS[key])[language]
