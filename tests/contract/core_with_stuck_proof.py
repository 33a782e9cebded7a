"""A core whose proof of the whole book never comes back, as a read on a stalled disk does.

It stands before the command line of a core and becomes it: what follows `python -m core` is what that one would hear.
"""

import os
import sys

from core import auditor
from core.main import cli


def verify(*_: object) -> None:
    sys.stderr.write("The proof is stuck\n")
    sys.stderr.flush()
    reads, _writes = os.pipe()
    os.read(reads, 1)


if __name__ == "__main__":
    vars(auditor)["verify"] = verify
    cli(sys.argv[4:])
