"""The operator's words: `hardcore up`, `status`, `restart`, `incidents`, and so on.

Every command asks the running sentinel or reads the files it leaves; none does anything behind its back. What
is printed is for a person, or with `--json` for a program; a refusal is one sentence with the next step, and
never a traceback. Exit codes: 0 fine, 1 failed, 2 usage, 3 on the way, 4 needs a person.
"""

import contextlib
import functools
import json
import os
import shlex
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import click

from frontend.catalogue import text
from hardcore import __version__, standing, status
from hardcore import up as starting
from hardcore.control import client
from hardcore.control.protocol import DRILLS
from hardcore.host import lives
from hardcore.host.files import take_lock
from hardcore.host.folders import Folders, locate
from hardcore.model.phases import Wanted
from hardcore.recovery.policy import Policy, notes
from hardcore.status_page import printed_status
from hardcore.up import held
from postmortem import cli as incidents_cli

STATE_CODES = {"OPERATIONAL": 0, "STARTING": 3, "DEGRADED": 3, "RECOVERY": 3, "SAFE_MODE": 3}
NEEDS_A_PERSON = 4
WAIT_S = 60.0
LOOK_EVERY_S = 0.05
EXPECTED = {"crash": "CRASHED", "exit": "EXITED", "freeze": "FROZEN", "block": "LOOP_BLOCKED"}
VERIFY_TIMEOUT_S = 600.0


@dataclass(slots=True)
class Asked:
    """The options that every command takes."""

    data: Path
    json: bool
    lang: str

    @property
    def folders(self) -> Folders:
        """The files of the instance meant."""
        return locate(self.data)

    @property
    def command(self) -> str:
        """How this instance is spoken to from another terminal."""
        words = [sys.argv[0] if sys.argv[0].endswith("hardcore") else "hardcore"]
        if self.data != Path("var"):
            words += ["--data", str(self.data)]
        return shlex.join(words)

    def say(self, key: str, **values: object) -> None:
        """Print a text, unless a program reads."""
        if not self.json:
            click.echo(text(key, self.lang, **values))

    def tell(self, value: object) -> None:
        """Print a value, if a program reads."""
        if self.json:
            click.echo(json.dumps(value, ensure_ascii=False, indent=1))

    def fail(self, words: str, code: int = 1) -> NoReturn:
        """Say why it can't be done and end."""
        self.tell({"ok": False, "error": words})
        click.echo(words, err=True)
        sys.exit(code)

    def ask(self, **request: object) -> dict[str, Any]:
        """Ask the sentinel. Ends with a sentence when nobody answers or the answer is no."""
        try:
            answer = client.ask(self.folders.control, request)
        except client.Unreachable:
            self.fail(text("silent" if _held(self.folders) else "unreachable", self.lang))
        if answer.get("ok") is False:
            self.fail(text("refused", self.lang, why=answer.get("error")))
        return answer


def _held(folders: Folders) -> bool:
    return folders.run.is_dir() and held(folders.run / "sentinel.lock")


def _language() -> str:
    spoken = os.environ.get("LC_ALL") or os.environ.get("LC_MESSAGES") or os.environ.get("LANG") or ""
    return "ko" if spoken.lower().startswith("ko") else "en"


def _options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that every command takes; they may stand before or after the command's name."""
    for option in (
        click.option("--lang", type=click.Choice(["ko", "en"]), help="Language of what is printed."),
        click.option("--json", "as_json", is_flag=True, help="Print JSON, for a program."),
        click.option(
            "--data",
            type=click.Path(file_okay=False),
            help="Data folder.  [env HARDCORE_DATA; default ./var]",
        ),
    ):
        command = option(command)
    return command


def _data(given: str | None) -> Path:
    """Return the data folder; an empty name is none, or a ledger would be laid out where one stands."""
    return Path(given or os.environ.get("HARDCORE_DATA") or "./var")


