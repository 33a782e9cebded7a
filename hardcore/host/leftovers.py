"""What an earlier guard left behind: its processes, the last page, half-written files.

A process is found by its environment, which names our run folder: a core that was started the moment before its guard
died may not have written its page yet, but it can't lose its environment. Not chosen: the numbers of processes that
the guard before wrote down. They are given again, and what was not written is not found.
"""

import os
import re
import select
import signal
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from hardcore.host import clock, files, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import KILL_S, Life, clean_environment
from hardcore.host.processes import Handle, Identity
from hardcore.host.recorder import PageReader
from hardcore.model.recorder import Page

ENVIRONMENT_BYTES_MAX = 1 << 20


@dataclass(frozen=True, slots=True)
class Leftovers:
    """What an earlier guard left behind: its cores, its gateways, and the page of its last core."""

    cores: tuple[Life, ...]
    gateways: tuple[Handle, ...]
    last_page: Page | None


def find_leftovers(folders: Folders) -> Leftovers:
    """Look for processes of an earlier guard of this instance, and for the last recorder page."""
    cores, gateways = [], []
    # By its name alone: the folder above it may be another one now than where they were started.
    run = re.escape(folders.run.name)
    core_mark = re.compile(rf"HARDCORE_RECORDER=(.*/{run}/recorder-([0-9a-f]+))", re.DOTALL)
    gateway_mark = re.compile(rf"HARDCORE_GATEWAY=.*/{run}", re.DOTALL)
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        found = _read_environment(int(entry.name))
        core = next(filter(None, map(core_mark.fullmatch, found)), None)
        mark = core or next(filter(None, map(gateway_mark.fullmatch, found)), None)
        handle = _hold(int(entry.name), mark[0]) if mark else None
        if handle is None:
            continue
        if core is None:
            gateways.append(handle)
        else:
            nonce = core[2]
            reader = PageReader(Path(core[1]), nonce)
            cores.append(Life(0, nonce, folders, reader, handle))
    return Leftovers(tuple(cores), tuple(gateways), _last_page(folders))


def end_leftovers(folders: Folders, grace_s: float) -> int:
    """End what a guard that is gone has left behind, asked first, killed after `grace_s`; return how many.

    The caller holds the sentinel's lock: nobody else may be adopting them meanwhile.
    """
    found = find_leftovers(folders)
    left = [*(life.handle for life in found.cores if life.handle is not None), *found.gateways]
    for handle in left:
        handle.signal(signal.SIGTERM)
        handle.signal(signal.SIGCONT)  # a stopped one could not obey
    give_up_at = time.monotonic() + grace_s
    for handle in left:
        if not _ends(handle, max(0.0, give_up_at - time.monotonic())):
            handle.kill_tree()
            _ends(handle, KILL_S)
        handle.close()
    return len(left)


def _ends(handle: Handle, within_s: float) -> bool:
    return bool(select.select([handle.pidfd], [], [], within_s)[0])


def _read_environment(pid: int) -> list[str]:
    try:
        with Path(f"/proc/{pid}/environ").open("rb") as file:
            return os.fsdecode(file.read(ENVIRONMENT_BYTES_MAX)).split("\0")
    except OSError:
        return []


def _hold(pid: int, mark: str) -> Handle | None:
    """Return a handle on the process if it still is the one whose environment was read."""
    start = processes.start_of(pid)
    handle = processes.find(Identity(pid, start)) if start is not None else None
    if handle is not None and mark not in _read_environment(pid):
        handle.close()
        return None
    return handle


def _last_page(folders: Folders) -> Page | None:
    """Return the page with the highest commit among those of this boot whose word still counts."""
    best: Page | None = None
    overruled = files.read_json(_overruled(folders)).get("pages")
    for path in folders.run.glob("recorder-*"):
        if path.suffix or (isinstance(overruled, list) and path.name in overruled):
            continue
        reader = PageReader(path)
        page = reader.read()
        reader.close()
        if not isinstance(page, Page) or page.boot_id != clock.boot_id() or page.witness is None:
            continue
        if best is None or best.witness is None or page.witness.seq > best.witness.seq:
            best = page
    return best


def overrule_pages(folders: Folders) -> None:
    """Let no page that is there now count as a witness: the operator has said that the ledger is right.

    They stay where they are, because the evidence of the last death may still be read from them.
    """
    names = [path.name for path in folders.run.glob("recorder-*")]
    with suppress(OSError):  # this guard obeys all the same; only its successor would ask again
        files.write_json(_overruled(folders), {"pages": names}, durable=False)


def _overruled(folders: Folders) -> Path:
    return folders.run / "overruled.json"


def forget_pages(folders: Folders) -> None:
    """Remove every recorder page: what they witnessed is another ledger's."""
    for path in folders.run.glob("recorder-*"):
        path.unlink(missing_ok=True)


def sweep_drafts(folders: Folders) -> None:
    """Remove what writers that died in the middle have left beside the small files: their number names them."""
    for folder in (folders.data, folders.state, folders.run):
        for path in folder.glob(".*.tmp"):
            writer = path.name.removesuffix(".tmp").rpartition(".")[2]
            if writer.isdigit() and not Path(f"/proc/{writer}").exists():
                with suppress(OSError):
                    path.unlink()


def environment_of_gateway(folders: Folders) -> dict[str, str]:
    """Return the environment by which a later guard recognises our gateway."""
    return {**clean_environment(), "HARDCORE_GATEWAY": str(folders.run)}
