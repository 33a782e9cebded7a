"""The demo's page: whole in both languages, nothing in it that the page's policy would refuse, and small."""

import gzip
import re
from pathlib import Path
from typing import get_args

import pytest

from frontend import demo_paper
from frontend.catalogue_demo import DEMO, FAULTS, words
from frontend.render import Language

SCRIPT = (Path(demo_paper.__file__).parent / "demo" / "demo.js").read_text("utf-8")
PAGE_BYTES_MAX = 8_000
PLACE = re.compile(r"\{(\w+)\}")
PARTICLE_AFTER_A_VALUE = re.compile(r"\}(은|는|이|가|을|를|과|와|로)\b")


def test_every_text_that_the_script_says_is_in_the_catalogue() -> None:
    said = set(re.findall(r'say\("([\w.]+)"', SCRIPT)) | set(re.findall(r"WORDS\.(\w+)", SCRIPT))
    assert said
    assert said <= set(DEMO)
    assert {f"stage.{number}" for number in range(1, 5)} <= set(DEMO)


@pytest.mark.parametrize("code", sorted(DEMO))
def test_both_languages_name_the_same_values_and_no_particle_stands_after_one(code: str) -> None:
    ko, en = DEMO[code]
    assert set(PLACE.findall(ko)) == set(PLACE.findall(en))
    assert not PARTICLE_AFTER_A_VALUE.search(ko)


@pytest.mark.parametrize("code", ["coffee", "category", "method"])
def test_what_is_booked_has_one_name_in_both_languages(code: str) -> None:
    ko, en = DEMO[code]
    assert ko == en


def test_a_length_that_nobody_knows_is_not_called_zero() -> None:
    assert 'detail.outage_ms === null) say("log.again_there"' in SCRIPT


@pytest.mark.parametrize("lang", get_args(Language))
def test_the_page_has_a_button_for_each_fault_and_nothing_inline(lang: Language) -> None:
    page = demo_paper.demo_page(lang).decode()
    for fault in FAULTS:
        assert f'data-fault="{fault}"' in page
    assert f'<html lang="{lang}">' in page
    assert not re.search(r"<style|\sstyle=|\son\w+=|<script(?![^>]*\ssrc=)", page)
    assert words(lang)["title"] in page


def test_the_page_and_its_files_are_small() -> None:
    bodies = [demo_paper.demo_page("ko"), *(body for body, _kind in demo_paper.demo_files().values())]
    assert sum(len(gzip.compress(body)) for body in bodies) <= PAGE_BYTES_MAX


def test_nothing_is_put_into_the_page_as_markup() -> None:
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(", SCRIPT)
