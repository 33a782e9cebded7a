"""The step that a guard is at, in `run/switch`: written before each deed, for whoever goes on after its death.

What stands there is a hint but for two things. `condemned` are the lives that this guard has begun to stop, to drain
or to end: a successor must not go on with one of those, however well it looks; where the file takes no more, each is
named by an empty file of its own, for which a full tmpfs still has room. `incident` is what is known of the one that is
open: a guard that dies in the middle has often not written it anywhere else. The file lies on tmpfs and is written on
the spot where a deed is urgent: handing it to a thread took longer than writing it.
"""

import json
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from hardcore.host import files
from hardcore.host.folders import Folders

#: The ending of the empty file that condemns a life, beside its page.
BRAND = ".condemned"
#: Nonces of lives that were given up on: more than there can be of them, so that a damaged file costs nothing.
CONDEMNED_MAX = 64


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

    def mark(self, step: str | None, **particulars: object) -> None:
        """Ask whether the next deed is still ours, and write down which it is; None: it is no step of the core's."""
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
            self._brand()

    def _brand(self) -> None:
        """Name those who are given up on by empty files: that needs no room but for a name."""
        try:
            for nonce in self._condemned:
                _brand_of(self._folders, nonce).touch(mode=0o600)
        except OSError as error:
            self._failed("condemned", error)

    def tell(self, incident: Mapping[str, object] | None) -> None:
        """Let the incident that is open stand there from the next step on that is written; None: none is."""
        with self._lock:
            self._told["incident"] = incident

    def forget(self, incident: str) -> None:
        """This incident has been written down as a whole."""
        with self._lock:
            known = self._told.get("incident")
            if isinstance(known, Mapping) and known.get("id") == incident:
                self._told["incident"] = None

    def condemn(self, *nonces: str) -> None:
        """Let no successor go on with these lives, from the next step on that is written."""
        with self._lock:
            self._condemned = tuple(dict.fromkeys((*self._condemned, *nonces)))

    def absolve(self, nonce: str) -> None:
        """This life is over, or goes on after all."""
        with self._lock:
            self._condemned = tuple(each for each in self._condemned if each != nonce)
        with suppress(OSError):  # it would be swept with the life's other files
            _brand_of(self._folders, nonce).unlink(missing_ok=True)


def _brand_of(folders: Folders, nonce: str) -> Path:
    page = folders.recorder(nonce)
    return page.with_name(f"{page.name}{BRAND}")


def condemned(folders: Folders) -> frozenset[str]:
    """Return the nonces of the lives that the earlier guard had begun to stop, to drain or to end."""
    told = files.read_json(folders.switch).get("condemned")
    named = [str(nonce) for nonce in told[:CONDEMNED_MAX]] if isinstance(told, list) else []
    pages = folders.run.glob(f"recorder-*{BRAND}")
    return frozenset((*named, *(page.stem.removeprefix("recorder-") for page in pages)))


def incident_left(folders: Folders) -> dict[str, object]:
    """Return what the earlier guard knew of the incident that was open when it ended; empty if none was.

    `released_at`: when it had requests go to a core again, if it still did; a wall time.
    """
    told = files.read_json(folders.switch)
    known = told.get("incident")
    if not isinstance(known, dict):
        return {}
    released = told.get("step") == "released" and told.get("incident_released") == known.get("id")
    return {**known, "released_at": told.get("released_at") if released else None}
