"""What somebody is told who is not there: the alerts, and why one did not arrive, in Korean and English.

An alert is read on a telephone, by somebody who was doing something else: a title that says the whole of it, then a few
lines that each say one fact. Nothing is said that is not known when it is sent. In Korean no particle stands right after
a value.
"""

from collections.abc import Mapping
from typing import Final

from frontend.catalogue_policy import DIAGNOSES

LANGUAGES: Final = ("ko", "en")


def _text(ko: str, en: str) -> tuple[str, str]:
    return ko, en


#: code -> (ko, en)
ALERTS: Final[Mapping[str, tuple[str, str]]] = {
    # ---- titles ----
    "opened": _text("[문제] 가계부 서버: {cause}", "[Problem] Ledger server: {cause}"),
    "recovered": _text("[복구됨] 서버가 {took} 멈췄어요", "[Recovered] Server was down {took}"),
    "recovered_unmeasured": _text("[끝남] 가계부 서버: {cause}", "[Over] Ledger server: {cause}"),
    "safe_mode": _text(
        "[읽기 전용] 입력을 막고 보기만 열어 두었어요", "[Read-only] Changes are off; reading goes on"
    ),
    "manual": _text("[확인 필요] 자동 복구를 멈췄어요", "[Needs you] Automatic recovery has stopped"),
    "assist": _text("[확인 필요] 복구를 사람에게 맡겼어요", "[Needs you] Recovery is left to you"),
    "abandoned": _text(
        "[끝남] 감시자가 끝까지 지켜보지 못했어요", "[Over] The guard did not see the end of it"
    ),
    "waits": _text("[확인 필요] 사람이 봐야 해요", "[Needs you] Nothing goes on by itself"),
    "overdue": _text("[확인 필요] 아직 아무도 보지 않았어요", "[Needs you] Nobody has come yet"),
    "forecast": _text("[예고] 가계부 서버: {cause}", "[Forecast] Ledger server: {cause}"),
    "test": _text("[시험] 알림이 도착했어요", "[Test] The alert has arrived"),
    # ---- lines ----
    "at": _text("시각: {at}", "Time: {at}"),
    "cause": _text("원인({grade}): {cause}", "Cause ({grade}): {cause}"),
    "told_when_over": _text("끝나면 한 번 더 알려요.", "You will be told once more when it is over."),
    "nothing_lost": _text("내역 손실 없음(확인함)", "No records lost (verified)"),
    "unverified": _text("내역 확인: 아직 끝나지 않음", "Records: not verified yet"),
    "ledger_wrong": _text("내역 확인: 맞지 않는 곳이 있음", "Records: something does not match"),
    "letters": _text("따로 보관한 요청 {n}건", "{n} requests set aside"),
    "letters_one": _text("따로 보관한 요청 1건", "1 request set aside"),
    "resume": _text(
        "서버에서 hardcore status 명령으로 이유를 보고, hardcore resume 명령으로 다시 켜요.",
        "On the server: hardcore status says why, hardcore resume tries again.",
    ),
    "observed": _text("관찰: {text}", "Seen: {text}"),
    "nothing_yet": _text("아직 아무 일도 일어나지 않았어요.", "Nothing has happened yet."),
    "test_line": _text(
        "서버에 일이 생기면 이 채널로 소식을 보내요.", "This channel will be told when something happens."
    ),
    "left_out": _text(
        "그동안 같은 알림 {n}건은 보내지 않았어요.", "{n} like it were left out since the last one."
    ),
    "left_out_one": _text(
        "그동안 같은 알림 1건은 보내지 않았어요.", "1 like it was left out since the last one."
    ),
    "details": _text("자세히: {url}", "Details: {url}"),
    "certain": _text("확인됨", "certain"),
    "likely": _text("추정", "likely"),
    "unknown": _text("아직 모름", "not known"),
    "seconds": _text("{n}초", "{n} s"),
    "minutes": _text("{n}분", "{n} min"),
    "hours": _text("{n}시간", "{n} h"),
}

#: Why an alert did not arrive -> (ko, en)
FAILURES: Final[Mapping[str, tuple[str, str]]] = {
    "name": _text("주소를 찾을 수 없어요", "its host can't be found"),
    "connection": _text("연결할 수 없어요", "no connection"),
    "timeout": _text("제시간에 답하지 않았어요", "it did not answer in time"),
    "tls": _text("인증서를 믿을 수 없어요", "its certificate can't be trusted"),
    "no_tls": _text("암호화된 연결을 제공하지 않아요", "it offers no encrypted connection"),
    "redirect": _text(
        "다른 주소로 가라고 해요. 그 주소를 직접 적어 주세요", "it redirects; enter the address it leads to"
    ),
    "status": _text("거절했어요", "it answered with a refusal"),
    "garbled": _text("답을 이해할 수 없어요", "its answer can't be read"),
    "login": _text("로그인이 거절됐어요", "it refused the login"),
    "recipient": _text("보내는 사람이나 받는 사람을 거절했어요", "it refused the sender or the recipient"),
    "partly": _text("받는 사람 일부는 거절됐어요", "some of its recipients were refused"),
    "secret": _text("비밀 파일을 읽을 수 없어요", "its secret_file can't be read"),
    "apprise": _text(
        "Apprise가 설치돼 있지 않아요 (pip install apprise)",
        "Apprise is not installed (pip install apprise)",
    ),
    "ended": _text("보내던 프로그램이 도중에 종료됐어요", "the sender ended in the middle"),
    "fault": _text("보내는 쪽에서 오류가 났어요", "the sender made a mistake"),
}

