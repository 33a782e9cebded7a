"""A gateway that keeps cases and goes by rules, and the guard's words to it, for the contract tests of trials."""

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.contract.gateway_world import Client, Core, World, key_hash, silent, world
from tests.contract.receipts_world import Ledger

BODY = b'{"account":"assets:cash"}'
PATH = "/api/ledger/t"
KEY = "Idempotency-Key: "
LETTER = "01939f00-0000-7000-8000-00000000abcd"


@contextlib.contextmanager
def trying(folder: Path, **limits: int) -> Iterator[World]:
    """A world whose gateway keeps cases and goes by rules."""
    (folder / "state").mkdir(exist_ok=True)
    options = ("--state", str(folder / "state"), "--receipts", str(folder / "receipts.db"))
    with world(
        folder, *options, **{"hold_ms": 20_000, "probe_ms": 20, "receipt_pause_ms": 20, **limits}
    ) as w:
        yield w


def rules(w: World, serial: int, *, told: bool = True, **fields: Any) -> None:
    """The guard writes its file, and says so."""
    made = {"version": 1, "serial": serial, "rules": [], "suspects": [], "sources": [], **fields}
    (w.folder / "state" / "quarantine.json").write_text(json.dumps(made))
    if told:
        w.feed.say("quarantine", serial=serial)


def a_letter(**fields: Any) -> dict[str, Any]:
    return {"id": LETTER, "type": "letter", "name": "0" * 32, "digest": None, "fingerprint": None, **fields}


def case_of(w: World, name: str) -> Any:
    """The case that the gateway has told of."""
    w.feed.wait("case", lambda line: line["name"] == name)
    return json.loads((w.folder / "state" / "cases" / f"{name}.json").read_text())


def verdict(w: World, name: str, outcome: str, letter: str | None = None) -> None:
    w.feed.say("verdict", name=name, outcome=outcome, letter=letter, reason=None)


def on_trial(
    w: World, *headers: str, ledger: Ledger | None = None, body: bytes = BODY
) -> tuple[Client, Core, Ledger]:
    """A request under the key `a` that a core died of, and that the next core does not have."""
    core = w.serving(silent)
    client = w.client().ask("POST", PATH, KEY + "a", *headers, body=body)
    core.wait(PATH)
    w.die(core)
    ledger = ledger or Ledger()
    second = w.core(2, ledger)
    w.feed.serve(second, incident="i1", suspects=(key_hash("a"),))
    case_of(w, key_hash("a"))
    return client, second, ledger
