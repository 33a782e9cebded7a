"""Why nothing works: what a core said that could not start is told while none serves, and not longer."""

from hardcore.model import observations as seen
from hardcore.sentinel.deaths import last_said
from tests.unit.recovery.play import Play, a_page

SAID = "SyntaxError: invalid syntax (core/limits.py, line 28)"


def _fails(play: Play) -> None:
    play.tell(seen.CoreSpawned(play.now_ns, play.life, 42))
    play.tell(seen.CoreExited(play.now_ns, play.life, seen.Exit(code=1), None, said=SAID))


def test_the_last_words_of_a_start_that_failed_are_told_until_a_core_serves() -> None:
    play = Play().begin()
    _fails(play)
    assert play.manager.reading().start_fault == SAID
    play.ring()
    play.running()
    assert play.manager.reading().start_fault == ""


def test_a_core_that_served_and_died_says_nothing_about_a_start() -> None:
    play = Play().begin().running()
    play.tell(seen.CoreExited(play.now_ns, play.life, seen.Exit(code=1), None, said=SAID))
    assert play.manager.reading().start_fault == ""


def test_an_incident_names_the_error_and_its_place_and_quotes_nothing() -> None:
    play = Play().begin().running()
    play.die()
    _fails(play)
    play.ring()
    story = play.manager.open_incident()
    assert story is not None
    assert ("log", "SyntaxError (core/limits.py, line 28)") in {
        (told.witness, told.why) for told in story.evidence
    }


def test_words_on_the_page_are_nearer_than_the_log() -> None:
    exited = seen.CoreExited(1, 1, seen.Exit(code=78), a_page(words="CONFIG_INVALID"), said=SAID)
    assert last_said(exited).startswith("CONFIG_INVALID")
    assert last_said(seen.CoreExited(1, 1, seen.Exit(code=1), None)) == "it ended without a word"


def test_a_promotion_is_a_step_of_its_incident() -> None:
    play = Play().begin().running().spared()
    play.die()
    told = play.manager.open_incident()
    assert told is not None
    assert "promoted" in dict(told.timeline)
    assert "spawned" not in dict(told.timeline)
