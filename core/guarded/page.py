"""Where everything stands on a recorder page: offsets, sizes and texts, as numbers and pure functions.

This is `docs/wires.md` section 3 from the core's side. The guard has its own numbers for the same page,
on purpose: a shared module would let one wrong offset be wrong on both sides and still pass every test.
"""

from collections.abc import Iterable

MAGIC = b"HCREC001"
VERSION = 2
FILE_BYTES = 368_640

SLOTS = 256
SLOT_BYTES = 1024
SLOTS_AT = 4096
TEXTS_AT = 128  # inside a slot and inside a finished entry
FINISHED = 64
FINISHED_BYTES = 512
FINISHED_AT = 266_240
EVENTS = 512
EVENT_BYTES = 128
EVENTS_AT = 299_008
CENSUSES = 2
CENSUS_BYTES = 2048
CENSUS_AT = 364_544
CENSUS_TYPES = 20
CENSUS_TYPE_BYTES = 64
COMPONENTS = 8
COMPONENT_BYTES = 64
COMPONENTS_AT = 1792

# Header: what the maker wrote, and what this process adds.
VERSION_AT = 8
PID_AT = 128
START_AT = 136
LOOP_THREAD_AT = 144
WRITER_THREAD_AT = 152
BEAT_THREAD_AT = 160
OWNED_AT = 168

# Beats: each word stands alone.
LOOP_NS_AT = 256
LOOP_COUNT_AT = 264
THREAD_NS_AT = 272
THREAD_COUNT_AT = 280
SUBMITTED_AT = 288
COMPLETED_AT = 296
COMPLETED_NS_AT = 304
IN_STORE_AT = 312
IN_GC_AT = 320
EPOCH_AT = 328
STATE_AT = 336
ANSWERED_AT = 352
LOG_WARNINGS_AT = 360
LOG_ERRORS_AT = 368
LOOP_LAG_AT = 376

WITNESS_AT = 512
WITNESS_BYTES = 128
HASH_BYTES = 32

WORDS_AT = 768
WORDS_BYTES = 1024

CODE_BYTES_MAX = 40
WORDS_TEXT_BYTES_MAX = 960
EVENT_CODE_BYTES_MAX = 32
EVENT_TEXT_BYTES_MAX = 64
ID_BYTES_MAX = 40
KIND_BYTES_MAX = 32
ACCOUNTS_BYTES_MAX = 240
PAYLOAD_BYTES_MAX = 512
COMPONENT_NAME_BYTES_MAX = 24
TYPE_NAME_BYTES_MAX = 48


def cut(text: str, bytes_max: int) -> bytes:
    """Return `text` as UTF-8 of at most `bytes_max` bytes, cut between characters, never inside one."""
    raw = text.encode("utf-8", "replace")
    if len(raw) <= bytes_max:
        return raw
    return raw[:bytes_max].decode("utf-8", "ignore").encode()


def join_ids(ids: Iterable[str], bytes_max: int = ACCOUNTS_BYTES_MAX) -> bytes:
    """Return as many whole ids as fit into `bytes_max` bytes, joined by a space.

    Half an account's name could be another account's whole name, so the list is cut between ids; only an
    id that would not fit even alone is cut inside.
    """
    joined = " ".join(ids).encode("utf-8", "replace")
    if len(joined) <= bytes_max:
        return joined
    joined = b""
    for name in ids:
        longer = joined + b" " + name.encode("utf-8", "replace") if joined else cut(name, bytes_max)
        if len(longer) > bytes_max:
            break
        joined = longer
    return joined
