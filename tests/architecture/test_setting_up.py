"""Setting up on a strange machine: one sentence with the next step, or a .venv that is exactly the lock.

The scripts run for real under `sh`, on a PATH that holds only what the machine in question would have: programs
of a few lines that answer as that machine's kernel or Python would.
"""

import os
import shlex
import shutil
import stat
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[2]
SHELL: Final = shutil.which("sh") or "/bin/sh"
WAIT_S: Final = 20
# What a POSIX machine has in any case; everything else is put on the PATH by the test.
TOOLS: Final = ("sh", "cat", "cmp", "dirname", "grep", "rm", "mkdir", "tail")


@dataclass(frozen=True, slots=True)
class Machine:
    """A folder that is the whole PATH of a machine."""

    programs: Path

    def put(self, name: str, script: str) -> Path:
        """Install a program of a few lines of shell."""
        return _program(self.programs / name, script)

    def run(
        self, script: str, *words: str, env: Mapping[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        """Run one of our scripts on this machine."""
        return subprocess.run(
            [SHELL, script, *words],
            env={"PATH": str(self.programs), **(env or {})},
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )


def _program(path: Path, script: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!{SHELL}\n{script}\n", "utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return path


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    machine = Machine(tmp_path / "programs")
    machine.put("uname", "case $1 in -s) echo Linux ;; *) echo 6.1.0-18-amd64 ;; esac")
    for tool in TOOLS:
        found = shutil.which(tool)
        assert found, f"every POSIX machine has {tool}"
        (machine.programs / tool).symlink_to(found)
    return machine


def _preflight(machine: Machine, **env: str) -> subprocess.CompletedProcess[str]:
    return machine.run(str(ROOT / "scripts/preflight"), env=env)


def _refusal(result: subprocess.CompletedProcess[str]) -> str:
    """The one sentence in which the machine was refused."""
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr.count("\n") == 1
    assert result.stderr.endswith(".\n")
    return result.stderr


def test_the_first_python_that_fits_is_taken(machine: Machine) -> None:
    machine.put("python3", "echo 3.9 old")
    machine.put("python3.14", "exit 127")
    machine.put("python3.12", "echo 3.12 fine")
    machine.put("python3.11", "echo 3.11 fine")
    assert _preflight(machine).stdout == "python3.12\n"


def test_a_python_newer_than_the_locks_is_taken_last(machine: Machine) -> None:
    machine.put("python3", "echo 3.15 newer")
    assert _preflight(machine).stdout == "python3\n"
    machine.put("python3.13", "echo 3.13 fine")
    assert _preflight(machine).stdout == "python3.13\n"


def test_the_real_python_of_these_tests_fits(machine: Machine) -> None:
    assert _preflight(machine, PYTHON=sys.executable).stdout == f"{sys.executable}\n"


def test_another_system_is_refused(machine: Machine) -> None:
    machine.put("uname", "echo Darwin")
    assert "needs Linux, and here is Darwin" in _refusal(_preflight(machine))


@pytest.mark.parametrize("release", ["4.19.0-26-amd64", "5.3.18", "5.3-rc1", "2.6.32"])
def test_a_kernel_without_pidfds_is_refused(machine: Machine, release: str) -> None:
    machine.put("uname", f"case $1 in -s) echo Linux ;; *) echo {release} ;; esac")
    assert (
        f"needs Linux 5.4 or newer, because it watches processes through pidfds, and here is {release}"
        in _refusal(_preflight(machine))
    )


@pytest.mark.parametrize("release", ["5.4.0", "5.15.167.4-microsoft-standard-WSL2", "6.18.44+", "10.0"])
def test_a_kernel_with_pidfds_is_taken(machine: Machine, release: str) -> None:
    machine.put("uname", f"case $1 in -s) echo Linux ;; *) echo {release} ;; esac")
    machine.put("python3", "echo 3.11 fine")
    assert _preflight(machine).stdout == "python3\n"


def test_no_python_at_all_is_refused(machine: Machine) -> None:
    assert "No Python was found: install CPython 3.11 or newer" in _refusal(_preflight(machine))


def test_an_old_python_is_refused_with_its_version(machine: Machine) -> None:
    machine.put("python3", "echo 3.9 old")
    assert "needs CPython 3.11 or newer, and here is 3.9" in _refusal(_preflight(machine))


@pytest.mark.parametrize("module", ["venv", "ensurepip"])
def test_a_python_without_virtual_environments_is_refused(machine: Machine, module: str) -> None:
    machine.put("python3", f"echo 3.11 {module}")
    assert "apt install python3.11-venv" in _refusal(_preflight(machine))


def test_a_python_built_without_sqlite_is_refused(machine: Machine) -> None:
    machine.put("python3", "echo 3.12 sqlite3")
    assert "Python 3.12 was built without its sqlite3 module" in _refusal(_preflight(machine))


def test_a_named_python_that_does_not_start_is_refused(machine: Machine) -> None:
    machine.put("python3", "echo 3.12 fine")
    assert "/no/python is not a Python that starts" in _refusal(_preflight(machine, PYTHON="/no/python"))


@dataclass(frozen=True, slots=True)
class Checkout:
    """A checkout with small locks, on a machine whose Python only notes what it is asked to do."""

    machine: Machine
    top: Path

    def set_up(self, kind: str) -> subprocess.CompletedProcess[str]:
        """Run scripts/venv in it."""
        return self.machine.run(str(self.top / "scripts/venv"), kind)

    def installs(self) -> list[str]:
        """What pip was asked to install so far, in order."""
        notes = self.top / "notes"
        return notes.read_text("utf-8").splitlines() if notes.exists() else []


@pytest.fixture
def checkout(machine: Machine, tmp_path: Path) -> Checkout:
    top = tmp_path / "a checkout"
    (top / "scripts").mkdir(parents=True)
    for script in ("venv", "preflight"):
        shutil.copy(ROOT / "scripts" / script, top / "scripts" / script)
    (top / "requirements.lock").write_text("click==8.1 \\\n", "utf-8")
    (top / "requirements-dev.lock").write_text("click==8.1 \\\npytest==9 \\\n", "utf-8")
    (top / "pyproject.toml").write_text("", "utf-8")
    notes, inner = shlex.quote(str(top / "notes")), shlex.quote(str(top / ".venv/bin/python"))
    _program(
        top / "inner",
        f'[ "$1" = -c ] && exit 0\necho "$*" >> {notes}\n[ ! -e {shlex.quote(str(top / "broken"))} ]',
    )
    machine.put(
        "python3",
        f"""case $1 in
        -c) echo 3.12 fine ;;
        --version) echo Python 3.12.1 ;;
        *) mkdir -p "$4/bin" && cat {shlex.quote(str(top / "inner"))} > {inner} && chmod +x {inner} ;;
        esac""",
    )
    (machine.programs / "chmod").symlink_to(shutil.which("chmod") or "/bin/chmod")
    return Checkout(machine, top)


def test_only_hashed_wheels_of_the_lock_are_installed(checkout: Checkout) -> None:
    result = checkout.set_up("run")
    assert (result.returncode, result.stderr) == (0, "")
    packages, ours = checkout.installs()
    assert "install --require-hashes --only-binary :all: -r requirements.lock" in packages
    assert ours.endswith("install --no-deps --no-build-isolation -e .")
    assert len(result.stdout.splitlines()) == 2


def test_a_second_run_installs_nothing_and_says_nothing(checkout: Checkout) -> None:
    checkout.set_up("run")
    again = checkout.set_up("run")
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
    assert len(checkout.installs()) == 2


def test_a_changed_lock_is_installed_again(checkout: Checkout) -> None:
    checkout.set_up("run")
    (checkout.top / "requirements.lock").write_text("click==8.2 \\\n", "utf-8")
    checkout.set_up("run")
    assert len(checkout.installs()) == 4


def test_a_moved_checkout_is_installed_again(checkout: Checkout) -> None:
    checkout.set_up("run")
    moved = checkout.top.rename(checkout.top.with_name("moved"))
    notes = len((moved / "notes").read_text("utf-8").splitlines())
    result = checkout.machine.run(str(moved / "scripts/venv"), "run")
    assert (notes, result.returncode) == (2, 0)
    assert "Installing" in result.stdout


def test_what_runs_is_there_once_the_development_lock_is_installed(checkout: Checkout) -> None:
    checkout.set_up("dev")
    assert "requirements-dev.lock" in checkout.installs()[0]
    checkout.set_up("run")
    assert len(checkout.installs()) == 2


def test_a_failed_install_is_told_and_tried_again(checkout: Checkout) -> None:
    (checkout.top / "broken").touch()
    failed = checkout.set_up("run")
    assert failed.returncode == 1
    assert "The packages could not be installed" in failed.stderr
    (checkout.top / "broken").unlink()
    assert checkout.set_up("run").returncode == 0
    assert len(checkout.installs()) == 3


def _make(top: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["make", *words],
        cwd=top,
        env={"PATH": os.environ["PATH"]},
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A checkout whose .venv is there, with programs that only repeat their arguments."""
    top = tmp_path / "a checkout"
    _program(top / "scripts/venv", "exit 0")
    for name in ("hardcore", "python"):
        _program(top / ".venv/bin" / name, "printf '%s\\n' \"$@\"")
    shutil.copy(ROOT / "Makefile", top / "Makefile")
    return top


def test_make_run_starts_everything_with_the_documented_defaults(made: Path) -> None:
    assert _make(made, "run").stdout.splitlines() == ["--data", "./var", "up", "--port", "3000"]


def test_make_run_hands_a_folder_through_as_it_is_written(made: Path) -> None:
    told = _make(made, "run", "PORT=3100", "DATA=/some dir/it's here").stdout.splitlines()
    assert told == ["--data", "/some dir/it's here", "up", "--port", "3100"]


def test_make_simulate_hands_seeds_through(made: Path) -> None:
    assert _make(made, "simulate").stdout.split() == ["-m", "tests.simulation"]
    assert _make(made, "simulate", "SEED=7", "SEEDS=9").stdout.split() == [
        *("-m", "tests.simulation"),
        *("--seed", "7", "--seeds", "9"),
    ]


def test_make_alone_changes_nothing(made: Path) -> None:
    _program(made / "scripts/venv", "echo something was set up; exit 1")
    told = _make(made)
    assert told.returncode == 0
    assert "something was set up" not in told.stdout
