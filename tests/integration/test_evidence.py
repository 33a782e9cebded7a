"""Evidence from real processes: a core that hangs in one way or another, stopped, read and killed."""

import asyncio
import json
import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
from msgspec.structs import replace

from hardcore.host.recorder import make_page
from hardcore.model.actions import CloseIncident
from hardcore.model.looks import ProcessSample
from hardcore.model.observations import CoreExited, Exit
from hardcore.model.recorder import SlotStage
from hardcore.recovery.flight import CODEC
from hardcore.sentinel.deaths import judge_death
from hardcore.snapshot import stacks, writer
from hardcore.snapshot.facts import facts
from hardcore.snapshot.subject import Evidence, EvidenceFailed, Subject, Tools
from postmortem import bundle, cli
from tests.unit.snapshot.test_filing import incident

ID = "0199a000-0000-7000-8000-00000000000b"
NONCE = "abcdef0123456789"
CANARY = "canary-5d1e"
TRANSACTION = "0199a000-7777-7000-8000-000000000001"
ACCOUNT = "assets:bank:kb"
#: Generous: the tests ask what is in a bundle, not how fast a loaded machine fills it.
BUDGET_MS = 20_000

CORE = """
import os, signal, sys, threading, time
from pathlib import Path
from core.guarded.last_words import keep_last_words
from core.guarded.recorder import Recorder, Stage

page, how, canary = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
recorder = Recorder.open(page)
assert isinstance(recorder, Recorder), recorder
if how != "unguarded":
    keep_last_words(recorder, page.with_name(page.name + ".stacks"))
body = b'{"description": "\\xec\\xbb\\xa4\\xed\\x94\\xbc", "amount": "-4500"}'
slot = recorder.begin("cmd-1", "key-1", "transaction.post", sys.argv[4], [sys.argv[5]], body, 0)
recorder.stage(slot, Stage.DECIDING)
book = open(page.parent / "ledger.db", "w")
outside = open("/etc/hostname")


def settle(transaction_id, account_id):
    password = canary
    headers = {"accept": "json", "authorization": "Bearer " + canary}
    nested = [("x", {"api_key": canary})]
    print("up", flush=True)
    if how == "spin":
        while True:
            pass
    if how == "crash":
        os.abort()
    if how == "raise":
        thread = threading.Thread(target=lambda: int("password: " + canary))
        thread.start()
        thread.join()
        raise ValueError(f"the form said password={canary} and {canary}")
    time.sleep(600)


worker = threading.Thread(target=threading.Event().wait, daemon=True)
worker.start()
settle(sys.argv[4], sys.argv[5])
"""


@dataclass
class Bench:
    """One guarded process and where its evidence goes."""

    place: Path
    children: list["subprocess.Popen[bytes]"] = field(default_factory=list)
    pidfds: list[int] = field(default_factory=list)
    pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(4))

    def core(self, how: str) -> Subject:
        page = self.place / "recorder-1"
        make_page(page, NONCE, "b" * 36)
        log = self.place / "core.log"
        log.write_text(f"served /x\nset-cookie: a={CANARY}\n잔액 확인\n")
        argv = [sys.executable, "-c", CORE, str(page), how, CANARY, TRANSACTION, ACCOUNT]
        child = subprocess.Popen(argv, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        self.children.append(child)
        pidfd = os.pidfd_open(child.pid)
        self.pidfds.append(pidfd)
        assert child.stdout is not None
        assert child.stdout.readline() == b"up\n"
        return Subject(child.pid, pidfd, NONCE, page, (log,), ID, self.place / "incidents", self.place)

    def tool(self, script: str) -> Tools:
        path = self.place / "py-spy"
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o700)
        return Tools(path)

    def live(self, subject: Subject, tools: Tools, budget_ms: int = BUDGET_MS) -> Evidence | EvidenceFailed:
        return asyncio.run(writer.take_live(subject, budget_ms, self.pool, tools))

    def dead(self, subject: Subject, sample: ProcessSample | None = None) -> Evidence | EvidenceFailed:
        return asyncio.run(writer.take_dead(subject, BUDGET_MS, self.pool, sample))

    def end(self) -> None:
        for child in self.children:
            child.kill()
            child.wait()
            assert child.stdout is not None
            child.stdout.close()
        for pidfd in self.pidfds:
            os.close(pidfd)
        self.pool.shutdown()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    one = Bench(tmp_path)
    try:
        yield one
    finally:
        one.end()


