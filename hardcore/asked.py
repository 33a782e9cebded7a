"""What every command of the operator shares: its options, its voice, and its patience.

A command takes `--data`, `--json` and `--lang` before or after its name, prints for a person or for a program,
and refuses in one sentence with the next step. Waiting is asking the guard for its status again and again: what
goes on goes on without whoever looks.
"""

import functools
import json
import os
import shlex
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import click
import msgspec

from frontend.catalogue import next_step, refused_words, text
from frontend.catalogue_evidence import in_korean
from hardcore import status
from hardcore.control import client
from hardcore.host import backups
from hardcore.host.folders import Folders, locate
from hardcore.lines import wrapped
from hardcore.model.phases import Wanted
from hardcore.recovery.policy import Policy, read_policy
from hardcore.up import held

WAIT_S = 60.0
LOOK_EVERY_S = 0.05
#: A guard that dies is followed by another within a second; after this it is asked who would start one.
SILENT_S = 3.0


class Asked(msgspec.Struct):
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
            click.echo(wrapped(text(key, self.lang, **values)))

    def words(self, key: str, **values: object) -> str:
        """Return a text in the operator's language."""
        return text(key, self.lang, **values)

    def why(self, sentence: str) -> str:
        """Return the guard's own sentence in the operator's language, as far as it is known there."""
        return in_korean(sentence) if self.lang == "ko" else sentence

    def tell(self, value: object) -> None:
        """Print a value, if a program reads."""
        if self.json:
            click.echo(json.dumps(value, ensure_ascii=False, indent=1))

    def fail(self, words: str, code: int = 1) -> NoReturn:
        """Say why it can't be done and end."""
        self.tell({"ok": False, "error": words})
        click.echo(wrapped(words), err=True)
        sys.exit(code)

    def ask(self, **request: object) -> dict[str, Any]:
        """Ask the sentinel. Ends with a sentence when nobody answers or the answer is no."""
        try:
            answer = client.ask(self.folders.control, request)
        except client.Unreachable:
            self.fail(text("silent" if is_held(self.folders) else "unreachable", self.lang))
        if answer.get("ok") is False:
            self.fail(text("refused", self.lang, why=refused_words(answer, self.lang)))
        return answer


def next_words(told: Mapping[str, Any], lang: str) -> str:
    """Return the next step of a status that needs a person, or that reads only."""
    return next_step(told.get("waits_for") or told.get("safe"), lang)


def is_held(folders: Folders) -> bool:
    """Tell whether a sentinel lives for these folders."""
    return folders.run.is_dir() and held(folders.run / "sentinel.lock")


def is_kept(folders: Folders) -> bool:
    """Tell whether a sentinel lives for these folders, or a launcher that starts one.

    To ask takes their locks for a moment, so it is not for asking again and again.
    """
    return folders.state.is_dir() and (held(folders.launcher_lock) or is_held(folders))


def _language() -> str:
    spoken = os.environ.get("LC_ALL") or os.environ.get("LC_MESSAGES") or os.environ.get("LANG") or ""
    return "ko" if spoken.lower().startswith("ko") else "en"


def door_options(command: click.decorators.FC) -> click.decorators.FC:
    """Add the options that say how wide the door is opened (`opening.Opening`)."""
    file = click.Path(path_type=Path, exists=True, dir_okay=False)
    for option in (
        click.option(
            "--hostname",
            "names",
            multiple=True,
            help="A name that the server is reached by, such as money.example; may be repeated.",
        ),
        click.option(
            "--insecure-lan",
            is_flag=True,
            help="Serve other devices in the open: you trust everybody on this network.",
        ),
        click.option(
            "--trusted-proxy",
            "proxies",
            multiple=True,
            help="Address or network of a proxy in front of us, which encrypts; may be repeated.",
        ),
        click.option("--tls-key", type=file, help="Its private key."),
        click.option(
            "--tls-cert",
            type=file,
            help="Certificate (PEM, with its chain); a renewed one is taken by itself.",
        ),
        click.option(
            "--host",
            default="127.0.0.1",
            show_default=True,
            help="Address to serve on. Beyond this machine (0.0.0.0: every device) a password is needed, and encryption.",
        ),
    ):
        command = option(command)
    return command


def options(command: Callable[..., Any]) -> Callable[..., Any]:
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


def operator(command: Callable[..., None]) -> Callable[..., None]:
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

    return options(with_asked)


def status_of(asked: Asked) -> dict[str, Any]:
    """Return the status, from the guard or from its files when it is gone."""
    try:
        told = status.whole(client.ask(asked.folders.control, {"verb": "status"}))
    except client.Unreachable:
        told = status.from_files(asked.folders)
    return told | {"backup": msgspec.structs.asdict(backups.kept_in(asked.folders.data))}


def ask_policy(folders: Folders) -> Policy | None:
    """Return the policy that the running guard goes by; None where none runs, or none that can say."""
    try:
        answer = client.ask(folders.control, {"verb": "policy"})
    except client.Unreachable:
        return None
    found = read_policy(json.dumps(answer.get("policy")))
    return found if isinstance(found, Policy) else None


def keep(context: click.Context, given: dict[str, Any]) -> None:
    """Keep what was asked of a group for the command below it."""
    context.find_root().obj |= {name: value for name, value in given.items() if value}


def until(holds: Callable[[], bool], within_s: float = WAIT_S) -> bool:
    """Wait until something holds; return whether it did in time."""
    deadline = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > deadline:
            return False
        time.sleep(LOOK_EVERY_S)
    return True


def come_back(
    asked: Asked, back: Callable[[dict[str, Any]], bool], within_s: float = WAIT_S, left: str = "goes_on"
) -> dict[str, Any]:
    """Wait until the status says what is meant; end with a sentence if it does not in time, or never will.

    `left`: the text for somebody who does not wait for it.
    """
    told: dict[str, Any] = {}
    heard = time.monotonic()

    def look() -> bool:
        nonlocal told, heard
        told = status_of(asked)
        if told["wanted"] == Wanted.DOWN:
            asked.fail(text("stopped_meanwhile", asked.lang))
        if told["state"] != "UNKNOWN":
            heard = time.monotonic()
            return back(told) or told["state"] == "MANUAL_INTERVENTION"
        if time.monotonic() - heard > SILENT_S:
            if not is_kept(asked.folders):
                asked.fail(text("unreachable", asked.lang))
            heard = time.monotonic()
        return False

    try:
        back_in_time = until(look, within_s)
    except KeyboardInterrupt:
        asked.fail(text(left, asked.lang), 130)
    if not back_in_time:
        asked.fail(text("no_comeback", asked.lang, seconds=int(within_s)))
    return told
