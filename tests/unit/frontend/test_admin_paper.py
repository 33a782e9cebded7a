import re
import string
from pathlib import Path

import pytest

from frontend.admin_paper import (
    AdminReader,
    admin_files,
    admin_language,
    admin_text,
    draw_admin,
    moment,
    shortened,
    took,
)
from frontend.catalogue_admin import TEXTS
from frontend.catalogue_admin_alerts import ALERT_TEXTS
from frontend.catalogue_admin_guard import GUARD_TEXTS
from frontend.catalogue_admin_letters import LETTER_TEXTS
from tests.unit.frontend.test_pages_paper import names_in

ROOT = Path(__file__).parents[3]
WORDS = {**TEXTS, **LETTER_TEXTS, **ALERT_TEXTS, **GUARD_TEXTS}
TEMPLATES = sorted((ROOT / "templates" / "admin").glob("*.j2"))
SCRIPTS = sorted((ROOT / "frontend" / "admin").glob("*.js"))
ROOMS = sorted((ROOT / "postmortem" / "web").glob("*.py"))


def test_no_text_stands_in_both_catalogues() -> None:
    assert len(WORDS) == len(TEXTS) + len(LETTER_TEXTS) + len(ALERT_TEXTS) + len(GUARD_TEXTS)


@pytest.mark.parametrize("name", sorted(WORDS))
def test_a_text_of_the_dashboard_is_calm_and_whole_in_both_languages(name: str) -> None:
    assert set(WORDS[name]) == {"ko", "en"}
    assert names_in(WORDS[name]["ko"]) == names_in(WORDS[name]["en"])
    for text in WORDS[name].values():
        assert text.strip() == text != ""
        assert "!" not in text


@pytest.mark.parametrize("name", sorted(WORDS))
def test_in_korean_no_particle_stands_directly_after_a_value(name: str) -> None:
    after = set(re.findall(r"\}([가-힣]+)", WORDS[name]["ko"]))
    assert after <= {"건", "건을", "개", "일", "초", "초를", "번", "번보다", "시간", "건이", "건은", "부터"}


def test_every_text_is_used_and_every_used_text_is_there() -> None:
    used: set[str] = set()
    asked: set[str] = set()
    for path in (*TEMPLATES, *ROOMS):
        text = path.read_text()
        used |= set(re.findall(r'"([a-z][\w-]+)"', text))
        asked |= set(re.findall(r'\bt\("([a-z][\w-]*[a-zA-Z])"[,)]', text))
        # Names that are put together: t("state_" ~ state), words(f"bulk_{verb}").
        for start in re.findall(r'"([a-z]+_)" ~', text) + re.findall(r'f"([a-z]+_)\{', text):
            used |= {name for name in WORDS if name.startswith(start)}
    made = {
        name for name in WORDS if name.endswith(("_title", "_one")) or name.startswith(("said_", "refused_"))
    }
    made |= {"certain", "likely", "unknown"}  # the grades of a finding, as the facts have them
    assert set(WORDS) - used - made == set()
    assert asked - set(WORDS) == set()


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_a_script_says_its_idea_and_never_makes_markup_of_data(path: Path) -> None:
    text = path.read_text()
    assert text.startswith("// ")
    assert not re.search(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function", text
    )


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.name)
def test_nothing_in_a_template_is_inline_and_nothing_is_said_unescaped(path: Path) -> None:
    text = path.read_text()
    assert not re.search(r"<style|\sstyle=|\son[a-z]+=|\|\s*safe|javascript:", text)
    assert all(" src=" in tag for tag in re.findall(r"<script[^>]*>", text))
    assert not re.search(r">[^<{]*[가-힣]{2,}[^<{]*<", text.replace("한국어", ""))


def test_a_form_of_every_template_carries_the_token() -> None:
    for path in TEMPLATES:
        text = path.read_text()
        posts = len(re.findall(r'<form[^>]*method="post"', text))
        tokens = text.count("parts.token(csrf)") + text.count('name="_csrf"') - text.count("macro token")
        assert posts <= tokens, path.name


def test_the_files_are_named_by_what_they_hold_and_small() -> None:
    folder, files = admin_files()
    assert re.fullmatch(r"[0-9a-f]{12}", folder)
    assert sum(len(file.body) for name, file in files.items() if name.endswith(".js")) <= 12 << 10
    assert len(files["admin.css"].body) <= 14 << 10


def test_a_page_escapes_what_it_is_given() -> None:
    reader = AdminReader("en", "/admin/?a=\"'><script>")
    shared = {"here": "", "csrf": "x", "version": "0", "said": "", "wrong": False, "back": "/admin/"}
    page = draw_admin("lost.html.j2", reader, title="<b>&</b>", more="{{ 7*7 }}", **shared)
    assert "&lt;b&gt;&amp;&lt;/b&gt;" in page
    assert "{{ 7*7 }}" in page
    assert "><script>" not in page


def test_what_can_not_be_seen_is_written_out_and_what_is_long_is_cut() -> None:
    assert shortened("a\u202eb\x1b[31m") == "a\\u202eb\\x1b[31m"
    assert shortened("x" * 1_000_000) == "x" * 399 + "…"
    assert shortened("가나다") == "가나다"


def test_a_length_of_time_is_the_coarser_the_longer_it_is() -> None:
    said = [
        took(length, lang="en") for length in (None, 84.4, 1_000, 119_000, 120_000, 7_200_000, 200_000_000)
    ]
    assert said == ["–", "84 ms", "1.0 s", "119.0 s", "2 min", "2 h", "2 d"]
    assert took(7_200_000, lang="ko") == "2시간"


def test_what_is_no_time_stays_as_it_is() -> None:
    assert moment(None, lang="ko") == "–"
    assert moment("soon\u202e", lang="en") == "soon\\u202e"
    assert re.fullmatch(r"2026-11-2\d \d\d:\d\d:15", moment("2026-11-21T14:08:15Z", lang="en"))


def test_what_the_reader_chose_beats_what_the_browser_asks_for() -> None:
    assert admin_language("en", "ko-KR") == "en"
    assert admin_language("xx", "ko-KR") == "ko"


def test_one_is_told_as_one() -> None:
    assert admin_text("bulk_retry", "en", n=1) == "Retry 1 request?"
    assert admin_text("bulk_retry", "en", n=1_200) == "Retry 1,200 requests?"


def test_a_value_of_a_text_can_not_be_asked_for_what_it_is_made_of() -> None:
    for text in WORDS.values():
        for said in text.values():
            assert all(
                "." not in (name or "") and "[" not in (name or "")
                for _, name, _, _ in string.Formatter().parse(said)
            )
