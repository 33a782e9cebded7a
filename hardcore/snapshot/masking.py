"""What evidence may show of a value: three sieves, before anything reaches the disk.

First an allow-list: a value is shown only where its name says that it is an id, an amount or a number with a
unit, and only if it has that form; of free text only plain words, numbers, ids and places in code. Then a
list of names: whatever is said to be a secret goes, with all that follows it. Then patterns: what looks like
a secret by its shape, and in a line of text a long number that has no unit. To hide only what has a secret's
name was the rule before and was not kept: a password typed into a description has no name. What no sieve can
tell is one plain word of prose from another.
"""

import re

MASK = "<masked>"
#: Stands for each hidden byte of a payload, so that what is shown keeps its place and its length.
HIDDEN = b"*"

_SECRET_NAME = re.compile(
    r"pass(?:word|wd|phrase|code)|\bpwd\b|_pwd|pwd_|secret|token|cookie|authori[sz]ation|bearer|credential"
    r"|api_?-?key|private_?-?key|key_?material|signing_?key|encryption_?key|session_?id|\botp\b|one_time_code"
    r"|\bpin\b|비밀번호|암호|인증번호|주민(?:등록)?번호",
    re.IGNORECASE,
)

_ID = r"[\w:.-]{1,120}"
_IDS = rf"{_ID}(?:,{_ID}){{0,31}}"  # a core's frame names several in one text
_NUMBER = r"-?\d[\d.,]{0,30}"
_WORD = r"[A-Za-z_]{1,40}"
_MOMENT = r"\d{4}-\d\d-\d\d(?:T[\d:.+-]{5,24}Z?)?"

#: The names whose values may be shown, each with the form that the value must have.
_SHOWN: dict[str, str] = {
    **dict.fromkeys(("account_id", "account_ids", "transaction_id"), _IDS),
    **dict.fromkeys(("account", "command_id", "entry", "entry_id", "id", "import_id"), _ID),
    **dict.fromkeys(("key_hash", "lock_name", "reverses", "transaction"), _ID),
    **dict.fromkeys(
        ("amount", "epoch", "expected_seq", "generation", "held_by", "ordinal", "seq"), rf"{_NUMBER}|"
    ),
    **dict.fromkeys(("currency", "kind", "stage", "type"), _WORD + r"(?:\.[A-Za-z_]{1,40})*"),
    "date": _MOMENT,
}
#: A name with a unit holds a number.
_WITH_UNIT = re.compile(r"\w+_(?:ns|ms|s|bytes|count|max|min)")
_FORMS = {name: re.compile(form) for name, form in _SHOWN.items()}
_ANY_NUMBER = re.compile(_NUMBER)
_NOTHING = frozenset({"None", "True", "False", "null", "true", "false", '""', "''", "[]", "()"})
#: An object that a debugger can't look into: its type and its address, which is how a lock is told from another.
_OBJECT = re.compile(r"<[\w. ]{1,80} at 0x[0-9a-f]+>")

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
#: A secret in a rendered value: its name, then what is said to be its value, to the end.
_ASSIGNED = re.compile(rf"({_SECRET_NAME.pattern})[\w-]*[\"']?\s*[:=].*", re.IGNORECASE)
#: A secret in a line of text: its name, and whatever stands behind it. A file of code may be called so.
_SPOKEN = re.compile(rf"({_SECRET_NAME.pattern})(?![\w./-]*\.py\b).*", re.IGNORECASE)
_CARRIED = re.compile(r"\b(Bearer|Basic)\s+\S+", re.IGNORECASE)

#: What may be shown of a line of text, piece by piece; what stands between blanks and is none of it is hidden.
_PIECE = re.compile(
    r"[(\[]*(?:"
    r"[^\W\d_]{1,24}(?:'[a-z]{1,2})?"  # a word of prose
    r"|[\w.]{0,60}(?:Error|Exception|Warning|Interrupt|Exit)"  # a kind of exception, which is a name of code
    r"|[-+#]?\d[\d.,:]{0,29}(?:[a-z]{1,3}|%)?"  # a number, a time of day
    r"|\d{4}-\d\d-\d\d(?:T[\d:.+]{5,20}Z?)?"
    r"|[0-9a-f]{8}-(?:[0-9a-f]{4}-){3}[0-9a-f]{12}"  # an id of ours
    r"|(?:[\w.-]+/){0,3}\w{1,60}\.py:\d+"  # a place in code
    r")[)\].,:;]*|[-–—=…·]{1,3}"
)
_IN_CODE = re.compile(r'\s*File "(?:[^"]*/)?([^"/]+)", line (\d+)(?:, in ([\w<>.]{1,80}))?')
#: A function behind its place, as the stories of exceptions tell it.
_STORY = re.compile(r"\w\.py:\d+ ([\w<>]{1,80})(?=[:,)])")
_MASKS = re.compile(rf"{MASK}(?:\s+{MASK})+")
#: So many digits in a row are a time, a size, or a number that is somebody's: of an account, a card, a person.
_MANY_DIGITS = re.compile(r"\d(?:[.,]?\d){8,}")
_UNIT = r"(?:ns|us|ms|s|b|kb|mb|bytes)"
_MEASURED = re.compile(rf"[(\[]*[-+#]?[\d.,]+{_UNIT}[)\].,:;]*", re.IGNORECASE)
_A_UNIT = re.compile(rf"{_UNIT}[)\].,:;]*", re.IGNORECASE)
#: A moment, an id of ours, a place in code: their digits are nobody's number.
_OURS = re.compile(rf"[(\[]*(?:{_MOMENT}|[0-9a-f]{{8}}-[0-9a-f-]{{27}}|\S+\.py:\d+)[)\].,:;]*")

