"""The witness of the conduct: does the core do what it never does?

Unexpected children, changed code, new ports, jumps of threads or descriptors: from outside that is what tampering
would look like, and it is what an update or a debugger looks like too. So it is told as the fact it is, and
nobody is ever ended for it.
"""

import msgspec

from hardcore.model.looks import Conduct
from hardcore.model.observations import Surveyed
from hardcore.model.verdicts import Colour, Testimony

#: So many facts of each kind are told, the rest are counted.
TOLD_MAX = 3


class ConductWatch(msgspec.Struct):
    """Remembers what the last survey found."""

    _found: Conduct = msgspec.field(default_factory=Conduct)

    def hear(self, fact: Surveyed) -> None:
        """Take in a survey, if it looked."""
        self._found = fact.conduct or self._found

    def testify(self) -> tuple[Testimony, ...]:
        """Return what is strange, one testimony for each kind."""
        kinds = (
            ("children", self._found.children),
            ("code", self._found.code),
            ("ports", self._found.ports),
            ("jumps", self._found.jumps),
        )
        return tuple(
            Testimony("conduct", Colour.YELLOW, f"{kind}: {_listed(facts)}") for kind, facts in kinds if facts
        )


def _listed(facts: tuple[str, ...]) -> str:
    more = len(facts) - TOLD_MAX
    return "; ".join(facts[:TOLD_MAX]) + (f"; and {more} more" if more > 0 else "")
