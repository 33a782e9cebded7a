"""The command line's way to the investigators: one that listens, one that the guard wakes, or one of its own.

HTTP over their Unix socket (`docs/wires.md` section 16). Where no guard runs, the command starts an investigator for as
long as it takes and ends it afterwards, so letters can be read with everything stopped. What can't be reached is an
`Unreachable` with its why; what is refused is an answer like any other.
"""

import http.client
import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlencode

import msgspec

from hardcore.control import client
from hardcore.host.folders import Folders
from hardcore.host.local_http import Local

START_S: Final = 20.0
#: A retry may wait for a trial, and a dry run for a copy of the ledger.
ASK_S: Final = 180.0
ANSWER_BYTES_MAX: Final = 16 << 20
END_S: Final = 8.0


class Unreachable(Exception):  # noqa: N818  # it is a state of the other side, not an error of ours
    """No investigator answers, and none could be started."""


class Interrupted(Unreachable):
    """An investigator that was reached went away; whether it did what was asked is not known."""


class Answer(msgspec.Struct, frozen=True):
    """An answer: its status, and the object in it."""

    status: int
    told: dict[str, Any]

    @property
    def ok(self) -> bool:
        """Whether what was asked was done."""
        return self.status < 400


class Line:
    """An investigator that listens. `lang`: the language of its sentences."""

    def __init__(self, path: Path, lang: str) -> None:
        self._path = path
        self._lang = lang
        self._token = ""

    def get(self, path: str, **query: object) -> Answer:
        """Ask for something. Raises Interrupted."""
        asked = {name: value for name, value in query.items() if value != ""}
        return self._exchange("GET", f"/admin/api/{path}?{urlencode({**asked, 'lang': self._lang})}", None)

    def post(self, path: str, told: Mapping[str, Any]) -> Answer:
        """Have something done. Raises Interrupted."""
        if not self._token:
            self._token = str(self.get("token").told.get("token", ""))
        return self._exchange("POST", f"/admin/api/{path}?lang={self._lang}", json.dumps(told))

    def _exchange(self, method: str, path: str, body: str | None) -> Answer:
        connection = Local(self._path, ASK_S)
        headers = {"X-Admin": "1", "X-Hardcore-Cli": "1", "X-CSRF": self._token}
        if body is not None:
            headers["Content-Type"] = "application/json"
        try:
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            told = json.loads(answer.read(ANSWER_BYTES_MAX))
        except (OSError, ValueError, http.client.HTTPException) as error:
            raise Interrupted(str(error) or type(error).__name__) from error
        finally:
            connection.close()
        return Answer(answer.status, told if isinstance(told, dict) else {})


@contextmanager
def investigator(folders: Folders, lang: str) -> Iterator[Line]:
    """Give a line to an investigator; one of our own is ended afterwards. Raises Unreachable."""
    if _woken(folders) or _listens(folders.investigator):
        yield Line(folders.investigator, lang)
        return
    argv = ["-I", "-m", "postmortem", "serve", "--data", str(folders.data)]
    argv += ["--socket", str(folders.investigator), "--control", str(folders.control)]
    folders.run.mkdir(mode=0o700, exist_ok=True)
    child = subprocess.Popen(
        [sys.executable, *argv], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    try:
        _wait_for(child, folders.investigator)
        yield Line(folders.investigator, lang)
    finally:
        _end(child)


def _woken(folders: Folders) -> bool:
    """Have the guard wake its investigator; False: there is no guard, or it could not."""
    try:
        return client.ask(folders.control, {"verb": "investigate"}, START_S).get("ok") is True
    except client.Unreachable:
        return False


def _listens(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
    return True


def _wait_for(child: "subprocess.Popen[bytes]", path: Path) -> None:
    """Wait until it listens. Raises Unreachable with its own last words."""
    deadline = time.monotonic() + START_S
    while not _listens(path):
        if child.poll() is not None or time.monotonic() > deadline:
            child.kill()
            words = child.communicate()[1].decode("utf-8", "replace").strip().splitlines()
            raise Unreachable(words[-1] if words else "no answer")
        time.sleep(0.02)


def _end(child: "subprocess.Popen[bytes]") -> None:
    child.terminate()
    try:
        child.communicate(timeout=END_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
