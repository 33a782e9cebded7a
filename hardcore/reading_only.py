"""`hardcore safe-mode`: have the ledger served to read only, for as long as the operator wants, and end that.

What is wanted lies on the disk before anybody is told, so it outlives every core, guard and reboot. With everything
stopped it is written there all the same, and holds from the next start on.
"""

import click

from frontend.catalogue_operator import operator_text
from hardcore import standing
from hardcore.asked import Asked, is_held, operator, status_of, until
from hardcore.model.phases import Wanted

#: A core that serves is told within milliseconds; one that is to write again tries a write of its own first.
SWITCHED_S = 15.0


@click.command("safe-mode")
@click.argument("wish", type=click.Choice(["on", "off"]))
@click.option("--reason", default="", help="Why; it stands in status and history.")
@operator
def safe_mode(asked: Asked, wish: str, reason: str) -> None:
    """Serve reads only (on) or everything again (off). It stays so over restarts until you say otherwise."""
    on = wish == "on"
    if not is_held(asked.folders):
        _write_down(asked, reason, on=on)
        return
    answer = asked.ask(verb="safe-mode", on=on, reason=reason)
    if not answer.get("changed"):
        _say(asked, "safe_already")
    reached = until(lambda: _is_so(asked, on=on), SWITCHED_S)
    told = status_of(asked)
    if answer.get("changed"):
        key = "safe_on" if on else "safe_off"
        _say(asked, key if reached else f"{key}_asked", state=told["state"])
    asked.tell({"ok": True, "changed": answer.get("changed"), "safe": told["safe"], "state": told["state"]})


def _is_so(asked: Asked, *, on: bool) -> bool:
    told = status_of(asked)
    return bool(told["core"]["ready"]) and (told["safe"] is not None) == on


def _write_down(asked: Asked, reason: str, *, on: bool) -> None:
    folders = asked.folders
    if not folders.state.is_dir():
        asked.fail(asked.words("nothing_there"))
    try:
        changed = standing.want_safe(folders, reason, on=on)
    except OSError as error:
        asked.fail(asked.words("data_not_written", path=folders.data, why=error.strerror))
    _say(asked, "safe_offline" if changed else "safe_already")
    wanted = str(Wanted.SAFE if on else Wanted.UP)
    asked.tell({"ok": True, "changed": changed, "wanted": wanted, "state": "UNKNOWN"})


def _say(asked: Asked, key: str, **values: object) -> None:
    if not asked.json:
        click.echo(operator_text(key, asked.lang, **values))
