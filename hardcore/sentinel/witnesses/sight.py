"""The witness of what we can't see: is there a page to read, and a process to look at?

A page that is no evidence is no evidence of a hang either, but it must never look like calm: what can't be judged is
said, with its reason, from the first look on. A page is as good as unreadable if it says what no core writes: beats
from the future, or none where there were some.
"""

import msgspec

from hardcore.model.observations import Sampled
from hardcore.model.recorder import Beats
from hardcore.model.verdicts import Colour, Testimony


class Missing(msgspec.Struct, frozen=True):
    """Why the page is no evidence, and why nobody can look at the process; empty where all is well."""

    page: str = ""
    process: str = ""


class Sight(msgspec.Struct):
    """Remembers whether this core has ever beaten."""

    _beaten: bool = False

    def look(self, tick: Sampled) -> Missing:
        """Take in one look."""
        process = "" if tick.process is not None else tick.process_fault or "It is not known why."
        missing = Missing(self._page(tick), process)
        self._beaten = self._beaten or bool(not missing.page and tick.beats and tick.beats.loop_ns)
        return missing

    def _page(self, tick: Sampled) -> str:
        if tick.beats is None:
            return tick.page_fault or "It can't be read."
        return self._impossible(tick.beats, tick.at_ns)

    def _impossible(self, beats: Beats, at_ns: int) -> str:
        if max(beats.loop_ns, beats.thread_ns) > at_ns:
            return "Its beats are from the future."
        return "Its beats were taken back." if self._beaten and not beats.loop_ns else ""


def testify(missing: Missing) -> tuple[Testimony, ...]:
    """Return what can't be seen. Never red, and never nothing."""
    said = []
    if missing.page:
        said.append(Testimony("page", Colour.YELLOW, f"no page to judge by: {missing.page}"))
    if missing.process:
        why = f"nobody can look at the core's process: {missing.process}"
        said.append(Testimony("process", Colour.YELLOW, why))
    return tuple(said)