def until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 30
    while not holds():
        assert time.monotonic() < deadline, "the condition never held"
        os.sched_yield()


def words_of(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.Error:
        return []


def state_of(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


def states_of(pid: int) -> set[str]:
    """Of every thread: a stop reaches each of them in its own moment."""
    stats = Path(f"/proc/{pid}/task").glob("*/stat")
    return {stat.read_text().rpartition(")")[2].split()[0] for stat in stats}


def whole(taken: Evidence | EvidenceFailed) -> Evidence:
    assert isinstance(taken, Evidence), taken
    assert bundle.verify_bundle(taken.path) == []
    return taken


@pytest.mark.parametrize("how", ["sleep", "spin"])
def test_the_stacks_of_a_hung_core_name_transaction_and_account(bench: Bench, how: str) -> None:
    subject = bench.core(how)
    taken = whole(bench.live(subject, stacks.find_tools()))
    assert taken.missing == {}
    assert taken.complete
    assert [name for name, _ in taken.steps] == ["frozen", "dumped"]
    assert state_of(subject.pid) == "T"
    text = (taken.path / "stacks.txt").read_text()
    assert f'transaction_id = "{TRANSACTION}"' in text
    assert f'account_id = "{ACCOUNT}"' in text
    assert "settle" in text


def test_the_recorder_tells_what_was_being_decided(bench: Bench) -> None:
    subject = bench.core("sleep")
    taken = whole(bench.live(subject, Tools(None)))
    assert taken.page is not None
    (note,) = taken.page.in_flight
    assert (note.stage, note.transaction_id, note.account_ids) == (
        SlotStage.DECIDING,
        TRANSACTION,
        (ACCOUNT,),
    )
    page = json.loads((taken.path / "recorder.json").read_text())
    (told,) = page["in_flight"]
    assert told["stage"] == "DECIDING"
    assert '"amount": "-4500"' in told["payload"]
    assert "커피" not in told["payload"], "a description is nobody's business"


def test_no_secret_value_reaches_the_bundle(bench: Bench) -> None:
    taken = whole(bench.live(bench.core("sleep"), stacks.find_tools()))
    assert (taken.path / "stacks.json").exists()
    files = {file.name: file.read_bytes() for file in taken.path.iterdir()}
    assert [name for name, data in files.items() if CANARY.encode() in data] == []
    assert "잔액 확인" in files["log.txt"].decode()


def test_no_secret_that_an_exception_quotes_is_in_any_file_of_its_incident(bench: Bench) -> None:
    subject = bench.core("raise")
    assert bench.children[0].wait() == 1
    taken = whole(bench.dead(subject))
    page = taken.page
    assert page is not None
    assert page.last_words is not None
    assert CANARY in page.last_words.text, "else this asks nothing"
    how = Exit(code=1)
    death = judge_death(how, page.last_words, was_ready=True, term_sent=False)
    closed = replace(incident(), evidence=death.evidence, exit=how, last_words=page.last_words)
    assert writer.write_facts(taken.path, facts(closed, subject.pid, NONCE, str)) is None
    heard = json.dumps(CODEC.encode((CoreExited(1, 1, how, page), CloseIncident(closed)))).encode()
    assert writer.add_recording(taken.path, lambda: heard) is None
    assert cli.write_report(taken.path) is None
    files = {file.name: file.read_bytes() for file in taken.path.iterdir()}
    assert {"recorder.bin", "incident.json", "observations.jsonl", "report.md", "report.json"} <= set(files)
    assert [name for name, data in files.items() if CANARY.encode() in data] == []
    assert b"EXCEPTION" in files["report.md"]


def test_where_each_thread_slept_was_read_before_the_stop(bench: Bench) -> None:
    taken = whole(bench.live(bench.core("sleep"), Tools(None)))
    threads = json.loads((taken.path / "process.json").read_text())["threads"]
    assert len(threads) >= 2
    assert {thread["state"] for thread in threads} <= {"S", "R"}
    assert "do_signal_stop" not in {thread["wchan"] for thread in threads}


def test_open_files_are_named_only_inside_the_data_folder(bench: Bench) -> None:
    taken = whole(bench.live(bench.core("sleep"), Tools(None)))
    text = (taken.path / "process.json").read_text()
    files = json.loads(text)["files"]
    assert "ledger.db" in files["in_data"]
    assert files["kinds"]["outside"] >= 1
    assert "hostname" not in text
    assert str(bench.place) not in text


def test_everything_in_the_bundle_is_its_owners_alone(bench: Bench) -> None:
    taken = whole(bench.live(bench.core("sleep"), Tools(None)))
    assert stat.S_IMODE(taken.path.stat().st_mode) == 0o700
    assert {stat.S_IMODE(file.stat().st_mode) for file in taken.path.iterdir()} == {0o600}


def test_without_py_spy_the_core_prints_its_own_stacks_before_the_stop(bench: Bench) -> None:
    taken = whole(bench.live(bench.core("sleep"), Tools(None)))
    assert not taken.complete
    assert taken.missing == {"stacks.json": "py-spy is not installed"}
    assert "in settle" in (taken.path / "stacks.txt").read_text()


def test_a_core_that_can_not_print_its_stacks_is_not_killed_by_the_question(bench: Bench) -> None:
    subject = bench.core("unguarded")
    taken = whole(bench.live(subject, Tools(None)))
    assert state_of(subject.pid) == "T"
    assert taken.missing["stacks.txt"] == "the process had not set up the printing of its stacks"


def test_a_frozen_core_is_read_and_leaves_no_signal_pending(bench: Bench) -> None:
    subject = bench.core("sleep")
    os.kill(subject.pid, signal.SIGSTOP)
    until(lambda: states_of(subject.pid) == {"T"})
    taken = whole(bench.live(subject, stacks.find_tools()))
    assert taken.complete
    facts = json.loads((taken.path / "process.json").read_text())
    assert {thread["state"] for thread in facts["threads"]} == {"T"}
    assert int(facts["status"]["ShdPnd"], 16) >> (signal.SIGUSR1 - 1) & 1 == 0


def test_a_debugger_that_hangs_is_cut_off_and_the_rest_is_kept(bench: Bench) -> None:
    subject = bench.core("sleep")
    seconds = f"600.{os.getpid()}"  # marks the process as this test's own
    taken = whole(bench.live(subject, bench.tool(f"exec sleep {seconds}"), budget_ms=1_500))
    assert taken.missing["stacks.json"] == "py-spy: it took too long"
    assert {"recorder.bin", "process.json", "log.txt"} <= {file.name for file in taken.path.iterdir()}
    until(lambda: seconds not in {word for one in psutil.process_iter() for word in words_of(one)})


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("exit 3", "py-spy: ended with 3: no word about it"),
        ("echo 'Permission denied' >&2; exit 1", "py-spy: ended with 1: Permission denied"),
        ("echo hello", "py-spy: the answer is not in the form known here"),
        ("echo '[{}]'", "py-spy: the answer is not in the form known here"),
        ("exec cat /dev/zero", f"py-spy: it said more than {stacks.STACKS_BYTES_MAX} bytes"),
    ],
)
def test_whatever_the_debugger_answers_is_a_reason_and_not_a_failure(
    bench: Bench, script: str, reason: str
) -> None:
    taken = whole(bench.live(bench.core("sleep"), bench.tool(script)))
    assert taken.missing == {"stacks.json": reason}
    assert "in settle" in (taken.path / "stacks.txt").read_text()


