"""The step that a guard is at, in `run/switch`: written before each deed, for whoever goes on after its death.

What stands there is a hint but for one thing: `condemned`, the lives that this guard has begun to stop, to drain or
to end. A successor must not go on with one of those, however well it looks. The file lies on tmpfs and is written on
the spot where a deed is urgent: handing it to a thread took longer than writing it.
"""

import json
import threading
from collections.abc import Callable

from hardcore.host import files
from hardcore.host.folders import Folders


class Steps:
    """Writes down where we are. `still_ours` ends the process if another guard may act; `failed` takes what went wrong."""

    def __init__(
        self,
        folders: Folders,
        generation: int,
        still_ours: Callable[[], None],
        failed: Callable[[str | None, BaseException], None],
    ) -> None:
        self._folders = folders
        self._still_ours = still_ours
        self._failed = failed
        self._lock = threading.Lock()
        self._told: dict[str, object] = {"generation": generation, "step": "begin"}
        self._condemned: tuple[str, ...] = ()

    def mark(self, step: str, **particulars: object) -> None:
        """Ask whether the next deed is still ours, and write down which it is."""
        self._still_ours()
        self.hint(step, **particulars)

    def hint(self, step: str | None, **particulars: object) -> None:
        """Write down where we are, for whoever looks; without a step, the one before stays.

        No deed depends on it: a hint that can't be written is told, and the deed is done.
        """
        try:
            with self._lock:
                self._told |= particulars if step is None else {"step": step, **particulars}
                told = {**self._told, "condemned": list(self._condemned)}
                text = json.dumps(told, ensure_ascii=False).encode() + b"\n"
                files.write_whole(self._folders.switch, text, durable=False)
        except Exception as error:  # noqa: BLE001  # whatever it is: a process may just have been made
            self._failed(step, error)

    def condemn(self, *nonces: str) -> None:
        """Let no successor go on with these lives, from the next step on that is written."""
        with self._lock:
            self._condemned = tuple(dict.fromkeys((*self._condemned, *nonces)))

    def absolve(self, nonce: str) -> None:
        """This life is over, or goes on after all."""
        with self._lock:
            self._condemned = tuple(each for each in self._condemned if each != nonce)
