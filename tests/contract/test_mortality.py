"""A child that dies with whoever began it: held with real processes, of which the middle one is killed."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil

from core.departure import ExitCode
from tests.waiting import until

CHILD = "import os, sys, time; from core.mortality import die_with; print(die_with(os.getppid()), os.getpid(), flush=True); time.sleep(60)"
PARENT = f"import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', {CHILD!r}]); time.sleep(60)"


def test_a_child_is_gone_when_whoever_began_it_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        tied, pid = parent.stdout.readline().split()
        assert tied == "True"
        child = psutil.Process(int(pid))
        parent.send_signal(signal.SIGKILL)
        until(
            lambda: not child.is_running() or child.status() == psutil.STATUS_ZOMBIE, "the child to be gone"
        )


def test_whose_parent_was_gone_before_the_kernel_was_asked_is_told_so() -> None:
    done = subprocess.run(
        [sys.executable, "-c", f"from core.mortality import die_with; print(die_with({os.getpid()} + 1))"],
        check=True,
        capture_output=True,
        text=True,
    )
    assert done.stdout == "False\n"


def test_a_backup_whose_core_is_gone_is_not_made(tmp_path: Path) -> None:
    words = ["-m", "core", "backup", "--data", str(tmp_path), "--parent", str(os.getpid() + 1)]
    done = subprocess.run([sys.executable, *words], check=False, capture_output=True, text=True)
    assert (done.returncode, list(tmp_path.iterdir())) == (ExitCode.ASKED, [])
