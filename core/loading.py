"""Loading a spare: all of its code and all that code loads at its first use, at low priority.

A spare is started just when the core that was promoted has the most to do, and there may be two processors for all
of us. On Linux a priority belongs to a thread: one thread loads, the main thread waits for it and keeps its own
priority, so that no privilege is needed to come back to it. Not chosen: to lower the whole process, which would be
promoted with a priority that only a superuser can raise again.
"""

import importlib
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Final

NICE: Final = 10


def be_nice() -> None:
    """Lower the priority of the calling thread, and of the threads it starts, for the rest of their lives."""
    os.setpriority(os.PRIO_PROCESS, 0, NICE)


def load_quietly() -> None:
    """Load everything and return when it is there. Raises what an import raises."""
    with ThreadPoolExecutor(1, "loading", initializer=be_nice) as thread:
        thread.submit(_load).result()


def _load() -> None:
    # By name, because importing this room must not load them. The code is named before it is loaded: if it changes
    # meanwhile, the name is that of code which nobody runs any more, and this spare is not promoted.
    importlib.import_module("core.build").own_build()
    importlib.import_module("core.main")
    importlib.import_module("core.page_socket")
    importlib.import_module("core.web.rehearsal").load()
