"""What a browser says in a crisis: complete in both languages, and no claim without the fact it stands on."""

import re
from typing import Final

import pytest

from frontend import catalogue_receipts as receipts
from frontend.catalogue_crisis import CRISIS, FACTS, LANGUAGES, words
from hardcore.model.phases import Phase

_VALUE: Final = re.compile(r"\{(\w+)\}")
# With or without a sentence's own mark between: "{n}은", "{stage}를".
_PARTICLE: Final = re.compile(r"\}(은|는|이|가|을|를|과|와|로|으로)(\s|$|[.,])")
#: Words that claim something of the ledger, the storage, the clipboard or the past.
_CLAIMS: Final = re.compile(
    r"확인했어요|잃은 내역은 없|저장해 뒀|되살렸|복사했|처리하지 않았|보내지 않았|알림을 보내지 못|알림을 보냈어요|돌아왔어요|관리자가 껐|이미 처리|접수했어요|적혀 있어요"
    r"|were checked|Nothing was lost|is stored in|^Restored|^Copied|was not done|not been sent|No alert could|was alerted"
    r"|It took|Interrupted for|was stopped by|lready done|lready received|in the ledger|not been done"
)

#: Both catalogues, each text under its own name.
SAID: Final = {**CRISIS, **{f"receipts.{code}": texts for code, texts in receipts.RECEIPTS.items()}}
GROUNDS: Final = {**FACTS, **{f"receipts.{code}": fact for code, fact in receipts.FACTS.items()}}


@pytest.mark.parametrize("code", SAID)
def test_every_text_is_there_in_both_languages_with_the_same_values(code: str) -> None:
    korean, english = SAID[code]
    assert korean.strip()
    assert english.strip()
    assert set(_VALUE.findall(korean)) == set(_VALUE.findall(english))


@pytest.mark.parametrize("code", SAID)
def test_no_korean_particle_stands_right_after_a_value(code: str) -> None:
    assert not _PARTICLE.search(SAID[code][0])


@pytest.mark.parametrize("code", SAID)
def test_the_tone_is_calm(code: str) -> None:
    assert not any("!" in text or "oops" in text.lower() for text in SAID[code])


@pytest.mark.parametrize("code", SAID)
def test_whatever_claims_something_names_its_fact(code: str) -> None:
    claims = [text for text in SAID[code] if _CLAIMS.search(text)]
    base = code.removesuffix(".line")
    assert not claims or code in GROUNDS or base in GROUNDS


def test_every_fact_belongs_to_a_text() -> None:
    assert GROUNDS.keys() <= SAID.keys()
    assert all(GROUNDS.values())


def test_every_phase_of_the_guard_has_its_words() -> None:
    named = {code.removeprefix("phase.") for code in CRISIS if code.startswith("phase.")}
    assert named == {*Phase, "UNKNOWN"}


def test_words_are_those_of_the_language() -> None:
    for which, lang in enumerate(LANGUAGES):
        assert words(lang) == {code: texts[which] for code, texts in CRISIS.items()}


def test_a_sentence_with_a_particle_after_its_value_is_noticed() -> None:
    assert _PARTICLE.search("지금 {stage}를 하고 있어요.")
    assert not _PARTICLE.search("기다리는 요청 {n}건")
