"""Which code lies on the disk: one short name for all of it, so that an update is seen without anybody saying so.

It is a hash of the files that a process of ours would load if it began now, of the interpreter, and of the names of
what is installed beside them (a distribution's folder bears its version). The core says the same name of the code it
runs (`X_BUILD`), by the same rule in a file of its own. Not chosen: the version in `__init__`, which stays while
somebody mends a line; times of files, which a copy changes.
"""

import hashlib
import sys
import sysconfig
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: What a core loads, and what the guard and its gateway load. Both draw pages and speak from `frontend`.
CORE = ("core", "frontend", "templates")
GUARD = ("hardcore", "frontend", "templates")
DIGITS = 16


def build_id(root: Path = ROOT) -> str:
    """Return the name of the core's code as it lies on the disk now, 16 hex digits. Takes some milliseconds."""
    return _name_of(root, CORE)


def guard_build_id(root: Path = ROOT) -> str:
    """Return the name of the guard's and the gateway's code as it lies on the disk now."""
    return _name_of(root, GUARD)


def _name_of(root: Path, folders: Iterable[str]) -> str:
    digest = hashlib.sha256(sys.version.encode())
    for name in _installed():
        digest.update(name.encode() + b"\0")
    for path in sorted(file for folder in folders for file in _files(root / folder)):
        try:
            content = path.read_bytes()
        except OSError:
            continue  # it is being replaced at this moment: what was read is another code's name all the same
        where = path.relative_to(root).as_posix()
        digest.update(f"{where}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()[:DIGITS]


def _files(folder: Path) -> Iterable[Path]:
    return (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)


def _installed() -> list[str]:
    places = {Path(sysconfig.get_path(kind)) for kind in ("purelib", "platlib")}
    return sorted({path.name for place in places for path in place.glob("*.dist-info")})
