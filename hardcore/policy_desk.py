"""The policy of a running guard: its file is looked at once a second, and taken whole or not at all.

A file that is changed is judged before anything goes by it; a bad one leaves the policy in force as it is, and is told
once: an alert, a line in the status, until it is mended. Editors write in pieces, so what is found faulty is read again
before it is called that. The looking is done on a thread of its own that may hang with its disk; nothing waits for it.
What a core or a gateway was told when it was started holds for it until the next one; whoever asks for the reload is
told which names those are. To watch the folder by inotify was not chosen: it is silent on some file systems.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Callable

import msgspec

from hardcore import standing
from hardcore.host import clock
from hardcore.host.errand import Errand
from hardcore.host.folders import Folders
from hardcore.house import Answer, House, refuse
from hardcore.model.actions import Alert, AlertStage
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.channels import as_shown
from hardcore.recovery.differing import differences
from hardcore.recovery.policy import Policy, PolicyFault, in_full

LOOK_EVERY_S = 1.0
#: A look takes a millisecond where the disk is well; what comes later is taken at the next round.
LOOKED_S = 0.05
#: What is half written when it is asked for is whole a moment later, or it is broken.
AGAIN_S = 0.2
#: Whoever asks for a reload waits so long for the disk.
RELOAD_S = 5.0
#: Told to a core when it is started; the next one goes by them.
OF_A_CORE = frozenset(
    {
        "transaction_timeout_ms",
        "memory_limit_mb",
        "enable_state_recovery",
        "checkpoint_interval_sec",
        "checkpoints_kept",
        "checkpoint_age_hours",
    }
)
#: As above, to a gateway.
OF_A_GATEWAY = "gateway."


class Found(msgspec.Struct, frozen=True):
    """What the file says: a policy with the text it stands in, or everything that is wrong with it."""

    policy: Policy | None
    text: bytes = b""
    faults: tuple[PolicyFault, ...] = ()


class PolicyFile:
    """Looks at the file of a data folder. `look` blocks, and may be called on any thread."""

    def __init__(self, folders: Folders) -> None:
        self._path = folders.policy
        self._lock = threading.Lock()
        self._stamp: tuple[int, ...] | None = None
        self._told: bytes | None = None  # what was judged last
        self._doubted: bytes | None = None  # what was found faulty once

    def look(self, *, at_once: bool = False) -> Found | None:
        """Return what is new, or None: nothing, or a fault that is to be seen a second time before it is told.

        `at_once`: say what stands there now, new or not.
        """
        with self._lock:
            stamp = standing.stamp_of(self._path)
            if stamp == self._stamp and self._doubted is None and not at_once:
                return None
            self._stamp = stamp
            text = standing.read_policy_file(self._path)
            known = b"" if isinstance(text, list) else text
            if known == self._told and not at_once:
                self._doubted = None
                return None
            found = self._judge(text)
            if found.policy is None and not at_once and self._doubted != known:
                self._doubted = known
                return None
            self._told, self._doubted = known, None
            return found

    @staticmethod
    def _judge(text: bytes | list[PolicyFault]) -> Found:
        judged = text if isinstance(text, list) else standing.judge_policy(text)
        if isinstance(judged, Policy):
            return Found(judged, text if isinstance(text, bytes) else b"")
        return Found(None, faults=tuple(judged))


class PolicyDesk:
    """Keeps the policy in force. `fault`: why the file is not what is gone by; empty: it is."""

    def __init__(self, house: House, go_by: Callable[[Policy], None], fault: str = "") -> None:
        """`go_by` has the guard go by another policy from now on."""
        self.fault = fault
        self._house = house
        self._go_by = go_by
        self._file = PolicyFile(house.folders)
        self._found: deque[Found] = deque()
        self._errand = Errand("policy", self._look)

    async def look_on(self) -> None:
        """Look at the file once a second, for as long as the guard lives."""
        if self.fault:
            self._alarm(self.fault)
        while True:
            try:
                self._errand.send(clock.now_ns())
            except RuntimeError as error:  # no thread can be made now: the policy in force holds meanwhile
                self._house.note("policy", unread=str(error))
            await asyncio.sleep(LOOKED_S)
            while self._found:
                self._take(self._found.popleft())
            await asyncio.sleep(LOOK_EVERY_S - LOOKED_S)

    def _look(self) -> None:
        found = self._file.look()
        if found is not None:
            self._found.append(found)

    async def reload(self) -> Answer:
        """Read the file now, and say what has changed, or what is wrong with it."""
        try:
            found = await asyncio.wait_for(self._now(), RELOAD_S)
        except TimeoutError:
            return refuse("not-read", "The policy file can't be read now: its disk does not answer.")
        changed = self._take(found)
        if found.policy is None:
            faults = [{"line": one.line, "name": one.name, "reason": one.reason} for one in found.faults]
            first = standing.first_of(found.faults)
            words = f"The policy file is not right ({first}); the policy before it stays in force."
            return refuse("policy-faults", words, faults=faults)
        return {"ok": True, "changed": changed, "later": [name for name in changed if _is_later(name)]}, []

    async def _now(self) -> Found:
        found = await self._house.in_hand(self._at_once)
        if found.policy is None:
            await asyncio.sleep(AGAIN_S)
            found = await self._house.in_hand(self._at_once)
        assert isinstance(found, Found), "at once, something is always said"
        return found

    def _at_once(self) -> Found | None:
        return self._file.look(at_once=True)

    def shown(self) -> Answer:
        """Return what is gone by; of a channel no address."""
        policy = self._house.policy
        told = {"policy": in_full(policy), "alerts": [as_shown(one) for one in policy.alerts]}
        return {"ok": True, **told, "fault": self.fault}, []

    def _take(self, found: Found) -> list[str]:
        """Go by what was found, if it is right; return the names of what is other than before."""
        if found.policy is None:
            why = standing.fault_of(self._house.folders, found.faults)
            if why != self.fault:
                self.fault = why
                self._alarm(why)
            return []
        if self.fault:
            self._house.note("policy", mended=self.fault)
            self.fault = ""
            mended = Alert(Diagnosis.CONFIG_INVALID, _MENDED, stage=AlertStage.CLOSED, outcome="mended")
            self._alert(mended)
        policy = standing.of_this_run(found.policy)
        changed = differences(self._house.policy, policy)
        if changed:
            self._house.note("policy", changed=changed)
            self._go_by(policy)
        self._house.begin(self._house.in_hand(standing.keep_policy, self._house.folders, found.text))
        return changed

    def _alarm(self, why: str) -> None:
        self._house.note("policy", fault=why)
        self._alert(Alert(Diagnosis.CONFIG_INVALID, why))

    def _alert(self, alert: Alert) -> None:
        self._house.note("alert", diagnosis=alert.diagnosis, stage=alert.stage, text=alert.text)
        self._house.begin(self._house.outbox.put(alert))


_MENDED = "The policy file is right again and in force."


def _is_later(name: str) -> bool:
    return name in OF_A_CORE or name.startswith(OF_A_GATEWAY)
