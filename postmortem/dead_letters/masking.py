"""A letter as it is shown: whatever is said to be a secret, or looks like one, is hidden until somebody asks to see it.

Two sieves, as for evidence: a list of names, whose values go whatever they are, and the shapes of secrets in what is
left. What people need to decide about a letter, its accounts, amounts and words, stays to be seen; an allow-list, as
for what leaves the machine, was not chosen for that reason. What is kept is not changed: a retry sends what was sent.
"""

import re
from collections.abc import Mapping
from typing import Any, Final
from urllib.parse import unquote_plus

from msgspec import structs

from postmortem.views import Letter

MASK: Final = "<masked>"
#: What lies deeper is hidden, whatever it is.
DEPTH_MAX: Final = 32

_NAME: Final = re.compile(
    r"pass(?:word|wd|phrase|code)|\bpwd\b|_pwd|pwd_|secret|token|cookie|authori[sz]ation|bearer|credential"
    r"|api[ _-]?key|private[ _-]?key|key_?material|signing[ _-]?key|encryption[ _-]?key|session[ _-]?id|csrf"
    r"|\botp\b|one_time_code|\bpin\b|비밀번호|암호|인증번호|주민(?:등록)?번호",
    re.IGNORECASE,
)
_SHAPES: Final = re.compile(
    r"(?<![\w-])eyJ[\w-]{8,4096}\.[\w-]+(?:\.[\w-]*)?"
    r"|-----BEGIN[^-]{0,40}PRIVATE KEY-----.*"
    r"|(?<=://)[^/\s:@]{1,256}:[^/\s@]{1,256}(?=@)"
    r"|\b\d{6}-[1-8]\d{6}\b"
    r"|(?<![\w.-])(?:\d{4}[ -]){3}\d{1,4}(?![\w-])"
    r"|\bBearer\s{1,8}\S+|\bBasic\s{1,8}[A-Za-z0-9+/=]{8,}",
    re.DOTALL | re.IGNORECASE,
)
#: In a text: a secret's name, then what is said to be its value, to the end of the line.
_SPOKEN: Final = re.compile(rf"({_NAME.pattern})([\w-]{{0,40}}[\"']?\s{{0,8}}[:=]).*", re.IGNORECASE)


def shown(letter: Letter) -> Letter:
    """The letter with the secrets of its contents, of its address and of a core's answer to it hidden."""
    dry_run = letter.dry_run
    return structs.replace(
        letter,
        path=masked_path(letter.path),
        payload=masked(letter.payload),
        row=masked(letter.row),
        dry_run=structs.replace(dry_run, answer=masked(dry_run.answer)) if dry_run is not None else None,
    )


def masked(value: Any, depth: int = 0) -> Any:
    """A JSON value with its secrets hidden; what holds none is equal to what it was."""
    if isinstance(value, str):
        return _SPOKEN.sub(rf"\1\2 {MASK}", _SHAPES.sub(MASK, value))
    if not isinstance(value, list | Mapping):
        return value
    if depth >= DEPTH_MAX:
        return MASK
    if isinstance(value, list):
        return [masked(one, depth + 1) for one in value]
    return {
        _SHAPES.sub(MASK, str(name)): MASK if _NAME.search(str(name)) else masked(one, depth + 1)
        for name, one in value.items()
    }


def masked_path(path: str) -> str:
    """A request's address with the secrets of its query hidden; the order and the names of its fields stay."""
    place, sign, query = path.partition("?")
    return _SHAPES.sub(MASK, place) + sign + "&".join(map(_field, query.split("&")))


def _field(field: str) -> str:
    name, sign, value = field.partition("=")
    told = unquote_plus(value)
    hides = _NAME.search(unquote_plus(name)) is not None or masked(told) != told
    return f"{name}{sign}{MASK}" if sign and hides else _SHAPES.sub(MASK, field)
