"""The words about the policy: is a file right, what holds now, and what would be done on a diagnosis.

All of them work with everything stopped; what is explained is read off the same words and numbers that the guard
goes by.
"""

import json
import sys
from pathlib import Path

import click

from frontend.catalogue_policy import explained
from hardcore import standing
from hardcore import up as starting
from hardcore.asked import Asked, keep, operator, options
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.explain import explain
from hardcore.recovery.policy import Policy, in_full, notes


@click.group()
@options
@click.pass_context
def policy(context: click.Context, /, **given: object) -> None:
    """The failover policy."""
    keep(context, given)


@policy.command("check")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@operator
def policy_check(asked: Asked, file: Path) -> None:
    """Check a policy file; every fault with its line and reason."""
    found = standing.load_policy_file(file)
    if not isinstance(found, Policy):
        asked.tell(
            {"ok": False, "faults": [{"line": f.line, "name": f.name, "reason": f.reason} for f in found]}
        )
        if not asked.json:
            click.echo(starting.policy_faults(file, found, asked.lang), err=True)
        sys.exit(1)
    asked.say("policy_good", path=file)
    if not asked.json:
        for note in notes(found):
            click.echo(f"  {note}")
    asked.tell({"ok": True, "notes": notes(found)})


@policy.command("show")
@click.option("--defaults", is_flag=True, help="Every number and action as it is without a file.")
@operator
def policy_show(asked: Asked, *, defaults: bool) -> None:
    """Show the policy in force, or all that holds without one."""
    found = Policy() if defaults else standing.policy_in_force(asked.folders).policy
    click.echo(json.dumps(in_full(found), ensure_ascii=False, indent=2))


@policy.command("explain")
@click.argument("diagnosis", metavar="DIAGNOSIS", type=click.Choice(list(Diagnosis), case_sensitive=False))
@operator
def policy_explain(asked: Asked, diagnosis: str) -> None:
    """Say what would be done on a diagnosis: after how long, what, and who would be suspect."""
    lines = explain(standing.policy_in_force(asked.folders).policy, Diagnosis(diagnosis))
    words = [explained(line.said, dict(line.numbers), asked.lang) for line in lines]
    if not asked.json:
        click.echo(f"{diagnosis}\n" + "\n".join(f"  {line}" for line in words))
    asked.tell(
        {
            "diagnosis": diagnosis,
            "lines": [
                {"said": line.said, "text": text, **dict(line.numbers)}
                for line, text in zip(lines, words, strict=True)
            ],
        }
    )
