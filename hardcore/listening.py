"""What cores say on the notify socket, taken in as facts; who is no core of ours is passed over, and counted.

The kernel tells who sent a datagram, and only the lives that this guard holds are listened to: anybody on the machine
may write to the socket, and a word from a stranger must not move a core.
"""

import os
from collections.abc import Callable

from hardcore.court_room import CourtRoom
from hardcore.executor import Executor
from hardcore.host import clock
from hardcore.host.folders import Folders
from hardcore.host.lives import Life
from hardcore.host.notify import NotifySocket, Tally
from hardcore.model import observations as seen
from hardcore.sentinel.heartbeat import (
    CONTROL_VERSION,
    NOTICE_BYTES_MAX,
    MalformedNotice,
    Notice,
    SpareNotice,
    read_notice,
)


class Listener:
    """Listens to the cores. `feed` takes the facts, on the loop."""

    def __init__(
        self, folders: Folders, executor: Executor, feed: Callable[[seen.Observation], None]
    ) -> None:
        self._socket = NotifySocket(folders.notify, NOTICE_BYTES_MAX)
        self._executor = executor
        self._feed = feed
        self._strange = Tally()

    @property
    def _court(self) -> CourtRoom:
        return self._executor.court

    def fileno(self) -> int:
        """Return the socket that is readable when somebody has said something."""
        return self._socket.fileno()

    def close(self) -> None:
        """Listen no more."""
        self._socket.close()

    def hear(self) -> None:
        """Take in all that waits."""
        at_ns = clock.now_ns()
        for pid, data in self._socket.waiting():
            life = self._executor.speaker(pid)
            if life is None:
                self._passed_over(f"from process {pid}, which is no core of ours", at_ns)
                continue
            notice = read_notice(data)
            if isinstance(notice, MalformedNotice):
                self._passed_over(f"malformed: {notice.reason}", at_ns)
            elif notice.spare is not None:
                self._heard_spare(notice.spare, life, at_ns)
            else:
                self._heard(notice, life.number, at_ns)

    def _passed_over(self, why: str, at_ns: int) -> None:
        count = self._strange.count(at_ns)
        if count:
            self._executor.note("notice", passed_over=count, last=why)

    def _heard_spare(self, told: SpareNotice, life: Life, at_ns: int) -> None:
        if told.control != CONTROL_VERSION:
            why = f"it speaks version {told.control} of the control socket, this guard version {CONTROL_VERSION}"
            self._executor.reject(life, why)
            return
        life.build, life.schema = told.build, None if told.migrates else told.schema
        self._feed(seen.SpareReady(at_ns, life.number, told.build, told.schema, told.migrates))
        if self._court.rules.aside.serial:  # it may have read the rules before the last change was made
            self._executor.begin(self._court.rules.tell_cores())

    def _heard(self, notice: Notice, life: int, at_ns: int) -> None:
        if notice.term_pid is not None and notice.term_pid != os.getpid():
            self._feed(seen.TermReceived(at_ns, life, notice.term_pid))
        if notice.fence_blocked:
            self._feed(seen.FenceBlocked(at_ns, life))
        for name in notice.cases:
            self._executor.begin(self._court.case_filed(name))
        if notice.store is not None:
            self._executor.senses.look_at_disk()  # the core's word is one kind of evidence, ours the other
            self._feed(seen.StoreTold(at_ns, life, notice.store))
        if notice.extend_usec:
            self._feed(seen.StartExtended(at_ns, life, notice.extend_usec * 1000))
        if notice.ready and notice.epoch is not None and notice.hash is not None:
            assert notice.proof is not None, "the parser gives a whole proof or none"
            assert notice.tail is not None, "as above"
            assert notice.seq is not None, "as above"
            proof = seen.Proof(notice.proof, notice.tail, notice.seq, notice.hash)
            self._feed(seen.CoreReady(at_ns, life, notice.epoch, proof))
        elif notice.epoch is not None:
            self._feed(seen.EpochRaised(at_ns, life, notice.epoch))
        if notice.verified_seq is not None or notice.unsound is not None:
            self._feed(seen.LedgerAudited(at_ns, life, notice.verified_seq, notice.unsound or ""))
