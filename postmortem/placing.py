"""How a file gets into its place: whole or not at all, synced, by one writer at a time.

What every writer of the black box does with the disk and nothing of what it writes. Errors of the system are
raised here, as the one below knows how to, and become values at the box's own face (`bundle`).
"""

import errno
import fcntl
import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

#: How long a writer waits for another one of the same bundle.
LOCK_WAIT_MS = 2_000
_DRAFT = re.compile(r"\..+\.[0-9]+\.partial")


def empty(folder: Path) -> None:
    """Remove everything in a folder. Raises OSError."""
    for item in list(os.scandir(folder)):
        if item.is_dir(follow_symlinks=False):
            shutil.rmtree(item.path)
        else:
            Path(item.path).unlink()


def read_up_to(handle: int, bytes_max: int) -> bytes:
    """Return what a descriptor gives, up to `bytes_max` bytes. Raises OSError."""
    parts, left_bytes = [], bytes_max
    while left_bytes and (part := os.read(handle, left_bytes)):
        parts.append(part)
        left_bytes -= len(part)
    return b"".join(parts)


def replace(folder: Path, name: str, data: bytes) -> None:
    """Put a file in its place as a whole: a reader sees the old one or the new one. Raises OSError."""
    replace_all(folder, {name: data})


def replace_all(folder: Path, files: Mapping[str, bytes]) -> None:
    """Put several files in their places, each as a whole: all are written before the first of them is synced.

    In this order, because the first sync carries the others' bytes along: ten files cost little more than one.
    Each gets its name as soon as it is synced; after an error no half file is left. Raises OSError.
    """
    waiting: dict[Path, tuple[str, BinaryIO]] = {}
    with ExitStack() as handles:
        try:
            for name, data in files.items():
                temporary = folder / f".{name}.{os.getpid()}.partial"
                file = handles.enter_context(_open(temporary))
                waiting[temporary] = (name, file)
                _write(file, data)
            for temporary, (name, file) in list(waiting.items()):
                os.fsync(file.fileno())
                temporary.rename(folder / name)
                del waiting[temporary]
        finally:
            for temporary in waiting:
                temporary.unlink(missing_ok=True)


def remove_drafts(folder: Path) -> None:
    """Remove the drafts of writers that died, for whoever holds the bundle alone: no other draft can be there.

    A draft that can't be removed stays, and is told as a stranger among the files. Raises OSError.
    """
    for item in list(os.scandir(folder)):
        if _DRAFT.fullmatch(item.name):
            with suppress(OSError):
                Path(item.path).unlink()


def _open(path: Path) -> BinaryIO:
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    return os.fdopen(handle, "wb", buffering=0)


def _write(file: BinaryIO, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[file.write(view) :]


@contextmanager
def writing(path: Path, wait_ms: int = LOCK_WAIT_MS) -> Iterator[Callable[[], bool]]:
    """Hold the bundle alone: the guard adds evidence while the report of the same incident is made.

    What is given tells whether the folder that is held is still the one at `path`. Raises OSError: EBUSY when
    another writer had it for all of `wait_ms`.
    """
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)

    def held() -> bool:
        try:
            return os.path.samestat(os.fstat(handle), path.lstat())
        except OSError:
            return False

    try:
        deadline_ns = time.monotonic_ns() + wait_ms * 1_000_000
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic_ns() > deadline_ns:
                    raise OSError(errno.EBUSY, "another writer holds it") from None
                time.sleep(0.005)
        yield held
    finally:
        os.close(handle)


def sync_folder(path: Path) -> None:
    """Have the folder's own entries on the disk. Raises OSError."""
    handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def digest(data: bytes) -> str:
    """Return the SHA-256 of some bytes, in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def now() -> str:
    """Return the wall clock's time in RFC 3339."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def words(error: OSError | ValueError) -> str:
    """Say an error in the system's own words, without the path: a bundle may be shown to others."""
    return (error.strerror if isinstance(error, OSError) else None) or "unusable name"


def why(error: OSError, what: str) -> str:
    """Return a sentence on what failed and why, from the system's own words."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return f"{what}: no room on the disk ({words(error)})"
    return f"{what}: {words(error)}"
