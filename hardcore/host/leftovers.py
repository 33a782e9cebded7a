"""What an earlier guard left behind: its processes, the last page, half-written files.

A process is found by its environment, which names our run folder: a core that was started the moment before its guard
died may not have written its page yet, but it can't lose its environment. Not chosen: the numbers of processes that
the guard before wrote down. They are given again, and what was not written is not found.

One core may be gone on with: it serves, by its own page, under the highest epoch that any page shows, and nobody had
begun to end it. Everything in the middle of something (a spare, a core that drains, one that was stopped for its
evidence, one behind the fence) is ended instead: to finish another's half-done step one would have to know what the
other knew.
"""

import json
import os
import re
import select
import signal
import socket
import time
from contextlib import suppress
from pathlib import Path

import msgspec

from hardcore.host import clock, files, processes
from hardcore.host.folders import Folders
from hardcore.host.lives import KILL_S, Life, clean_environment
from hardcore.host.processes import Handle, Identity
from hardcore.host.recorder import PageReader
from hardcore.host.steps import condemned
from hardcore.model.recorder import LifeState, Page
from hardcore.model.verdicts import Diagnosis

ENVIRONMENT_BYTES_MAX = 1 << 20
#: A core that serves answers at once; what does not is no reason to end it, the watch will see to it.
ASKED_S = 0.3
ANSWER_BYTES_MAX = 4096
#: The line in a page's ring of events that a core writes when it begins to serve.
SERVES = "READY"
#: By which variable of its environment, that names our run folder, each other process of ours is known.
_GATEWAY = "HARDCORE_GATEWAY"
_COURT = "HARDCORE_COURT"
_INVESTIGATOR = "HARDCORE_INVESTIGATOR"


class Leftovers(msgspec.Struct, frozen=True):
    """What an earlier guard left behind: cores to be ended, its gateways, the page of its last core.

    `adoptable` is the core to go on with, which is not among the others, and `adoptable_page` its page as it was read.
    """

    cores: tuple[Life, ...]
    gateways: tuple[Handle, ...]
    last_page: Page | None
    adoptable: Life | None = None
    adoptable_page: Page | None = None
    courts: tuple[Handle, ...] = ()  # nobody hears them any more: they are to be ended
    investigators: tuple[Handle, ...] = ()

    @property
    def serves_since_ns(self) -> int | None:
        """When that core said that it begins to serve; None: its page does not say so any more."""
        events = () if self.adoptable_page is None else self.adoptable_page.events
        return max((event.at_ns for event in events if event.code == SERVES), default=None)


class _Found(msgspec.Struct, frozen=True):
    """A core that was found, and whether it was started to read only."""

    life: Life
    reader: bool


def find_leftovers(folders: Folders, *, adopt: bool = False, reads_only: bool = False) -> Leftovers:
    """Look for processes of an earlier guard of this instance, and for the last recorder page.

    `adopt`: say which of the cores may be gone on with, if one may. It may take a moment: that core is asked.
    `reads_only`: a person wants reads only, so a core that obeys that is as good as one that writes.
    """
    found, others = _processes(folders)
    pages = _pages(folders)
    last = max(pages, key=_head_of, default=None)
    last = last if last is not None and last.witness is not None else None
    chosen = _adoptable(folders, found, pages, reads_only=reads_only) if adopt else None
    life, page = chosen if chosen is not None else (None, None)
    cores = tuple(core.life for core in found if core.life is not life)
    return Leftovers(
        cores,
        tuple(others[_GATEWAY]),
        last,
        life,
        page,
        tuple(others[_COURT]),
        tuple(others[_INVESTIGATOR]),
    )


def _processes(folders: Folders) -> tuple[list[_Found], dict[str, list[Handle]]]:
    """Return the cores whose environment names our run folder, and the others by what they are."""
    cores: list[_Found] = []
    others: dict[str, list[Handle]] = {name: [] for name in (_GATEWAY, _COURT, _INVESTIGATOR)}
    # By its name alone: the folder above it may be another one now than where they were started.
    run = re.escape(folders.run.name)
    core_mark = re.compile(rf"HARDCORE_RECORDER=(.*/{run}/recorder-([0-9a-f]+))", re.DOTALL)
    other_mark = re.compile(rf"({'|'.join(others)})=.*/{run}", re.DOTALL)
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        found = read_environment(int(entry.name))
        core = next(filter(None, map(core_mark.fullmatch, found)), None)
        mark = core or next(filter(None, map(other_mark.fullmatch, found)), None)
        handle = _hold(int(entry.name), mark[0]) if mark else None
        if handle is None:
            continue
        if core is None:
            assert mark is not None, "it is held by its mark"
            others[mark[1]].append(handle)
        else:
            life = Life(0, core[2], folders, PageReader(Path(core[1]), core[2]), handle)
            cores.append(_Found(life, any(name.startswith("HARDCORE_SAFE=") for name in found)))
    return cores, others


