"""What a core said with its last words goes nowhere unmasked: not into the facts, not onto the tape."""

import json

import pytest
from msgspec.structs import replace

from hardcore.model.observations import CoreExited, Exit
from hardcore.model.recorder import Beats, LastWords, Page, Threads
from hardcore.model.verdicts import Colour
from hardcore.recovery.flight import CODEC
from hardcore.sentinel.deaths import judge_death
from hardcore.snapshot.facts import facts
from tests.unit.snapshot.test_filing import incident

CANARY = "canary-7f3a"
WORDS = LastWords(1, "EXCEPTION", f"ValueError at web/forms.py:3 post: password={CANARY} and 110234567890")
PAGE = Page("n", "b", 1, 1, Threads(), Beats(), None, WORDS, (), (), ())


@pytest.mark.parametrize("how", [Exit(code=1), Exit(code=74), Exit(signal=6)])
def test_last_words_are_masked_wherever_the_facts_tell_them(how: Exit) -> None:
    death = judge_death(how, WORDS, was_ready=True, term_sent=False)
    told = facts(replace(incident(), evidence=death.evidence, exit=how, last_words=WORDS), 1, "n", str)
    assert CANARY not in json.dumps(told)
    assert "110234567890" not in json.dumps(told)
    assert told["last_words"]["code"] == "EXCEPTION"
    assert "ValueError at web/forms.py:3 post" in told["last_words"]["text"]
    assert {"kind": "last words", "colour": "red", "text": "EXCEPTION"} in told["evidence"]


def test_the_tape_keeps_no_sentence_of_a_core_and_repeats_its_orders_all_the_same() -> None:
    heard = CoreExited(1, 1, Exit(code=1), PAGE)
    told = CODEC.encode(heard)
    assert CANARY not in json.dumps(told)
    again = CODEC.decode(told)
    assert isinstance(again, CoreExited)
    assert again.page is not None
    first, second = (
        judge_death(heard.exit, words, was_ready=True, term_sent=False)
        for words in (WORDS, again.page.last_words)
    )
    assert first == second


def test_the_facts_say_of_each_witness_whether_it_complained() -> None:
    death = judge_death(Exit(signal=9), None, was_ready=True, term_sent=False)
    told = facts(replace(incident(), evidence=death.evidence), 1, "n", str)
    assert [line["colour"] for line in told["evidence"]] == [str(Colour.RED)]
