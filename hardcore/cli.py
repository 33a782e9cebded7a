"""The operator's words: `hardcore up`, `status`, `restart`, `incidents`, and so on.

Every command asks the running sentinel or reads the files it leaves; none does anything behind its back. What
is printed is for a person, or with `--json` for a program; a refusal is one sentence with the next step, and
never a traceback. Exit codes: 0 fine, 1 failed, 2 usage, 3 on the way, 4 needs a person.

Here are the words of every day; each of the others has a room of its own, which is loaded when its word is said: a person
and a test wait for what they asked, and not for all that could be asked.
"""

import contextlib
import importlib
import sys
import time
from pathlib import Path
from typing import Any, Final

import click
from click.core import ParameterSource

from frontend.catalogue_operator import operator_text
from hardcore import __version__, standing
from hardcore import up as starting
from hardcore.asked import Asked, come_back, door_options, next_words, operator, options, status_of
from hardcore.crisis.history import estimate_score
from hardcore.host.files import read_json
from hardcore.opening import Opening
from hardcore.status_page import PROVEN, printed_status

STATE_CODES = {"OPERATIONAL": 0, "STARTING": 3, "DEGRADED": 3, "RECOVERY": 3, "SAFE_MODE": 3}
NEEDS_A_PERSON = 4

#: Words with a room of their own, and the name there.
ELSEWHERE: Final = {
    "alerts": ("hardcore.alert_words", "alerts"),
    "backup": ("hardcore.keeping_words", "backup"),
    "dlq": ("hardcore.letter_words", "dlq"),
    "down": ("hardcore.stopping", "down"),
    "doctor": ("hardcore.examination", "doctor"),
    "drill": ("hardcore.drilling", "drill"),
    "incidents": ("hardcore.looking_back", "incidents"),
    "journal": ("hardcore.journals.words", "journal"),
    "log": ("hardcore.keeping_words", "log"),
    "logs": ("hardcore.log_words", "logs"),
    "passwd": ("hardcore.access_words", "passwd"),
    "policy": ("hardcore.policy_words", "policy"),
    "replay": ("hardcore.looking_back", "replay"),
    "restart": ("hardcore.restarting", "restart"),
    "restore": ("hardcore.keeping_words", "restore"),
    "safe-mode": ("hardcore.reading_only", "safe_mode"),
    "service": ("hardcore.service_words", "service"),
    "snapshot": ("hardcore.snapshot_words", "snapshot"),
    "token": ("hardcore.access_words", "token"),
    "verify": ("hardcore.verifying", "verify"),
}


class Words(click.Group):
    """All words: those of this file, and those elsewhere."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all."""
        return sorted({*super().list_commands(ctx), *ELSEWHERE})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of a name, loaded if it is elsewhere; None: there is none."""
        if cmd_name not in ELSEWHERE:
            return super().get_command(ctx, cmd_name)
        room, name = ELSEWHERE[cmd_name]
        command = getattr(importlib.import_module(room), name)
        assert isinstance(command, click.Command), "the table names commands"
        return command


@click.group(cls=Words, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="hardcore")
@options
@click.pass_context
def main(context: click.Context, /, **given: object) -> None:
    """A household ledger that dies and comes back, with proof.

    \b
    hardcore up                  start everything; Ctrl-C stops it
    hardcore status              how it is
    hardcore incidents           what has happened
    hardcore dlq                 requests that were set aside
    hardcore drill crash         break it on purpose and watch it come back
    hardcore safe-mode on        serve reads only until you say otherwise
    hardcore alerts test         tell everybody who would be told, now
    hardcore backup              a proven copy of the ledger, now; one is made each day
    hardcore doctor              what this machine lets the guard see and do
    hardcore restart             a new core with the code on the disk, without losing a request
    hardcore down                stop it and keep it stopped
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    context.obj = given


