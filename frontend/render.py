"""From a slug and values to words in a person's language; the one place where texts are filled in.

It imports the standard library and the catalogues alone, because the gateway uses it too and must stay small.
Only two languages exist, so the choice is a short reading of `Accept-Language` and no negotiation library:
Korean and English by the client's own order, and English for everybody else.
"""

from typing import Final, Literal

from frontend.catalogue_problems import PROBLEMS, READ_ONLY

Language = Literal["ko", "en"]

ACCEPT_LANGUAGE_CHARACTERS_MAX: Final = 1_000
_DEFAULT: Final[Language] = "en"


def language(accept_language: str | None) -> Language:
    """Return the language a client would rather read; English if it says nothing that we speak.

    A hostile or endless header costs no more than its first thousand characters.
    """
    best: Language = _DEFAULT
    best_quality = 0.0
    for part in (accept_language or "")[:ACCEPT_LANGUAGE_CHARACTERS_MAX].split(","):
        name, _, parameters = part.strip().partition(";")
        spoken = name.strip().lower().partition("-")[0]
        quality = _quality(parameters)
        if quality <= best_quality:
            continue
        if spoken == "ko":
            best, best_quality = "ko", quality
        elif spoken in {"en", "*"}:
            best, best_quality = "en", quality
    return best


def problem_text(slug: str, lang: Language, **values: object) -> tuple[str, str]:
    """Return title and detail of a ledger's problem. A slug or value that is missing is our own bug.

    `why` among the values is the diagnosis because of which only reads are served; a sentence says it.
    """
    title, detail = PROBLEMS[slug][lang]
    if "why" in values:
        values["why"] = read_only_because(str(values["why"]), lang)
    return title, detail.format_map(values)


def read_only_because(diagnosis: str, lang: Language) -> str:
    """Return the sentence that says why only reads are served."""
    return READ_ONLY.get(diagnosis, READ_ONLY[""])[lang]


def _quality(parameters: str) -> float:
    name, _, number = parameters.replace(" ", "").partition("=")
    if name != "q":
        return 1.0
    digits = number.replace(".", "", 1)
    # Only plain decimals: float() would also take "nan" and "1e9".
    return min(float(number), 1.0) if digits.isascii() and digits.isdigit() else 0.0
