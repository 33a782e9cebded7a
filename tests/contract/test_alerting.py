"""The sender against targets of every temper, each a real one on loopback."""

import email
import email.policy
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from hardcore.alerting import over_http, over_mail, sender
from hardcore.alerting.over_apprise import is_installed
from hardcore.alerting.sender import Sender
from hardcore.alerting.trying import try_channels
from hardcore.host import muting
from hardcore.host.files import take_lock
from tests.contract.alert_targets import (
    HANGS,
    OK,
    Outgoing,
    comes,
    outgoing,
    own_certificate,
    post,
    status,
    web,
)

QUICK = (0.05, 0.05)


@pytest.fixture
def out(tmp_path: Path) -> Outgoing:
    return outgoing(tmp_path)


def hook(url: str, **more: object) -> dict[str, object]:
    return {"kind": "webhook", "url": f"{url}/hook/CANARY-token?key=CANARY-key", "min_interval_s": 60, **more}


def send(out: Outgoing, pauses_s: Sequence[float] = QUICK) -> None:
    Sender(out.folders, pauses_s).run(life_s=30.0)


def entry(out: Outgoing, name: str) -> Any:
    return next(one for one in out.book["last"] if one["id"] == name)


# ---- the ways ----


def test_a_webhook_is_told_in_json_and_can_check_who_told_it(out: Outgoing, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("CANARY-secret\n", "utf-8")
    with web() as target:
        out.channels(hook(target.url, secret_file=str(secret)))
        name = out.put(incident="01a201ba")
        send(out)
    (came,) = target.came
    assert came.target == "/hook/CANARY-token?key=CANARY-key"
    assert {
        "id": name,
        "stage": "opened",
        "diagnosis": "CRASHED",
        "incident": "01a201ba",
    }.items() <= came.json.items()
    assert came.json["url"] == "http://127.0.0.1:3000/admin/incidents/01a201ba"
    assert "[문제]" in came.json["text"]
    assert "[Problem]" in came.json["text"]
    told_s = int(came.headers["x-hardcore-timestamp"])
    signed = over_http.signature("CANARY-secret", told_s, came.body)
    assert came.headers["x-hardcore-signature"] == signed
    assert signed != over_http.signature("CANARY-secret", told_s + 1, came.body)
    assert out.waiting == []
    assert entry(out, name)["delivered_at"]


def test_ntfy_is_told_under_its_topic_with_its_token(out: Outgoing, tmp_path: Path) -> None:
    secret = tmp_path / "token"
    secret.write_text("CANARY-token", "utf-8")
    with web() as target:
        out.channels(
            {"kind": "ntfy", "url": f"{target.url}/household", "secret_file": str(secret), "lang": "ko"}
        )
        out.put("waits", incident="i1")
        send(out)
    (came,) = target.came
    assert came.target == "/"
    assert came.headers["authorization"] == "Bearer CANARY-token"
    assert {"topic": "household", "priority": 5}.items() <= came.json.items()
    assert came.json["title"] == "[확인 필요] 사람이 봐야 해요"
    assert "hardcore resume" in came.json["message"]
    assert "Needs you" not in came.json["message"]


def test_a_mail_says_it_in_korean_and_english(out: Outgoing, tmp_path: Path) -> None:
    secret = tmp_path / "password"
    secret.write_text("CANARY-password", "utf-8")
    with post() as target:
        url = f"smtp://me@127.0.0.1:{target.port}/?from=a@home.example&to=b@home.example&to=c@home.example"
        out.channels({"kind": "smtp", "url": url, "secret_file": str(secret)})
        name = out.put()
        send(out)
    (raw,) = target.mails
    mail = email.message_from_bytes(raw, policy=email.policy.default)
    assert mail["Subject"] == "[문제] 가계부 서버: 비정상 종료"
    assert mail["Message-ID"] == f"<{name}@hardcore.invalid>"
    assert {"rcpt TO:<b@home.example>", "rcpt TO:<c@home.example>"} <= set(target.heard)
    body = mail.get_content()
    assert "[Problem] Ledger server: it crashed" in body
    assert "the core ended by SIGSEGV" in body


@pytest.mark.skipif(is_installed(), reason="Apprise is installed here")
def test_apprise_that_is_not_installed_is_said_so_and_not_tried_again(out: Outgoing) -> None:
    out.channels({"kind": "apprise", "url": "json://127.0.0.1:9/CANARY-token"})
    name = out.put()
    send(out)
    (tried,) = entry(out, name)["attempts"]
    assert (tried["ok"], tried["why"]) == (False, "apprise")


# ---- what is said when it is over ----


def test_the_closing_message_says_cause_money_and_letters_from_the_report(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url))
        out.put(incident="i1")
        out.put("closed", incident="i1", outcome="recovered", outage_ms=4000)
        money = {"lost": 0, "doubled": 0, "verified": True}
        out.report(
            "i1",
            diagnosis="OUT_OF_MEMORY",
            grade="likely",
            outage_ms=4123.4,
            money=money,
            trials=[{"letter": "1"}, {"letter": ""}],
        )
        send(out)
    beginning, end = target.texts
    assert "[Problem]" in beginning
    lines = end.splitlines()
    assert lines[0] == "[복구됨] 서버가 4.1초 멈췄어요"
    assert {"원인(추정): 메모리가 모자라서 종료됨", "내역 손실 없음(확인함)", "따로 보관한 요청 1건"} <= set(
        lines
    )
    assert {"[Recovered] Server was down 4.1 s", "No records lost (verified)", "1 request set aside"} <= set(
        lines
    )


