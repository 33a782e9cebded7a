"""`hardcore service`: have systemd start the ledger at boot, and say how that goes.

Two units are written from `templates/service/`: a socket, which keeps the address open over everything, and a service,
whose main process is the launcher. What would be done can be seen first (`--dry-run`), what is there and was not
written by us is never overwritten, and where no systemd rules nothing is left half done. A unit in a package's own
folder was not chosen: the paths of a household are its own.
"""

import json
import os
import pwd
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import click
import msgspec

from frontend.catalogue_service import service_words
from hardcore import standing
from hardcore.access.files import read_people
from hardcore.asked import Asked, door_options, is_kept, keep, operator, options
from hardcore.host import files
from hardcore.host.folders import Folders
from hardcore.lines import wrapped
from hardcore.model.phases import Wanted
from hardcore.opening import Opening, address_of, doorway_for, shown_url

TEMPLATES: Final = Path(__file__).parents[1] / "templates" / "service"
#: The first line of what we write: whatever does not begin with it belongs to somebody else.
MARK: Final = "# Written by `hardcore service install`."
SYSTEM_UNITS: Final = Path("/etc/systemd/system")
#: It is there if this machine was started by systemd (sd_booted(3)).
BOOTED: Final = Path("/run/systemd/system")
COMMAND_S: Final = 150.0
#: Somebody may have asked at the address the moment before, when it was still to stay off: that start counts for ours.
START_TRIES: Final = 2
#: The file of a unit is as readable as every other.
MODE: Final = 0o644
SHOWN: Final = ("ActiveState", "SubState", "MainPID", "NRestarts", "Result", "UnitFileState")


class Place(msgspec.Struct, frozen=True):
    """Whose service it is, and under which name. `owner`: who a service of the whole machine runs as."""

    name: str
    user: bool
    owner: str = ""

    @property
    def folder(self) -> Path:
        """Where its units lie."""
        if not self.user:
            return SYSTEM_UNITS
        return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "systemd" / "user"

    @property
    def socket(self) -> Path:
        """The unit that keeps the address."""
        return self.folder / f"{self.name}.socket"

    @property
    def service(self) -> Path:
        """The unit of the launcher."""
        return self.folder / f"{self.name}.service"

    def systemctl(self, *words: str) -> list[str]:
        """Return a command for the manager that has it."""
        return ["systemctl", *(["--user"] if self.user else []), *words]


def units(place: Place, data: Path, opening: Opening, port: int) -> dict[Path, str]:
    """Return both units as they are written."""
    address = address_of(opening.host) or opening.host
    address = "127.0.0.1" if address == "localhost" else address
    values = {
        "up": " ".join(["up", *map(in_unit, opening.words)]),
        "name": place.name,
        "address": f"[{address}]" if ":" in address else address,
        "port": port,
        "data": in_unit(str(data)),
        "data_shown": str(data).replace("%", "%%"),
        "python": in_unit(f"{sys.executable}"),
        "systemctl": shlex.join(place.systemctl()),
        "user": place.owner,
        "wanted_by": "default.target" if place.user else "multi-user.target",
    }
    hardening = "" if place.user else _template("hardening.conf").format(**values)
    service = _template("hardcore.service").format(**values, hardening=hardening)
    return {place.socket: _template("hardcore.socket").format(**values), place.service: service}


def in_unit(word: str) -> str:
    """Return a word as a unit file has it: `%` is systemd's own sign, and a space would end it."""
    escaped = word.replace("\\", "\\\\").replace("%", "%%")
    return f'"{escaped}"' if " " in word else escaped


def _template(name: str) -> str:
    return (TEMPLATES / name).read_text("utf-8")


@click.group()
@options
@click.pass_context
def service(context: click.Context, /, **given: object) -> None:
    """Start the ledger at boot, by systemd."""
    keep(context, given)


def _of_whom(command: click.decorators.FC) -> click.decorators.FC:
    for option in (
        click.option("--name", default="hardcore", show_default=True, help="Name of the units."),
        click.option(
            "--user/--system",
            default=os.geteuid() != 0,
            help="Of yours, or of the whole machine.  [default: --system for root]",
        ),
    ):
        command = option(command)
    return command


