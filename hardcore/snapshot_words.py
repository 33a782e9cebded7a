"""`hardcore snapshot`: the evidence that is kept of each incident, what is in it, and its removal.

Listing and showing read the folders, so they work with everything stopped. Removing is the investigators' deed, because
they keep the record of who removed what; the story of the incident stays.
"""

from pathlib import Path
from typing import Any

import click

from frontend.catalogue_operator import operator_text
from hardcore.asked import Asked, keep, operator, options
from hardcore.investigator_line import Unreachable, investigator
from hardcore.looking_back import place_of, places
from postmortem import cli as incidents_cli

FILES_MAX = 4096
#: Made of the facts and not of the evidence: what stays when that is removed.
STORY = frozenset({"incident.json", "report.json", "report.md", "report.html"})


@click.group()
@options
@click.pass_context
def snapshot(context: click.Context, /, **given: object) -> None:
    """The evidence of incidents: list, show ID, delete ID."""
    keep(context, given)


@snapshot.command("list")
@operator
def snapshot_list(asked: Asked) -> None:
    """List what evidence is kept, newest first."""
    kept: dict[str, dict[str, Any]] = {}
    for place in places(asked):
        for item in incidents_cli.list_incidents(place, asked.lang):
            files = _files(place / str(item["id"]))
            if files:
                kept[item["id"]] = {
                    "id": item["id"],
                    "diagnosis": item["diagnosis"],
                    "files": len(files),
                    "bytes": sum(files.values()),
                    "complete": item["evidence_complete"],
                }
    told = [kept[name] for name in sorted(kept, reverse=True)]
    asked.tell(told)
    if not asked.json:
        for one in told:
            click.echo(
                f"{one['id']}  {one['diagnosis']:<20}  {one['files']:>3}  {one['bytes'] // 1024:>7} KiB"
            )
        if not told:
            click.echo(operator_text("snapshots_none", asked.lang))


@snapshot.command("show")
@click.argument("incident")
@operator
def snapshot_show(asked: Asked, incident: str) -> None:
    """Show which files the evidence of an incident is made of."""
    found = incidents_cli.find_incident(place_of(asked, incident), incident, asked.lang)
    if isinstance(found, incidents_cli.Refused):
        asked.fail(found.sentence)
    files = _files(found.path)
    asked.tell({"id": found.id, "path": str(found.path), "files": files})
    if not asked.json:
        click.echo(str(found.path))
        for name, size in files.items():
            click.echo(f"  {name:<28} {size:>10}")


@snapshot.command("delete")
@click.argument("incident")
@click.option("--yes", is_flag=True, help="Remove it: it does not come back.")
@operator
def snapshot_delete(asked: Asked, incident: str, *, yes: bool) -> None:
    """Remove the evidence of an incident; its story stays."""
    found = incidents_cli.find_incident(place_of(asked, incident), incident, asked.lang)
    if isinstance(found, incidents_cli.Refused):
        asked.fail(found.sentence)
    if not yes:
        asked.fail(operator_text("snapshot_sure", asked.lang, incident=found.id))
    try:
        with investigator(asked.folders, asked.lang) as line:
            answer = line.post(f"incidents/{found.id}/remove-evidence", {})
    except Unreachable as error:
        asked.fail(asked.words("refused", why=str(error)))
    if not answer.ok:
        asked.fail(asked.words("refused", why=answer.told.get("detail") or answer.told.get("title") or ""))
    if not asked.json:
        click.echo(operator_text("snapshot_gone", asked.lang, incident=found.id))
    asked.tell({"ok": True, "incident": found.id})


def _files(folder: Path) -> dict[str, int]:
    """Return the files of evidence in a folder with their sizes, without the story that is told of it."""
    found: dict[str, int] = {}
    try:
        for path in sorted(folder.iterdir())[:FILES_MAX]:
            if path.name not in STORY and not path.name.startswith(".") and path.is_file():
                found[path.name] = path.stat().st_size
    except OSError:
        return found
    return found
