"""How long each kind of evidence must have lasted before the judge acts on it: numbers of the policy, as one value."""

import msgspec


class Patience(msgspec.Struct, frozen=True):
    """How long each kind of silence is borne, as the policy says.

    `late_ms`: a beat older than this is late. `conclusive_ms`: a hang that can't end by itself is acted on after
    this; `hang_ms`: any other. `gc_grace_ms`: processor time that a collection of memory may take.
    `transaction_ms`: how long a command may be decided whose page names no limit of its own; 0: for ever.
    `memory_bytes`: resident memory above this is worth saying; 0: never. `disk_floor_bytes`: less free space is a
    full disk. `disk_slow_ms`: a small write of ours that takes longer means that the disk stands still. `survey_ms`:
    the time between two surveys.
    """

    interval_ms: int
    late_ms: int
    conclusive_ms: int
    hang_ms: int
    gc_grace_ms: int = 5_000
    transaction_ms: int = 0
    memory_bytes: int = 0
    disk_floor_bytes: int = 16 << 20
    disk_slow_ms: int = 2_000
    survey_ms: int = 1_000
