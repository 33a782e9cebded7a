"""What `hardcore up` does before it becomes the launcher: checks everything that can be told in one sentence.

Once the launcher runs, nobody reads a terminal any more; so folders, locks, policy, address and port are
settled here, each refusal with its next step. Then this process *becomes* the launcher (exec), which keeps
the listener and the lock and loses the weight of the command line.
"""

import contextlib
import os
import shlex
import signal
import socket
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from frontend.catalogue import text
from frontend.catalogue_access import access_text
from frontend.catalogue_operator import operator_text
from hardcore import standing
from hardcore.access.doorway import Doorway
from hardcore.access.files import read_doorway, read_people, write_doorway
from hardcore.control import client
from hardcore.host import files, leftovers, lives
from hardcore.host.folders import Folders, Unusable, locate, prepare, prepare_data
from hardcore.host.listener_left import Left, find_listener
from hardcore.model.phases import Wanted
from hardcore.opening import Opening, address_of, doorway_for, is_loopback, shown_url, warning_for
from hardcore.recovery.policy import Policy, PolicyFault

BACKLOG = 1024
#: What the address of a server begins with (`docs/postgresql.md`).
STORE_SCHEMES = ("postgresql://", "postgresql+psycopg://")
#: The first descriptor that a service manager hands over.
HANDED_FD = 3
#: A sentinel that an agent starts, or that has just begun, answers within this.
AGENTS_S, LOOK_S = 3.0, 0.05


class Refused(msgspec.Struct, frozen=True):
    """Why it can't be started, in words for the operator, and the exit code."""

    words: str
    code: int = 1


class Wishes(msgspec.Struct, frozen=True):
    """What `up` leaves in the launcher's environment, for each sentinel that it starts."""

    demo: bool = False  # add a page with buttons that break the core
    no_spare: bool = False  # keep no spare core, whatever the policy says
    mode: str = ""  # what the guard may do, whatever the policy says; empty: what that says


class Ready(msgspec.Struct, frozen=True):
    """All that the launcher needs; both descriptors are kept over the exec."""

    folders: Folders
    listen_fd: int
    url: str
    attached: bool
    warning: str = ""


def prepare_start(
    data: Path, opening: Opening, port: int, policy: Path | None, lang: str, wishes: Wishes, store: str | None
) -> Ready | Refused:
    """Settle everything that can go wrong before the launcher takes over. `store`: where the ledger is to lie."""
    made = prepare_data(data)
    if isinstance(made, Unusable):
        return Refused(made.reason)
    command = "hardcore" if data == Path("var") else f"hardcore --data {shlex.quote(str(data))}"
    doorway = doorway_for(opening, read_people(made.state), lang, command)
    if isinstance(doorway, str):
        return Refused(doorway, 2)
    try:
        folders = _claim(made, lang)
        if isinstance(folders, Refused):
            return folders
        # A sentinel that runs was told when it began.
        later = _later(wishes)
        if later is not None and held(folders.run / "sentinel.lock"):
            return Refused(text(later, lang))
        if opening.given and held(folders.run / "sentinel.lock") and doorway != read_doorway(folders.state):
            return Refused(access_text("door_later", lang))
        refused = _keep_store(folders, store, lang) if store is not None else None
        if refused is not None:
            return refused
        ready = _settle(folders, doorway, opening.host, port, policy, lang)
        return ready if isinstance(ready, Refused) else _opened(ready, doorway, opening, lang)
    except OSError as error:  # a full disk lets folders be made, but no files be written
        return Refused(text("data_not_written", lang, path=made.data, why=error.strerror))


def _opened(ready: Ready, doorway: Doorway, opening: Opening, lang: str) -> Ready:
    """Leave word for the gateway of how wide the door is, and name it as people will. A guard that runs has heard it."""
    if ready.attached:
        return ready
    if doorway != read_doorway(ready.folders.state):  # a disk that takes no writes is served as it lies there
        write_doorway(ready.folders.state, doorway)
    warning = "\n".join(filter(None, (ready.warning, warning_for(doorway, lang))))
    return msgspec.structs.replace(ready, url=shown_url(ready.url, doorway, opening.host), warning=warning)


def _claim(made: Folders, lang: str) -> Folders | Refused:
    """Take the launcher's lock, and only then make the run folder and the link to it."""
    lock = files.take_lock(made.launcher_lock)
    if lock is None:
        return _in_use(made, lang)
    os.set_inheritable(lock, True)  # held by the launcher for as long as it lives
    if held(made.guard_lock) and not _held_if_there(made.run / "sentinel.lock"):
        return _in_use(made, lang)  # it lives, and nothing here leads to it: nobody may start beside it
    folders = prepare(made.data)
    return Refused(folders.reason) if isinstance(folders, Unusable) else folders


