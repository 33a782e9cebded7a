import re
import string
from pathlib import Path

import pytest
from jinja2 import UndefinedError

from frontend.assets import assets
from frontend.catalogue_pages import SCRIPT_WORDS, TEXTS
from frontend.catalogue_receipts import RECEIPTS
from frontend.paper import Reader, draw, page_text, reader_language
from tests.unit.frontend.test_days import TODAY

ROOT = Path(__file__).parents[3]
OWN = (
    "base", "parts", "overview", "register", "entry", "accounts", "imports", "import", "problem", "transaction",
    "transaction_new", "plans", "recurring",
)  # fmt: skip
TEMPLATES = [ROOT / "templates" / f"{name}.html.j2" for name in OWN]
SCRIPTS = sorted((ROOT / "frontend" / "static").glob("*.js"))
CSS_GZIP_BYTES_MAX = 6 << 10
SCRIPTS_GZIP_BYTES_MAX = 20 << 10  # both languages, and those of the import page and of the full form


def names_in(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}


@pytest.mark.parametrize("name", sorted(TEXTS))
def test_a_text_of_the_pages_is_calm_and_whole_in_both_languages(name: str) -> None:
    assert set(TEXTS[name]) == {"ko", "en"}
    assert names_in(TEXTS[name]["ko"]) == names_in(TEXTS[name]["en"])
    for text in TEXTS[name].values():
        assert text.strip() == text != ""
        assert "!" not in text


@pytest.mark.parametrize("name", sorted(TEXTS))
def test_in_korean_only_a_counter_stands_directly_after_a_value(name: str) -> None:
    assert set(re.findall(r"\}([가-힣]+)", TEXTS[name]["ko"])) <= {
        "번째",
        "줄을",
        "줄",
        "건",
        "건은",
        "분",
        "건 중",
    }


def test_every_text_is_used_and_every_used_text_is_there() -> None:
    used = set(SCRIPT_WORDS)
    for path in (
        *TEMPLATES,
        *(ROOT / "core" / "web").glob("pages*.py"),
    ):
        used |= set(re.findall(r'"([a-z][a-z_]+)"', path.read_text()))
        # Names that are put together: t("type_" ~ kind).
        for start in re.findall(r'\bt\("([a-z_]+_)" ~', path.read_text()):
            used |= {name for name in TEXTS if name.startswith(start)}
    made = {name for name in TEXTS if name.startswith(("fault_", "date_format_", "decimal_", "positive_"))}
    made |= {f"{name}_one" for name in used}
    assert set(TEXTS) - used - made == set()
    asked = {name for path in TEMPLATES for name in re.findall(r'\bt\("([a-z_]+[a-z])"', path.read_text())}
    assert asked - set(TEXTS) == set()


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_a_script_says_its_idea_and_never_makes_markup_of_data(path: Path) -> None:
    text = path.read_text()
    assert text.startswith("// ")
    assert not re.search(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text
    )
    for word in re.findall(r'\bsay\("([a-z_]+)"', text):
        assert word in SCRIPT_WORDS
    for code in re.findall(r'"receipt\.([\w.]+)"', text):
        assert code in RECEIPTS


def test_the_files_of_a_page_are_small_and_named_by_what_they_hold() -> None:
    files = assets().files
    assert len(files["ledger.css"].packed) <= CSS_GZIP_BYTES_MAX
    scripts = [kept for name, kept in files.items() if name.endswith(".js")]
    assert sum(len(kept.packed) for kept in scripts) <= SCRIPTS_GZIP_BYTES_MAX
    assert assets().path("ledger.css") == f"/static/{assets().folder}/ledger.css"


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_what_is_left_out_of_a_script_is_none_of_its_texts(path: Path) -> None:
    bare = re.sub(r"^\s*(//.*|/\*(?s:.*?)\*/)$", "", path.read_text(), flags=re.MULTILINE)
    assert all(line.count("`") % 2 == 0 for line in bare.splitlines())
    sent = assets().files[path.name].body.decode()
    assert [line.strip() for line in bare.splitlines() if line.strip()] == [
        line for line in sent.splitlines() if line
    ]


def test_a_page_escapes_what_it_is_given_and_misses_nothing_silently() -> None:
    reader = Reader("en", TODAY, "/x?a=\"'><script>")
    page = draw("problem.html.j2", reader, here="", seq=0, title="<b>&</b>", detail="{{ 7*7 }}")
    assert "&lt;b&gt;&amp;&lt;/b&gt;" in page
    assert "{{ 7*7 }}" in page
    assert "<script>" not in page
    with pytest.raises(UndefinedError):
        draw("problem.html.j2", reader, here="", seq=0, title="")


def test_what_the_reader_chose_beats_what_the_browser_asks_for() -> None:
    assert reader_language("en", "ko-KR") == "en"
    assert reader_language("ko", None) == "ko"
    assert reader_language("xx", "ko-KR") == "ko"
    assert reader_language(None, None) == "en"


def test_how_many_there_are_is_grouped_and_one_is_one() -> None:
    assert page_text("import_progress", "ko", done=320, total=6000) == "6,000건 중 320건"
    assert page_text("import_rows", "en", n=1) == "1 row was found in the file."
    assert page_text("import_rows", "en", n=1234) == "1,234 rows were found in the file."
    assert page_text("line_n", "en", n="1234") == "Line 1234"


def test_a_text_takes_values_of_any_name() -> None:
    assert page_text("account_close_of", "en", name="{0.__class__}") == "More: {0.__class__}"
