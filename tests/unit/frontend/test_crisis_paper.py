"""What the gateway shows of its own: whole pages, small files, nothing that a policy or a reader has to forgive."""

import base64
import gzip
import hashlib
import json
import re
from html.parser import HTMLParser
from itertools import product
from typing import Final

import pytest

from frontend.catalogue_crisis import LANGUAGES, words
from frontend.catalogue_receipts import RECEIPTS
from frontend.crisis_paper import (
    BRACKET,
    CLIENT_MODULES,
    GATE_MODULES,
    KINDS,
    OPERATOR,
    OUTCOMES,
    PAGE_MODULES,
    PAGE_ONLY,
    RECEIPT_MODULES,
    RECEIPT_OUTCOMES,
    SOURCES,
    Kind,
    Outcome,
    Settled,
    own_files,
    receipt_page,
    recovery_page,
)
from frontend.render import Language

KIB: Final = 1024
RECOVERY_PAGE_BYTES_MAX: Final = 20 * KIB  # gzip, as the project promises
LIVING_PAGE_BYTES_MAX: Final = 15 * KIB + 512  # gzip, file by file, one language
_ANY_IMPORT: Final = re.compile(r"^[ ]*import\b.*", flags=re.MULTILINE)
_TOP_NAME: Final = re.compile(r"^(?:export )?(?:async )?(?:const|let|function) (\w+)", flags=re.MULTILINE)
_USED_WORD: Final = re.compile(r"words(?:\.(\w+)|\[\"([\w.]+)\"\])")

ALL: Final = [(lang, kind, outcome) for lang in LANGUAGES for kind in KINDS for outcome in OUTCOMES]


class _Elements(HTMLParser):
    """The elements of a page, and the texts of its styles and scripts."""

    def __init__(self, page: bytes) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.inside: dict[str, str] = {}
        self.feed(page.decode())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.found and self.found[-1][0] in {"style", "script"}:
            self.inside.setdefault(self.found[-1][0], data)


def _zipped(*bodies: bytes) -> int:
    return sum(len(gzip.compress(body)) for body in bodies)


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


@pytest.mark.parametrize(("lang", "kind", "outcome"), ALL)
def test_a_recovery_page_is_allowed_by_its_own_hashes_and_needs_nothing_else(
    lang: Language, kind: Kind, outcome: Outcome
) -> None:
    page = recovery_page(lang, kind, outcome)
    seen = _Elements(page.body)
    assert page.script_hash == _hash(seen.inside["script"])
    assert page.style_hash == _hash(seen.inside["style"])
    for _, attributes in seen.found:
        assert not {"src", "style", "onclick", "onload"} & attributes.keys()
    assert len([tag for tag, _ in seen.found if tag in {"script", "style"}]) == 2
    assert _zipped(page.body) <= RECOVERY_PAGE_BYTES_MAX


@pytest.mark.parametrize(("lang", "kind", "outcome"), ALL)
def test_a_page_that_answers_a_form_or_waits_for_a_person_never_reopens_by_itself(
    lang: Language, kind: Kind, outcome: Outcome
) -> None:
    seen = _Elements(recovery_page(lang, kind, outcome).body)
    refreshes = [attributes for tag, attributes in seen.found if attributes.get("http-equiv") == "refresh"]
    waits = kind in {"recovering", "planned"} and outcome == "get"
    assert [refresh["content"] for refresh in refreshes] == (["5"] if waits else [])


@pytest.mark.parametrize(("lang", "kind", "outcome"), ALL)
def test_a_page_says_without_a_script_what_is_true(lang: Language, kind: Kind, outcome: Outcome) -> None:
    text = recovery_page(lang, kind, outcome).body.decode().partition("<script")[0]
    says = words(lang)
    assert (says["not_done.line"] in text) == (outcome == "not_done")
    assert (says["unknown.line"] in text) == (outcome in {"unknown", "doubtful"})
    assert (says["doubtful.wait"] in text) == (outcome == "doubtful")
    assert (says["keepable.line"] in text) == (outcome == "keepable")
    assert text.count("<form") == text.count("<!--fields-->") == (outcome in {"keepable", "doubtful"})
    assert (says["R15.line"] in text) == (kind in {"recovering", "planned"} and outcome == "get")
    assert says["R3.verified"] not in text
    assert says["draft.stored"] not in text