@main.command()
@click.option(
    "--port", default=3000, show_default=True, type=click.IntRange(0, 65535), help="0: any free one."
)
@click.option(
    "--policy", type=click.Path(path_type=Path, dir_okay=False), help="Policy to check and use from now on."
)
@click.option(
    "--demo", is_flag=True, help="Add a page with buttons that break the core, to watch it come back."
)
@click.option("--no-spare", is_flag=True, help="Keep no second core ready: less memory, a slower way back.")
@click.option(
    "--mode",
    type=click.Choice(standing.MODES),
    help="What the guard may do in this run, whatever the policy says.",
)
@click.option(
    "--store",
    envvar="HARDCORE_STORE",
    help="Keep the ledger in a PostgreSQL database, from now on: postgresql://USER@HOST/DATABASE.",
)
@door_options
@operator
def up(
    asked: Asked,
    port: int,
    policy: Path | None,
    mode: str | None,
    store: str | None,
    *,
    demo: bool,
    no_spare: bool,
    **door: Any,
) -> None:
    """Start the ledger and its guard, here in the foreground. Ctrl-C stops everything cleanly.

    \b
    hardcore up                                   this machine alone
    hardcore passwd                               before it is opened to others
    hardcore up --host 0.0.0.0 --tls-cert cert.pem --tls-key key.pem
    hardcore up --trusted-proxy 127.0.0.1 --hostname money.example
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    typed = click.get_current_context().get_parameter_source("store") is ParameterSource.COMMANDLINE
    if store is not None and typed and starting.has_password(store):
        asked.fail(starting.password_typed(asked.lang), 2)
    wishes = starting.Wishes(demo=demo, no_spare=no_spare, mode=mode or "")
    opening = Opening(**door)
    ready = starting.prepare_start(asked.data, opening, port, policy, asked.lang, wishes, store)
    if isinstance(ready, starting.Refused):
        asked.fail(ready.words, ready.code)
    if ready.warning:
        click.echo(ready.warning, err=True)
    asked.say("attached" if ready.attached else "serving", url=ready.url, command=asked.command)
    asked.say("dashboard", url=ready.url)
    if demo:
        asked.say("demo", url=ready.url, data=asked.data.absolute())
    asked.tell({"ok": True, "url": ready.url, "attached": ready.attached})
    sys.stdout.flush()
    starting.become_launcher(ready, wishes)


@main.command("status")
@click.option("--watch", is_flag=True, help="Go on showing it until Ctrl-C.")
@operator
def show_status(asked: Asked, *, watch: bool) -> None:
    """Show how it is. Exit code: 0 working, 3 on the way, 4 needs a person."""
    with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C is how a watch ends
        while True:
            code = _show_once(asked, clear=watch)
            if not watch:
                sys.exit(code)
            time.sleep(1)


def _show_once(asked: Asked, *, clear: bool) -> int:
    told = status_of(asked)
    # The gateway's own file: how long it said that an outage would take, and how long it took.
    told["estimate"] = estimate_score(read_json(asked.folders.state / "recoveries.json"))
    if clear and not asked.json:
        click.clear()
    asked.tell(told)
    if not asked.json:
        click.echo(printed_status(told, asked.lang))
    return STATE_CODES.get(str(told["state"]), NEEDS_A_PERSON)


@main.command()
@click.option(
    "--accept-ledger",
    is_flag=True,
    help="Take the ledger as it stands: you have put back an older copy on purpose.",
)
@operator
def resume(asked: Asked, *, accept_ledger: bool) -> None:
    """Try again after automatic recovery has stopped; empties the restart budget."""
    answer = asked.ask(verb="resume", accept_ledger=accept_ledger)
    if not answer.get("changed"):
        asked.say("resume_needless", state=answer.get("phase"))
        asked.tell(answer)
        return
    asked.say("resumed")
    if answer.get("mode") == "assist" and not asked.json:
        click.echo(operator_text("resume_assists", asked.lang))
    told = come_back(asked, lambda told: told["phase"] in PROVEN | {"FATAL"})
    if told["phase"] not in PROVEN:
        asked.fail(asked.words("not_back", next=next_words(told, asked.lang)))
    asked.tell({"ok": True, "phase": told["phase"]})


if __name__ == "__main__":
    main()
