"""The status as a person reads it: aligned in both languages, and never without an answer."""

import subprocess
import sys
from pathlib import Path

import click
import pytest
from msgspec.structs import replace

from frontend.catalogue import text
from hardcore import quarantine_file, status
from hardcore.cli import ELSEWHERE, STATE_CODES, main
from hardcore.host.folders import Folders
from hardcore.model import verdicts
from hardcore.model.phases import HAState
from hardcore.model.trials import Letter, Reason
from hardcore.quarantine_file import Aside
from hardcore.recovery.policy import Policy
from hardcore.status_page import printed_status
from tests.unit.recovery.play import Play


@pytest.mark.parametrize("lang", ["ko", "en"])
def test_a_status_without_a_sentinel_can_be_printed(tmp_path: Path, lang: str) -> None:
    told = status.from_files(Folders(tmp_path, tmp_path))
    lines = printed_status(told, lang).splitlines()
    assert "UNKNOWN" in lines[0]
    assert all("  " in line for line in lines)


@pytest.mark.parametrize("state", list(HAState))
@pytest.mark.parametrize("lang", ["ko", "en"])
def test_every_state_has_words(tmp_path: Path, state: HAState, lang: str) -> None:
    told = status.from_files(Folders(tmp_path, tmp_path)) | {"state": str(state)}
    assert str(state) in printed_status(told, lang)


def test_only_a_working_ledger_is_a_success() -> None:
    assert {state: STATE_CODES.get(state, 4) for state in HAState} == {
        HAState.OPERATIONAL: 0,
        HAState.STARTING: 3,
        HAState.DEGRADED: 3,
        HAState.RECOVERY: 3,
        HAState.SAFE_MODE: 3,
        HAState.MANUAL_INTERVENTION: 4,
        HAState.SHUTDOWN: 4,
    }


def test_every_word_that_is_told_of_is_found_and_says_what_it_does() -> None:
    with click.Context(main) as context:
        words = {name: main.get_command(context, name) for name in main.list_commands(context)}
        assert set(ELSEWHERE) <= set(words)
        assert all(word is not None and word.name == name and word.help for name, word in words.items())
        assert main.get_command(context, "no-such-word") is None


def test_a_word_is_loaded_when_it_is_said_and_no_hands_with_it() -> None:
    said = "import sys, hardcore.cli; print(*sys.modules)"
    loaded = set(
        subprocess.run(
            [sys.executable, "-c", said], capture_output=True, text=True, check=True
        ).stdout.split()
    )
    assert "hardcore.cli" in loaded
    assert not loaded & {room for room, _name in ELSEWHERE.values()}
    assert not loaded & {
        "hardcore.executor",
        "hardcore.recovery.failover",
        "postmortem.cli",
        "urllib.request",
    }


@pytest.mark.parametrize("content", ["", "[]", '{"wanted": 5}', '{"wanted": "SIDEWAYS"}'])
def test_a_damaged_note_of_what_is_wanted_is_never_more_than_reading(tmp_path: Path, content: str) -> None:
    folders = Folders(tmp_path, tmp_path)
    folders.state.mkdir()
    (folders.state / "wanted.json").write_text(content)
    assert status.from_files(folders)["wanted"] == "SAFE"


def test_a_witness_to_whom_all_is_well_is_no_worry() -> None:
    play = Play().begin().running(2)
    well = verdicts.Testimony("beats", verdicts.Colour.GREEN, "both beats are fresh")
    late = verdicts.Testimony("store", verdicts.Colour.YELLOW, "process 7 holds the lock")
    reading = replace(
        play.manager.reading(), verdict=verdicts.Verdict(verdicts.Colour.YELLOW, testimonies=(well, late))
    )
    assert status.running(reading, Policy())["worries"] == ["process 7 holds the lock"]


@pytest.mark.parametrize(("lang", "words"), [("en", "Make room"), ("ko", "자리를 만들면")])
def test_a_ledger_that_only_reads_says_why_and_what_to_do(tmp_path: Path, lang: str, words: str) -> None:
    told = status.from_files(Folders(tmp_path, tmp_path)) | {"state": "SAFE_MODE", "safe": "DISK_FULL"}
    assert words in printed_status(told, lang)


def test_columns_are_aligned_where_letters_are_wide(tmp_path: Path) -> None:
    told = status.from_files(Folders(tmp_path, tmp_path))
    starts = set()
    for line in printed_status(told, "ko").splitlines():
        label, _, value = line.partition("  ")
        width = sum(2 if "가" <= letter <= "힣" else 1 for letter in label)
        starts.add(width + len(line) - len(label) - len(value.lstrip()))
    assert len(starts) == 1


