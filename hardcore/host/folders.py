"""Where everything lies: the data folder, and the short run folder on tmpfs that it links to.

Unix socket paths end at 107 bytes, so sockets can't lie under a data folder of any length: they live in a
private folder named after a hash of it. Where that folder is depends on the environment it was made in, so the
link in the data says it to everybody else. The link is made anew when the data was moved or copied, or when the
folder is gone. The locks that keep a second guard away lie in the data itself: there is only one of it.
"""

import errno
import hashlib
import os
import stat
from pathlib import Path

import msgspec

SOCKET_PATH_BYTES_MAX = 107
#: What a disk says that takes no writes at all, whatever room there is.
REFUSED = frozenset({errno.EROFS, errno.EIO})
_LONGEST_NAME = "core-0123456789abcdef.sock"


class Unusable(msgspec.Struct, frozen=True):
    """Why a folder can't be used, as one sentence with the next step."""

    reason: str


class Folders(msgspec.Struct, frozen=True):
    """The names of all files of one instance."""

    data: Path
    run: Path

    @property
    def store(self) -> Path:
        """Where the ledger lies, if that is a database server: an address, its owner's alone. The core knows this name too."""
        return self.data / "store"

    @property
    def policy(self) -> Path:
        """The policy in force."""
        return self.data / "failover_policy.json"

    @property
    def good_policy(self) -> Path:
        """The last policy that was read without a fault."""
        return self.state / "policy.json"

    @property
    def state(self) -> Path:
        """Small files about what is wanted and what is counted."""
        return self.data / "state"

    @property
    def generation(self) -> Path:
        """The last guard's number; there as soon as a guard has watched this data."""
        return self.state / "generation.json"

    @property
    def incidents(self) -> Path:
        """One folder for each incident."""
        return self.data / "incidents"

    @property
    def shelter(self) -> Path:
        """What the disk of the incidents did not take, until it does."""
        return self.run / "incidents"

    @property
    def logs(self) -> Path:
        """Bounded logs."""
        return self.data / "logs"

    def logs_of_others(self) -> tuple[Path, ...]:
        """The logs that processes of ours append to by themselves, there and where they go while the disk refuses."""
        names = ("core", "gateway", "postmortem", "drill", "alerts", "court")
        places = (self.logs, self.run)
        return (*(place / f"{name}.log" for place in places for name in names), self.run / "sentinel.out")

    @property
    def quarantine(self) -> Path:
        """What is set aside and which rules are in force; the guard alone writes it."""
        return self.state / "quarantine.json"

    @property
    def suspects(self) -> Path:
        """What the guard remembers of suspects and their trials."""
        return self.state / "suspects.json"

    @property
    def cases(self) -> Path:
        """The whole requests of suspects, one file each, as whoever held them has filed them."""
        return self.state / "cases"

    @property
    def armed(self) -> Path:
        """The drill whose request kills whoever executes it; absent: none."""
        return self.state / "drill.json"

    @property
    def calendar(self) -> Path:
        """Which drill was begun last on a schedule."""
        return self.state / "calendar.json"

    @property
    def spool(self) -> Path:
        """What the guard has to say to the investigators."""
        return self.data / "spool"

    @property
    def investigator(self) -> Path:
        """Where the investigators listen."""
        return self.run / "investigator.sock"

    @property
    def gateway(self) -> Path:
        """Where the owner's own programs ask the gateway."""
        return self.run / "gateway.sock"

    @property
    def control(self) -> Path:
        """The operator's door and the feed."""
        return self.run / "control.sock"

    @property
    def notify(self) -> Path:
        """Where cores say that they are ready."""
        return self.run / "notify.sock"

    @property
    def switch(self) -> Path:
        """Which processes are ours, and the step a switch is at."""
        return self.run / "switch"

    @property
    def launcher_lock(self) -> Path:
        """Held by the launcher as long as it lives."""
        return self.state / "launcher.lock"

    @property
    def guard_lock(self) -> Path:
        """Held by the sentinel as long as it lives: one for one data folder, whatever the environment."""
        return self.state / "guard.lock"

    @property
    def launcher(self) -> Path:
        """Who the launcher is."""
        return self.run / "launcher.json"

    @property
    def sentinel(self) -> Path:
        """Who the sentinel is."""
        return self.run / "sentinel.json"

    @property
    def sentinel_page(self) -> Path:
        """The sentinel's own beat, for whoever watches it."""
        return self.run / "sentinel.page"

    @property
    def gateway_page(self) -> Path:
        """The gateway's own recorder page."""
        return self.run / "gateway.page"

    @property
    def refused_paths(self) -> Path:
        """Paths that have killed a gateway twice."""
        return self.state / "refused_paths.json"

    @property
    def agents(self) -> Path:
        """What the agents in gateway and core go by when the sentinel is lost."""
        return self.run / "agents.json"

    @property
    def alerts(self) -> Path:
        """What was told to whom, and what came of it."""
        return self.state / "alerts.json"

    @property
    def outbox(self) -> Path:
        """Alerts that wait to be sent."""
        return self.spool / "alerts"

    @property
    def history(self) -> Path:
        """The last changes of the state for people."""
        return self.state / "history.json"

    @property
    def counters(self) -> Path:
        """What is counted over the lives of the guard."""
        return self.state / "counters.json"

    @property
    def checkpoints(self) -> Path:
        """Verified states of the ledger; the core alone writes them."""
        return self.data / "checkpoints"

    @property
    def capability(self) -> Path:
        """What this machine lets the guard see of a process."""
        return self.run / "capability.json"

    @property
    def exits(self) -> Path:
        """Exit statuses of orphans, written by the launcher."""
        return self.run / "exits"

    def recorder(self, nonce: str) -> Path:
        """The recorder page of one life."""
        return self.run / f"recorder-{nonce}"

    def core_socket(self, nonce: str) -> Path:
        """Where one life of the core listens."""
        return self.run / f"core-{nonce}.sock"

    def core_control(self, nonce: str) -> Path:
        """The control socket of one life of the core."""
        return self.run / f"core-{nonce}.ctl"