def test_without_a_report_nothing_is_promised_of_the_money(
    out: Outgoing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender, "REPORT_S", 0.1)
    with web() as target:
        out.channels(hook(target.url, lang="en"))
        out.put(incident="i1")
        out.put("closed", incident="i1", outcome="manual")
        send(out)
    assert "[Needs you] Automatic recovery has stopped" in target.texts[1]
    assert "Records: not verified yet" in target.texts[1]
    assert "No records lost" not in target.texts[1]


def test_an_end_that_was_put_in_the_same_moment_comes_after_its_beginning(
    out: Outgoing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender, "REPORT_S", 0.0)
    ended = out.put("closed", incident="i1", outcome="recovered")
    begun = out.folders.outbox / f"{ended[:14]}ffff-ffff-ffffffffffff.json"
    (out.folders.outbox / f"{out.put(incident='i1')}.json").rename(begun)
    with web() as target:
        out.channels(hook(target.url))
        send(out)
        assert [one.json["stage"] for one in target.came] == ["opened", "closed"]


def test_a_storm_is_one_message_and_one_closing_message(
    out: Outgoing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sender, "REPORT_S", 0.0)
    with web() as target:
        out.channels(hook(target.url, lang="en", min_interval_s=3600))
        names = []
        for number in range(6):
            names.append(out.put(incident=f"i{number}"))
            out.put("closed", incident=f"i{number}", outcome="recovered")
        send(out)
        assert [one.json["stage"] for one in target.came] == ["opened", "closed"]
        assert [entry(out, name)["held"] for name in names] == [None, *["floor"] * 5]
        out.put(fingerprint="FROZEN", incident="i9")
        send(out)
        assert len(target.came) == 3
    assert out.waiting == []
    assert set(out.book["told"]) == {"i0", "i9"}


# ---- targets of every temper ----


def test_a_target_that_is_down_is_tried_again_until_it_is_up(out: Outgoing) -> None:
    with web(status(503), status(503), OK) as target:
        out.channels(hook(target.url))
        name = out.put(incident="i1")
        send(out)
    tried = entry(out, name)["attempts"]
    assert [one["ok"] for one in tried] == [False, False, True]
    assert [one["status"] for one in tried] == [503, 503, 200]
    assert "i1" in out.book["told"]
    assert out.book["untold"] == {}


def test_a_target_that_stays_away_is_given_up_and_nobody_was_told(out: Outgoing) -> None:
    with web() as gone:
        url = gone.url
    out.channels(hook(url))
    name = out.put(incident="i1")
    send(out)
    tried = entry(out, name)["attempts"]
    assert [(one["ok"], one["why"]) for one in tried] == [(False, "connection")] * 3
    assert out.waiting == []
    assert list(out.book["untold"]) == ["i1"]
    assert out.book.get("told", {}) == {}


@pytest.mark.parametrize(
    ("code", "why"), [(301, "redirect"), (307, "redirect"), (404, "status"), (401, "status")]
)
def test_a_refusal_is_final_and_no_redirect_is_followed(out: Outgoing, code: int, why: str) -> None:
    with web() as elsewhere, web(status(code, f"Location: {elsewhere.url}/stolen")) as target:
        out.channels(hook(target.url))
        name = out.put()
        send(out)
        assert elsewhere.accepted == 0
    (tried,) = entry(out, name)["attempts"]
    assert (tried["why"], tried["status"], tried["final"]) == (why, code, True)


