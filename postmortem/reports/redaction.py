"""What may leave this machine of an incident: three sieves, each stricter than the evidence's own.

First an allow-list: of an object, the fields that are ids, amounts, numbers, times or words of ours, each only in its
form; of a sentence, the words that our own sentences are made of, numbers, ids and places in code. Then a list of
names whose values go whatever they are. Then patterns of what looks like a secret by its shape. The evidence on the
disk is masked already, by the guard; this is asked again because a file may be older than a sieve, may have been
edited, and is about to be sent to somebody. To trust the first sieve was not chosen: one hole in it would be a leak,
two have to be in the same place.
"""

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

import msgspec

from frontend import catalogue_evidence, catalogue_reports
from frontend.catalogue_findings import FINDINGS

MASK = "<masked>"
DEPTH_MAX = 24
ITEMS_MAX = 4_096
TEXT_CHARS_MAX = 4_096

_SECRET_NAME = re.compile(
    r"pass(?:word|wd|phrase|code)|pwd|secret|token|cookie|authori[sz]ation|bearer|credential|api_?-?key"
    r"|private_?-?key|session|csrf|\botp\b|\bpin\b|payload|body|header|environ|argv|cmdline|repr|description|memo|note"
    r"|비밀번호|암호|인증번호|주민",
    re.IGNORECASE,
)
_SHAPES = re.compile(
    r"eyJ[\w-]{8,}\.[\w-]+"
    r"|-----BEGIN"
    r"|://[^/\s:@]+:[^/\s@]+@"
    r"|\b\d{6}-?[1-8]\d{6}\b"
    r"|\b(?:\d[ -]?){13,19}\b"
    r"|\b(?=\w*\d)(?=\w*[a-z])(?=\w*[A-Z])\w{20,}\b"
)
_CARD = re.compile(r"(?<![\w.-])\d{4}([ -])\d{4}\1\d{4}\1\d{1,7}(?![\w-])")
_UUID = r"[0-9a-f]{8}-(?:[0-9a-f]{4}-){3}[0-9a-f]{12}"
_HEX = r"[0-9a-f]{8,64}"
_ACCOUNT = r"[a-z]{3,12}(?::[a-z0-9_.-]{1,40}){1,8}"
_MOMENT = r"\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d:\d\d(?:[.,]\d{1,9})?(?:Z|[+-]\d\d:\d\d)?)?"
_NUMBER = r"[-+#]?\d[\d.,]{0,20}(?:ms|s|B|KiB|MiB|GiB|%)?"
_PLACE = r"(?:[\w.-]{1,40}/){0,3}[\w.-]{1,60}\.(?:py|so|c)(?:[.\d]{0,12})(?::\d{1,7})?"
_WHOLE_ID = re.compile(rf"{_UUID}|{_HEX}|{_ACCOUNT}|[a-z]{{2,6}}-\d{{1,6}}")
_PIECE = re.compile(rf"(?:{_UUID}|{_HEX}|{_ACCOUNT}|{_MOMENT}|{_NUMBER}|{_PLACE}|SIG[A-Z]{{3,8}}|\d+)")
_FUNCTION = re.compile(r"(?:[A-Za-z_]\w{0,60}\.)*[A-Za-z_]\w{0,60}(?:\.<\w{1,16}>)*")
_AROUND = re.compile(r"^([(\[{'\"]*)(.*?)([)\]}'\",:;.]*)$", re.DOTALL)
_CODE = re.compile(r"[A-Z][A-Z0-9_]{1,39}")
_KIND = re.compile(r"[a-z_]{1,30}(?:\.[a-z_]{1,30}){0,3}")
_PATH = re.compile(r"/[a-z_/-]{0,120}")

#: Fields whose texts may be shown, each with the form that they must have.
_FORMS: Mapping[str, re.Pattern[str]] = {
    **dict.fromkeys(
        (
            "id",
            "incident",
            "command_id",
            "transaction_id",
            "key_hash",
            "letter",
            "account_ids",
            "suspects",
            "blamed",
        ),
        _WHOLE_ID,
    ),
    **dict.fromkeys(("name", "fingerprint", "digest", "hash", "nonce", "boot_id", "left_open"), _WHOLE_ID),
    **dict.fromkeys(("at", "opened_at", "closed_at", "served_again_at", "written_at"), re.compile(_MOMENT)),
    **dict.fromkeys(("diagnosis", "code", "stage", "waits_for", "method", "state"), _CODE),
    **dict.fromkeys(("kind", "outcome", "grade", "step", "ordeal", "colour"), _KIND),
    "path": _PATH,
    "function": _FUNCTION,
    "place": re.compile(_PLACE),
    "short_filename": re.compile(_PLACE),
    "thread_name": re.compile(r"[A-Za-z_]{1,20}(?:-?\d{1,4})?(?:_\d{1,4})?"),
    "wchan": re.compile(r"[a-z_0-9]{1,40}"),
}