def test_a_debugger_that_is_gone_is_a_reason(bench: Bench) -> None:
    taken = whole(bench.live(bench.core("sleep"), Tools(bench.place / "nowhere")))
    assert taken.missing == {"stacks.json": "py-spy: could not be started: No such file or directory"}


def test_a_budget_that_is_over_at_once_still_gives_a_bundle_that_names_what_is_missing(bench: Bench) -> None:
    taken = bench.live(bench.core("sleep"), bench.tool("exec sleep 600"), budget_ms=10)
    if isinstance(taken, Evidence):
        assert not taken.complete
        assert "stacks" in taken.missing or "stacks.json" in taken.missing
    else:
        assert taken.reason


def test_a_process_that_dies_under_the_collectors_leaves_its_recorder(bench: Bench) -> None:
    subject = bench.core("sleep")
    bench.children[0].kill()
    bench.children[0].wait()
    taken = whole(bench.live(subject, stacks.find_tools()))
    assert not taken.complete
    assert taken.page is not None
    assert "recorder.bin" in {file.name for file in taken.path.iterdir()}
    assert taken.missing["process.json"].startswith("the kernel would not tell")


def test_a_page_of_another_life_is_no_evidence(bench: Bench) -> None:
    subject = bench.core("sleep")
    page = bench.place / "recorder-2"
    make_page(page, "another-life-000", "b" * 36)
    stranger = Subject(subject.pid, subject.pidfd, NONCE, page, (), ID, subject.incidents, subject.data)
    taken = whole(bench.live(stranger, Tools(None)))
    assert taken.page is None
    assert "another life" in taken.missing["recorder.json"]


