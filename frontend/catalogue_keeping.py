"""What is said of kept copies and of the way back to one, Korean and English, as plain data."""

from collections.abc import Mapping
from typing import Final

#: key -> (ko, en)
WORDS: Final[Mapping[str, tuple[str, str]]] = {
    "backup_begun": (
        "장부를 복사하고 첫 기록부터 확인하고 있어요. 그동안 장부는 그대로 쓸 수 있어요.",
        "Copying the ledger and proving the copy from its first event. The ledger works on meanwhile.",
    ),
    "made": (
        "백업했어요: {file}\n기록 {events}건을 모두 확인했어요.",
        "Backed up: {file}\nAll of its {events} events are proven.",
    ),
    "elsewhere": (
        "디스크가 고장 나도 남도록, 가끔 다른 디스크에도 두세요: hardcore backup --to 폴더",
        "Keep one on another disk too, for the day this one fails: hardcore backup --to FOLDER",
    ),
    "restore_begun": (
        "백업을 복사하고 첫 기록부터 확인하고 있어요.",
        "Copying the backup and proving it from its first event.",
    ),
    "restored": (
        "장부를 되돌렸어요: {data} (기록 {events}건, 모두 확인했어요)\n시작하려면: {command} up",
        "The ledger is back in {data}: {events} events, all proven.\nTo start it: {command} up",
    ),
    "runs": (
        "이 폴더의 장부가 켜져 있어요. 먼저 `hardcore down`으로 끄고 폴더를 옮겨 두세요.",
        "The ledger of this folder is running. Stop it with `hardcore down` and move the folder aside first.",
    ),
    "log_export_begun": ("기록 전체를 쓰고 있어요.", "Writing the whole log."),
    "log_written": (
        "기록 전체를 썼어요: {file}\n돌아올 때는: hardcore --data 빈폴더 log import 파일",
        "The whole log is in {file}\nTo come back with it: hardcore --data EMPTY log import FILE",
    ),
    "log_import_begun": (
        "기록을 읽으며 하나하나 확인하고 있어요.",
        "Reading the log and proving every link of it.",
    ),
    "log_taken": (
        "기록에서 장부를 만들었어요: {data} (기록 {events}건, 모두 확인했어요)\n시작하려면: {command} up",
        "The log is a ledger now, in {data}: {events} events, all proven.\nTo start it: {command} up",
    ),
    "failed": ("하지 못했어요: {why}", "It could not be done: {why}"),
    "no_answer": (
        "작업이 답 없이 끝났어요 (종료 코드 {code}). `hardcore doctor`를 해 보세요.",
        "the work ended without an answer (exit code {code}). Try `hardcore doctor`.",
    ),
    "stopped": ("멈췄어요. 만들다 만 파일은 지웠어요.", "Stopped. What was half done is removed."),
}


def keeping_text(key: str, lang: str, **values: object) -> str:
    """Return a text of this room."""
    return WORDS[key][0 if lang == "ko" else 1].format_map(values)