def _adoptable(
    folders: Folders, cores: list[_Found], pages: list[Page], *, reads_only: bool
) -> tuple[Life, Page] | None:
    """Return the core that serves and may go on, with its page; None if there is none."""
    highest = max((page.beats.epoch for page in pages), default=0)
    given_up = condemned(folders)
    well = {None, str(Diagnosis.OPERATOR)} if reads_only else {None}
    for core in cores:
        life, page = core.life, core.life.page()
        if core.reader or page is None or life.nonce in given_up or not _is_its_own(life, page):
            continue
        serves = page.beats.state is LifeState.READY and 0 < page.beats.epoch == highest
        if serves and _reachable(folders, life) and _reads_because(folders, life) in well:
            return life, page
    return None


def _is_its_own(life: Life, page: Page) -> bool:
    assert life.handle is not None, "it was found as a process"
    who = life.handle.identity
    return (page.pid, page.start) == (who.pid, who.start) and page.boot_id == clock.boot_id()


def _reachable(folders: Folders, life: Life) -> bool:
    """Whether what leads to it is where we would look: its folder may have been removed and made anew."""
    paths = (folders.recorder(life.nonce), folders.core_socket(life.nonce), folders.core_control(life.nonce))
    return all(path.exists() for path in paths)


def _reads_because(folders: Folders, life: Life) -> str | None:
    """Return why the core says that it only reads; None: it writes.

    One that does not answer in time counts as that: it is asked again by each health probe.
    """
    try:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(ASKED_S)
            connection.connect(str(folders.core_control(life.nonce)))
            connection.sendall(b'{"verb": "status"}\n')
            told = json.loads(connection.recv(ANSWER_BYTES_MAX))
    except (OSError, ValueError, RecursionError):
        return None
    why = told.get("safe") if isinstance(told, dict) else None
    return None if why is None else str(why)


def end_leftovers(folders: Folders, grace_s: float) -> int:
    """End what a guard that is gone has left behind, asked first, killed after `grace_s`; return how many.

    The caller holds the sentinel's lock: nobody else may be adopting them meanwhile.
    """
    found = find_leftovers(folders)
    left = [life.handle for life in found.cores if life.handle is not None]
    left += [*found.gateways, *found.courts, *found.investigators]
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


def read_environment(pid: int) -> list[str]:
    """Return the environment that a process was started with, `NAME=value` each; empty if nobody may know it."""
    try:
        with Path(f"/proc/{pid}/environ").open("rb") as file:
            return os.fsdecode(file.read(ENVIRONMENT_BYTES_MAX)).split("\0")
    except OSError:
        return []


def read_command_line(pid: int) -> list[str]:
    """Return the words that a process was started with; empty if it is gone."""
    try:
        return os.fsdecode(Path(f"/proc/{pid}/cmdline").read_bytes()).split("\0")[:-1]
    except OSError:
        return []


def _hold(pid: int, mark: str) -> Handle | None:
    """Return a handle on the process if it still is the one whose environment was read."""
    start = processes.start_of(pid)
    handle = processes.find(Identity(pid, start)) if start is not None else None
    if handle is not None and mark not in read_environment(pid):
        handle.close()
        return None
    return handle


def _pages(folders: Folders) -> list[Page]:
    """Return the pages of this boot whose word still counts."""
    found = []
    overruled = files.read_json(_overruled(folders)).get("pages")
    for path in folders.run.glob("recorder-*"):
        if path.suffix or (isinstance(overruled, list) and path.name in overruled):
            continue
        reader = PageReader(path)
        page = reader.read()
        reader.close()
        if isinstance(page, Page) and page.boot_id == clock.boot_id():
            found.append(page)
    return found


def _head_of(page: Page) -> int:
    return -1 if page.witness is None else page.witness.seq


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
    return {**clean_environment(), _GATEWAY: str(folders.run)}


def environment_of_court(folders: Folders) -> dict[str, str]:
    """Return the environment by which a later guard recognises a court of ours, and what that has started."""
    return {**clean_environment(), _COURT: str(folders.run)}


def environment_of_investigator(folders: Folders) -> dict[str, str]:
    """Return the environment by which a later guard recognises our investigators."""
    return {**clean_environment(), _INVESTIGATOR: str(folders.run)}
