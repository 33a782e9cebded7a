"""The words about the policy: is a file right, what holds now, and what would be done on a diagnosis.

All of them but the reload work with everything stopped. What is in force is asked of the guard that runs: it may go by
a mode of this run alone, or by the policy before a faulty one. What is explained is read off the same words and numbers
that it goes by, and a dry run gives the recorded facts to the same code.
"""

import json
import sys
from pathlib import Path

import click

from frontend.catalogue_operator import operator_text
from frontend.catalogue_policy import diagnosis_words, explained, note_words
from hardcore import standing
from hardcore import up as starting
from hardcore.alerting.over_apprise import is_installed
from hardcore.asked import Asked, ask_policy, keep, operator, options
from hardcore.lines import wrapped
from hardcore.looking_back import places
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.channels import Kind, as_shown
from hardcore.recovery.differing import differences, flat
from hardcore.recovery.explain import explain
from hardcore.recovery.policy import Policy, in_full
from hardcore.replay import compare_incident
from hardcore.snapshot.writer import RECORDING
from postmortem import cli as incidents_cli

USAGE = 2
#: A dry run is held against so many incidents, the newest.
DRY_INCIDENTS_MAX = 20
#: Of a name that is none, so much is shown.
NAME_CHARACTERS_MAX = 40


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
    notes = [note_words(name, asked.lang) for name in _notes(found)]
    if not asked.json:
        for note in notes:
            click.echo(f"  {wrapped(note, 2)}")
    asked.tell({"ok": True, "notes": notes})


def _notes(found: Policy) -> list[str]:
    """Return what a policy leaves out that somebody would miss, by the names of its texts."""
    mode = [] if found.mode == "act" else [found.mode]
    if any(one.kind is Kind.APPRISE for one in found.alerts) and not is_installed():
        mode.append("no_apprise")
    return mode if found.alerts else [*mode, "no_channels"]


@policy.command("show")
@click.option("--file", "of_file", is_flag=True, help="What the data folder's file says, in force or not.")
@click.option("--defaults", is_flag=True, help="Every number and action as it is without a file.")
@operator
def policy_show(asked: Asked, *, of_file: bool, defaults: bool) -> None:
    """Show the policy in force: what the running guard goes by, or what the next one would."""
    found = Policy() if defaults else _of_file(asked) if of_file else _in_force(asked)
    shown = {**in_full(found), "alerts": [as_shown(one) for one in found.alerts]}
    click.echo(json.dumps(shown, ensure_ascii=False, indent=2))


def _of_file(asked: Asked) -> Policy:
    path = asked.folders.policy
    found = standing.load_policy_file(path)
    if not path.exists():
        asked.fail(asked.words("policy_none", path=path))
    if not isinstance(found, Policy):
        asked.fail(starting.policy_faults(path, found, asked.lang))
    return found


def _in_force(asked: Asked) -> Policy:
    """Return the policy in force, and say beside it where it is not the file's."""
    found, coming = ask_policy(asked.folders), standing.policy_at_next_start(asked.folders)
    if asked.folders.policy.exists() and coming.fault:
        _note(asked, "policy_kept", path=asked.folders.policy)
    elif found is None:
        _note(asked, "policy_of_next_start")
    elif in_full(found) != in_full(coming.policy):
        _note(asked, "policy_changed")
    return found or coming.policy


@policy.command("reload")
@operator
def policy_reload(asked: Asked) -> None:
    """Have the running guard read its policy file now; say what changed, and what of it holds only later."""
    answer = asked.ask(verb="policy-reload")
    asked.tell(answer)
    if asked.json:
        return
    changed, later = ", ".join(answer["changed"]), ", ".join(answer["later"])
    click.echo(wrapped(_said("policy_reloaded" if changed else "policy_same", asked, changed=changed)))
    if later:
        click.echo(wrapped(_said("policy_holds_later", asked, later=later)))


