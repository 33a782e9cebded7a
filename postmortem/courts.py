"""Tries a letter's request in a throw-away core on a copy of the ledger: the dry run.

The court is a child, `python -m core try` (`docs/wires.md` section 12), one at a time, bounded in time, in memory and in what it
may say; nothing of what it does is kept. Asking the serving core to roll back was not chosen: what is tried here has killed
a core before.
"""

import asyncio
import contextlib
import json
import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from postmortem import placing
from postmortem.views import DryRun

DOCKET_VERSION: Final = 1
LINE_BYTES_MAX: Final = 4 << 20
LINES_MAX: Final = 1_000
ANSWER_CHARACTERS_MAX: Final = 65_536
WORDS_BYTES_MAX: Final = 4_096
#: After TERM, so long until it is killed.
END_S: Final = 5.0


class Limits(msgspec.Struct, frozen=True):
    """What one dry run may take. `copy_s`: until its ledger is copied and its core has begun."""

    limit_ms: int = 15_000
    memory_bytes: int = 1 << 30
    copy_bytes_max: int = 2 << 30
    copy_s: float = 60.0


class Court(msgspec.Struct, frozen=True):
    """The court of one data folder."""

    data: Path
    limits: Limits = msgspec.field(default_factory=Limits)
    _one: asyncio.Lock = msgspec.field(default_factory=asyncio.Lock)

    async def try_case(self, case: Mapping[str, Any], name: str) -> DryRun:
        """Try one case and say what it did; what stood in the way is the ordeal `untried` with its why."""
        async with self._one:
            docket = self.data / "state" / f"dry-run-{os.getpid()}.json"
            try:
                placing.replace(docket.parent, docket.name, json.dumps(self._docket(case, name)).encode())
                return await self._hear(docket, name)
            except OSError as error:
                return _untried(placing.why(error, "the throw-away core could not be started"))
            finally:
                with contextlib.suppress(OSError):
                    docket.unlink(missing_ok=True)

    def _docket(self, case: Mapping[str, Any], name: str) -> dict[str, Any]:
        matter = {key: case[key] for key in ("request", "row", "events") if key in case}
        return {
            "version": DOCKET_VERSION,
            "limit_ms": self.limits.limit_ms,
            "memory_bytes": self.limits.memory_bytes,
            "copy_bytes_max": self.limits.copy_bytes_max,
            "cases": [{"name": name, **matter}],
        }

    async def _hear(self, docket: Path, name: str) -> DryRun:
        argv = ["-I", "-m", "core", "try", "--data", str(self.data), "--docket", str(docket)]
        child = await asyncio.create_subprocess_exec(
            sys.executable,
            *argv,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            limit=LINE_BYTES_MAX,
            start_new_session=True,
            # What the guard says to its own cores is not meant for this one.
            env={name: value for name, value in os.environ.items() if not name.startswith("HARDCORE_")},
        )
        assert child.stdout is not None
        assert child.stderr is not None
        words = asyncio.create_task(_last_words(child.stderr))
        verdict: DryRun | None = None
        try:
            async with asyncio.timeout(self.limits.copy_s + self.limits.limit_ms / 1000):
                verdict = await _verdict(child.stdout, name)
                await child.wait()
        except (TimeoutError, ValueError):
            verdict = verdict or _untried("the throw-away core said nothing in its time")
        finally:
            await _end(child)
            said = await words
        return verdict or _untried(said or f"the throw-away core ended with {child.returncode}")


async def _verdict(stdout: asyncio.StreamReader, name: str) -> DryRun | None:
    """Read until the case's line; the rest is read too, so that nobody writes into a full pipe."""
    verdict = None
    for _ in range(LINES_MAX):
        line = await stdout.readline()
        if not line:
            break
        told = _object(line)
        if told.get("type") == "tried" and told.get("name") == name:
            verdict = read_tried(told)
    return verdict


def read_tried(told: Mapping[str, Any]) -> DryRun:
    """What a court's line says of a case, bounded, whatever stands in it."""
    status, took, answer = told.get("status"), told.get("ms"), told.get("answer")
    if len(json.dumps(answer)) > ANSWER_CHARACTERS_MAX:
        answer = None
    ending = told.get("exit")
    ending = ending if isinstance(ending, dict) else {}
    end = f"signal {ending['signal']}" if ending.get("signal") else ""
    parts = [end, *(str(told.get(name) or "")[:512] for name in ("frame", "why"))]
    return DryRun(
        at=placing.now(),
        ordeal=str(told.get("ordeal"))[:32],
        status=status if isinstance(status, int) else None,
        took_ms=took if isinstance(took, int) else 0,
        answer=answer,
        why="; ".join(part for part in parts if part),
    )


def _untried(why: str) -> DryRun:
    return DryRun(placing.now(), "untried", None, 0, None, why)


def _object(line: bytes) -> dict[str, Any]:
    try:
        told = json.loads(line)
    except (ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}


async def _last_words(stderr: asyncio.StreamReader) -> str:
    """The last line it said on standard error, all of which is read."""
    kept = b""
    while part := await stderr.read(WORDS_BYTES_MAX):
        kept = (kept + part)[-WORDS_BYTES_MAX:]
    lines = kept.decode("utf-8", "replace").strip().splitlines()
    return lines[-1][:512] if lines else ""


async def _end(child: asyncio.subprocess.Process) -> None:
    """End the court and all of its session, if it has not ended."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        if child.returncode is not None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, sign)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(END_S):
                await child.wait()