def test_what_was_read_is_handed_on_when_the_disk_refuses(bench: Bench) -> None:
    subject = bench.core("sleep")
    subject.incidents.write_text("a file in the folder's place")
    taken = bench.live(subject, Tools(None))
    assert isinstance(taken, EvidenceFailed)
    assert taken.page is not None
    assert taken.page.in_flight[0].transaction_id == TRANSACTION
    assert state_of(subject.pid) == "T"


def test_a_dead_core_leaves_recorder_log_and_the_last_sample(bench: Bench) -> None:
    subject = bench.core("sleep")
    bench.children[0].kill()
    bench.children[0].wait()
    sample = ProcessSample("S", 1_000_000, 50 << 20, 3)
    taken = whole(bench.dead(subject, sample))
    assert taken.complete
    assert taken.page is not None
    assert taken.page.in_flight[0].transaction_id == TRANSACTION
    facts = json.loads((taken.path / "process.json").read_text())
    assert facts["last_sample"]["rss_bytes"] == 50 << 20


def test_a_crash_leaves_the_stacks_that_the_dying_process_printed(bench: Bench) -> None:
    subject = bench.core("crash")
    assert bench.children[0].wait() == -signal.SIGABRT
    taken = whole(bench.dead(subject))
    text = (taken.path / "stacks.txt").read_text()
    assert "Aborted" in text
    assert "in settle" in text


def test_the_evidence_of_a_second_death_stands_beside_that_of_the_first(bench: Bench) -> None:
    subject = bench.core("sleep")
    first = whole(bench.live(subject, Tools(None)))
    bench.children[0].kill()
    bench.children[0].wait()
    before = (first.path / "recorder.json").read_bytes()
    second = whole(bench.dead(subject))
    assert second.path == first.path
    assert (first.path / "recorder.json").read_bytes() == before
    assert (first.path / "life-2.recorder.bin").exists()


def test_a_story_with_account_and_transaction_comes_from_the_bundle_alone(bench: Bench) -> None:
    taken = whole(bench.live(bench.core("sleep"), stacks.find_tools()))
    story = cli.show_incident(taken.path.parent, ID[:8])
    assert isinstance(story, dict)
    assert (story["outcome"], story["evidence_complete"]) == ("open", True)
    assert story["transaction_ids"] == [TRANSACTION]
    assert story["account_ids"] == [ACCOUNT]
    assert "settle" in story["findings"][0]["sentence"]["en"]


def test_the_report_of_a_closed_incident_is_made_by_a_child_and_the_same_each_time(bench: Bench) -> None:
    taken = whole(bench.live(bench.core("sleep"), stacks.find_tools()))
    facts = {"version": 1, "id": ID, "outcome": "recovered", "diagnosis": "LOOP_BLOCKED", "grade": "certain"}
    assert writer.write_facts(taken.path, facts) is None
    argv = [sys.executable, "-m", "postmortem", "report", str(taken.path), "--lang", "ko"]
    texts = []
    for _ in range(2):
        done = subprocess.run(argv, capture_output=True, text=True, timeout=50, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        texts.append([(taken.path / name).read_text() for name in ("report.json", "report.md")])
    assert texts[0] == texts[1]
    assert bundle.verify_bundle(taken.path) == []
    assert json.loads(texts[0][0])["diagnosis"] == "LOOP_BLOCKED"
    assert "사건 보고서" in texts[0][1]
    assert "settle" in texts[0][1]


def test_a_report_of_nothing_is_one_sentence(tmp_path: Path) -> None:
    argv = [sys.executable, "-m", "postmortem", "report", str(tmp_path / "none")]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=50, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("The report was not written: ")
    assert len(done.stderr.splitlines()) == 1
