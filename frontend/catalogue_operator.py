"""What the operator's words about guarding say: safe mode, parts, modes, policy, logs, snapshots. Korean and English.

Plain data and one lookup, as in `catalogue.py`. No particle stands right after a value.
"""

from collections.abc import Mapping
from typing import Final

LANGUAGES: Final = ("ko", "en")

#: key -> (ko, en)
WORDS: Final[Mapping[str, tuple[str, str]]] = {
    "store_address": (
        "--store에는 postgresql://사용자@서버/데이터베이스 모양의 주소를 적어 주세요.",
        "--store takes an address like postgresql://USER@HOST/DATABASE.",
    ),
    "store_later": (
        "이미 실행 중이라 장부의 자리를 지금은 바꿀 수 없어요. `hardcore down`으로 멈춘 뒤 다시 시작해 주세요.",
        "It is running already, so where the ledger lies can't be changed now: `hardcore down`, then start again.",
    ),
    "store_password": (
        "명령줄은 이 컴퓨터의 모두가 볼 수 있어요. 비밀번호가 든 주소는 HARDCORE_STORE 환경 변수나 ~/.pgpass에 두세요.",
        "Everybody on this machine can read a command line: put the password into HARDCORE_STORE or ~/.pgpass.",
    ),
    "safe_on": (
        "지금부터 읽기만 받아요. 다시 켜도 그대로예요. 끝내려면 `hardcore safe-mode off`를 하세요.",
        "From now on reads only are served, over restarts too. `hardcore safe-mode off` ends it.",
    ),
    "safe_on_asked": (
        "읽기 전용으로 기억해 뒀어요. 핵심 서버가 돌아오면 읽기만 받아요.",
        "It is noted: when a core serves again, it serves reads only.",
    ),
    "safe_off": ("다시 쓸 수 있어요.", "Everything is served again."),
    "safe_off_asked": (
        "안전 모드를 끝내기로 기억해 뒀어요. 지금 상태: {state}",
        "It is noted that the safe mode is over. The state now: {state}",
    ),
    "safe_already": ("이미 그래요. 바뀐 것은 없어요.", "It is so already; nothing was changed."),
    "safe_offline": (
        "감시자가 돌고 있지 않아요. 다음 `hardcore up`부터 이렇게 해요.",
        "No sentinel is running: it holds from the next `hardcore up` on.",
    ),
    "part_restarted": (
        "{component}: 이 부분만 다시 시작했어요. 장부는 그동안 계속 대답했어요.",
        "{component}: this part alone was started anew; the ledger answered all the while.",
    ),
    "part_not_restarted": (
        "{component}: 다시 시작하지 못했어요. `hardcore status`를 보세요.",
        "{component} was not started anew. See `hardcore status`.",
    ),
    "policy_reloaded": (
        "정책을 다시 읽었어요. 바뀐 항목: {changed}",
        "The policy was read. Changed: {changed}",
    ),
    "policy_same": (
        "정책을 다시 읽었어요. 바뀐 것은 없어요.",
        "The policy was read; nothing in it has changed.",
    ),
    "policy_holds_later": (
        "다음 핵심 서버나 관문부터 적용되는 항목: {later} (`hardcore restart`로 바꿔요)",
        "From the next core or gateway on: {later} (`hardcore restart` takes it)",
    ),
    "dry_same_words": (
        "지금 정책과 같은 뜻이에요. 달라지는 항목이 없어요.",
        "It says what the policy in force says.",
    ),
    "dry_words": ("달라지는 항목 (지금 -> 이 파일):", "What would be other (in force -> this file):"),
    "dry_none": ("비교할 사건 기록이 없어요.", "No incident was recorded that it could be held against."),
    "dry_incident_same": ("{incident} {diagnosis}: 똑같이 했을 거예요.", "{incident} {diagnosis}: the same."),
    "dry_incident_other": (
        "{incident} {diagnosis}: {fact} 뒤에 달라져요.\n    그때: {does}\n    이 정책: {would}",
        "{incident} {diagnosis}: other from {fact} on.\n    then: {does}\n    with this: {would}",
    ),
    "dry_incident_unreadable": (
        "{incident} {diagnosis}: 비교할 수 없어요. {why}",
        "{incident} {diagnosis}: can't be compared. {why}",
    ),
    "dry_nothing": ("아무것도 안 함", "nothing"),
    "dry_beyond": (
        "처음 달라지는 곳까지만 알 수 있어요. 그 뒤의 일은 달라졌을 거예요.",
        "Only the first difference can be known: what came after would have been other too.",
    ),
    "logs_none": ("아직 기록이 없어요: {path}", "Nothing is logged yet: {path}"),
    "snapshots_none": ("남겨 둔 증거가 없어요.", "No evidence is kept."),
    "snapshot_gone": (
        "사건 {incident}: 증거를 지웠어요. 사건의 기록은 그대로 있어요.",
        "Incident {incident}: its evidence was removed; its story stays.",
    ),
    "snapshot_sure": (
        "사건 {incident}: 증거를 지우면 되돌릴 수 없어요. 지우려면 --yes를 붙이세요.",
        "Incident {incident}: evidence that is removed does not come back. Add --yes to remove it.",
    ),
    "resume_assists": (
        "assist 모드예요. 지금부터 act 모드에서 했을 일을 해요.",
        "The mode is assist: what `act` would have done is done now.",
    ),
    "down_unheard": (
        "감시자가 대답하지 않아요. 꺼 두기로 적어 뒀고, 감시자가 멈춘 것인지 지금 살펴봐요.",
        (
            "The sentinel does not answer. It is noted that everything should stay off; now it is found out whether "
            "the sentinel stands still."
        ),
    ),
    "down_noted": (
        (
            "감시자가 아직 대답하지 않지만, 멈췄다는 증거는 없어서 그대로 두었어요. 꺼 두기로 적어 뒀어요: 다음 감시자가 모두 꺼요. "
            "잠시 뒤 `hardcore down`을 다시 해 보세요."
        ),
        (
            "The sentinel still does not answer, and nothing proves that it stands still: it was left alone. It is noted "
            "that everything should stay off, and the next sentinel stops everything. Try `hardcore down` again shortly."
        ),
    ),
}


def operator_text(key: str, lang: str, **values: object) -> str:
    """Return a text in a language, its values filled in."""
    return WORDS[key][LANGUAGES.index(lang)].format_map(values)
