"""Takes in what the guard leaves: messages of the spool, and incidents' folders that are new or have changed.

Each message is committed together with its own number and removed afterwards, so it counts once, whoever dies
between. A folder is read when it looks different than when it was read last, and written when it says something else.
Being told of news was not chosen: the guard must not wait for us, and a glance at two folders costs nothing.
What can't be read is told and set aside; it never stops what comes after it.
"""

import logging
import os
import uuid
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import msgspec

from postmortem import bundle, found_rules, placing, reading
from postmortem.bundle import Found
from postmortem.dead_letters import slip as slips
from postmortem.dead_letters import spool
from postmortem.dead_letters.spool import Message, Unreadable
from postmortem.records import letters, log, stories
from postmortem.records.opening import Records
from postmortem.records.stories import Proposed, Story
from postmortem.reports.as_json import as_story
from postmortem.views import Act, IncidentLine

#: Files that nobody can read, kept for a person; the oldest go.
UNREADABLE_MAX: Final = 100
#: Folders read in one look, so that letters never wait for long behind old stories.
READ_AT_ONCE_MAX: Final = 16
SUMMARY_MAX: Final = 2_000
#: The lists of one incident: accounts, and facts that its group is made of.
LIST_MAX: Final = 64
#: How a trial ended, in a sentence.
_ENDS: Final = {
    "died": "ended the core",
    "hung": "hung",
    "grew": "passed its bound of memory",
    "survived": "was carried out",
    "committed": "was in the ledger already",
}

_LOG: Final = logging.getLogger("postmortem.intake")


class Intake(msgspec.Struct, frozen=True):
    """The places that are looked at, and the archive that it goes into. `rules`: the guard's file."""

    records: Records
    spool: Path
    incidents: Path
    rules: Path = Path("/dev/null")

    def begin(self) -> None:
        """Take in what waits, then what only the guard's rules tell. For the beginning."""
        # The rules first: a letter's message is in the spool before its rule says so.
        found = found_rules.read(self.rules)
        self.take_spool()
        if (made := found.take_letters(self.records)) > 0:
            _LOG.warning("%d letters were made of the guard's rules alone", made)
            told = Act(placing.now(), "investigator", "found", f"{made} rules of letters", "", "letters made")
            with self.records.writing() as connection:
                log.add_act(connection, told)

    def look(self) -> int:
        """Take in what is new; return how much of it there was. Raises what the archive raises."""
        return self.take_spool() + self.take_incidents()

    def take_spool(self) -> int:
        """Take in every message that waits, the oldest first; return how many."""
        taken = 0
        for found in spool.read_all(self.spool):
            told = _told(found) if isinstance(found, Message) else found
            if isinstance(told, Unreadable):
                self._set_aside(told)
            else:
                self._commit(found.path.stem, told)
                with suppress(OSError):  # it stays and is known: removed some other time
                    found.path.unlink(missing_ok=True)
            taken += 1
        return taken

    def take_incidents(self) -> int:
        """Take in incidents that are new or have changed, the newest first, a bounded number; return how many."""
        with self.records.reading() as connection:
            known = stories.marks(connection)
        changed = ((found, mark) for found, mark in self._folders() if known.get(found.id) != mark)
        taken = 0
        for (found, mark), _ in zip(changed, range(READ_AT_ONCE_MAX), strict=False):
            story = read_story(found)
            with self.records.writing() as connection:
                stories.put(connection, story, mark)
            taken += 1
        if taken:
            found_rules.read(self.rules).take_proposals(self.records)
        return taken

    def _folders(self) -> Iterator[tuple[Found, str]]:
        seen: set[str] = set()
        for found in bundle.find_bundles(self.incidents):
            if found.id in seen:
                continue  # the half one beside a whole one
            seen.add(found.id)
            with suppress(OSError):
                about = found.path.lstat()
                yield found, f"{about.st_ino}:{about.st_mtime_ns}:{found.partial:d}"

    def _commit(self, message: str, told: "_Told | Unreadable") -> None:
        """Write what a message says together with its number: so it counts once, whoever dies afterwards."""
        with self.records.writing() as connection:
            if letters.is_taken(connection, message):
                return
            match told:
                case slips.LetterSlip():
                    letters.take(connection, told)
                case slips.DrillSlip():
                    log.add_drill(connection, message, told)
                    log.add_act(connection, _act_of_drill(told))
                case slips.ActSlip():
                    # The guard writes of what it did, never of what it refused.
                    act = Act(told.at, told.who or "?", told.verb, told.what, told.reason, "done")
                    log.add_act(connection, act)
                case slips.StateSlip():
                    log.add_state(connection, told)
                case Unreadable():
                    _LOG.warning("%s of the spool could not be read: %s", told.path.name, told.reason)
                    words = (told.path.name, told.reason, "set aside")
                    log.add_act(connection, Act(placing.now(), "investigator", "unreadable", *words))

    def _set_aside(self, found: Unreadable) -> None:
        """Keep what can't be read for a person, and say so in the audit log."""
        corner = self.spool / "unreadable"
        self._commit(found.path.stem, found)
        try:
            corner.mkdir(mode=0o700, exist_ok=True)
            found.path.rename(corner / found.path.name)
            with os.scandir(corner) as items:
                names = sorted(item.name for item in items)
            for name in names[:-UNREADABLE_MAX]:
                (corner / name).unlink(missing_ok=True)
        except OSError:
            # It stays where it is and is tried again: nothing that somebody sent is removed because a disk is full.
            return