#: A number with a unit is a measure, whatever it is the measure of.
_UNITS = ("_bytes", "_ns", "_ms", "_count")
#: Where the kernel has a thread wait; a wait that is not here is hidden.
_WAITS = (
    "hrtimer_nanosleep",
    "futex_do_wait",
    "futex_wait_queue",
    "do_epoll_wait",
    "ep_poll",
    "do_select",
    "do_poll",
)


class Sieve(msgspec.Struct):
    """Redacts, and counts what it hid."""

    hidden: int = 0

    def value(self, raw: Any, name: str = "", depth: int = 0) -> Any:
        """Return a JSON value with nothing in it that is not known to be harmless."""
        if raw is None or isinstance(raw, bool):
            return raw
        counted = isinstance(raw, int) and name.endswith(_UNITS)
        if name and _SECRET_NAME.search(name) and not counted:
            return self._mask()
        if isinstance(raw, int | float):
            return raw if _SHAPES.search(str(raw)) is None or abs(raw) >= 1e10 else self._mask()
        if isinstance(raw, str):
            return self.named(raw, name)
        if depth >= DEPTH_MAX:
            return self._mask()
        if isinstance(raw, list):
            return [self.value(item, name, depth + 1) for item in raw[:ITEMS_MAX]]
        if isinstance(raw, dict):
            return self._object(raw, depth)
        return self._mask()

    def named(self, text: str, name: str) -> str:
        """Return the text of a field called `name`: as it is if its form is the field's, else word by word."""
        form = _FORMS.get(name)
        if form is not None and form.fullmatch(text) and _shapeless(text):
            return text
        return self.sentence(text)

    def sentence(self, text: str) -> str:
        """Return a sentence with every word hidden that is neither ours nor a number, an id or a place in code."""
        words = self._shapes(text[:TEXT_CHARS_MAX]).split(" ")
        kept = [self._word(word, after) for word, after in zip(words, [*words[1:], ""], strict=True)]
        told: list[str] = []
        for word in kept:  # what is hidden beside each other is hidden once
            if word != MASK or not told or told[-1] != MASK:
                told.append(word)
        return " ".join(told)

    def path(self, text: str) -> str:
        """Return a request's path without its query, its parts shown where they are words of ours or ids."""
        parts = text.partition("?")[0].split("/")
        return "/".join(
            part
            if not part or (re.fullmatch(r"[a-z_-]{1,24}", part) and part in _path_words())
            else self._id(part)
            for part in parts[:12]
        )

    def identifier(self, text: str) -> str:
        """Return an id if it has the form of one."""
        return self._id(text) if text else text

    def _shapes(self, text: str) -> str:
        """Return a text without the stretches that look like a secret over several words, as a card's number does."""
        clean, count = _CARD.subn(MASK, text)
        self.hidden += count
        return clean

    def _id(self, text: str) -> str:
        return text if _WHOLE_ID.fullmatch(text) and _shapeless(text) else self._mask()

    def _word(self, word: str, after: str) -> str:
        if not word:
            return word
        match = _AROUND.match(word)
        core = match[2] if match else word
        if not core or core.lower() in _vocabulary() or (_PIECE.fullmatch(core) and _shapeless(core)):
            return word
        if after.startswith("(") and _FUNCTION.fullmatch(core) and _PIECE.fullmatch(after.strip("(),;:.")):
            return word  # a function, with its place behind it
        return self._mask()

    def _object(self, raw: Mapping[Any, Any], depth: int) -> dict[str, Any]:
        shown: dict[str, Any] = {}
        for key, item in list(raw.items())[:ITEMS_MAX]:
            name = str(key)
            if re.fullmatch(r"[a-z_][a-z0-9_.-]{0,60}", name) is None or not _shapeless(name):
                name = self._mask()
            as_name = "function" if name == "name" and "short_filename" in raw else name
            shown[name] = self.value(item, as_name, depth + 1)
        return shown

    def _mask(self) -> str:
        self.hidden += 1
        return MASK


def _shapeless(text: str) -> bool:
    """Tell whether a text looks like no secret; the ids that we make are long and are none."""
    return re.fullmatch(rf"{_UUID}|{_HEX}|{_MOMENT}", text) is not None or _SHAPES.search(text) is None


@cache
def _vocabulary() -> frozenset[str]:
    """Return the words that our own English sentences are made of, and the names of witnesses, stages and causes."""
    sentences = [english for english, _ in catalogue_evidence.SENTENCES]
    sentences += [text["en"] for text in FINDINGS.values()]
    sentences += [text["en"] for text in catalogue_evidence.STAGES.values()]
    names = [*catalogue_evidence.WITNESSES, *catalogue_evidence.STAGES, *catalogue_evidence.KINDS]
    names += [*catalogue_reports.CAUSES, *catalogue_reports.STEPS, *catalogue_evidence.ORDEALS, MASK, *_WAITS]
    said = re.sub(r"\{\w+\}", " ", " ".join([*sentences, *names]))
    return frozenset(word for raw in said.lower().split() if (word := raw.strip("()[]{}'\",:;.")))


@cache
def _path_words() -> frozenset[str]:
    return frozenset(
        {"api", "ledger", "transactions", "accounts", "entries", "imports", "commands", "balances", "drill"}
    )