@pytest.mark.parametrize(
    "answer",
    [b"\x00\xff garbage\r\n\r\n", b"HTTP/1.1 999999 X\r\n\r\n", b"HTTP/1.1 200 OK\r\nX: " + b"a" * 200_000],
)
def test_an_answer_that_nobody_can_read_is_a_failure_and_not_kept(out: Outgoing, answer: bytes) -> None:
    with web(answer) as target:
        out.channels(hook(target.url))
        name = out.put()
        send(out, (0.01,))
    assert {one["ok"] for one in entry(out, name)["attempts"]} == {False}
    assert len(json.dumps(out.book)) < 4000


def test_an_endless_answer_is_read_for_a_moment_only(out: Outgoing) -> None:
    with web(
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n" + b"1000\r\n" + b"x" * 4096 + b"\r\n"
    ) as target:
        out.channels(hook(target.url))
        name = out.put()
        send(out)
    assert entry(out, name)["delivered_at"]


def test_who_hangs_does_not_keep_the_others_waiting(out: Outgoing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sender, "ATTEMPT_S", 0.3)
    with web(HANGS) as slow, web() as quick:
        out.channels(hook(slow.url), hook(quick.url))
        name = out.put(incident="i1")
        out.put(fingerprint="FROZEN", incident="i2")
        send(out, (0.01,))
        assert {one.json["incident"] for one in quick.came} == {"i1", "i2"}
    tried = [(one["channel"], one["ok"], one["why"]) for one in entry(out, name)["attempts"]]
    assert sorted(tried) == [(1, False, "timeout"), (1, False, "timeout"), (2, True, "")]
    assert set(out.book["told"]) == {"i1", "i2"}


def test_a_certificate_that_nobody_vouches_for_is_refused(out: Outgoing, tmp_path: Path) -> None:
    with web(tls=own_certificate(tmp_path)) as target:
        out.channels(hook(target.url.replace("http:", "https:")))
        name = out.put()
        send(out)
        assert target.came == []
    (tried,) = entry(out, name)["attempts"]
    assert (tried["why"], tried["final"]) == ("tls", True)


@pytest.mark.parametrize(("refuses", "why"), [("AUTH", "login"), ("RCPT", "recipient"), ("DATA", "status")])
def test_what_a_mail_server_refuses_is_told_in_words_of_ours(out: Outgoing, refuses: str, why: str) -> None:
    with post(refuses) as target:
        url = f"smtp://me:CANARY-pw@127.0.0.1:{target.port}/?from=a@home.example&to=b@home.example"
        out.channels({"kind": "smtp", "url": url})
        name = out.put()
        send(out, (0.01,))
    assert {one["why"] for one in entry(out, name)["attempts"]} == {why}
    assert "CANARY" not in json.dumps(out.book)


def test_no_mail_goes_in_the_open_to_another_machine(out: Outgoing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        over_mail, "is_loopback", lambda _: False
    )  # the test's own server plays another machine
    with post() as target:
        out.channels(
            {"kind": "smtp", "url": f"smtp://127.0.0.1:{target.port}/?from=a@home.example&to=b@home.example"}
        )
        name = out.put()
        send(out)
        assert target.mails == []
    (tried,) = entry(out, name)["attempts"]
    assert (tried["why"], tried["final"]) == ("no_tls", True)


def test_a_secret_that_can_not_be_read_sends_nothing(out: Outgoing, tmp_path: Path) -> None:
    with web() as target:
        out.channels(hook(target.url, secret_file=str(tmp_path / "none")))
        name = out.put()
        send(out, (0.01,))
        assert target.came == []
    assert {one["why"] for one in entry(out, name)["attempts"]} == {"secret"}


# ---- what is put there ----


def test_what_nobody_can_read_is_taken_away(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url))
        for number, text in enumerate(("", "{", "[]", '{"stage": "party"}', "null")):
            (out.folders.outbox / f"{number}.json").write_text(text, "utf-8")
        out.put(text=["x"], outage_ms="y", incident={"a": 1})
        send(out)
    assert len(target.came) == 1
    assert out.waiting == []


def test_what_waited_for_more_than_a_day_is_told_to_nobody(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url))
        out.put(at="2020-01-01T00:00:00Z")
        send(out)
    assert target.came == []
    assert out.waiting == []


