"""Reading a journal by the program whose format it is, in a process of its own: hledger, or Beancount.

Neither is part of this house (both are GPL, and each knows its own format better than anybody else): hledger is asked for JSON,
Beancount's loader is run by a Python that has it. What they say on their error output is what a person needs to mend the journal,
and is passed on.
"""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any, Final

import msgspec

from hardcore.journals.wishes import Line, Told

PATIENCE_S: Final = 120.0
FORMATS: Final = ("hledger", "beancount")
_ENDINGS: Final = {".beancount": "beancount", ".bean": "beancount"}
_SAID_CHARACTERS_MAX: Final = 2_000
_LOADER: Final = """
import json, sys
from beancount import loader
from beancount.core.data import Transaction
entries, errors, _ = loader.load_file(sys.argv[1])
if errors:
    from beancount.parser import printer
    printer.print_errors(errors[:10], file=sys.stderr)
    sys.exit(1)
json.dump([
    {"line": one.meta["lineno"], "date": one.date.isoformat(),
     "description": " ".join(filter(None, (one.payee, one.narration))), "tags": sorted(one.tags or ()),
     "lines": [{"account": p.account, "amount": format(p.units.number, "f"), "currency": p.units.currency}
               for p in one.postings]}
    for one in entries if isinstance(one, Transaction)
], sys.stdout)
"""


class Unread(msgspec.Struct, frozen=True):
    """A journal that could not be read: why (a code of the catalogue), and what its program said."""

    why: str
    said: str = ""


def format_of(file: Path) -> str:
    """Return the format that a file's ending says."""
    return _ENDINGS.get(file.suffix.lower(), "hledger")


def read_journal(file: Path, form: str) -> list[Told] | Unread:
    """Return the transactions of a journal in their order. Blocks."""
    if form == "beancount":
        if importlib.util.find_spec("beancount") is None:
            return Unread("no_beancount")
        raw = _said([sys.executable, "-I", "-c", _LOADER, str(file)])
        return raw if isinstance(raw, Unread) else msgspec.json.decode(raw, type=list[Told])
    program = shutil.which("hledger")
    if program is None:
        return Unread("no_hledger")
    raw = _said([program, "-f", str(file), "print", "--output-format", "json"])
    return raw if isinstance(raw, Unread) else list(_of_hledger(json.loads(raw, parse_float=Decimal)))


def _said(argv: Sequence[str]) -> bytes | Unread:
    try:
        done = subprocess.run(
            argv,
            capture_output=True,
            check=False,
            timeout=PATIENCE_S,
            env={**os.environ, "LC_ALL": "C.UTF-8"},
        )
    except subprocess.TimeoutExpired:
        return Unread("too_slow")
    if done.returncode:
        return Unread("refused", done.stderr.decode("utf-8", "replace").strip()[-_SAID_CHARACTERS_MAX:])
    return done.stdout


def _of_hledger(told: Sequence[dict[str, Any]]) -> Iterator[Told]:
    for one in told:
        places = one.get("tsourcepos") or [{}]
        place = places[0] if isinstance(places, list) else places
        lines: list[Line] = []
        fault = ""
        for posting in one["tpostings"]:
            if posting["ptype"] == "VirtualPosting":
                fault = "virtual"
            lines += [
                Line(posting["paccount"], _amount(each["aquantity"]), each["acommodity"])
                for each in posting["pamount"]
            ]
        tags = tuple(name for name, value in one["ttags"] if not value)
        yield Told(
            int(place.get("sourceLine", 0)), one["tdate"], one["tdescription"], tags, tuple(lines), fault
        )


def _amount(quantity: dict[str, Any]) -> str:
    digits = Decimal(int(quantity["decimalMantissa"])).scaleb(-int(quantity["decimalPlaces"]))
    return f"{digits:f}"