def has_password(store: str) -> bool:
    """Whether an address holds a password."""
    with contextlib.suppress(ValueError):
        return urlsplit(store).password is not None or "password=" in urlsplit(store).query
    return True  # what can't be read may hold one


def password_typed(lang: str) -> str:
    """Say where a password belongs instead."""
    return operator_text("store_password", lang)


def _keep_store(folders: Folders, store: str, lang: str) -> Refused | None:
    """Write down where the ledger lies, for every core there will be; its owner alone reads it, for it may hold a password."""
    if not store.startswith(STORE_SCHEMES):
        return Refused(operator_text("store_address", lang), 2)
    if held(folders.run / "sentinel.lock"):
        return Refused(operator_text("store_later", lang))
    files.write_whole(folders.store, store.encode() + b"\n")
    return None


def _in_use(made: Folders, lang: str) -> Refused:
    url = files.read_json(locate(made.data).sentinel).get("url") or f"--data {made.data}"
    return Refused(text("already_running", lang, url=url))


def held(path: Path) -> bool:
    """Return whether somebody holds this lock now."""
    lock = files.take_lock(path)
    if lock is not None:
        os.close(lock)
    return lock is None


def _held_if_there(path: Path) -> bool:
    return path.exists() and held(path)


def _settle(
    folders: Folders, doorway: Doorway, host: str, port: int, policy: Path | None, lang: str
) -> Ready | Refused:
    handed = _handed(doorway, lang)
    if isinstance(handed, Refused):
        return handed
    living = _attach(folders)
    if living is not None and handed is not None and not _same_socket(living[0], handed.fileno()):
        # Nobody would answer at the other address.
        return Refused(text("already_running", lang, url=living[1]))
    warning = _settle_policy(folders, policy, lang, attached=living is not None)
    if isinstance(warning, Refused):
        return warning
    if living is not None:
        return Ready(folders, *living, attached=True, warning=warning)
    left = find_listener(folders)
    listener = handed or left.listener or _listen(address_of(host) or host, port, lang)
    if isinstance(listener, Refused):
        return _whose(listener, folders, port, left, lang)
    # Only now: a start that was refused must not have changed what is wanted.
    standing.want_up(folders)
    if handed is None and left.listener is not None:
        url = _url_left(folders, left.listener)
        return Ready(folders, left.listener.detach(), url, attached=False, warning=warning)
    if left.listener is not None and handed is not None:
        _give_up(left.listener, handed)
    # By the name that was asked for: a cookie of `localhost` is none of 127.0.0.1.
    host = address_of(host) or host if handed is None else str(listener.getsockname()[0])
    shown = f"[{host}]" if ":" in host else host
    port = listener.getsockname()[1]
    return Ready(folders, listener.detach(), f"http://{shown}:{port}", attached=False, warning=warning)


def _whose(refused: Refused, folders: Folders, port: int, left: Left, lang: str) -> Refused:
    """Say whose the port is, if it is one that our own processes hold and that could not be taken from them."""
    if not left.pids or port != _port_before(folders):
        return refused
    pids, command = ", ".join(map(str, left.pids)), f"hardcore --data {shlex.quote(str(folders.data))}"
    return Refused(text("port_ours", lang, port=port, pids=pids, command=command))


def _port_before(folders: Folders) -> int | None:
    try:
        return urlsplit(str(files.read_json(folders.sentinel).get("url"))).port
    except ValueError:
        return None


def _url_left(folders: Folders, listener: socket.socket) -> str:
    """Return the address of a listener that is gone on with, by the name it was opened under."""
    host, port = listener.getsockname()[:2]
    if port == _port_before(folders):
        return str(files.read_json(folders.sentinel)["url"])
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _give_up(left: socket.socket, ours: socket.socket) -> None:
    """Close an address for everybody who holds it: the core would keep it open, and nobody would answer there."""
    if not _same_socket(left.fileno(), ours.fileno()):
        with contextlib.suppress(OSError):
            left.shutdown(socket.SHUT_RDWR)
    left.close()


def _later(wishes: Wishes) -> str | None:
    """Return the text for a wish that only the next start can fulfil, if there is one."""
    if wishes.demo:
        return "demo_later"
    if wishes.no_spare:
        return "no_spare_later"
    return "mode_later" if wishes.mode else None