#: Why an alert was not sent -> (ko, en)
HELD: Final[Mapping[str, tuple[str, str]]] = {
    "floor": _text("같은 소식을 얼마 전에 보냈어요", "the same was told a short while ago"),
    "muted": _text("알림을 꺼 두었어요", "alerts are muted"),
    "quiet": _text("조용한 시간이에요", "quiet hours"),
    "untold": _text("시작을 알리지 않았던 일이에요", "its beginning was not told"),
}


#: What `hardcore alerts` says -> (ko, en)
WORDS: Final[Mapping[str, tuple[str, str]]] = {
    "none": _text(
        "알림 채널이 없어요. 일이 생겨도 알려 줄 수 없어요. 정책 파일의 alerts에 적어 주세요 (docs/alerts.md).",
        "No channel: you would not be told. Name one under alerts in the policy file (docs/alerts.md).",
    ),
    "not_read": _text(
        "정책 파일에서 알림 채널을 읽을 수 없어요. hardcore policy check 명령으로 이유를 볼 수 있어요.",
        "The channels can't be read from the policy now. `hardcore policy check` says why.",
    ),
    "channel": _text("{number}. {name} ({kind}, {place})", "{number}. {name} ({kind}, {place})"),
    "manners": _text(
        "같은 소식은 {n}초 안에 한 번까지. 조용한 시간: {quiet}",
        "The same once in {n} s at most. Quiet hours: {quiet}",
    ),
    "no_quiet": _text("없음", "none"),
    "arrived": _text("마지막: 도착함, {at}", "Last: arrived, {at}"),
    "arrived_partly": _text("마지막: 도착함, {at} ({why})", "Last: arrived, {at} ({why})"),
    "failed": _text("마지막: 도착하지 않음, {at} ({why})", "Last: did not arrive, {at} ({why})"),
    "never": _text("아직 보낸 적이 없어요.", "Nothing was sent yet."),
    "muted": _text("알림을 꺼 두었어요. 다시 켜지는 때: {until}", "Alerts are muted until {until}."),
    "unmuted": _text("알림을 다시 보내요.", "Alerts are sent again."),
    "not_stored": _text(
        "적어 둘 수 없어요 ({why}). 데이터 폴더에 쓸 수 있는지 확인해 주세요.",
        "It can't be written down ({why}). Check that the data folder can be written to.",
    ),
    "bad_time": _text(
        "--for에는 30m, 2h, 1d처럼 적어 주세요 (길어도 30d).",
        "--for takes a time like 30m, 2h or 1d (30d at most).",
    ),
    "no_channel": _text(
        "{n}번 채널은 없어요. hardcore alerts 명령으로 볼 수 있어요.",
        "There is no channel {n}. See `hardcore alerts`.",
    ),
    "tried": _text("{number}. {name}: 도착했어요.", "{number}. {name}: it has arrived."),
    "tried_partly": _text(
        "{number}. {name}: 도착했지만 {why}.", "{number}. {name}: it has arrived, but {why}."
    ),
    "tried_in_vain": _text(
        "{number}. {name}: 도착하지 않았어요 ({why}).", "{number}. {name}: did not arrive ({why})."
    ),
    "last": _text("최근 알림", "Lately"),
    "line_delivered": _text("{at} {title}: 보냄", "{at} {title}: sent"),
    "line_held": _text("{at} {title}: 보내지 않음 ({why})", "{at} {title}: not sent ({why})"),
    "line_later": _text(
        "{at} {title}: {until} 뒤에 보낼 예정 ({why})", "{at} {title}: will be sent after {until} ({why})"
    ),
    "line_failed": _text("{at} {title}: 도착하지 않음", "{at} {title}: did not arrive"),
}


def word(code: str, lang: str, /, **values: object) -> str:
    """Return a text of the command line."""
    return WORDS[code][LANGUAGES.index(lang)].format(**values)


def title_text(stage: str, diagnosis: str, lang: str) -> str:
    """Return the title of an alert as a list shows it; an end is only named as one."""
    code = "recovered_unmeasured" if stage == "closed" else stage
    return (
        alert_text(code, lang, cause=cause_text(diagnosis, lang))
        if code in ALERTS
        else f"{stage} {diagnosis}"
    )


def alert_text(code: str, lang: str, /, **values: object) -> str:
    """Return a text of an alert; where `n` is one, the form for one is taken if there is one."""
    single = f"{code}_one"
    chosen = single if values.get("n") == 1 and single in ALERTS else code
    return ALERTS[chosen][LANGUAGES.index(lang)].format(**values)


def failure_text(code: str, lang: str) -> str:
    """Return why an alert did not arrive; a code of another version is shown as it is."""
    return FAILURES[code][LANGUAGES.index(lang)] if code in FAILURES else code


def held_text(code: str, lang: str) -> str:
    """Return why an alert was not sent; a code of another version is shown as it is."""
    return HELD[code][LANGUAGES.index(lang)] if code in HELD else code


def cause_text(diagnosis: str, lang: str) -> str:
    """Return what a diagnosis means, in a few words; one of another version is shown as it is."""
    return DIAGNOSES[diagnosis][LANGUAGES.index(lang)] if diagnosis in DIAGNOSES else diagnosis


def took_text(length_ms: float, lang: str) -> str:
    """Return a length of time as a telephone shows it: the longer, the coarser."""
    for code, unit_ms in (("hours", 3_600_000), ("minutes", 60_000)):
        if length_ms >= 2 * unit_ms:
            return alert_text(code, lang, n=round(length_ms / unit_ms))
    seconds = length_ms / 1_000
    return alert_text("seconds", lang, n=f"{seconds:.1f}" if seconds < 10 else f"{seconds:.0f}")
