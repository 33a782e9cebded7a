"""Evidence in Korean: the sentences known are said anew with their values, all others stay as they are."""

import re

import pytest

from frontend import catalogue_evidence as texts
from hardcore.model.observations import Exit
from hardcore.model.verdicts import Colour
from hardcore.sentinel.deaths import judge_death
from postmortem.reports.evidence_words import command_word, kind_word, stage_word, told

_FIELD = re.compile(r"\{(\w+)\}")


@pytest.mark.parametrize(
    ("line", "korean"),
    [
        ("the core ended by SIGKILL", "장부 서버가 신호로 종료됨: SIGKILL"),
        (
            "process 5712 (python3) has held the store's write lock for 577 ms",
            "프로세스 5712(python3), 장부 파일의 쓰기 잠금을 577ms 동안 쥐고 있음",
        ),
        (
            "the loop's last beat is 612 ms old; the thread's last beat is 590 ms old",
            "주 작업의 마지막 박동이 612ms 전; 보조 스레드의 마지막 박동이 590ms 전",
        ),
        ("disk: 3 MiB are free (ENOSPC)", "디스크: 빈 공간 3MiB (ENOSPC)"),
        ("a sentence of tomorrow's", "a sentence of tomorrow's"),
        ("12 MiB are free; a sentence of tomorrow's", "빈 공간 12MiB; a sentence of tomorrow's"),
    ],
)
def test_a_sentence_that_is_known_is_said_in_korean(line: str, korean: str) -> None:
    assert told(line, "ko") == korean
    assert told(line, "en") == line


@pytest.mark.parametrize(("english", "korean"), texts.SENTENCES)
def test_every_known_sentence_keeps_its_values_and_none_has_a_particle_behind_it(
    english: str, korean: str
) -> None:
    assert sorted(_FIELD.findall(english)) == sorted(_FIELD.findall(korean))
    assert re.search(r"\}(?:은|는|이|가|을|를|과|와|로|으로)(?:\s|$)", korean) is None
    filled = english.format_map({name: f"v{at}" for at, name in enumerate(_FIELD.findall(english))})
    assert told(filled, "ko") != filled


@pytest.mark.parametrize("how", [Exit(signal=9), Exit(code=74), Exit()])
def test_what_is_said_of_a_death_is_known(how: Exit) -> None:
    for fact in judge_death(how, None, was_ready=True, term_sent=True, oom_kills=2).evidence:
        assert fact.colour is Colour.RED
        assert told(fact.why, "ko") != fact.why
        assert kind_word(fact.witness, "ko") != fact.witness


def test_words_unknown_here_are_shown_as_they_are() -> None:
    for word in (kind_word, stage_word, command_word):
        assert word("SOMETHING_NEW", "ko") == "SOMETHING_NEW"


def test_codes_in_a_known_sentence_are_words_in_korean_and_what_is_no_code_stays() -> None:
    assert told("tried in a throw-away core: cmd-1 died after 7 ms", "ko").endswith("결과 또 종료됨, 7ms")
    assert "단계: 처리 중" in told("the recorder's slot had it in stage DECIDING", "ko")
    assert "단계: <b>" in told("the recorder's slot had it in stage <b>", "ko")