def become_launcher(ready: Ready, wishes: Wishes) -> None:
    """Become the launcher. Does not return."""
    for name, wished in (
        (lives.DEMO_SWITCH, "1" if wishes.demo else ""),
        (standing.NO_SPARE_SWITCH, "1" if wishes.no_spare else ""),
        (standing.MODE_SWITCH, wishes.mode),
    ):
        os.environ.pop(name, None)  # the command line decides, not what a shell has left over
        if wished:
            os.environ[name] = wished
    os.set_inheritable(ready.listen_fd, True)
    # Kept back over the exec: a Ctrl-C that meets a starting interpreter is answered with a traceback.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    launcher = Path(__file__).with_name("launcher.py")
    argv = [sys.executable, "-I", "-S", str(launcher), str(ready.folders.data), str(ready.folders.run)]
    os.execv(sys.executable, [*argv, str(ready.listen_fd), ready.url])  # noqa: S606  # to become it is the point


def _settle_policy(folders: Folders, given: Path | None, lang: str, *, attached: bool) -> str | Refused:
    """Check the policy and copy a given one into the data folder. Returns a warning, or an empty text."""
    if given is not None:
        found = standing.load_policy_file(given)
        if not isinstance(found, Policy):
            return Refused(policy_faults(given, found, lang))
        if given.resolve() != folders.policy:
            files.write_whole(folders.policy, given.read_bytes())
        # A guard that runs takes it within a second, and keeps it as the last good one.
        old = attached and found != standing.load_policy_file(folders.good_policy)
        return text("policy_later", lang, path=given) if old else ""
    if not folders.policy.exists():
        return ""
    found = standing.load_policy_file(folders.policy)
    if isinstance(found, Policy):
        return ""
    if isinstance(standing.load_policy_file(folders.good_policy), Policy):
        return text("policy_kept", lang, path=folders.policy)
    return Refused(policy_faults(folders.policy, found, lang))


def policy_faults(path: Path, faults: list[PolicyFault], lang: str) -> str:
    """Return what is wrong with a policy file, a line for each fault, and the next step."""
    lines = [text("policy_bad", lang, path=path), *(f"  {fault}" for fault in faults)]
    return "\n".join([*lines, text("policy_next", lang)])


def _attach(folders: Folders) -> tuple[int, str] | None:
    """Return the listener and the URL of a sentinel that is alive, or that an agent starts now; None: there is none."""
    coming = _agents_act(folders)
    give_up_at = time.monotonic() + AGENTS_S
    while (watched := held(folders.run / "sentinel.lock")) or coming:
        living = _ask_for_listener(folders) if watched else None
        if living is not None or time.monotonic() > give_up_at:
            return living
        time.sleep(LOOK_S)
    return None


def _agents_act(folders: Folders) -> bool:
    """Whether a gateway or core of a guard that is lost lives, and may start another: at any other address than its own
    there would be two listeners, and nobody at ours.
    """
    lost = files.read_json(folders.agents).get("sentinel_lost") is True
    if not lost or standing.wanted(folders) is Wanted.DOWN:
        return False
    found = leftovers.find_leftovers(folders)
    return bool(found.gateways or found.cores)


def _ask_for_listener(folders: Folders) -> tuple[int, str] | None:
    try:
        answer, fds = client.ask_with_fds(folders.control, {"verb": "attach", "pid": os.getpid()})
    except client.Unreachable:
        return None
    if len(fds) != 1 or not isinstance(answer.get("url"), str):
        return None
    return fds[0], str(answer["url"])


def _handed(doorway: Doorway, lang: str) -> socket.socket | Refused | None:
    """Return the listener that a service manager has opened for us (`LISTEN_FDS`); None: it has opened none."""
    meant_for, count = (os.environ.pop(name, "") for name in ("LISTEN_PID", "LISTEN_FDS"))
    if meant_for != str(os.getpid()) or count in {"", "0"}:
        return None
    try:
        handed = socket.socket(fileno=HANDED_FD)
        listens = handed.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN)
    except OSError:
        return Refused(text("handed_unfit", lang))
    fit = count == "1" and listens and handed.type == socket.SOCK_STREAM
    if not fit or handed.family not in {socket.AF_INET, socket.AF_INET6}:
        return Refused(text("handed_unfit", lang))
    host = str(handed.getsockname()[0])
    if not is_loopback(host) and not doorway.open:
        return Refused(access_text("open_plain", lang, host=host), 2)
    return handed


def _same_socket(one: int, other: int) -> bool:
    return os.path.samestat(os.fstat(one), os.fstat(other))


def _listen(host: str, port: int, lang: str) -> socket.socket | Refused:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        if error.errno in {98, 13}:  # in use, or a port below 1024
            return Refused(text("port_taken", lang, port=port, next=max(1024, port) + 100))
        return Refused(text("cannot_listen", lang, host=host, port=port, why=error.strerror))
    return listener
