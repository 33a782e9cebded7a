"""What a guard tells its core at birth: the environment variables of `docs/wires.md` section 1, as a value.

Everything is read once, judged together and frozen; nothing else in the core looks into the environment.
Each variable is optional by itself, because a program that is guarded by somebody else's service manager
has only some of them, and a core run by hand has none. Not chosen: defaults for missing paths; a core
that guesses its own socket would be one that nobody asked for.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import msgspec

#: The kernel's limit for a Unix socket's path, without the closing zero.
SOCKET_PATH_BYTES_MAX = 107
#: A day: a limit of more is none.
LIMIT_MS_MAX = 86_400_000
#: Who can have seen a commit: the last core's page, its guard, the gateway, and one to spare.
WITNESSES_MAX = 4
#: No process has a descriptor beyond this: the kernel's largest `fs.nr_open`.
FDS_MAX = 1 << 31
#: What is asked of checkpoints beyond these is no wish any more.
DAY_S = 86_400
YEAR_H = 8_784
CHECKPOINTS_KEPT_MAX = 1_000
_NUMBER_MAX = 2**63 - 1
_WITNESS = re.compile(r"([0-9]{1,19}):([0-9]{1,19}):([0-9a-f]{64})")
_NUMBER = re.compile(r"[0-9]{1,19}")
_DIAGNOSIS = re.compile(r"[A-Z_]{1,40}")


class LastSeen(msgspec.Struct, frozen=True):
    """The last commit of the predecessor that somebody saw. `hash`: 32 bytes."""

    seq: int
    epoch: int
    hash: bytes

    @classmethod
    def read(cls, text: str) -> "LastSeen | None":
        """Return what `sequence:epoch:hash` says; None: it says nothing that can be understood."""
        parts = _WITNESS.fullmatch(text)
        if parts is None or max(int(parts[1]), int(parts[2])) > _NUMBER_MAX:
            return None
        return cls(int(parts[1]), int(parts[2]), bytes.fromhex(parts[3]))


class GuardedEnvironment(msgspec.Struct, frozen=True):
    """What the guard said. None: it said nothing about that."""

    data: Path | None = None
    socket: Path | None = None
    recorder: Path | None = None
    control: Path | None = None
    expected_epoch: int | None = None
    witnesses: tuple[LastSeen, ...] = ()
    #: The diagnosis because of which this core may only read.
    safe: str | None = None
    #: It loads everything and waits to be promoted.
    spare: bool = False
    #: How long a command may be DECIDING; a kind of command may have a multiple of it.
    limit_ms: int | None = None
    memory_bytes: int | None = None
    #: The rules it makes for its core; beside them the drills it has armed, and a place for cases.
    quarantine: Path | None = None
    #: What the sentinel has left word of for its agents, and the gateway's listener, which is only kept for it.
    agents: Path | None = None
    listen_fd: int | None = None
    #: Checkpoints of the ledger: one in how many seconds (0: only when told to), how many are kept, for how long.
    checkpoint_s: int | None = None
    checkpoints_kept: int | None = None
    checkpoint_age_h: int | None = None
    #: Whether a start goes by one; else it proves the whole chain.
    recovers_state: bool = True
    notify_socket: str | None = None
    watchdog_usec: int | None = None

    @property
    def guarded(self) -> bool:
        """Whether somebody watches: a core that was given nothing runs alone."""
        return any((self.socket, self.recorder, self.control, self.notify_socket))

    @classmethod
    def read(cls, environ: Mapping[str, str], own_pid: int | None = None) -> "GuardedEnvironment | list[str]":
        """Return what `environ` says, or one sentence for each thing that is wrong with it.

        `own_pid`: a `WATCHDOG_PID` other than this means that the watchdog is meant for somebody else.
        """
        reading = _Reading(environ)
        found = cls(
            data=reading.path("HARDCORE_DATA"),
            socket=reading.socket("HARDCORE_SOCKET"),
            recorder=reading.path("HARDCORE_RECORDER"),
            control=reading.socket("HARDCORE_CONTROL"),
            expected_epoch=reading.number("HARDCORE_EPOCH"),
            witnesses=reading.witnesses("HARDCORE_WITNESS"),
            safe=reading.word("HARDCORE_SAFE"),
            spare=reading.spare("HARDCORE_SPARE"),
            limit_ms=reading.number("HARDCORE_LIMIT_MS", 1, LIMIT_MS_MAX),
            memory_bytes=reading.number("HARDCORE_MEMORY_BYTES", 1),
            quarantine=reading.path("HARDCORE_QUARANTINE"),
            agents=reading.path("HARDCORE_AGENTS"),
            listen_fd=reading.number("HARDCORE_LISTEN_FD", 3, FDS_MAX),
            checkpoint_s=reading.number("HARDCORE_CHECKPOINT_S", 0, DAY_S),
            checkpoints_kept=reading.number("HARDCORE_CHECKPOINTS_KEPT", 1, CHECKPOINTS_KEPT_MAX),
            checkpoint_age_h=reading.number("HARDCORE_CHECKPOINT_AGE_H", 1, YEAR_H),
            recovers_state=reading.number("HARDCORE_STATE_RECOVERY", 0, 1) != 0,
            notify_socket=reading.notify("NOTIFY_SOCKET"),
            watchdog_usec=reading.watchdog(own_pid),
        )
        return reading.faults or found


class _Reading:
    """One pass over the environment that collects every fault on its way."""

    def __init__(self, environ: Mapping[str, str]) -> None:
        self._environ = environ
        self.faults: list[str] = []

    def _text(self, name: str) -> str | None:
        return self._environ.get(name) or None

    def path(self, name: str) -> Path | None:
        text = self._text(name)
        if text is None:
            return None
        if not text.startswith("/"):
            self.faults.append(f"{name} must be an absolute path, not {text!r}.")
            return None
        return Path(text)

    def socket(self, name: str) -> Path | None:
        found = self.path(name)
        if found is not None and len(bytes(found)) > SOCKET_PATH_BYTES_MAX:
            self.faults.append(f"{name} is longer than the {SOCKET_PATH_BYTES_MAX} bytes of a socket's path.")
            return None
        return found

    def number(self, name: str, least: int = 0, most: int = _NUMBER_MAX) -> int | None:
        text = self._text(name)
        if text is None:
            return None
        if not _NUMBER.fullmatch(text) or not least <= int(text) <= most:
            self.faults.append(f"{name} must be a whole number from {least} to {most}, not {text!r}.")
            return None
        return int(text)

    def word(self, name: str) -> str | None:
        text = self._text(name)
        if text is None:
            return None
        if not _DIAGNOSIS.fullmatch(text):
            self.faults.append(f"{name} must be a diagnosis in capitals, not {text!r}.")
            return None
        return text

    def spare(self, name: str) -> bool:
        text = self._text(name)
        if text not in {None, "1"}:
            self.faults.append(f"{name} must be 1 or nothing, not {text!r}.")
        if text is not None and self._text("HARDCORE_CONTROL") is None:
            self.faults.append(f"{name} needs HARDCORE_CONTROL: a spare is promoted over its control socket.")
        if text is not None and self._text("HARDCORE_SAFE") is not None:
            self.faults.append(f"{name} and HARDCORE_SAFE exclude each other: a spare is there to write.")
        return text is not None

    def witnesses(self, name: str) -> tuple[LastSeen, ...]:
        text = self._text(name)
        if text is None:
            return ()
        found = [LastSeen.read(part) for part in text.split(",", WITNESSES_MAX)]
        seen = tuple(one for one in found if one is not None)
        if len(seen) < len(found) or len(seen) > WITNESSES_MAX:
            self.faults.append(
                f"{name} must be sequence:epoch:hash, up to {WITNESSES_MAX} with commas, not {text!r}."
            )
        return seen

    def notify(self, name: str) -> str | None:
        text = self._text(name)
        if text is None:
            return None
        if text[0] not in "/@" or len(text) < 2:
            self.faults.append(f"{name} must be an absolute path or an abstract name, not {text!r}.")
            return None
        if len(text.encode("utf-8", "surrogateescape")) > SOCKET_PATH_BYTES_MAX:
            self.faults.append(f"{name} is longer than the {SOCKET_PATH_BYTES_MAX} bytes of a socket's path.")
            return None
        return text

    def watchdog(self, own_pid: int | None) -> int | None:
        usec = self.number("WATCHDOG_USEC", 1)
        meant_for = self.number("WATCHDOG_PID")
        return None if own_pid is not None and meant_for not in {None, own_pid} else usec