def test_an_incident_that_is_a_path_leads_nowhere(out: Outgoing) -> None:
    (out.folders.data / "report.json").write_text('{"diagnosis": "CANARY"}', "utf-8")
    with web() as target:
        out.channels(hook(target.url))
        out.put("waits", incident="../../data")
        send(out)
    assert "CANARY" not in target.texts[0]


def test_without_a_channel_nothing_waits_for_ever(out: Outgoing) -> None:
    out.channels()
    out.put()
    send(out)
    assert out.waiting == []


def test_alerts_that_are_muted_are_counted_and_not_sent(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url, lang="en"))
        muting.mute(out.folders, 3600)
        name = out.put()
        send(out)
        assert entry(out, name)["held"] == "muted"
        muting.unmute(out.folders)
        out.put()
        send(out)
    (text,) = target.texts
    assert "1 like it was left out since the last one." in text


# ---- its own deaths ----


@contextmanager
def process(out: Outgoing) -> Iterator["subprocess.Popen[bytes]"]:
    argv = [
        sys.executable,
        "-m",
        "hardcore.alerting",
        "--data",
        str(out.folders.data),
        "--pauses-s",
        "0.1",
        "0.1",
    ]
    started = subprocess.Popen(argv, env={**os.environ, "XDG_RUNTIME_DIR": str(out.folders.run)})
    try:
        yield started
    finally:
        started.kill()
        started.wait()


def test_a_sender_that_dies_in_the_middle_is_followed_but_not_for_ever(out: Outgoing) -> None:
    with web(HANGS) as target:
        out.channels(hook(target.url))
        name = out.put(incident="i1")
        for number in range(1, 4):
            with process(out) as sending:
                comes(target, number)
                sending.send_signal(signal.SIGKILL)
                sending.wait()
            assert len(out.waiting) == 1
        with process(out) as sending:
            assert sending.wait(20) == 0
        assert len(target.came) == 3
    assert [one["ok"] for one in entry(out, name)["attempts"]] == [None] * 3
    assert out.waiting == []


def test_there_is_one_sender_at_a_time(out: Outgoing) -> None:
    with web() as target:
        out.channels(hook(target.url))
        out.put()
        lock = take_lock(out.folders.state / "alerts.lock")
        assert lock is not None
        with process(out) as second:
            assert second.wait(20) == 0
        assert target.came == []
        os.close(lock)
        with process(out) as third:
            assert third.wait(20) == 0
        assert len(target.came) == 1


def test_a_book_that_can_not_be_written_to_the_disk_goes_on_in_the_run_folder(out: Outgoing) -> None:
    out.folders.alerts.mkdir()  # nothing can be put in its place
    with web() as target:
        out.channels(hook(target.url))
        out.put(incident="i1")
        send(out)
        assert len(target.came) == 1
    kept = json.loads((out.folders.run / "alerts.json").read_text("utf-8"))
    assert list(kept["told"]) == ["i1"]


# ---- a person's own try, and secrets ----


def test_a_try_says_of_each_channel_what_came_of_it(out: Outgoing) -> None:
    with web() as good, web(status(500)) as bad:
        out.channels(hook(good.url, name="집"), hook(bad.url))
        muting.mute(out.folders, 60)
        results = try_channels(out.folders)
        assert [(one["channel"], one["ok"], one["why"]) for one in results] == [
            (1, True, ""),
            (2, False, "status"),
        ]
        assert [one["channel"] for one in try_channels(out.folders, only=2)] == [2]
        assert "[시험]" in good.texts[0]
    assert [(one["ok"], one["sent"], one["failed"]) for one in out.book["channels"]] == [
        (True, 1, 0),
        (False, 0, 2),
    ]
    assert "CANARY" not in json.dumps([results, out.book])


def test_no_secret_stands_in_anything_that_is_written(out: Outgoing, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("CANARY-secret", "utf-8")
    with web(status(500, body=b"CANARY-of-the-target")) as target, web() as gone:
        out.channels(hook(target.url, secret_file=str(secret)), hook(target.url), hook(gone.url))
        out.put(incident="i1")
        with process(out) as sending:
            assert sending.wait(30) == 0
    written = [
        path
        for path in tmp_path.rglob("*")
        if path.is_file() and path not in {secret, out.folders.good_policy}
    ]
    assert out.folders.alerts in written
    assert [path for path in written if b"CANARY" in path.read_bytes()] == []
