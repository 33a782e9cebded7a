"""`hardcore restart`: another core, and what was done, in words.

A core that waits takes over, once it runs the code that lies on the disk: so an update is a restart. Waiting for it is
the guard's business, not this command's: Ctrl-C ends the looking and leaves the wish standing, because who has asked
for an update wants it done, and to take it back would need a word that nobody knows when his terminal is gone. Code
that does not start is told with what the spare said last; the core that serves was never asked to leave.
"""

from collections.abc import Mapping
from typing import Any

import click

from frontend.catalogue_operator import operator_text
from hardcore.asked import Asked, come_back, next_words, operator, status_of
from hardcore.looking_back import told_incident
from hardcore.model.phases import Phase
from hardcore.recovery.spare import Lack
from hardcore.status_page import PROVEN

#: A spare may take two starts before the guard gives up on it, then comes the switch and its probation.
SWITCH_S = 180.0


@click.command()
@click.option("--reason", default="", help="Why; it stands in the report.")
@click.option("--hard", is_flag=True, help="Kill the core instead of letting it finish.")
@click.option("--component", default="", help="Start this part of the core anew, and nothing else.")
@click.option(
    "--image", is_flag=True, help="Keep the old core's whole memory (policy: memory_image on_request)."
)
@operator
def restart(asked: Asked, reason: str, component: str, *, hard: bool, image: bool) -> None:
    """Start a new core, with the code that lies on the disk now. Requests wait meanwhile; none is lost."""
    if component:
        if hard or image:
            raise click.UsageError("--component stands alone: neither --hard nor --image goes with it.")
        _restart_part(asked, component, reason)
        return
    first = status_of(asked)
    before, sentinel = _core_of(first), first["sentinel"]["pid"]
    answer = asked.ask(verb="restart", reason=reason, hard=hard or image, image=image)
    asked.say(_begun(answer))
    told = come_back(
        asked,
        lambda told: (
            _is_another(told, before) or _refused(told, before) or _forgotten(told, before, sentinel)
        ),
        SWITCH_S,
        "switch_left" if answer.get("waits") else "goes_on",
    )
    if _refused(told, before):
        asked.fail(_why_refused(asked, told))
    if _forgotten(told, before, sentinel):
        asked.fail(asked.words("switch_forgotten"))
    told = come_back(asked, lambda told: _is_another(told, before) and told["phase"] in PROVEN)
    step = next_words(told, asked.lang)
    if not _is_another(told, before):
        why = asked.why(told["start_fault"])
        asked.fail(asked.words("not_back_why" if why else "not_back", next=step, why=why))
    incident = answer.get("incident") or told["last_incident"]
    outage_ms = told_incident(asked, str(incident))["outage_ms"] if incident else None
    shown = "-" if outage_ms is None else f"{outage_ms:.0f}"
    said = "restarted_to_read" if told["safe"] else "restarted"
    asked.say(said, ms=shown, incident=incident or "-", next=step)
    asked.tell({"ok": True, "incident": incident, "safe": told["safe"], "outage_ms": outage_ms})


def _restart_part(asked: Asked, component: str, reason: str) -> None:
    """Have one part started anew, and say whether it was."""
    answer = asked.ask(verb="restart", component=component, reason=reason)
    if not answer.get("done"):
        asked.fail(operator_text("part_not_restarted", asked.lang, component=component))
    if not asked.json:
        click.echo(operator_text("part_restarted", asked.lang, component=component))
    asked.tell({"ok": True, "component": component, "incident": answer.get("incident")})


def _begun(answer: Mapping[str, Any]) -> str:
    """Return what to say of the guard's answer."""
    if answer.get("changed"):
        return "switching" if answer.get("phase") == Phase.DRAINING else "restarting"
    if answer.get("waits"):
        return "awaits_update" if answer.get("updates") else "awaits_spare"
    return "starting_already"


def _refused(told: Mapping[str, Any], before: tuple[object, object]) -> bool:
    """Tell whether the guard has given the switch up and the core that was to be changed serves on."""
    serves_on = bool(told["core"]["ready"]) and _core_of(told) == before
    return serves_on and bool(told["switch_fault"]) and not told["switch_waits"]


def _why_refused(asked: Asked, told: Mapping[str, Any]) -> str:
    log = asked.folders.logs / "core.log"
    words = asked.words("switch_refused", why=asked.why(told["switch_fault"]), log=log)
    unspared = told["spare_lack"] == Lack.DIED
    return f"{words}\n{asked.words('switch_unspared')}" if unspared else words


def _forgotten(told: Mapping[str, Any], before: tuple[object, object], sentinel: object) -> bool:
    """Tell whether another guard has taken over, and goes on with the core that was to be changed."""
    followed = told["sentinel"]["pid"] not in {None, sentinel}
    goes_on = told["phase"] in PROVEN and not told["switch_waits"] and not _is_another(told, before)
    return followed and goes_on


def _core_of(told: Mapping[str, Any]) -> tuple[object, object]:
    """Return which core it is; the number of a process alone may be given again."""
    return told["core"]["pid"], told["core"]["epoch"]


def _is_another(told: Mapping[str, Any], before: tuple[object, object]) -> bool:
    """Tell whether another core serves than the one before, whatever other trouble may be open."""
    return bool(told["core"]["ready"]) and _core_of(told) != before
