"""Letters as the guard writes them, for the tests of what becomes of them."""

import base64
import json
from typing import Any


def request_case(body: object, **more: Any) -> dict[str, Any]:
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    request = {
        "method": "POST",
        "path": "/api/ledger/transactions",
        "headers": [["Content-Type", "application/json"], ["Cookie", "canary"], ["Authorization", "canary"]],
        "body": base64.b64encode(data).decode(),
    }
    return {"name": "a" * 32, "request": request | more}


def posting(amount: str, currency: str = "KRW") -> dict[str, str]:
    return {"account": "assets:cash", "amount": amount, "currency": currency}


def slip(number: int = 1, **fields: Any) -> dict[str, Any]:
    """The fields of a letter; the letters of two numbers are those of two requests."""
    return {
        "id": f"0199{number:04x}-0000-7000-8000-000000000000",
        "state": "QUARANTINED",
        "reason": "CRASHED_CORE",
        "name": f"{number:032x}",
        "command_id": f"c{number}",
        "idempotency_key": f"k{number}",
        "kind": "transaction.post",
        "source": "browser:0123456789abcdef",
        "account_ids": ["assets:cash", "expenses:food"],
        "transaction_id": f"t{number}",
        "fingerprint": f"{number:064x}",
        "digest": f"{number + 1:064x}",
        "incident_ids": ["i1"],
        "deaths": 1,
        "quarantined_at": f"2026-11-22T14:00:{number % 60:02d}.000Z",
        "case": request_case({"postings": [posting("12000"), posting("-12000")]}),
        "trial": {"ordeal": "died", "exit": {"signal": 11, "code": None}, "frame": "f (x.py:1)"},
    } | fields