@pytest.mark.parametrize(("lang", "outcome"), [*product(LANGUAGES, RECEIPT_OUTCOMES)])
def test_a_receipts_page_says_what_became_of_it_and_nothing_else(lang: Language, outcome: Settled) -> None:
    page = receipt_page(lang, outcome)
    seen = _Elements(page.body)
    assert page.script_hash == _hash(seen.inside["script"])
    assert page.style_hash == _hash(seen.inside["style"])
    assert _zipped(page.body) <= RECOVERY_PAGE_BYTES_MAX
    text = page.body.decode().partition("<body")[2].partition("<script")[0]
    which = LANGUAGES.index(lang)
    for other in RECEIPT_OUTCOMES:
        head = RECEIPTS[{"waiting": "R1c", "ask": "R5.line", "done": "done"}.get(other, f"{other}.line")][
            which
        ]
        assert (head.partition("{")[0] in text) == (other == outcome)
    assert text.count("<!--id-->") == 1
    assert ("<!--why-->" in text) == (outcome == "refused")
    assert text.count("<!--key-->") == text.count("<form") == {"ask": 2, "set_aside": 1}.get(outcome, 0)
    refreshes = [attributes for _, attributes in seen.found if attributes.get("http-equiv") == "refresh"]
    assert [one["content"] for one in refreshes] == (["5"] if outcome == "waiting" else [])


@pytest.mark.parametrize("lang", LANGUAGES)
def test_what_a_living_page_loads_is_small(lang: Language) -> None:
    loaded = ("client.js", "client.css", f"words.{lang}.js")
    assert _zipped(*[own_files()[f"/__hc/{name}"].body for name in loaded]) <= LIVING_PAGE_BYTES_MAX


def test_the_words_of_a_language_are_a_module() -> None:
    for lang in LANGUAGES:
        one = own_files()[f"/__hc/words.{lang}.js"]
        assert one.content_type == "text/javascript; charset=utf-8"
        told = one.body.decode().removeprefix("export const words = ").removesuffix(";\n")
        said = {code: text for code, text in words(lang).items() if code.partition(".")[0] not in PAGE_ONLY}
        assert json.loads(told) == said


def test_what_only_the_recovery_page_says_is_asked_for_only_there() -> None:
    """On a living page there is no form that was answered, and nobody who reopens it."""
    recovery = (SOURCES / "recovery.js").read_text("utf-8")
    for module in set(CLIENT_MODULES):
        used = {
            plain or quoted for plain, quoted in _USED_WORD.findall((SOURCES / module).read_text("utf-8"))
        }
        assert not {word for word in used if word.partition(".")[0] in PAGE_ONLY}, module
    assert "words.reopen" in recovery


def test_no_comment_of_ours_is_sent() -> None:
    for path, one in own_files().items():
        lines = one.body.decode().splitlines()
        assert not [line for line in lines if line.lstrip().startswith(("//", "/*", "*/"))], path


@pytest.mark.parametrize("module", sorted(path.name for path in SOURCES.glob("*.js")))
def test_every_import_is_one_line_so_that_modules_can_stand_in_one(module: str) -> None:
    text = (SOURCES / module).read_text("utf-8")
    assert all(
        re.fullmatch(r'import \{ .* \} from "\./\w+\.js";', line) for line in _ANY_IMPORT.findall(text)
    )


@pytest.mark.parametrize("modules", [PAGE_MODULES, CLIENT_MODULES, RECEIPT_MODULES])
def test_modules_that_stand_in_one_share_no_name(modules: tuple[str, ...]) -> None:
    names = [name for module in modules for name in _TOP_NAME.findall((SOURCES / module).read_text("utf-8"))]
    assert sorted(names) == sorted(set(names))


@pytest.mark.parametrize("modules", [PAGE_MODULES, CLIENT_MODULES, RECEIPT_MODULES])
def test_each_module_comes_after_those_it_imports(modules: tuple[str, ...]) -> None:
    for place, module in enumerate(modules):
        text = (SOURCES / module).read_text("utf-8")
        assert set(re.findall(r'from "\./([\w.]+)"', text)) <= set(modules[:place])


@pytest.mark.parametrize("module", sorted({*CLIENT_MODULES, *RECEIPT_MODULES}))
def test_no_string_has_what_is_taken_for_an_operator(module: str) -> None:
    text = re.sub(r"//.*|/\*.*?\*/", "", (SOURCES / module).read_text("utf-8"))
    strings = re.findall(r"\"[^\"\n]*\"", text)
    assert not [string for string in strings if OPERATOR.search(string) and string != '" ? "']
    assert not [string for string in strings if BRACKET.search(string)]


def test_every_module_is_used() -> None:
    used = {*PAGE_MODULES, *CLIENT_MODULES, *RECEIPT_MODULES, *GATE_MODULES}
    assert {path.name for path in SOURCES.glob("*.js")} == used


def test_every_word_the_scripts_say_is_in_the_catalogue_and_no_module_makes_markup() -> None:
    says = words("en")
    for path in SOURCES.glob("*.js"):
        text = path.read_text("utf-8")
        for plain, quoted in _USED_WORD.findall(text):
            assert (plain or quoted) in says, f"{path.name}: {plain or quoted}"
        assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(", text), (
            path.name
        )