@service.command()
@_of_whom
@click.option("--dry-run", is_flag=True, help="Only show what would be written and run.")
@door_options
@click.option("--port", default=3000, show_default=True, type=click.IntRange(1, 65535))
@click.option("--as", "owner", default="", help="Who a service of the whole machine runs as.")
@operator
def install(
    asked: Asked, name: str, port: int, owner: str, *, user: bool, dry_run: bool, **door: Any
) -> None:
    """Write the units, and have them started now and at each boot."""
    data, opening = asked.data.absolute(), Opening(**door)
    doorway = doorway_for(opening, read_people(asked.folders.state), asked.lang, asked.command)
    if isinstance(doorway, str):
        asked.fail(doorway, 2)
    place = Place(name, user, "" if user else owner or _owner(data))
    _refuse_what_can_not_be(asked, place, data, dry_run=dry_run)
    written = units(place, data, opening, port)
    unit_names = (place.socket.name, place.service.name)
    commands = [
        place.systemctl("daemon-reload"),
        place.systemctl("enable", *unit_names),
        place.systemctl("start", *unit_names),
    ]
    if not asked.json:
        _show(asked, written, commands, in_full=dry_run)
    told = {"files": {str(path): text for path, text in written.items()}, "commands": commands}
    if dry_run:
        _say(asked, "dry")
        asked.tell({"ok": True, "dry_run": True, **told})
        return
    _make_data(asked, place, data)
    _write(asked, written)
    _run(asked, place, commands)
    host = opening.host
    url = shown_url(f"http://{f'[{host}]' if ':' in host else host}:{port}", doorway, host)
    _say(asked, "installed", url=url)
    if standing.wanted(asked.folders) is Wanted.DOWN:
        _say(asked, "down", command=asked.command)
    if user:
        _say(asked, "linger")
    asked.tell({"ok": True, "dry_run": False, "url": url, **told})


def _owner(data: Path) -> str:
    """Return who the ledger belongs to, or whoever asked for root's rights; empty where that is nobody, or root."""
    there = next((path for path in (data, *data.parents) if path.exists()), data)
    uid = there.stat().st_uid or int(os.environ.get("SUDO_UID") or 0)
    try:
        return pwd.getpwuid(uid).pw_name if uid else ""
    except KeyError:
        return ""


def _refuse_what_can_not_be(asked: Asked, place: Place, data: Path, *, dry_run: bool) -> None:
    if any(character in str(data) for character in '\n\r"$'):
        _fail(asked, "odd_path", path=repr(str(data)))
    if not place.user and not place.owner:
        _fail(asked, "no_owner", data=data)
    for path in (place.socket, place.service):
        if path.exists() and not _is_ours(path):
            _fail(asked, "foreign", path=path)
    if dry_run:
        return
    if not BOOTED.is_dir() or shutil.which("systemctl") is None:
        _fail(asked, "no_systemd", command=f"{asked.command} up")
    if not place.user and os.geteuid() != 0:
        _fail(asked, "not_root")
    if not place.service.exists() and is_kept(asked.folders):
        _fail(asked, "running", command=asked.command)


def _is_ours(path: Path) -> bool:
    try:
        return path.read_text("utf-8", "replace").startswith(MARK)
    except OSError:
        return False


def _show(
    asked: Asked, written: dict[Path, str], commands: Sequence[Sequence[str]], *, in_full: bool
) -> None:
    for path, text in written.items():
        _say(asked, "writes", path=path)
        if in_full:
            click.echo("\n" + text)
    for command in commands:
        _say(asked, "runs", command=shlex.join(command))


def _make_data(asked: Asked, place: Place, data: Path) -> None:
    """Make the data folder: systemd mounts it for the service, and its owner may not be who makes it."""
    try:
        if not data.exists():
            data.mkdir(mode=0o700, parents=True)
            if place.owner:
                shutil.chown(data, place.owner)
    except (OSError, LookupError) as error:
        _fail(asked, "not_written", path=data, why=error)


def _write(asked: Asked, written: dict[Path, str]) -> None:
    for path, text in written.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            files.write_whole(path, text.encode())
            path.chmod(MODE)
        except OSError as error:
            _fail(asked, "not_written", path=path, why=error.strerror)