_Told = slips.LetterSlip | slips.DrillSlip | slips.ActSlip | slips.StateSlip


def _act_of_drill(drill: slips.DrillSlip) -> Act:
    """How a drill ended, as a line of the audit log."""
    outage = "" if drill.outage_ms is None else f", {drill.outage_ms:.0f} ms"
    who = "schedule" if drill.scheduled else "sentinel"
    ended = f"passed{outage}" if drill.ok else f"failed{outage}"
    return Act(drill.at, who, "drill-ended", drill.fault, drill.incident or "", ended)


def _told(message: Message) -> _Told | Unreadable:
    match message.kind:
        case "letter":
            return slips.letter(message.fields) or Unreadable(
                message.path, "a letter without an id or a name"
            )
        case "drill":
            return slips.drill(message.fields)
        case "act":
            return slips.act(message.fields)
        case "state":
            return slips.state(message.fields)
        case _:
            return Unreadable(message.path, "of no kind that is known here")


def read_story(found: Found) -> Story:
    """Return an incident as its folder says it now; one that defeats its reader is an incident all the same."""
    try:
        return story_of(found, as_story(reading.read_report(found), "en"))
    except Exception:  # noqa: BLE001  # the reason stands below
        # Whatever a rule of ours does not survive came out of a folder that anybody may have filled: the incident
        # has to be on the list, and the fault in our log.
        _LOG.exception("incident %s could not be understood", found.id)
        return story_of(found, {})


def story_of(found: Found, told: Mapping[str, Any]) -> Story:
    """Return what the archive keeps of an incident; `told`: its report, in which anything may be missing."""
    unread = {"ko": "이 사건의 기록을 읽지 못했어요.", "en": "The record of this incident could not be read."}
    summary = _texts(told.get("summaries")) or unread
    line = IncidentLine(
        id=found.id,
        opened_at=_text(told.get("opened_at")) or _begun(found),
        closed_at=_text(told.get("closed_at")) or None,
        diagnosis=_text(told.get("diagnosis")) or "UNKNOWN",
        grade=_text(told.get("grade")) or "unknown",
        summary=summary,
        outcome=_text(told.get("outcome")) or "open",
        outage_ms=_number(told.get("outage_ms")),
        detected_ms=_number(told.get("detected_ms")),
        fingerprint=_text(told.get("fingerprint")) or f"unread-{found.id}",
        account_ids=_list(told.get("account_ids")),
        planned=told.get("planned") is True,
        drill=_text(told.get("drill")) or None,
    )
    title = _texts(told.get("title")) or summary
    made = (_proposed(one, _trials(told)) for one in _dicts(told.get("proposals")))
    return Story(line, title, _list(told.get("why")), tuple(one for one in made if one is not None))


def _proposed(told: Mapping[str, Any], trials: Mapping[str, str]) -> Proposed | None:
    if not (text := _texts(told.get("text"))):
        return None
    rule = told.get("rule")
    rule = rule if isinstance(rule, dict) else None
    return Proposed(
        kind=_text(told.get("kind")) or "person",
        text=text,
        rule=rule,
        tested=_text(told.get("tested")) or trials.get(_text((rule or {}).get("fingerprint"))),
    )


def _trials(told: Mapping[str, Any]) -> dict[str, str]:
    """What a throw-away core said of each wish that was tried, by its fingerprint: the test of a rule that refuses it."""
    found = {}
    for one in _dicts(told.get("trials")):
        wish, ordeal, took_ms = _text(one.get("fingerprint")), _text(one.get("ordeal")), one.get("took_ms")
        if wish and ordeal not in ("", "untried"):
            took = f" after {took_ms:.0f} ms" if isinstance(took_ms, int | float) else ""
            found[wish] = (
                f"In a throw-away core on a copy of the ledger it {_ENDS.get(ordeal, ordeal)}{took}."
            )
    return found


def _dicts(given: object) -> list[Mapping[str, Any]]:
    return [one for one in given[:LIST_MAX] if isinstance(one, dict)] if isinstance(given, list) else []


def _begun(found: Found) -> str:
    """When an incident that does not say it began: its id's own time, else its folder's."""
    try:
        at_s = (uuid.UUID(found.id).int >> 80) / 1000
        told = datetime.fromtimestamp(at_s, UTC)
    except (ValueError, OverflowError, OSError):
        try:
            told = datetime.fromtimestamp(found.path.lstat().st_mtime, UTC)
        except (OSError, OverflowError, ValueError):
            told = datetime.fromtimestamp(0, UTC)
    return told.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _text(given: object) -> str:
    if not isinstance(given, str):
        return ""
    return given[:SUMMARY_MAX].encode("utf-8", "backslashreplace").decode()


def _texts(given: object) -> dict[str, str]:
    told = given if isinstance(given, Mapping) else {}
    return {lang: text for lang in ("ko", "en") if (text := _text(told.get(lang)))}


def _list(given: object) -> tuple[str, ...]:
    told = given[:LIST_MAX] if isinstance(given, list | tuple) else []
    return tuple(text for one in told if (text := _text(one)))


def _number(given: object) -> float | None:
    fits = isinstance(given, int | float) and not isinstance(given, bool) and abs(given) < 1e15
    return float(given) if fits and isinstance(given, int | float) else None