def _operator(command: Callable[..., None]) -> Callable[..., None]:
    """Hand a command what was asked globally as `Asked`; the option nearest to its name wins."""

    @functools.wraps(command)
    def with_asked(*args: Any, data: str | None, as_json: bool, lang: str | None, **particulars: Any) -> None:
        before = click.get_current_context().find_root().obj or {}
        asked = Asked(
            data=_data(data or before.get("data")),
            json=as_json or before.get("as_json", False),
            lang=lang or before.get("lang") or _language(),
        )
        command(asked, *args, **particulars)

    return _options(with_asked)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="hardcore")
@_options
@click.pass_context
def main(context: click.Context, /, **given: object) -> None:
    """A household ledger that dies and comes back, with proof.

    \b
    hardcore up                  start everything; Ctrl-C stops it
    hardcore status              how it is
    hardcore incidents           what has happened
    hardcore drill crash         break it on purpose and watch it come back
    hardcore restart             a new core, without losing a request
    hardcore down                stop it and keep it stopped
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    context.obj = given


@main.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to serve on; loopback only.")
@click.option(
    "--port", default=3000, show_default=True, type=click.IntRange(0, 65535), help="0: any free one."
)
@click.option(
    "--policy", type=click.Path(path_type=Path, dir_okay=False), help="Policy to check and use from now on."
)
@click.option(
    "--demo", is_flag=True, help="Add a page with buttons that break the core, to watch it come back."
)
@_operator
def up(asked: Asked, host: str, port: int, policy: Path | None, *, demo: bool) -> None:
    """Start the ledger and its guard, here in the foreground. Ctrl-C stops everything cleanly."""
    ready = starting.prepare_start(asked.data, host, port, policy, asked.lang, demo=demo)
    if isinstance(ready, starting.Refused):
        asked.fail(ready.words, ready.code)
    if ready.warning:
        click.echo(ready.warning, err=True)
    asked.say("attached" if ready.attached else "serving", url=ready.url, command=asked.command)
    if demo:
        asked.say("demo", url=ready.url, data=asked.data.absolute())
    asked.tell({"ok": True, "url": ready.url, "attached": ready.attached})
    sys.stdout.flush()
    starting.become_launcher(ready, demo=demo)


@main.command()
@_operator
def down(asked: Asked) -> None:
    """Stop everything and keep it stopped until the next `up`."""
    folders = asked.folders
    if not _held(folders):
        try:
            ended = _down_without_a_sentinel(folders)
        except OSError as error:
            asked.fail(text("down_not_stored", asked.lang, why=error.strerror))
        if ended is None:
            asked.fail(text("silent", asked.lang))
        noted = "nothing_running" if _is_laid_out(folders) else "nothing_there"
        asked.say("stopped" if ended else noted)
        asked.tell({"ok": True, "was_running": ended > 0})
        return
    asked.ask(verb="down")
    asked.say("stopping")
    if not _until(lambda: not _held(folders)):
        asked.fail(text("still_stopping", asked.lang, seconds=int(WAIT_S)))
    asked.say("stopped")
    asked.tell({"ok": True, "was_running": True})


def _is_laid_out(folders: Folders) -> bool:
    return os.path.isdir(folders.state)  # noqa: PTH112  # pathlib's raises for a name that is too long


def _down_without_a_sentinel(folders: Folders) -> int | None:
    """Store DOWN and end what a guard that was killed has left; return how many processes that were.

    None: a sentinel lives that can't be reached. One whose run folder was removed makes way within moments.
    """
    if not _is_laid_out(folders):
        return 0
    standing.store_wanted(folders, Wanted.DOWN)
    folders.run.mkdir(mode=0o700, exist_ok=True)  # somebody may have removed it under the living
    lock = take_lock(folders.run / "sentinel.lock")
    if lock is None:
        return 0  # a sentinel has just begun: it reads what is wanted and ends them itself
    try:
        if not _until(lambda: not held(folders.guard_lock)):
            return None
        return lives.end_leftovers(folders, standing.policy_in_force(folders).policy.stop_timeout_ms / 1000)
    finally:
        os.close(lock)


@main.command("status")
@click.option("--watch", is_flag=True, help="Go on showing it until Ctrl-C.")
@_operator
def show_status(asked: Asked, *, watch: bool) -> None:
    """Show how it is. Exit code: 0 working, 3 on the way, 4 needs a person."""
    with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C is how a watch ends
        while True:
            code = _show_once(asked, clear=watch)
            if not watch:
                sys.exit(code)
            time.sleep(1)


def _show_once(asked: Asked, *, clear: bool) -> int:
    told = _status(asked)
    if clear and not asked.json:
        click.clear()
    asked.tell(told)
    if not asked.json:
        click.echo(printed_status(told, asked.lang))
    return STATE_CODES.get(str(told["state"]), NEEDS_A_PERSON)


def _status(asked: Asked) -> dict[str, Any]:
    try:
        return client.ask(asked.folders.control, {"verb": "status"})
    except client.Unreachable:
        return status.from_files(asked.folders)


@main.command()
@click.option("--reason", default="", help="Why; it stands in the report.")
@click.option("--hard", is_flag=True, help="Kill the core instead of letting it finish.")
@_operator
def restart(asked: Asked, reason: str, *, hard: bool) -> None:
    """Start a new core. Requests wait meanwhile; none is lost."""
    answer = asked.ask(verb="restart", reason=reason, hard=hard)
    if not answer.get("changed"):
        asked.say("starting_already")
        asked.tell(answer)
        return
    asked.say("restarting")
    began = time.monotonic()
    incident = answer.get("incident")
    _come_back(asked, lambda told: told["phase"] == "RUNNING" and told["incident"] is None)
    asked.say("restarted", seconds=f"{time.monotonic() - began:.1f}", incident=incident or "-")
    asked.tell({"ok": True, "incident": incident})


@main.command()
@click.option(
    "--accept-ledger",
    is_flag=True,
    help="Take the ledger as it stands: you have put back an older copy on purpose.",
)
@_operator
def resume(asked: Asked, *, accept_ledger: bool) -> None:
    """Try again after automatic recovery has stopped; empties the restart budget."""
    answer = asked.ask(verb="resume", accept_ledger=accept_ledger)
    if not answer.get("changed"):
        asked.say("resume_needless", state=answer.get("phase"))
        asked.tell(answer)
        return
    asked.say("resumed")
    told = _come_back(asked, lambda told: told["phase"] in {"RUNNING", "FATAL"})
    asked.tell({"ok": told["phase"] == "RUNNING", "phase": told["phase"]})
    sys.exit(0 if told["phase"] == "RUNNING" else 1)


@main.command()
@click.argument("fault", type=click.Choice(list(DRILLS)))
@click.option("--yes", is_flag=True, help="Even while others are connected.")
@_operator
def drill(asked: Asked, fault: str, *, yes: bool) -> None:
    """Break the core on purpose, wait for it to come back, and tell how it went."""
    before = _status(asked).get("last_incident")
    asked.ask(verb="drill", fault=fault, yes=yes)
    asked.say("drill_begins", fault=fault)
    told = _come_back(asked, lambda told: told["last_incident"] != before and told["incident"] is None)
    story = _incident(asked, str(told["last_incident"]))
    expected = story["diagnosis"] == EXPECTED[fault] and story["outcome"] == "recovered"
    asked.say(
        "drill_done" if expected else "drill_other",
        diagnosis=story["diagnosis"],
        outcome=story["outcome"],
        detected=story["detected_ms"],
        outage=story["outage_ms"],
        incident=story["id"],
    )
    asked.tell({"ok": expected, "incident": story["id"], "story": story})
    sys.exit(0 if expected else 1)


def _incident(asked: Asked, incident: str) -> dict[str, Any]:
    found: dict[str, Any] | incidents_cli.Refused = {}

    def there() -> bool:
        nonlocal found
        found = incidents_cli.show_incident(asked.folders.incidents, incident, asked.lang)
        return isinstance(found, dict) and found["closed_at"] is not None

    _until(there)
    if not isinstance(found, dict):
        asked.fail(found.sentence)
    return found


def _keep(context: click.Context, given: dict[str, Any]) -> None:
    """Keep what was asked of a group for the command below it."""
    context.find_root().obj |= {name: value for name, value in given.items() if value}


@main.group(invoke_without_command=True)
@_options
@click.pass_context
def incidents(context: click.Context, /, **given: object) -> None:
    """What has happened: list, show ID, export ID --out FILE. Works with everything stopped."""
    _keep(context, given)
    if context.invoked_subcommand is None:
        context.invoke(incidents_list, data=None, as_json=False, lang=None)


@incidents.command("list")
@_operator
def incidents_list(asked: Asked) -> None:
    """List the incidents, newest first."""
    items = incidents_cli.list_incidents(asked.folders.incidents, asked.lang)
    asked.tell(items)
    if not asked.json:
        incidents_cli.print_list(items, asked.lang, sys.stdout.write)


@incidents.command("show")
@click.argument("incident")
@_operator
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
@_operator
def incidents_export(asked: Asked, incident: str, out: Path) -> None:
    """Write one incident to a file, in the form that its ending names."""
    refused = incidents_cli.export(asked.folders.incidents, incident, out, asked.lang)
    if refused is not None:
        asked.fail(refused.sentence)
    asked.say("exported", path=out)
    asked.tell({"ok": True, "path": str(out)})


@main.command()
@_operator
def verify(asked: Asked) -> None:
    """Prove the whole ledger: chain, sums, balances, keys. Works with everything stopped."""
    told = _verify_served(asked) or _verify_alone(asked)
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
    told = _status(asked)
    if not told["core"]["ready"] or not told["url"]:
        return None
    request = urllib.request.Request(f"{told['url']}/api/ledger/verify")  # noqa: S310  # our own loopback URL
    try:
        with urllib.request.urlopen(request, timeout=VERIFY_TIMEOUT_S) as answer:  # noqa: S310  # as above
            found: dict[str, Any] = json.load(answer)
            return found
    except (OSError, ValueError):
        return None


def _verify_alone(asked: Asked) -> dict[str, Any]:
    argv = [sys.executable, "-I", "-m", "core", "verify", "--data", str(asked.folders.data), "--json"]
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    try:
        found: dict[str, Any] = json.loads(done.stdout)
    except ValueError:
        why = (done.stderr.strip().splitlines() or ["no answer"])[-1]
        asked.fail(text("verify_failed", asked.lang, why=why))
    return found


@main.group()
@_options
@click.pass_context
def policy(context: click.Context, /, **given: object) -> None:
    """The failover policy."""
    _keep(context, given)


@policy.command("check")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@_operator
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


def _until(holds: Callable[[], bool]) -> bool:
    """Wait until something holds; return whether it did in time."""
    deadline = time.monotonic() + WAIT_S
    while not holds():
        if time.monotonic() > deadline:
            return False
        time.sleep(LOOK_EVERY_S)
    return True


def _come_back(asked: Asked, back: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Wait until the status says what is meant; end with a sentence if it does not in time."""
    told: dict[str, Any] = {}

    def look() -> bool:
        nonlocal told
        told = _status(asked)
        return told["state"] != "UNKNOWN" and (back(told) or told["state"] == "MANUAL_INTERVENTION")

    try:
        back_in_time = _until(look)
    except KeyboardInterrupt:
        asked.fail(text("goes_on", asked.lang), 130)
    if not back_in_time:
        asked.fail(text("no_comeback", asked.lang, seconds=int(WAIT_S)))
    return told


if __name__ == "__main__":
    main()