def _run(asked: Asked, place: Place, commands: Sequence[Sequence[str]]) -> None:
    for command in commands:
        done = _done(command)
        if done.returncode != 0:
            why = (done.stderr.strip().splitlines() or [f"{done.returncode}"])[-1]
            _fail(asked, "command_failed", command=shlex.join(command), why=why, unit=place.service.name)


def _done(command: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=COMMAND_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return subprocess.CompletedProcess(command, 1, "", str(error))


@service.command(hidden=True)
@operator
def wanted(asked: Asked) -> None:
    """Say by the exit code whether it may be started: 1 where `down` was the last word. Asked by the unit."""
    down = standing.wanted(asked.folders) is Wanted.DOWN
    if down:
        _say(asked, "down", command=asked.command)
    sys.exit(1 if down else 0)


@service.command()
@_of_whom
@operator
def start(asked: Asked, name: str, *, user: bool) -> None:
    """Start it again after `hardcore down`."""
    place = Place(name, user)
    names = [path.name for path in _there(asked, place)]
    try:
        _want_up(asked.folders)
    except OSError as error:
        _fail(asked, "not_written", path=asked.folders.state, why=error.strerror)
    _done(place.systemctl("reset-failed", *names))  # what systemd has given up it would not try again
    active = ""
    for _ in range(START_TRIES):
        if active != "active":
            _run(asked, place, [place.systemctl("start", *names)])
            active = _shown(place).get("ActiveState", "")
    if active != "active":  # what its condition passes over is a success to systemd
        _fail(asked, "not_started", unit=place.service.name, active=active)
    _say(asked, "started")
    asked.tell({"ok": True})


def _want_up(folders: Folders) -> None:
    """Store that it should run. Raises OSError as the disk gives it."""
    standing.want_up(folders)
    told = folders.state / "wanted.json"
    if os.geteuid() == 0 and told.exists():  # who it runs as has to read what root has written
        owner = folders.state.stat()
        os.chown(told, owner.st_uid, owner.st_gid)


@service.command()
@_of_whom
@operator
def uninstall(asked: Asked, name: str, *, user: bool) -> None:
    """Stop it, and take the units away; the ledger stays."""
    place = Place(name, user)
    there = list(_there(asked, place))
    _run(asked, place, [place.systemctl("disable", "--now", *(path.name for path in there))])
    for path in there:
        path.unlink(missing_ok=True)
    _run(asked, place, [place.systemctl("daemon-reload")])
    _say(asked, "uninstalled", data=asked.data.absolute())
    asked.tell({"ok": True})


def _there(asked: Asked, place: Place) -> Iterator[Path]:
    """The units that are there; ends with a sentence where there are none, or some of somebody else."""
    found = [path for path in (place.socket, place.service) if path.exists()]
    if not found:
        _fail(asked, "not_installed", path=place.service)
    for path in found:
        if not _is_ours(path):
            _fail(asked, "foreign", path=path)
        yield path


@service.command()
@_of_whom
@operator
def status(asked: Asked, name: str, *, user: bool) -> None:
    """Say what systemd knows of it. Exit code 0: it runs."""
    place = Place(name, user)
    if not place.service.exists():
        _fail(asked, "not_installed", path=place.service)
    told = _shown(place)
    if not told:
        _fail(asked, "no_systemd", command=f"{asked.command} up")
    active = told.get("ActiveState", "")
    _say(
        asked,
        "state",
        unit=place.service.name,
        active=active,
        sub=told.get("SubState", ""),
        pid=told.get("MainPID", ""),
        restarts=told.get("NRestarts", ""),
    )
    if asked.json:
        click.echo(json.dumps({"ok": active == "active", **told}, indent=1))
    sys.exit(0 if active == "active" else 1)


def _shown(place: Place) -> dict[str, str]:
    """Return what systemd says of the service; empty where nobody answers."""
    done = _done(place.systemctl("show", "-p", ",".join(SHOWN), place.service.name))
    return dict(line.partition("=")[::2] for line in done.stdout.splitlines() if "=" in line)


def _say(asked: Asked, key: str, **values: object) -> None:
    if not asked.json:
        click.echo(wrapped(service_words(key, asked.lang, **values)))


def _fail(asked: Asked, key: str, **values: object) -> None:
    asked.fail(service_words(key, asked.lang, **values))
