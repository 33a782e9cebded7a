"""The gateway looks a suspect up in a real core: both make the same digest of the same request."""

import json
from pathlib import Path

from tests.contract.gateway_world import Client, World, key_hash, silent, world
from tests.integration.lone_core import Core, moving, ready, started

POST = "/api/ledger/transactions"
CLOSE = "/api/ledger/accounts/assets%3Aold/close?by=hand"  # no other spelling of a path is the same request


def _known(core: Core) -> None:
    """What the ledger holds: K and C are carried out."""
    for name in ("a", "b", "assets:old"):
        assert core.open(name).status == 201
    assert core.move(5, "a", "b", Idempotency_Key="K").status == 201
    assert core.ask("POST", CLOSE, Idempotency_Key="C").status == 200


def _asked(w: World, path: str, key: str, body: object = None) -> Client:
    data = b"" if body is None else json.dumps(body).encode()
    return w.client().ask("POST", path, f"Idempotency-Key: {key}", body=data)


def test_only_the_very_request_that_was_carried_out_is_told_the_stored_answer(tmp_path: Path) -> None:
    with started(tmp_path / "data", sock=tmp_path / "real") as core, world(tmp_path, hold_ms=3000) as w:
        _known(ready(core))
        dying = w.serving(silent, epoch=0)
        same = _asked(w, POST, "K", moving(5, "a", "b"))
        other = _asked(w, POST, "K", moving(6, "a", "b"))
        closed = _asked(w, CLOSE, "C")
        absent = _asked(w, POST, "N", moving(5, "a", "b"))
        dying.wait(POST, 3)
        dying.wait(CLOSE)
        w.die(dying)
        w.feed.say("suspects", keys=[key_hash(key) for key in "KCN"])
        w.feed.say("serving", socket=str(tmp_path / "real"), epoch=1)
        w.feed.say("release", epoch=1, incident="i1")
        w.feed.phase("FORWARD")
        assert (told := same.read()).status == 201
        assert told.header("Idempotent-Replayed") == "true"
        assert closed.read().status == 200
        assert absent.read().json()["outcome"] == "not_done"
        unknown = other.read()
        assert (unknown.status, unknown.json()["outcome"]) == (503, "unknown")
        # What the text for it advises: the request itself, sent again, is told the truth.
        assert _asked(w, POST, "K", moving(6, "a", "b")).read().json()["type"] == "/problems/key-reused"
