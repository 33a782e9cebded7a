"""What has happened: the commands that read the black boxes. All of them work with everything stopped."""

import sys
from pathlib import Path
from typing import Any

import click
import msgspec
from msgspec import structs

from hardcore.asked import Asked, keep, operator, options, until
from hardcore.replay import Replayed, replay_incident
from hardcore.snapshot.writer import RECORDING
from postmortem import cli as incidents_cli


@click.group(invoke_without_command=True)
@options
@click.pass_context
def incidents(context: click.Context, /, **given: object) -> None:
    """What has happened: list, show ID, export ID --out FILE. Works with everything stopped."""
    keep(context, given)
    if context.invoked_subcommand is None:
        context.invoke(incidents_list, data=None, as_json=False, lang=None)


@incidents.command("list")
@operator
def incidents_list(asked: Asked) -> None:
    """List the incidents, newest first."""
    found = [item for place in places(asked) for item in incidents_cli.list_incidents(place, asked.lang)]
    items = sorted({item["id"]: item for item in found}.values(), key=lambda item: item["id"], reverse=True)
    asked.tell(items)
    if not asked.json:
        incidents_cli.print_list(items, asked.lang, sys.stdout.write)


@incidents.command("show")
@click.argument("incident")
@operator
def incidents_show(asked: Asked, incident: str) -> None:
    """Tell one incident: what happened, when, why, and what became of each request."""
    story = incidents_cli.show_incident(place_of(asked, incident), incident, asked.lang)
    if not isinstance(story, dict):
        asked.fail(story.sentence)
    asked.tell(story)
    if not asked.json:
        incidents_cli.print_show(story, asked.lang, sys.stdout.write)


@incidents.command("export")
@click.argument("incident")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="A .md, .json, .html or .zip file.",
)
@operator
def incidents_export(asked: Asked, incident: str, out: Path) -> None:
    """Write one incident to a file, in the form that its ending names."""
    refused = incidents_cli.export(place_of(asked, incident), incident, out, asked.lang)
    if refused is not None:
        asked.fail(refused.sentence)
    asked.say("exported", path=out)
    asked.tell({"ok": True, "path": str(out)})


def places(asked: Asked) -> tuple[Path, Path]:
    """Where incidents are: what their disk does not take is kept in the first, and home in the second counts more."""
    return asked.folders.shelter, asked.folders.incidents


def place_of(asked: Asked, incident: str) -> Path:
    """Return the folder in which an incident's own folder lies."""
    shelter, home = places(asked)
    if isinstance(incidents_cli.find_incident(home, incident), incidents_cli.Refused):
        kept = incidents_cli.find_incident(shelter, incident)
        return home if isinstance(kept, incidents_cli.Refused) else shelter
    return home


@click.command()
@click.argument("incident")
@operator
def replay(asked: Asked, incident: str) -> None:
    """Give an incident's recorded facts to the same code again: would it do the same?

    Exit code 0: every order is the same. 1: another order, or a record that can't be read.
    """
    folder = incidents_cli.find_incident(place_of(asked, incident), incident, asked.lang)
    if isinstance(folder, incidents_cli.Refused):
        asked.fail(folder.sentence)
    if not (folder.path / RECORDING).exists():
        asked.fail(asked.words("replay_missing", incident=folder.id))
    found = replay_incident(folder.path)
    if not isinstance(found, Replayed):
        asked.fail(asked.words("replay_damaged", incident=folder.id, file=RECORDING, why=found))
    other = found.first_difference
    asked.say("replay_same" if found.same else "replay_other", facts=found.facts, orders=found.orders)
    if other is not None:
        asked.say("replay_where", **structs.asdict(other))
    asked.tell({"ok": found.same, "incident": folder.id, **msgspec.to_builtins(found)})
    sys.exit(0 if found.same else 1)


def told_incident(asked: Asked, incident: str) -> dict[str, Any]:
    """Return one incident as it is told, once it is written and closed; end with a sentence if it can't be."""
    found: dict[str, Any] | incidents_cli.Refused = {}

    def there() -> bool:
        nonlocal found
        found = incidents_cli.show_incident(asked.folders.incidents, incident, asked.lang)
        return isinstance(found, dict) and found["closed_at"] is not None

    until(there)
    if not isinstance(found, dict):
        asked.fail(found.sentence)
    return found
