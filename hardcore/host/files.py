"""Small files that survive a death in the middle of writing them: temp, fsync, rename, fsync the folder."""

import errno
import fcntl
import json
import os
import stat
import threading
from pathlib import Path

SMALL_FILE_BYTES_MAX = 1 << 20


def write_whole(path: Path, data: bytes, *, durable: bool = True) -> None:
    """Put `data` at `path`, wholly or not at all. Not `durable` on tmpfs, where nothing outlives a boot.

    Raises OSError as the file system gives it.
    """
    # Threads are numbered like processes, over the whole machine: no two writers share a draft.
    temp = path.with_name(f".{path.name}.{threading.get_native_id()}.tmp")
    fd = os.open(temp, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
    try:
        with os.fdopen(fd, "wb") as file:
            file.write(data)
            file.flush()
            if durable:
                os.fsync(file.fileno())
        temp.replace(path)
    except OSError:
        temp.unlink(missing_ok=True)
        raise
    if durable:
        sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Make a rename in `folder` durable."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_json(path: Path, value: object, *, durable: bool = True) -> None:
    """Put `value` at `path` as JSON, wholly or not at all. Half a character from outside becomes a `?`."""
    text = json.dumps(value, ensure_ascii=False, indent=1)
    write_whole(path, text.encode("utf-8", "replace") + b"\n", durable=durable)


def read_json(path: Path, bytes_max: int = SMALL_FILE_BYTES_MAX) -> dict[str, object]:
    """Return the JSON object at `path`; empty when there is none, or none that can be read."""
    try:
        value = json.loads(read_small(path, bytes_max))
    except (OSError, ValueError, RecursionError):
        return {}
    return value if isinstance(value, dict) else {}


def read_small(path: Path, bytes_max: int = SMALL_FILE_BYTES_MAX) -> bytes:
    """Return the first `bytes_max` bytes of a file. Raises OSError, also for what is no file.

    Somebody may have put a pipe there: opening that would wait for a writer for ever, and nobody would watch.
    """
    fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(fd, "rb") as file:
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            raise OSError(errno.EINVAL, "is no file", str(path))
        return file.read(bytes_max)


def take_lock(path: Path) -> int | None:
    """Return a descriptor that holds `path` exclusively until it is closed, or None if somebody else does.

    The file is never unlinked, and its inode is compared after locking: two owners were seen when a lock
    file was removed and made anew between one's open and lock.
    On a disk that takes no write the file is locked as it lies there. Raises OSError where there is none.
    """
    try:
        fd = _open_to_lock(path)
    except OSError as error:
        if error.errno != errno.EROFS or not path.exists():
            raise
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.fstat(fd).st_ino == path.stat().st_ino:
            return fd
    except (BlockingIOError, FileNotFoundError):
        pass
    os.close(fd)
    return None


def _open_to_lock(path: Path) -> int:
    """Open it, and make it only where there is none: to ask for that waits for a disk that hangs."""
    try:
        return os.open(path, os.O_RDWR | os.O_CLOEXEC)
    except FileNotFoundError:
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)


def still_locked(fd: int, path: Path) -> bool:
    """Return whether the lock held by `fd` still is the one that others find at `path`."""
    try:
        return os.path.samestat(os.fstat(fd), path.stat())
    except OSError:
        return False