@policy.command("dry-run")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@operator
def policy_dry_run(asked: Asked, file: Path) -> None:
    """Say what another policy would have done: which words and numbers differ, and where an incident would have."""
    found = standing.load_policy_file(file)
    if not isinstance(found, Policy):
        asked.fail(starting.policy_faults(file, found, asked.lang))
    words = _other_words(_in_force(asked), found)
    held_against = [_held_against(asked, found, *one) for one in _recorded(asked)]
    asked.tell({"ok": True, "differences": words, "incidents": held_against})
    if asked.json:
        return
    click.echo(_said("dry_words" if words else "dry_same_words", asked))
    for name, (before, after) in words.items():
        click.echo(f"  {name}: {before} -> {after}")
    for one in held_against:
        click.echo(_said(str(one["said"]), asked, **one))
    click.echo(_said("dry_beyond" if held_against else "dry_none", asked))


def _said(key: str, asked: Asked, **values: object) -> str:
    return operator_text(key, asked.lang, **values)


def _other_words(before: Policy, after: Policy) -> dict[str, list[object]]:
    """Return the settings that two policies have otherwise, by their names: what is in force, what would be."""
    old, new = flat(in_full(before)), flat(in_full(after))
    return {name: [old.get(name), new.get(name)] for name in differences(before, after) if name in new}


def _recorded(asked: Asked) -> list[tuple[str, str, Path]]:
    """Return the newest incidents that were recorded: name, diagnosis, folder."""
    found = {}
    for place in places(asked):
        for item in incidents_cli.list_incidents(place, asked.lang)[:DRY_INCIDENTS_MAX]:
            folder = place / str(item["id"])
            if (folder / RECORDING).exists():
                found[str(item["id"])] = (str(item["id"]), str(item["diagnosis"]), folder)
    return [found[name] for name in sorted(found, reverse=True)][:DRY_INCIDENTS_MAX]


def _held_against(
    asked: Asked, policy: Policy, incident: str, diagnosis: str, folder: Path
) -> dict[str, object]:
    came = compare_incident(folder, policy)
    told: dict[str, object] = {"incident": incident, "diagnosis": diagnosis}
    if isinstance(came, str):
        return {**told, "said": "dry_incident_unreadable", "why": came}
    if came.fact is None:
        return {**told, "said": "dry_incident_same"}
    nothing = _said("dry_nothing", asked)
    deeds = {"does": ", ".join(came.does) or nothing, "would": ", ".join(came.would) or nothing}
    return {**told, "said": "dry_incident_other", "fact": came.fact, **deeds}


def _note(asked: Asked, key: str, **values: object) -> None:
    click.echo(wrapped(asked.words(key, **values)), err=True)


@policy.command("explain")
@click.argument("diagnosis", required=False)
@operator
def policy_explain(asked: Asked, diagnosis: str | None) -> None:
    """Say what would be done on a DIAGNOSIS: after how long, what, and who would be suspect.

    Without one: the diagnoses that there are.
    """
    if diagnosis is None:
        _list_diagnoses(asked)
        return
    name = diagnosis.upper().replace("-", "_")
    if name not in Diagnosis.__members__:
        asked.fail(asked.words("no_diagnosis", name=_shown(diagnosis)), USAGE)
    lines = explain(_in_force(asked), Diagnosis(name))
    words = [explained(line.said, dict(line.numbers), asked.lang) for line in lines]
    if not asked.json:
        title = f"{name}: {diagnosis_words(name, asked.lang)}"
        click.echo("\n".join([title, *(f"  {wrapped(line, 2)}" for line in words)]))
    asked.tell(
        {
            "diagnosis": name,
            "lines": [
                {"said": line.said, "text": text, **dict(line.numbers)}
                for line, text in zip(lines, words, strict=True)
            ],
        }
    )


def _shown(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name[:NAME_CHARACTERS_MAX])


def _list_diagnoses(asked: Asked) -> None:
    names = {str(one): diagnosis_words(one, asked.lang) for one in Diagnosis}
    if not asked.json:
        width = max(map(len, names))
        click.echo("\n".join(f"{name:<{width}}  {words}" for name, words in names.items()))
    asked.tell([{"diagnosis": name, "text": words} for name, words in names.items()])
