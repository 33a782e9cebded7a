"""The texts of the drawings and of the tables behind them, Korean and English, as plain data.

A drawing's title is what a person hears who can't see it, so it says what is to be seen and not what kind of
picture it is. A Korean particle never stands right after a value.
"""

from collections.abc import Mapping

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


WORDS: Mapping[str, Text] = {
    "timeline": _text("진행 순서, 모두 {whole}", "The course of it, {whole} in all"),
    "memory": _text("메모리: 처음 {first}, 마지막 {last}.", "Memory: {first} at first, {last} at the end."),
    "memory_limit": _text("한도 {limit}.", "The limit is {limit}."),
    "waits": _text("{who} → {holder} 기다림", "{who} waits for {holder}"),
    "day": _text("지난 24시간, 멈춘 시간 모두 {down}", "The last 24 hours, {down} of them down"),
    "ago": _text("{length} 전", "{length} ago"),
}

#: Heads of the tables' columns.
HEADS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "timeline_head": {
        "ko": ("번호", "단계", "경과", "걸린 시간", "비율"),
        "en": ("No.", "Step", "After the fault", "Took", "Share"),
    },
    "course_head": {"ko": ("언제", "메모리"), "en": ("When", "Memory")},
    "memory_head": {"ko": ("종료 전", "메모리"), "en": ("Before the end", "Memory")},
    "ring_head": {
        "ko": ("기다리는 스레드", "잠금", "쥔 스레드"),
        "en": ("Thread that waits", "Lock", "Thread that has it"),
    },
    "day_head": {
        "ko": ("언제", "길이", "상태", "사건"),
        "en": ("When", "For", "State", "Incident"),
    },
}

#: What a stretch of a day was.
SPANS: Mapping[str, Text] = {
    "up": _text("정상", "served"),
    "down": _text("멈춤", "down"),
    "reads": _text("읽기 전용", "reads only"),
    "off": _text("꺼 둠", "turned off"),
    "unknown": _text("기록 없음", "not recorded"),
}

#: Behind a number.
UNITS: Mapping[str, Text] = {
    "s": _text("초", " s"),
    "min": _text("분", " min"),
    "h": _text("시간", " h"),
}