def _run_base() -> Path:
    own = os.environ.get("XDG_RUNTIME_DIR", "")
    for base in (Path(own) if own else None, Path("/dev/shm")):  # noqa: S108  # the folder in it is 0700
        if base is None or not base.is_dir() or not os.access(base, os.W_OK):
            continue
        if (
            len(os.fsencode(base)) + len("/hardcore-0123456789ab/") + len(_LONGEST_NAME)
            <= SOCKET_PATH_BYTES_MAX
        ):
            return base
    return Path("/tmp")  # noqa: S108  # as above


def _run_name(data: Path) -> str:
    digest = hashlib.sha256(os.fsencode(data.resolve()) + b"\0" + str(os.getuid()).encode()).hexdigest()
    return f"hardcore-{digest[:12]}"


def run_folder(data: Path) -> Path:
    """Return the run folder that belongs to this data folder: the one it links to, or one for this environment."""
    name = _run_name(data)
    try:
        linked = (data / "run").readlink()
    except OSError:
        return _run_base() / name
    # A copied or moved folder has another name; what it still links to is not its own.
    return linked if linked.name == name and linked.is_absolute() and _private(linked) else _run_base() / name


def _private(folder: Path) -> bool:
    """Return whether it is a folder that only we can open."""
    try:
        status = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077


def locate(data: Path) -> Folders:
    """Return the names of this instance's files without making anything."""
    return Folders(data.resolve(), run_folder(data))


def prepare_data(data: Path) -> Folders | Unusable:
    """Make what lies in the data folder itself, owner-only; nothing that another environment would make anew."""
    folders = None
    try:
        data.mkdir(parents=True, exist_ok=True, mode=0o700)
        folders = locate(data)
        for folder in (folders.state, folders.cases, folders.incidents, folders.logs):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        probe = folders.state / ".writable"
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        # On a disk that takes no writes, what a guard has left there can still be read and watched.
        if error.errno in REFUSED and folders is not None and folders.generation.exists():
            return folders
        return _unusable(data, error)
    return folders


def _unusable(data: Path, error: OSError) -> Unusable:
    shown = str(data) if len(str(data)) <= 120 else f"{str(data)[:117]}…"
    return Unusable(
        f"The data folder {shown} can't be used ({error.strerror}). Choose another with --data DIR."
    )


def prepare(data: Path) -> Folders | Unusable:
    """Make the folders of an instance, owner-only, and the link to its run folder.

    The caller holds the lock of the launcher or of the guard: two of them would take the link from each other.
    """
    folders = prepare_data(data)
    return folders if isinstance(folders, Unusable) else prepare_run(folders)


def laid_out(data: Path) -> Folders | None:
    """Return this instance's names if a guard has watched it and nothing has to be made; writes nothing anywhere."""
    folders = locate(data)
    needed = (folders.state, folders.cases, folders.incidents, folders.logs)
    return folders if folders.generation.exists() and all(path.is_dir() for path in needed) else None


def prepare_run(folders: Folders) -> Folders | Unusable:
    """Make the run folder, owner-only, and the link to it; the caller as for `prepare`, and the data folder is there."""
    try:
        for folder in (folders.run, folders.exits):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        return _unusable(folders.data, error)
    if not _private(folders.run):
        return Unusable(
            f"{folders.run} must be a folder that only you can open. Remove it, or set XDG_RUNTIME_DIR."
        )
    return _link(folders)


def _link(folders: Folders) -> Folders | Unusable:
    link = folders.data / "run"
    try:
        if link.is_symlink() and link.readlink() == folders.run:
            return folders
        if link.is_symlink():
            link.unlink()
        link.symlink_to(folders.run)
    except OSError as error:
        return Unusable(f"{link} must be a link that this program makes ({error.strerror}). Remove it.")
    return folders
