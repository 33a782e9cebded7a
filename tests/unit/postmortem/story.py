"""One whole story, as the guard writes it, for the tests of everything that reads it."""

from typing import Any

ID = "0199a000-0000-7000-8000-00000000000c"


def facts(**other: Any) -> dict[str, Any]:
    """The facts of a core that was killed from outside, with `other` in the place of some of them."""
    return {
        "version": 1,
        "id": ID,
        "opened_at": "2026-11-21T14:08:15.000Z",
        "closed_at": "2026-11-21T14:08:18.500Z",
        "outcome": "recovered",
        "diagnosis": "KILLED_FROM_OUTSIDE",
        "grade": "certain",
        "evidence": [{"kind": "death", "text": "SIGKILL that nobody here sent"}],
        "planned": False,
        "drill": None,
        "reason": None,
        "timeline": [
            {"at": "2026-11-21T14:08:15.000Z", "offset_ms": 0.0, "step": "fault"},
            {"at": "2026-11-21T14:08:15.001Z", "offset_ms": 0.8, "step": "detected"},
            {"at": "2026-11-21T14:08:15.912Z", "offset_ms": 912.3, "step": "serving"},
        ],
        "detected_ms": 0.8,
        "outage_ms": 912.3,
        "core": {"pid": 101, "nonce": "n", "epoch": 7, "exit": {"signal": 9}},
        "last_words": None,
        "in_flight": [
            command("cmd-2", "QUEUED", "tx-2", ["assets:cash"], "b" * 32),
            command("cmd-1", "DECIDING", "tx-1", ["assets:bank:kb", "expenses:food"], "a" * 32),
        ],
        "suspects": [],
        "requests": [
            {
                "method": "POST",
                "path": "/api/ledger/transactions",
                "key_hash": "a" * 32,
                "outcome": "replayed",
                "status": 201,
                "held_ms": 900,
            }
        ],
        "proof": {"kind": "witness", "tail": 12, "seq": 40, "epoch": 8, "hash": "ff", "witness_seq": 39},
        "deaths": [
            {"at": "2026-11-21T14:08:15.000Z", "diagnosis": "KILLED_FROM_OUTSIDE", "exit": {"signal": 9}}
        ],
        "next_epoch": 8,
        **other,
    }


def command(
    command_id: str, stage: str, transaction_id: str, account_ids: list[str], key_hash: str
) -> dict[str, Any]:
    """A command in flight."""
    return {
        "command_id": command_id,
        "kind": "transaction.post",
        "stage": stage,
        "transaction_id": transaction_id,
        "account_ids": account_ids,
        "key_hash": key_hash,
        "age_ms": 3,
    }


def frame(name: str, line: int = 1, file: str = "core/x.py", **shown: str) -> dict[str, Any]:
    """A frame of a `stacks.json`."""
    local = [{"name": key, "repr": text, "addr": 1, "arg": False} for key, text in shown.items()]
    return {
        "name": name,
        "filename": f"/somewhere/{file}",
        "short_filename": file,
        "line": line,
        "locals": local,
    }


def thread(
    tid: int, *frames: dict[str, Any], name: str = "MainThread", active: bool = False
) -> dict[str, Any]:
    """A thread of a `stacks.json`, the innermost frame first."""
    return {
        "os_thread_id": tid,
        "thread_name": name,
        "active": active,
        "owns_gil": False,
        "frames": list(frames),
    }
