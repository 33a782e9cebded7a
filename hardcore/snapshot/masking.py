"""What evidence may show of a value: secrets are masked before anything reaches the disk.

Three sieves, from coarse to fine. A local variable with a secret's name, or in a function with one, is
masked whatever it holds. A text that *mentions* such a name is masked as a whole: a debugger's rendering of
a nested value is cut, unescaped and can't be parsed safely, and evidence that is lost is cheaper than a
password that is kept. What passes both loses the parts that look like a secret by their shape. The names of
the ledger's own ids pass the second sieve, never the third.
"""

import re

MASK = "<masked>"

_SECRET_NAME = re.compile(
    r"pass(?:word|wd|phrase|code)|\bpwd\b|_pwd|pwd_|secret|token|cookie|authori[sz]ation|bearer|credential"
    r"|api_?-?key|private_?-?key|key_?material|signing_?key|encryption_?key|session_?id|\botp\b|one_time_code"
    r"|비밀번호|암호",
    re.IGNORECASE,
)

#: Locals whose value is an id, a time or an amount by the ledger's own convention.
_OPEN_NAMES = frozenset(
    {
        "account_id",
        "account_ids",
        "amount",
        "command_id",
        "currency",
        "epoch",
        "kind",
        "ordinal",
        "seq",
        "stage",
        "transaction_id",
    }
)

_SHAPES = re.compile(
    r"eyJ[\w-]{8,}\.[\w-]+(?:\.[\w-]*)?"  # a signed web token
    r"|-----BEGIN[^-]*PRIVATE KEY-----.*"  # a key in text form, to the end of what is shown
    r"|(?<=://)[^/\s:@]+:[^/\s@]+(?=@)"  # user and password in an address
    r"|\b\d{6}-[1-8]\d{6}\b",  # a resident registration number
    re.DOTALL,
)
#: The shape of a card number. A time in nanoseconds has it too, so the check digit decides, and the parts
#: of an id made of hexadecimal groups are no candidates.
_CARD = re.compile(r"(?<![\w.-])(?:(?:\d{4}[ -]){3}\d{1,4}|\d{15,16})(?![\w-])")
#: A secret in a line of text: its name, then what is said to be its value, to the end of the line.
_ASSIGNED = re.compile(rf"((?:{_SECRET_NAME.pattern})[\w-]*[\"']?\s*[:=]).*", re.IGNORECASE)
_CARRIED = re.compile(r"\b(Bearer|Basic)\s+\S+", re.IGNORECASE)


def mask_local(function: str, name: str, shown: str) -> str:
    """Return how the value `shown` of the local variable `name` of `function` may appear in evidence."""
    if name in _OPEN_NAMES:
        return mask_shapes(shown)
    if any(_SECRET_NAME.search(text) for text in (function, name, shown)):
        return MASK
    return mask_shapes(shown)


def mask_line(line: str) -> str:
    """Return one line of a log without what follows a secret's name."""
    return mask_shapes(_CARRIED.sub(rf"\1 {MASK}", _ASSIGNED.sub(rf"\1 {MASK}", line)))


def mask_payload(text: str) -> str:
    """Return a request's body as it may appear in evidence: whole, or not at all if it names a secret."""
    return MASK if _SECRET_NAME.search(text) else mask_shapes(text)


def mask_shapes(text: str) -> str:
    """Return `text` without the parts that look like a secret by their shape."""
    return _CARD.sub(_mask_card, _SHAPES.sub(MASK, text))


def _mask_card(match: re.Match[str]) -> str:
    digits = [int(digit) for digit in match.group() if digit.isdecimal()]
    doubled = [digit * 2 - 9 * (digit > 4) for digit in digits[-2::-2]]
    return MASK if (sum(digits[-1::-2]) + sum(doubled)) % 10 == 0 else match.group()
