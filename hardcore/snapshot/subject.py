"""Who the evidence is about and what came of taking it: the values between the guard and the collectors.

Everything a collector may touch stands in the `Subject`, so that none of them looks anything up by itself;
in particular a process is only ever signalled through the `pidfd` given here, never through its number.
"""

from collections.abc import Mapping
from enum import Enum
from pathlib import Path

import msgspec

from hardcore.model.recorder import Page


class Subject(msgspec.Struct, frozen=True):
    """One life of the core and where its evidence goes. `pidfd` is not used once the core is dead."""

    pid: int
    pidfd: int
    nonce: str
    recorder: Path
    logs: tuple[Path, ...]
    incident: str
    incidents: Path
    data: Path
    control: Path | None = None  # the core's own control socket, to ask for its suspended tasks
    first_stacks: bytes = b""  # the suspicion's look at the stacks, in the form of `stacks.json`
    shelter: Path | None = None  # where it goes while the disk of the incidents takes none


class Tools(msgspec.Struct, frozen=True):
    """What is at hand on this host. `py_spy` None: not installed, the core's own traceback must do."""

    py_spy: Path | None
    gcore: Path | None = None


class Haul(msgspec.Struct):
    """What has been collected so far; filled on a thread, and readable from another at any moment.

    `missing` says why something can't be had, `pending` what nobody has come to, or to the end of,
    yet; `costs_us` what each piece took, in microseconds.
    """

    files: dict[str, bytes] = msgspec.field(default_factory=dict)
    missing: dict[str, str] = msgspec.field(default_factory=dict)
    pending: dict[str, str] = msgspec.field(default_factory=dict)
    costs_us: dict[str, int] = msgspec.field(default_factory=dict)
    steps: list[tuple[str, int]] = msgspec.field(default_factory=list)
    page: Page | None = None


class Evidence(msgspec.Struct, frozen=True):
    """The evidence of one life, on disk at `path`. `complete`: nothing of the recipe is missing.

    `steps` are (name, monotonic ns) of the timeline: `frozen` and `dumped` of a living core.
    """

    path: Path
    complete: bool
    missing: Mapping[str, str]
    page: Page | None
    steps: tuple[tuple[str, int], ...]
    duration_ms: int
    costs_us: Mapping[str, int] = msgspec.field(default_factory=dict)  # what each piece took


class Kept(Enum):
    """Where evidence is that its disk did not take."""

    NOWHERE = "lost"
    ELSEWHERE = "in the shelter"
    PERHAPS = "still on its way"


class EvidenceFailed(msgspec.Struct, frozen=True):
    """Nothing is on disk, or not yet; `reason` is one sentence. What was read is handed on all the same."""

    reason: str
    page: Page | None
    steps: tuple[tuple[str, int], ...]
    duration_ms: int
    kept: Kept = Kept.NOWHERE
