"""Rules and investigators, as asked for at the door: shown, made, taken away; woken.

A rule is judged whole before anything is changed, and what is wrong with it is one sentence. Everything else is the rule
book's business; here is only how it is said.
"""

from hardcore import quarantine_file
from hardcore.control.protocol import Request
from hardcore.house import Answer, House, refuse


class RuleDesk:
    """Answers what is asked of a house's rules."""

    def __init__(self, house: House) -> None:
        self._house = house

    def shown(self) -> Answer:
        """Return everything that is set aside and every rule in force."""
        return {"ok": True, "quarantine": quarantine_file.shown(self._house.court.rules.aside)}, []

    async def add(self, request: Request) -> Answer:
        """Put a rule in force."""
        return _said("bad-rule", await self._house.court.rules.add(request.rule))

    async def remove(self, request: Request) -> Answer:
        """Take a rule away; one that is not there is taken away already."""
        if not request.id:
            return refuse("bad-rule", "The id of the rule is missing.")
        return _said("not-stored", await self._house.court.rules.remove(request.id))

    async def investigate(self) -> Answer:
        """Have the investigators listen, and say where."""
        failed = await self._house.investigators.listen()
        if failed:
            return refuse("no-investigators", failed)
        return {"ok": True, "socket": str(self._house.folders.investigator)}, []


def _said(code: str, done: dict[str, object] | str) -> Answer:
    return refuse(code, done) if isinstance(done, str) else ({"ok": True, **done}, [])
