"""What the guard's rules say of letters and proposals that the archive does not know: read, and taken in.

An archive that was damaged begins empty, a message may have been lost, and the guard goes on refusing: so its file
(`docs/wires.md` section 13) is looked at when an investigator begins, and when incidents are read. A letter made of a rule
has no request and can't be run; but it is seen, and its key to the rule is there. Asking the guard was not chosen: letters can
be read with everything stopped. What the file does not say in its shape is passed over.
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from postmortem import placing
from postmortem.dead_letters import slip as slips
from postmortem.dead_letters.slip import LetterSlip
from postmortem.records import letters, log
from postmortem.records.opening import Records
from postmortem.records.stories import PROPOSAL_RULE

FILE_BYTES_MAX: Final = 8 << 20
RULES_MAX: Final = 4_000
VERSION: Final = 1
#: Beside a letter's rule while its message is not in the spool yet: it will be.
_UNSENT: Final = "unsent"
_PROPOSAL = re.compile(re.escape(PROPOSAL_RULE) + r"([0-9a-f]{32})")


class FoundRules(msgspec.Struct, frozen=True):
    """The rules of one file, as they stood when it was read."""

    rules: tuple[Mapping[str, Any], ...]

    def take_letters(self, records: Records) -> int:
        """Make a letter of each rule that has none; return of how many. For after the spool was taken in."""
        slips_found = [found for rule in self.rules if _UNSENT not in rule and (found := _slip(rule))]
        with records.writing() as connection:
            return sum(letters.take_unknown(connection, found) for found in slips_found)

    def take_proposals(self, records: Records) -> None:
        """Call accepted what is enforced; for after a reading of incidents that an archive before this one had, too."""
        enforced = [match[1] for rule in self.rules if (match := _PROPOSAL.fullmatch(str(rule.get("id"))))]
        if enforced:
            with records.writing() as connection:
                log.find_accepted(connection, enforced)


def read(path: Path) -> FoundRules:
    """The rules in the guard's file; none where it can't be read."""
    try:
        with path.open("rb") as file:
            told = json.loads(file.read(FILE_BYTES_MAX))
    except (OSError, ValueError, RecursionError):
        return FoundRules(())
    rules = told.get("rules") if isinstance(told, dict) and told.get("version") == VERSION else None
    many = rules[:RULES_MAX] if isinstance(rules, list) else []
    return FoundRules(tuple(rule for rule in many if isinstance(rule, dict)))


def _slip(rule: Mapping[str, Any]) -> LetterSlip | None:
    """The letter of a rule, as far as the rule knows it."""
    if rule.get("type") not in ("letter", "parked"):
        return None
    # An event that is left out has no request's name; one made of its number is the same whenever it is made.
    name = (
        rule.get("name")
        if rule["type"] == "letter"
        else placing.digest(f"event {rule.get('seq')}".encode())[:32]
    )
    reason = rule.get("reason") or "CRASHED_CORE"
    held = reason in ("UNPROVEN", "OPERATOR_HOLD")
    told = {**rule, "name": name, "reason": reason, "state": "HELD" if held else "QUARANTINED"}
    return slips.letter({**told, "quarantined_at": placing.now()})
