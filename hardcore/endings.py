"""The end of a life: it is seen by its pidfd, told as a fact with all that the dead leave, and then buried.

Whatever else goes wrong, a death is told: the manager answers nothing that it has not heard of, so where the telling
fails the guard ends and another one finds what is left. How a core ended that is no child of ours only the launcher
can read; it writes that down within milliseconds, and without its word the cause is unknown and said to be so.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any, Protocol

from hardcore.host import build, clock, core_control, logs
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.host.steps import Steps
from hardcore.model import observations as seen

LIVES_KEPT_MAX = 4
#: The launcher reaps an orphan within milliseconds; without its word a death is told as one of unknown cause.
ORPHAN_LOOKS_MAX, ORPHAN_LOOK_S = 25, 0.002
#: A core that serves says in milliseconds which code it runs.
NAMED_S = 1.0


class Hands(Protocol):
    """What is needed of the executor around it."""

    lives: dict[int, Life]
    steps: Steps

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        """Start a piece of work that nobody waits for."""

    async def in_hand(self, work: Callable[..., Any], *args: Any) -> Any:
        """Run blocking work on a hand's thread."""


class Endings:
    """Sees lives end. `tell` takes the facts, on the loop; `calm` waits for a switch to be over."""

    def __init__(
        self,
        hands: Hands,
        folders: Folders,
        tell: Callable[[seen.Observation], None],
        calm: Callable[[], Awaitable[None]],
    ) -> None:
        self._hands = hands
        self._folders = folders
        self._tell = tell
        self._calm = calm

    def keep_watch(self, life: Life) -> None:
        """From now on this life is ours: its end will be seen."""
        assert life.handle is not None, "only a process ends"
        self._hands.lives[life.number] = life
        try:
            asyncio.get_running_loop().add_reader(life.handle.pidfd, self._ended, life)
        except OSError as error:
            logs.end_with(f"a core's end can't be watched: {error}")  # the next guard finds and ends it

    def _ended(self, life: Life) -> None:
        """The pidfd is readable: the process is gone, or soon reapable."""
        assert life.handle is not None, "a pidfd belongs to a handle"
        at_ns = clock.now_ns()
        how = life.handle.reap()
        if how is None:
            return
        asyncio.get_running_loop().remove_reader(life.handle.pidfd)
        life.ended = True
        if life.handle.child:
            self._over(life, how, at_ns)
        else:
            self._hands.begin(self._orphan_over(life, at_ns))

    async def _orphan_over(self, life: Life, at_ns: int) -> None:
        how = None
        for _ in range(ORPHAN_LOOKS_MAX):
            how = how or life.orphans_exit()
            if how is None:
                await asyncio.sleep(ORPHAN_LOOK_S)
        self._over(life, how or seen.Exit(), at_ns)

    def _over(self, life: Life, how: seen.Exit, at_ns: int) -> None:
        self._hands.steps.absolve(life.nonce)
        try:
            page, kills, said = life.page(), life.oom_kills(), life.said(how)
            self._tell(seen.CoreExited(at_ns, life.number, how, page, kills, said))
        except Exception as error:  # noqa: BLE001  # a death that nobody was told of would never be answered
            logs.end_with(f"the end of a core could not be told: {type(error).__name__}: {error}")
        self._hands.begin(self.name_code(life))
        self._hands.begin(self.bury(life))

    async def bury(self, ended: Life) -> None:
        """Give back what a life that has just ended had to itself, and let go of those that are long over.

        Of a spare nothing is kept: it has done nothing that its page could bear witness to.
        """
        await self._hands.in_hand(ended.dissolve)
        lives = self._hands.lives
        over = [number for number, life in sorted(lives.items()) if life.ended]
        spares = [number for number in over if lives[number].spare]
        for number in {*spares, *over[:-LIVES_KEPT_MAX]}:
            life = lives.pop(number)
            await self._hands.in_hand(life.discard)

    async def name_code(self, life: Life) -> None:
        """Learn which code a core runs that has not said so: from itself, or from the disk that it was just loaded from."""
        if life.build or life.spare:
            return
        await self._calm()
        if not life.ended:
            told = core_control.Told(self._folders.core_control(life.nonce), {"verb": "status"})
            life.build = str((await told.answer(NAMED_S)).said.get("build", ""))
        if not (life.build or life.adopted_ns):
            life.build = await self._hands.in_hand(build.build_id)