SPARE = {"pid": 102, "ready": True, "build_fits": True}


@pytest.mark.parametrize(
    ("spare", "lack", "said"),
    [
        (SPARE, None, "pid 102, ready"),
        (SPARE | {"ready": False, "build_fits": None}, None, "pid 102, being started"),
        (SPARE | {"build_fits": False}, None, "pid 102, ready, not the code that is on the disk"),
        (None, "off", "none: it is turned off"),
        (None, "memory", "none: too little memory is free"),
        (None, "died", f"Why: {'x' * 159}…"),
    ],
)
def test_the_spare_is_shown_or_why_there_is_none(
    tmp_path: Path, spare: dict[str, object] | None, lack: str | None, said: str
) -> None:
    told = status.from_files(Folders(tmp_path, tmp_path)) | {"spare": spare, "spare_lack": lack}
    told |= {"spare_off": "x" * 500 if lack == "died" else "", "switch_waits": True}
    told["sentinel"] |= {"pid": 7, "rss_bytes": 1 << 20}
    told["budget"] |= {"limit": 5, "window_s": 60}
    told["core"] |= {"pid": 101, "old_pid": 100}
    lines = printed_status(told, "en").splitlines()
    assert any(line.startswith("Spare") and said in line for line in lines), lines
    assert any(line.startswith("Old core") and "pid 100, can write no more" in line for line in lines)
    assert any(line.startswith("Switch") for line in lines)
    assert "예비 서버" in printed_status(told, "ko")


@pytest.mark.parametrize(("phase", "said"), [("RUNNING", "in a moment"), ("PROBATION", "has proven itself")])
def test_a_spare_that_is_still_to_come_is_no_spare_without_a_reason(
    tmp_path: Path, phase: str, said: str
) -> None:
    told = status.from_files(Folders(tmp_path, tmp_path)) | {"phase": phase}
    told["sentinel"] |= {"pid": 7, "rss_bytes": 1 << 20}
    told["budget"] |= {"limit": 5, "window_s": 60}
    assert any(line.startswith("Spare") and said in line for line in printed_status(told, "en").splitlines())


@pytest.mark.parametrize(("lang", "label"), [("en", "Start failed"), ("ko", "켜지 못한 까닭")])
def test_why_a_core_does_not_start_stands_in_the_status(tmp_path: Path, lang: str, label: str) -> None:
    why = "SyntaxError: invalid syntax (core/limits.py, line 28)"
    told = status.from_files(Folders(tmp_path, tmp_path)) | {"state": "RECOVERY", "start_fault": why}
    found = [line for line in printed_status(told, lang).splitlines() if line.startswith(label)]
    assert found, "it is told"
    assert why in found[0]


def test_a_worry_is_told_in_korean_where_its_sentence_is_known(tmp_path: Path) -> None:
    told = status.from_files(Folders(tmp_path, tmp_path)) | {"worries": ["it ended without a word"]}
    assert "아무 말 없이 종료됨" in printed_status(told, "ko")


@pytest.mark.parametrize(
    ("scored", "said"),
    [(4, "3 of 4 came true (9 ways back on record)"), (0, "none has been put to the test yet")],
)
def test_how_the_estimates_came_true_is_told(tmp_path: Path, scored: int, said: str) -> None:
    told = status.from_files(Folders(tmp_path, tmp_path))
    told["estimate"] = {"samples": 9, "scored": scored, "within": 3}
    assert said in printed_status(told, "en")


@pytest.mark.parametrize("lang", ["ko", "en"])
def test_letters_in_force_are_counted_and_shown(tmp_path: Path, lang: str) -> None:
    folders = Folders(tmp_path, tmp_path)
    folders.state.mkdir()
    assert "dlq" not in printed_status(status.from_files(folders), lang)
    aside = Aside()
    for n, seq in enumerate((None, None, 7)):
        letter = Letter(f"l{n}", f"{n}" * 32, Reason.CRASHED_CORE, False, ("incident",), 1, seq=seq)
        aside = quarantine_file.set_aside(aside, letter, {})
    limit = {"id": "r", "type": "limit", "kind": "x", "per_minute": 1, "body_bytes_max": None}
    quarantine_file.write(folders, quarantine_file.with_rule(aside, limit))
    told = status.from_files(folders)
    assert told["dead_letters"] == 3, "a rule that a person made is no letter"
    assert "3" in next(line for line in printed_status(told, lang).splitlines() if "dlq" in line)


@pytest.mark.parametrize("lang", ["ko", "en"])
def test_who_starts_is_told_where_the_dashboard_is(lang: str) -> None:
    assert text("dashboard", lang, url="http://127.0.0.1:1").endswith(" http://127.0.0.1:1/admin")
