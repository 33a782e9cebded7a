"""What has happened: the commands that read the black boxes. All of them work with everything stopped."""

import sys
from pathlib import Path
from typing import Any

import click

from hardcore.asked import Asked, keep, operator, options, until
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
    items = incidents_cli.list_incidents(asked.folders.incidents, asked.lang)
    asked.tell(items)
    if not asked.json:
        incidents_cli.print_list(items, asked.lang, sys.stdout.write)


@incidents.command("show")
@click.argument("incident")
@operator
def incidents_show(asked: Asked, incident: str) -> None:
    """Tell one incident: what happened, when, why, and what became of each request."""
    story = incidents_cli.show_incident(asked.folders.incidents, incident, asked.lang)
    if not isinstance(story, dict):
        asked.fail(story.sentence)
    asked.tell(story)
    if not asked.json:
        incidents_cli.print_show(story, asked.lang, sys.stdout.write)


@incidents.command("export")
@click.argument("incident")
@click.option(
    "--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="A .md or .json file."
)
@operator
def incidents_export(asked: Asked, incident: str, out: Path) -> None:
    """Write one incident to a file, in the form that its ending names."""
    refused = incidents_cli.export(asked.folders.incidents, incident, out, asked.lang)
    if refused is not None:
        asked.fail(refused.sentence)
    asked.say("exported", path=out)
    asked.tell({"ok": True, "path": str(out)})


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
