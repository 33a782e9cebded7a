"""Which code this process runs: one short name for all of it.

A spare runs what lay on the disk when it was started, and before it is promoted its guard has to know whether that
is what lies there now. So both say the same name by the same rule, each in a file of its own: a hash over the
interpreter, the names of what is installed beside us (a distribution's folder bears its version), and every file of
the three folders a core is made of. Not chosen: hashing the modules that are loaded, because templates, formats and
scripts are code as well; doing it at every start, because ten milliseconds are a tenth of what a start may take.
"""

import functools
import hashlib
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path
from typing import Final

FOLDERS: Final = ("core", "frontend", "templates")
DIGITS: Final = 16
ROOT: Final = Path(__file__).parent.parent


@functools.cache
def own_build() -> str:
    """Return the name (16 hex digits) of this code, as it lay on the disk when this was asked for the first time."""
    return build_of(ROOT)


def build_of(root: Path) -> str:
    """Return the name of the code below `root`, as it lies there now. Takes some milliseconds."""
    whole = hashlib.sha256(sys.version.encode())
    for name in _installed():
        whole.update(name.encode() + b"\0")
    for path in sorted(file for folder in FOLDERS for file in _files(root / folder)):
        try:
            content = path.read_bytes()
        except OSError:
            continue  # it is being replaced: what was read is another code's name all the same
        whole.update(f"{path.relative_to(root).as_posix()}\0{len(content)}\0".encode())
        whole.update(content)
    return whole.hexdigest()[:DIGITS]


def _files(folder: Path) -> Iterator[Path]:
    return (path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts)


def _installed() -> list[str]:
    places = {Path(sysconfig.get_path(kind)) for kind in ("purelib", "platlib")}
    return sorted({path.name for place in places for path in place.glob("*.dist-info")})
