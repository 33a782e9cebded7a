"""`hardcore verify`: proves the whole ledger, asked of the core that serves it, or made here when none does."""

import http.client
import json
import subprocess
import sys
from typing import Any

import click

from frontend.catalogue import text
from hardcore.asked import Asked, operator, status_of
from hardcore.host.local_http import ask

VERIFY_TIMEOUT_S = 600.0


@click.command()
@click.option("--quick", is_flag=True, help="Only what came after the newest good checkpoint.")
@operator
def verify(asked: Asked, *, quick: bool) -> None:
    """Prove the whole ledger: chain, sums, balances, keys. Works with everything stopped."""
    told = (None if quick else _verify_served(asked)) or _verify_alone(asked, quick=quick)
    asked.tell(told)
    if told.get("ok"):
        asked.say("verify_ok", events=told["events"])
        return
    if not asked.json:
        reason = told.get("reason") or ""
        click.echo(text("verify_bad", asked.lang, seq=told.get("first_bad_seq"), reason=reason), err=True)
    sys.exit(1)


def _verify_served(asked: Asked) -> dict[str, Any] | None:
    """Ask the serving core; None if none serves."""
    told = status_of(asked)
    if not told["core"]["ready"]:
        return None
    try:
        answer = ask(asked.folders.gateway, "GET", "/api/ledger/verify", None, {}, VERIFY_TIMEOUT_S)
    except (OSError, http.client.HTTPException):
        return None
    return answer.told if answer.status == http.HTTPStatus.OK else None


def _verify_alone(asked: Asked, *, quick: bool) -> dict[str, Any]:
    argv = [sys.executable, "-I", "-m", "core", "verify", "--data", str(asked.folders.data), "--json"]
    argv += ["--quick"] if quick else []
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    try:
        found: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        why = (done.stderr.strip().splitlines() or ["no answer"])[-1]
        asked.fail(text("verify_failed", asked.lang, why=why))
    return found
