"""What `hardcore drill` says: what is done to the core, and what the guard promises to make of it.

Plain words in Korean and English, because whoever tries a drill has not read the table of diagnoses yet. One entry
for each drill; what came instead of a promise is told by the incident's own summary.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

LANGUAGES: Final = ("ko", "en")


class Told(msgspec.Struct, frozen=True):
    """One drill in words, each (ko, en): what is done, and what is promised to come of it."""

    done: tuple[str, str]
    promised: tuple[str, str]


_BACK: Final = (
    "감시자가 증거를 남기고, 예비 서버가 이어받거나 새로 켜요.",
    "the guard keeps the evidence; the spare takes over, or it is started anew.",
)


def _back(ko: str, en: str) -> tuple[str, str]:
    """Return a promise that ends with a new core."""
    return f"{ko} {_BACK[0]}", f"{en}, and {_BACK[1]}"


TOLD: Final[Mapping[str, Told]] = {
    "crash": Told(
        ("장부 서버를 그 자리에서 죽여요.", "The ledger's server is made to die on the spot."),
        _back("비정상 종료라고 알아봐요.", "It is found to have crashed"),
    ),
    "segv": Told(
        (
            "장부 서버가 없는 메모리를 건드려 죽게 해요.",
            "The server is made to touch memory that is not there.",
        ),
        _back("비정상 종료라고 알아봐요.", "It is found to have crashed"),
    ),
    "exit": Told(
        (
            "장부 서버가 아무도 시키지 않았는데 꺼지게 해요.",
            "The server is made to leave, though nobody asked.",
        ),
        _back("스스로 꺼졌다고 알아봐요.", "It is found to have ended by itself"),
    ),
    "freeze": Told(
        ("장부 서버를 통째로 정지시켜요.", "The whole server is stopped in its tracks."),
        _back("정지했다고 알아봐요.", "It is found to be stopped"),
    ),
    "block": Told(
        (
            "장부 서버의 가운데 순환이 한곳에서 기다리게 해요.",
            "The server's main loop is made to wait in one place.",
        ),
        _back("한곳에서 멈췄다고 알아봐요.", "It is found to hang in one place"),
    ),
    "spin": Told(
        ("장부 서버가 끝나지 않는 계산을 하게 해요.", "The server is made to calculate without end."),
        _back("끝나지 않는 계산이라고 알아봐요.", "It is found to be caught in a calculation"),
    ),
    "gil": Told(
        (
            "한 가지 일이 장부 서버 전체를 붙들게 해요.",
            "One piece of work is made to hold up the whole server.",
        ),
        _back("한 가지 일이 전체를 붙들었다고 알아봐요.", "It is found to be held up by one piece of work"),
    ),
    "deadlock": Told(
        (
            "장부 서버의 두 작업이 서로를 기다리게 해요.",
            "Two parts of the server are made to wait for each other.",
        ),
        _back("서로를 기다린다고 알아봐요.", "They are found to wait for each other"),
    ),
    "slow-tx": Told(
        ("거래 하나가 끝나지 않게 해요.", "One transaction is made to go on without end."),
        _back("그 거래가 제시간에 끝나지 않았다고 알아봐요.", "It is found to be over its time"),
    ),
    "oom": Told(
        ("장부 서버가 메모리를 다 쓰게 해요.", "The server is made to use up its memory."),
        _back("메모리가 모자라서 종료됐다고 알아봐요.", "It is found to have ended for lack of memory"),
    ),
    "dblock": Told(
        (
            "다른 프로그램이 장부 파일을 몇 초 동안 잡고 있게 해요.",
            "Another program is made to hold the ledger's file for some seconds.",
        ),
        (
            "누가 잡고 있는지 알아내고 아무것도 종료하지 않아요. 놓으면 저절로 이어져요.",
            "The holder is named and nothing is ended; writing goes on once it lets go.",
        ),
    ),
    "diskfull": Told(
        (
            "디스크가 가득 찬 것처럼 몇 초 동안 쓰기를 막아요.",
            "Writes are made to fail for some seconds, as on a full disk.",
        ),
        (
            "아무것도 종료하지 않고 읽기만 받아요. 자리가 나면 저절로 다시 써요.",
            "Nothing is ended and reading goes on; it writes again by itself once there is room.",
        ),
    ),
    "gc": Told(
        (
            "건강한 장부 서버가 메모리를 오래 정리하게 해서 아파 보이게 해요.",
            "A healthy server is made to look ill: a long collection of garbage.",
        ),
        ("아무도 건드리지 않아요. 12초쯤 지켜볼게요.", "Nobody touches it. This is watched for some 12 s."),
    ),
    "spare": Told(
        ("기다리고 있는 예비 서버를 죽여요.", "The spare server that waits is killed."),
        (
            "새 예비 서버가 와요. 장부 서버는 아무것도 모르고 사건도 남지 않아요.",
            "Another spare comes. The ledger's server does not notice, and there is no incident.",
        ),
    ),
    "poison": Told(
        (
            "한 요청에 장부 서버를 죽이는 독을 넣어요.",
            "One request is made to kill whichever server carries it out.",
        ),
        (
            "장부 서버는 한 번만 죽고, 다시 살아나요. 요청은 사본에서 시험해 본 뒤에 따로 보관해요.",
            "The server dies once and comes back; the request is tried on a copy of the ledger and set aside.",
        ),
    ),
    "gateway": Told(
        (
            "접속을 맡은 관문을 죽여요. 연결이 한 번 끊겨요.",
            "The gateway is killed; every connection breaks once.",
        ),
        (
            "같은 주소에 새 관문이 와요. 장부 서버는 아무것도 몰라요.",
            "Another gateway comes on the same address; the server does not notice.",
        ),
    ),
    "sentinel": Told(
        ("지켜보던 감시자를 죽여요.", "The guard that watches is killed."),
        (
            "새 감시자가 와서 같은 장부 서버를 이어서 지켜봐요. 요청은 하나도 기다리지 않아요.",
            "Another guard comes and goes on with the same server; no request waits for it.",
        ),
    ),
    "leak": Told(
        (
            "장부 서버의 메모리를 조금씩 차지하고 돌려주지 않아요.",
            "The server is made to take memory little by little and keep it.",
        ),
        (
            "메모리가 바닥나기 전에 알아보고, 조용한 때에 예비 서버가 이어받아요. 종료되는 것은 없어요.",
            "It is seen before the memory is gone, and the spare takes over in a calm moment; nothing breaks off.",
        ),
    ),
    "stall": Told(
        (
            "장부 서버의 한 부분만 일하다 멈추게 해요.",
            "One part of the server is made to stand still in the middle of its work.",
        ),
        (
            "그 부분만 새로 시작해요. 장부는 그동안에도 응답해요.",
            "That part alone is begun anew; the ledger answers all the while.",
        ),
    ),
    "restore": Told(
        (
            "장부의 새 사본과 가장 새로운 백업을 버릴 폴더에 복원해 봐요.",
            "A fresh copy of the ledger and the newest backup are restored into a folder that is thrown away.",
        ),
        (
            "둘 다 온전하다고 증명돼요. 장부 서버는 모르고 지나가요.",
            "Both are proven whole; the server does not notice.",
        ),
    ),
}

#: What is said after a drill that has an end of its own, each (ko, en).
ENDS: Final[Mapping[str, tuple[str, str]]] = {
    "poison_kept": (
        (
            "약속대로예요. 장부 서버는 한 번만 죽었고, 독이 든 요청은 따로 보관했어요.\n"
            "보관 번호: {letter}\n사건 번호: {incident}\n{summary}"
        ),
        (
            "As promised: the server died once, and the request is set aside.\n"
            "Letter: {letter}\nIncident: {incident}\n{summary}"
        ),
    ),
    "poison_other": (
        "약속과 달라요. 죽은 횟수: {deaths}. 보관 번호: {letter}. 요청의 답: {status}.\n사건 번호: {incident}\n{summary}",
        (
            "Not as promised. Deaths: {deaths}. Letter: {letter}. The request was answered {status}.\n"
            "Incident: {incident}\n{summary}"
        ),
    ),
    "gateway_kept": (
        "약속대로예요. {ms}ms 뒤에 새 관문이 응답했고 장부 서버는 그대로예요. 사건 번호: {incident}",
        "As promised: another gateway answered after {ms} ms, and the server is the same. Incident: {incident}",
    ),
    "gateway_other": (
        "약속과 달라요. 장부 서버가 바뀌었거나 새 관문이 응답하지 않았어요. `hardcore incidents`를 보세요.",
        "Not as promised: the server changed, or no other gateway answered. See `hardcore incidents`.",
    ),
    "sentinel_kept": (
        "약속대로예요. 같은 장부 서버를 새 감시자가 지켜봐요. 걸린 시간: {seconds}초. 사건 번호: {incident}",
        "As promised: after {seconds} s another guard watches the same server. Incident: {incident}",
    ),
    "sentinel_other": (
        "약속과 달라요. 장부 서버나 관문이 바뀌었거나 새 감시자가 알리지 않았어요. `hardcore incidents`를 보세요.",
        "Not as promised: the server or the gateway changed, or nobody told of it. See `hardcore incidents`.",
    ),
    "leak_kept": (
        "약속대로예요. 메모리가 바닥나기 전에 다른 서버가 이어받았어요. 사건 번호: {incident}\n{summary}",
        "As promised: another server took over before the memory was gone. Incident: {incident}\n{summary}",
    ),
    "leak_other": (
        "약속과 달라요. 사건 번호: {incident}\n{summary}",
        "Not as promised. Incident: {incident}\n{summary}",
    ),
    "leak_unseen": (
        (
            "{seconds}초 동안 아무도 알리지 않았어요. 메모리는 돌려줬어요. 가장 많이 쓴 메모리: {most_mb}MiB. "
            "한도(memory_limit_mb): {limit_mb}MiB. --seconds나 --mb-per-s 값을 늘리거나 정책의 forecast_ 값을 줄여 보세요."
        ),
        (
            "Nobody told of it within {seconds} s, and the memory is given back. The server held at most {most_mb} MiB of "
            "{limit_mb} MiB (memory_limit_mb). Try more --seconds or --mb-per-s, or shorter forecast_ values in the policy."
        ),
    ),
    "stall_kept": (
        "약속대로예요. 그 부분만 새로 시작했고 장부 서버는 그대로예요. 사건 번호: {incident}\n{summary}",
        "As promised: that part was begun anew, and the server is the same. Incident: {incident}\n{summary}",
    ),
    "stall_other": (
        "약속과 달라요. 사건 번호: {incident}\n{summary}",
        "Not as promised. Incident: {incident}\n{summary}",
    ),
    "none": ("없음", "none"),
    "restore_kept": (
        "약속대로예요. 복원한 장부가 온전해요.",
        "As promised: what was restored is whole.",
    ),
    "restore_other": (
        "약속과 달라요. 복원하지 못했어요. 이유: {why}",
        "Not as promised: it could not be restored. {why}",
    ),
}


def end_words(key: str, lang: str, **values: object) -> str:
    """Return what is said at the end of such a drill."""
    return ENDS[key][LANGUAGES.index(lang)].format(**values)


def done_words(fault: str, lang: str) -> str:
    """Return what a drill does to the core."""
    return TOLD[fault].done[LANGUAGES.index(lang)]


def promised_words(fault: str, lang: str) -> str:
    """Return what must come of a drill."""
    return TOLD[fault].promised[LANGUAGES.index(lang)]
