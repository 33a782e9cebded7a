"""What this process may do because of whom it runs as, asked of the kernel.

A guard on the same machine asks alike in its own half, so that the two never disagree about a disk. Not chosen: the
user's number alone, because in a container it says 0 of somebody whom the file systems know under another number.
"""

import os
from pathlib import Path


def has_reserve() -> bool:
    """Whether this process may write where room is kept back for the superuser.

    The root of a container with users of its own is another one, and none such room is his.
    """
    try:
        mapped = Path("/proc/self/uid_map").read_text().split()
    except OSError:
        return False
    return os.geteuid() == 0 and mapped[:2] == ["0", "0"]