_PAIR = re.compile(
    rb'"('
    + b"|".join(name.encode() for name in _SHOWN)
    + rb')"\s*:\s*(?:"((?:[^"\\\x00-\x1f])*)"|(-?[\d.]{1,31}))'
)


def mask_local(function: str, name: str, shown: str) -> str:
    """Return how the value `shown` of the local variable `name` of `function` may appear in evidence."""
    if _OBJECT.fullmatch(shown) or shown in _NOTHING:
        return shown
    if not all(_has_form(name, part) for part in parts(shown) if part != "..."):
        return MASK
    return MASK if _SECRET_NAME.search(function) else _masked_text(shown)


def parts(shown: str) -> list[str]:
    """Return the texts in a debugger's rendering of a text, of a number, or of a list of texts."""
    if shown[:1] in {"[", "("}:
        inner = shown[1:-1].strip()
        return [part.strip().strip("\"'") for part in inner.split(",") if part.strip()] if inner else []
    return [shown[1:-1] if len(shown) > 1 and shown[0] == shown[-1] and shown[0] in "\"'" else shown]


def mask_line(line: str) -> str:
    """Return what may be shown of one line of a log, of an exception's story, or of any text like them."""
    if (place := _IN_CODE.fullmatch(line)) is not None:
        return f'  File "{place[1]}", line {place[2]}' + (f", in {place[3]}" if place[3] else "")
    functions = set(_STORY.findall(line))
    secret = _SPOKEN.search(line)
    words = (line[: secret.start()] if secret else line).split(" ")
    pieces = [
        word if _may_be_told(word, after) or word.rstrip(":,)") in functions else MASK
        for word, after in zip(words, [*words[1:], ""], strict=True)
    ]
    told = " ".join(pieces) + (f"{secret[1]}: {MASK}" if secret else "")
    return _MASKS.sub(MASK, mask_shapes(_CARRIED.sub(rf"\1 {MASK}", told)))


def short_path(path: str) -> str:
    """Return the last two parts of a file's path: enough to find it, nothing about the machine."""
    return "/".join(path.rsplit("/", 2)[-2:])


def visible(text: str) -> str:
    """Return `text` with every character that does not print as an escape: a name of the core moves no terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)


def mask_payload(payload: bytes) -> bytes:
    """Return a request's body as it may appear in evidence: as long as it was, with `*` for what is hidden.

    Shown are the fields of the allow-list and their values, where they have the form of one. The body may be cut
    anywhere and need not be JSON: then nothing of it is shown.
    """
    told = bytearray(HIDDEN * len(payload))
    for pair in _PAIR.finditer(payload):
        name = pair[1].decode()
        value = (pair[2] if pair[2] is not None else pair[3]).decode("utf-8", "replace")
        if _has_form(name, value) and _masked_text(value) == value:
            told[pair.start() : pair.end()] = pair[0]
    return bytes(told)


def readable_payload(masked: bytes) -> str:
    """Return a masked body as text for people: each stretch of what is hidden becomes one word."""
    return re.sub(r"\*+", MASK, masked.decode("utf-8", "replace"))


def mask_shapes(text: str) -> str:
    """Return `text` without the parts that look like a secret by their shape."""
    return _CARD.sub(_mask_card, _SHAPES.sub(MASK, text))


def is_id(text: str) -> bool:
    """Tell whether `text` has the form of an id, or of several with commas between, and looks like no secret."""
    return re.fullmatch(_IDS, text) is not None and _masked_text(text) == text


def _may_be_told(word: str, after: str) -> bool:
    """Tell whether a word of a line may be shown; `after` is the next one, which may be its unit."""
    if not word:
        return True
    if _PIECE.fullmatch(word) is None:
        return False
    if _MANY_DIGITS.search(word) is None or _OURS.fullmatch(word):
        return True
    return bool(_MEASURED.fullmatch(word) or _A_UNIT.fullmatch(after))


def _has_form(name: str, value: str) -> bool:
    form = _FORMS.get(name)
    if form is None and _WITH_UNIT.fullmatch(name):
        form = _ANY_NUMBER
    return form is not None and form.fullmatch(value) is not None


def _masked_text(text: str) -> str:
    return mask_shapes(_CARRIED.sub(rf"\1 {MASK}", _ASSIGNED.sub(rf"\1: {MASK}", text)))


def _mask_card(match: re.Match[str]) -> str:
    digits = [int(digit) for digit in match.group() if digit.isdecimal()]
    doubled = [digit * 2 - 9 * (digit > 4) for digit in digits[-2::-2]]
    return MASK if (sum(digits[-1::-2]) + sum(doubled)) % 10 == 0 else match.group()
