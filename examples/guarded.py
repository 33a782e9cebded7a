"""A guarded ledger as a program around it sees it: started, asked, hurt, stopped, all from outside.

Everything goes through what any operator has: the command `hardcore`, the URL it prints, signals. Nothing of
the guard is imported, so what is shown or measured with this room can't rest on an inside word. The instance
runs in a session of its own, because Ctrl-C at a terminal reaches a whole foreground group: who started it
decides when it stops.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import urlsplit

HARDCORE = Path(sys.executable).with_name("hardcore")
START_S = 30.0
STOP_S = 30.0
RECOVERY_S = 60.0
COMMAND_S = 120.0
LOOK_EVERY_S = 0.05


class GuardError(Exception):
    """The instance did not do what it was asked to; the sentence says what and what it answered."""


@dataclass(frozen=True, slots=True)
class Held:
    """A process held by its pidfd, so that a signal can never reach another one with the same number."""

    pid: int
    pidfd: int
    epoch: int

    def hit(self, number: signal.Signals) -> int:
        """Send a signal; return the monotonic time in ns of the moment before. Raises ProcessLookupError."""
        before_ns = time.monotonic_ns()
        signal.pidfd_send_signal(self.pidfd, number)
        return before_ns

    def let_go(self) -> None:
        """Give the descriptor back."""
        os.close(self.pidfd)


class Guarded:
    """One instance in one data folder: entering starts it, leaving stops it, whatever happened between."""

    def __init__(self, data: Path, policy: Mapping[str, object], stopping: Callable[[], bool] = bool) -> None:
        """Prepare. `policy` names what differs from the defaults; `stopping` may end a wait early."""
        self.data = data
        self.url = ""
        self._policy = policy
        self._stopping = stopping
        self._launcher: subprocess.Popen[str] | None = None

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the gateway."""
        parts = urlsplit(self.url)
        assert parts.hostname is not None, "asked before the start"
        assert parts.port is not None, "as above"
        return parts.hostname, parts.port

    def __enter__(self) -> Self:
        """Start everything and wait until a core is ready."""
        self.data.mkdir(parents=True, exist_ok=True)
        policy = self.data / "policy.json"
        policy.write_text(json.dumps(self._policy))
        with (self.data / "up.log").open("ab") as log:
            self._launcher = subprocess.Popen(
                [HARDCORE, "--data", self.data, "--json", "up", "--port", "0", "--policy", policy],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
                start_new_session=True,
            )
        try:
            self.url = self._told_url(self._launcher)
            self.until(lambda told: bool(told["core"]["ready"]), "a core to be ready", START_S)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        """Stop everything."""
        self.stop()

    def _told_url(self, launcher: subprocess.Popen[str]) -> str:
        assert launcher.stdout is not None, "it was asked for"
        told = ""
        for line in launcher.stdout:  # the launcher keeps the pipe open: only the object's end ends it
            told += line
            if line.startswith("}"):
                break
        try:
            return str(json.loads(told)["url"])
        except (ValueError, KeyError):
            words = (self.data / "up.log").read_text(errors="replace").strip()
            raise GuardError(f"`hardcore up` did not start: {words or told.strip()}") from None

    def hardcore(self, *words: str) -> Any:
        """Run a command of the operator with --json and return what it told. Raises GuardError."""
        argv = [str(HARDCORE), "--data", str(self.data), "--json", *words]
        done = subprocess.run(
            argv,
            capture_output=True,
            text=True,
            check=False,
            timeout=COMMAND_S,
            start_new_session=True,
        )
        try:
            return json.loads(done.stdout)
        except ValueError:
            raise GuardError(
                f"`hardcore {' '.join(words)}` said: {(done.stderr or done.stdout).strip()}"
            ) from None

    def status(self) -> dict[str, Any]:
        """Return `hardcore status --json`."""
        told: dict[str, Any] = self.hardcore("status")
        return told

    def until(
        self, holds: Callable[[dict[str, Any]], bool], what: str, within_s: float = RECOVERY_S
    ) -> dict[str, Any]:
        """Wait until the status is as wished and return it. Raises GuardError after `within_s` seconds."""
        give_up_at = time.monotonic() + within_s
        while not holds(told := self.status()):
            if self._stopping():
                raise GuardError("stopped while waiting")
            if time.monotonic() > give_up_at or told["state"] == "MANUAL_INTERVENTION":
                raise GuardError(f"Waited for {what}; the state is {told['state']} ({told['phase']}).")
            time.sleep(LOOK_EVERY_S)
        return told

    def running(self) -> dict[str, Any]:
        """Wait until a core has proven itself and no incident is open; return the status."""
        return self.until(
            lambda told: told["phase"] == "RUNNING" and told["incident"] is None, "the core to be running"
        )

    def core(self) -> Held:
        """Wait until a proven core runs, and hold it. The caller lets it go."""
        while True:
            told = self.running()["core"]
            try:
                held = Held(told["pid"], os.pidfd_open(told["pid"]), told["epoch"])
            except ProcessLookupError:
                continue  # it died after the status was told: ask again
            if self.status()["core"]["pid"] == told["pid"]:  # held now, and still the one that was meant
                return held
            held.let_go()

    def stop(self) -> None:
        """Stop everything as Ctrl-C would, and wait until it is gone."""
        launcher, self._launcher = self._launcher, None
        if launcher is None:
            return
        launcher.terminate()
        try:
            launcher.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._end()
            launcher.kill()
            launcher.wait()
        if launcher.stdout is not None:
            launcher.stdout.close()

    def _end(self) -> None:
        """Kill what did not stop when asked, the one that would start others first."""
        told = self.status()
        for part in ("launcher", "sentinel", "gateway", "core"):
            if told[part]["pid"] is not None:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(told[part]["pid"], signal.SIGKILL)


def stop_cleanly() -> None:
    """Make the first Ctrl-C or TERM a KeyboardInterrupt, and later ones nothing: what is running gets stopped."""

    def stop(_number: int, _frame: object) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        sys.stderr.write("\nStopping.\n")
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
