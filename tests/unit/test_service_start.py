"""`hardcore service start` says that it has started only what runs."""

import json
import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from hardcore import service_words
from hardcore.cli import main

#: Stands in for systemd's own command: notes what it was asked, and tells of a service in the state it was given.
SYSTEMCTL = """#!/bin/sh
echo "$@" >> {asked}
case "$*" in *show*) echo "ActiveState=$(head -n 1 {states})"; sed -i '1{{$!d}}' {states};; esac
"""


@pytest.fixture
def systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with two units of ours, and a `systemctl` in the path; what it is to tell goes into `states`."""
    units = tmp_path / "systemd" / "user"
    units.mkdir(parents=True)
    for kind in ("socket", "service"):
        (units / f"hardcore.{kind}").write_text(f"{service_words.MARK}\n")
    command = tmp_path / "systemctl"
    command.write_text(SYSTEMCTL.format(asked=tmp_path / "asked", states=tmp_path / "states"))
    command.chmod(0o700)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "data" / "state").mkdir(parents=True)
    return tmp_path


@pytest.mark.parametrize(
    ("states", "code"), [("active", 0), ("inactive\nactive", 0), ("inactive", 1), ("failed", 1)]
)
def test_a_start_is_told_only_of_a_service_that_runs(systemd: Path, states: str, code: int) -> None:
    (systemd / "states").write_text(f"{states}\n")
    argv = ["--json", "--data", str(systemd / "data"), "service", "start", "--user"]
    done = CliRunner().invoke(main, argv)
    assert (done.exit_code, json.loads(done.stdout)["ok"]) == (code, code == 0), done.output
    assert (systemd / "asked").read_text().splitlines()[0].startswith("--user reset-failed hardcore.socket")
