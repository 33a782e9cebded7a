"""What a policy means on a diagnosis, in sentences for a terminal, Korean and English, as plain data.

Keys are what `hardcore policy explain` finds to be true; numbers stand in braces under the names of their
settings, so that whoever reads a sentence knows what to change. No particle stands right after a number.
"""

from collections.abc import Mapping
from typing import Final

LANGUAGES: Final = ("ko", "en")


def _text(ko: str, en: str) -> tuple[str, str]:
    return ko, en


#: What may be true -> (ko, en)
EXPLAINED: Final[Mapping[str, tuple[str, str]]] = {
    "at-once": _text(
        "바로 대응해요. 그 자체로 확인된 사실이에요.",
        "Acted on at once: it is a fact by itself.",
    ),
    "conclusive": _text(
        "스스로 끝날 수 없는 멈춤이면 {confirm_deadlock_ms} ms 뒤에 대응해요 (confirm_deadlock_ms). 서로 다른 두 "
        "가지 증거가 그동안 계속 맞아야 해요.",
        "A hang that can't end by itself is acted on after {confirm_deadlock_ms} ms (confirm_deadlock_ms); two "
        "different kinds of evidence must agree for as long.",
    ),
    "hang": _text(
        "다른 멈춤은 {confirm_hang_ms} ms 뒤에 대응해요 (confirm_hang_ms). 두 가지 증거가 그동안 계속 맞아야 해요.",
        "Any other hang is acted on after {confirm_hang_ms} ms (confirm_hang_ms); two kinds of evidence must agree "
        "for as long.",
    ),
    "collecting": _text(
        "메모리를 정리하는 중이면 {gc_grace_ms} ms 동안 기다려요 (gc_grace_ms).",
        "While it collects garbage it is given {gc_grace_ms} ms (gc_grace_ms).",
    ),
    "over-time": _text(
        "명령 하나의 결정이 {transaction_timeout_ms} ms 넘게 걸리면 대응해요 (transaction_timeout_ms). 진행이 보고되면 "
        "시간을 다시 재요. 종류마다 더 긴 한도가 있을 수 있어요.",
        "Acted on when one command has been decided for {transaction_timeout_ms} ms (transaction_timeout_ms). Reported "
        "progress begins the time anew, and a kind of command may have a longer limit.",
    ),
    "held-twice": _text(
        "다른 프로그램이 장부를 {confirm_hang_ms} ms 넘게 잠근 것이 두 번 이어서 확인되면 대응해요 (confirm_hang_ms).",
        "Acted on when another program was found twice in a row to hold the ledger's lock, for {confirm_hang_ms} ms "
        "(confirm_hang_ms).",
    ),
    "surveyed-twice": _text(
        "{survey_interval_ms} ms 간격의 점검에서 두 번 이어서 확인되거나(survey_interval_ms, 빈 공간 기준 "
        "{disk_floor_mb} MB: disk_floor_mb), 핵심 서버가 스스로 쓸 수 없다고 하면 대응해요.",
        "Acted on when two looks in a row find it, one every {survey_interval_ms} ms (survey_interval_ms; room wanted: "
        "{disk_floor_mb} MB, disk_floor_mb), or when the core says that it can't write.",
    ),
    "slow-write": _text(
        "감시자의 작은 쓰기가 {disk_slow_ms} ms 넘게 걸리고(disk_slow_ms) 핵심 서버도 디스크를 기다리면 대응해요.",
        "Acted on when a small write of the guard's own takes {disk_slow_ms} ms (disk_slow_ms) and the core waits for "
        "the disk as well.",
    ),
    "not-ready": _text(
        "{startup_timeout_ms} ms 안에 준비되지 않거나(startup_timeout_ms) 그 전에 끝나면 대응해요.",
        "Acted on when a core is not ready within {startup_timeout_ms} ms (startup_timeout_ms), or ends before.",
    ),
    "budget-spent": _text(
        "{restart_window_sec}초 안에 {max_restart_count}번보다 많이 종료되면 대응해요 (restart_window_sec, "
        "max_restart_count).",
        "Acted on at more than {max_restart_count} deaths in {restart_window_sec} s (max_restart_count, "
        "restart_window_sec).",
    ),
    "never-acted-on": _text(
        "상태에만 나타나고, 이것 때문에 무엇도 종료하지 않아요.",
        "Only shown: nothing is ever ended for it.",
    ),
    "part-silent": _text(
        "할 일이 있는데도 한 부분의 신호가 정해진 시간 동안 없고, 다른 부분은 움직이면 대응해요.",
        "Acted on when a part has work and gives no sign for its limit, while the others go on.",
    ),
    "over-limit": _text(
        "핵심 서버의 메모리가 {memory_limit_mb} MB 위에 머물면 대응해요 (memory_limit_mb).",
        "Acted on when the core's memory stays above {memory_limit_mb} MB (memory_limit_mb).",
    ),
    "foreseen": _text(
        "지금의 증가로 {forecast_horizon_sec}초 안에 한도에 닿고(forecast_horizon_sec), 그 예측이 "
        "{forecast_confirm_sec}초 동안 이어지면 대응해요 (forecast_confirm_sec).",
        "Acted on when the growth reaches the limit within {forecast_horizon_sec} s (forecast_horizon_sec) even at its "
        "slowest, and the forecast has stood for {forecast_confirm_sec} s (forecast_confirm_sec).",
    ),
    "sentinel-gone": _text(
        "감시자가 종료되거나, 두 가지 증거로 멈춘 것이 확인되면 대응해요.",
        "Acted on when the guard has ended, or two kinds of evidence say that it stands still.",
    ),
    "gateway-gone": _text(
        "관문이 종료되면 바로, 멈추면 두 가지 증거가 {confirm_hang_ms} ms 동안 맞을 때 대응해요 (confirm_hang_ms).",
        "Acted on at once when it has ended; when it stands still, after two kinds of evidence for "
        "{confirm_hang_ms} ms (confirm_hang_ms).",
    ),
    "only-recorded": _text(
        "지금은 observe 모드예요. 아래 일은 하지 않고, 했을 일만 기록해요.",
        "The mode is observe: none of the following is done, only that it would have been is recorded.",
    ),
    "waits-for-word": _text(
        "지금은 assist 모드예요. 알림만 보내고, 아래 일은 `hardcore resume`이나 `hardcore restart` 뒤에 해요.",
        "The mode is assist: you are told, and the following is done after `hardcore resume` or `hardcore restart`.",
    ),
    "nothing": _text("아무것도 하지 않아요.", "Nothing is done."),
    "alert": _text(
        "알림을 보내요. 알림 통로가 없으면 감시자의 기록에만 남아요.",
        "You are told by the channels of the policy; without any, only the guard's log says it.",
    ),
    "evidence-first": _text(
        "증거를 먼저 남겨요. 길어도 {snapshot_budget_ms} ms예요 (snapshot_budget_ms).",
        "The evidence is taken first, in {snapshot_budget_ms} ms at most (snapshot_budget_ms).",
    ),
    "evidence-beside": _text(
        "핵심 서버를 멈추지 않고 증거를 남겨요.",
        "The evidence is taken beside the core, which goes on.",
    ),
    "evidence-left": _text(
        "남은 흔적을 증거로 남겨요. 다시 켜는 일을 늦추지 않아요.",
        "What it left behind is kept as evidence; that delays nothing.",
    ),
    "reads-only": _text(
        "읽기만 받아요. 종료하지 않고, 켤 수 없으면 읽기 전용으로 켜요.",
        "Reads only are served. Nothing is ended; a core that can't start is started to read only.",
    ),
    "tries-to-write": _text(
        "{safe_retry_ms} ms 뒤에 다시 써 보고, 안 되면 간격을 두 배씩 1분까지 늘려요 (safe_retry_ms).",
        "A try to write is made after {safe_retry_ms} ms, then at doubling pauses up to a minute (safe_retry_ms).",
    ),
    "tries-slowly": _text(
        "1분 뒤에 쓸 수 있는지 스스로 해 보고, 안 되면 간격을 두 배씩 {slow_retry_sec}초까지 늘려요 (slow_retry_sec).",
        "A try to write is made after a minute, then at doubling pauses up to {slow_retry_sec} s (slow_retry_sec).",
    ),
    "reads-until-resume": _text(
        "`hardcore resume`을 할 때까지 그대로 있어요.",
        "It stays so until `hardcore resume`.",
    ),
    "goes-on": _text(
        "핵심 서버는 그대로 두고, 계속되는 동안 사건으로 기록해요.",
        "The core is left as it is; an incident is kept open while it lasts.",
    ),
    "left-alone": _text(
        "핵심 서버를 그대로 두고 사람을 기다려요. 그동안 상태는 MANUAL_INTERVENTION이에요.",
        "The core is left as it is and a person is waited for; the state is MANUAL_INTERVENTION meanwhile.",
    ),
    "waits-for-lock": _text(
        "켜지던 핵심 서버가 잠금을 만나면, 풀릴 때까지 길어도 {backoff_max_ms} ms마다 다시 켜 봐요 (backoff_max_ms).",
        "A core that meets the lock at its start is started again, at pauses of up to {backoff_max_ms} ms "
        "(backoff_max_ms), for as long as the lock lasts.",
    ),
    "waits-for-server": _text(
        "데이터베이스 서버가 돌아올 때까지 길어도 {backoff_max_ms} ms마다 핵심 서버를 다시 켜 봐요 (backoff_max_ms).",
        "A core is started again, at pauses of up to {backoff_max_ms} ms (backoff_max_ms), until the database's server "
        "is back.",
    ),
    "reads-meanwhile": _text(
        "그동안은 읽기만 받고, 잠금이 풀리면 저절로 다시 써요.",
        "Reads are served meanwhile; it writes again by itself once the lock is free.",
    ),
    "ended-and-started": _text(
        "증거를 남긴 뒤 종료하고 새 핵심 서버를 켜요. 새 서버는 장부를 확인한 뒤에만 요청을 받아요.",
        "The core is ended after its evidence and another is started; that one serves once it has proven the ledger.",
    ),
    "started-again": _text(
        "새 핵심 서버를 켜요. 새 서버는 장부를 확인한 뒤에만 요청을 받아요.",
        "Another core is started; it serves once it has proven the ledger.",
    ),
    "adopted": _text(
        "새 감시자는 돌고 있던 건강한 핵심 서버를 멈추지 않고 이어받아요. 하던 일이 중간에 멈춘 서버는 종료하고 새로 켜요.",
        "The next guard goes on with a core that it finds serving. One that it finds in the middle of something is "
        "ended, and another is started.",
    ),
    "spares-given-up": _text(
        "예비 서버가 거듭 종료되면 한동안 두지 않아요. 그동안은 새 핵심 서버를 처음부터 켜서 더 오래 걸려요.",
        "Spares that die again and again are done without for a while: a core is started from nothing then, "
        "which takes longer.",
    ),
    "switch-given-up": _text(
        "부탁받은 교체를 할 수 없으면 그만두고, 지금의 핵심 서버가 계속 일해요.",
        "A switch that can't be done is given up, and the core that serves goes on.",
    ),
    "waits": _text(
        "다시 켜지 않고 `hardcore resume`을 기다려요.",
        "None is started: the guard waits for `hardcore resume`.",
    ),
    "shut-down": _text(
        "핵심 서버를 끈 채로 둬요. `hardcore resume`을 할 때까지 저절로 켜지지 않아요.",
        "The core stays down, and nothing starts it by itself until `hardcore resume`.",
    ),
    "part-started": _text(
        "멈춘 부분만 다시 시작해요. 장부는 그동안 계속 대답해요.",
        "That part alone is started anew; the ledger answers all the while.",
    ),
    "switched-in-quiet": _text(
        "조용할 때 예비 서버로 바꿔요. 요청은 잃지 않아요.",
        "In a quiet moment the spare takes over; no request is lost.",
    ),
    "gateway-started": _text(
        "같은 주소에 새 관문을 바로 켜요. 브라우저는 저절로 다시 연결돼요.",
        "Another gateway is started on the same address at once; browsers connect again by themselves.",
    ),
    "gateway-left": _text(
        "새 관문은 저절로 켜지지 않아요. `hardcore resume`을 기다려요. 그동안 아무도 접속할 수 없어요.",
        "No other gateway is started by itself: `hardcore resume` is waited for, and nobody can connect until then.",
    ),
    "agents-start": _text(
        "실행한 프로그램까지 없으면, 남은 관문이나 핵심 서버가 새 감시자를 켜요.",
        "Where the launcher is gone too, the gateway or the core that is left starts another guard.",
    ),
    "agents-rest": _text(
        "관문과 핵심 서버는 새 감시자를 켜지 않아요. 실행한 프로그램만 켤 수 있어요.",
        "Neither gateway nor core starts another guard: only the launcher does.",
    ),
    "overdue": _text(
        "{await_operator_sec}초 동안 아무도 오지 않으면 한 번 더 알려요 (await_operator_sec, on_await_timeout).",
        "When nobody has come after {await_operator_sec} s, you are told again (await_operator_sec, on_await_timeout).",
    ),
    "overdue-restart": _text(
        "{await_operator_sec}초 동안 아무도 오지 않으면 저절로 다시 켜요 (await_operator_sec, on_await_timeout).",
        "When nobody has come after {await_operator_sec} s, it is restarted all the same (await_operator_sec, "
        "on_await_timeout).",
    ),
    "overdue-reads": _text(
        "{await_operator_sec}초 동안 아무도 오지 않으면 읽기만 받아요 (await_operator_sec, on_await_timeout).",
        "When nobody has come after {await_operator_sec} s, reads only are served (await_operator_sec, "
        "on_await_timeout).",
    ),
    "overdue-stop": _text(
        "{await_operator_sec}초 동안 아무도 오지 않으면 꺼요 (await_operator_sec, on_await_timeout).",
        "When nobody has come after {await_operator_sec} s, it is shut down (await_operator_sec, on_await_timeout).",
    ),
    "suspects-touched": _text(
        "그때 처리하던 명령은 장부에서 먼저 찾아요. 장부에 없으면 복사본에서 시험한 뒤, 문제가 없으면 한 번 실행하고 다시 "
        "멈추게 하면 따로 보관해요.",
        "The commands being decided or written are looked up in the ledger first. One that is not there is tried on a copy: "
        "if it does no harm it is run once, if it ends the copy's core too it is set aside.",
    ),
    "suspects-grown": _text(
        "처리하는 동안 메모리가 크게 늘어난 명령만 복사본에서 먼저 시험해요.",
        "Only a command during which the memory grew is tried on a copy before it is run again.",
    ),
    "suspects-nobody": _text(
        "어떤 명령도 의심하지 않아요.",
        "No command is suspect.",
    ),
}


#: What each diagnosis means, in a few words -> (ko, en)
DIAGNOSES: Final[Mapping[str, tuple[str, str]]] = {
    "CRASHED": _text("비정상 종료", "it crashed"),
    "EXITED": _text("아무도 시키지 않은 종료", "it ended by itself, unasked"),
    "KILLED_FROM_OUTSIDE": _text("밖에서 강제로 종료됨", "somebody else killed it"),
    "STOPPED_FROM_OUTSIDE": _text("밖에서 종료를 요청받음", "somebody else asked it to stop"),
    "OUT_OF_MEMORY": _text("메모리가 모자라서 종료됨", "it ended for lack of memory"),
    "FENCED": _text("새 서버가 장부를 넘겨받음", "a newer core has taken over"),
    "COMMIT_FAILED": _text("기록의 마지막 단계가 실패함", "a commit failed"),
    "FROZEN": _text("통째로 정지함", "stopped in its tracks"),
    "LOOP_BLOCKED": _text("한곳에서 멈춤", "it hangs in one place"),
    "SPINNING": _text("끝나지 않는 계산", "an endless calculation"),
    "GIL_HELD": _text("한 가지 일이 전체를 붙듦", "one piece of work holds up all"),
    "DEADLOCK": _text("작업들이 서로를 기다림", "parts of it wait for each other"),
    "TRANSACTION_TIMEOUT": _text("요청 하나가 제시간에 끝나지 않음", "one command is over its time"),
    "NO_PROGRESS": _text("아무 요청도 끝나지 않음", "it finishes nothing any more"),
    "DB_LOCKED": _text("다른 프로그램이 장부를 잠금", "another program holds the ledger"),
    "STORE_AWAY": _text("데이터베이스에 연결할 수 없음", "the database can't be reached"),
    "DISK_FULL": _text("디스크가 가득 참", "the disk is full"),
    "DISK_READ_ONLY": _text("디스크에 쓸 수 없음", "the disk can't be written to"),
    "DISK_STALLED": _text("디스크가 대답하지 않음", "the disk does not answer"),
    "STORE_CORRUPT": _text("장부가 맞지 않음", "the ledger does not hold"),
    "COMPONENT_STALLED": _text("한 부분이 멈춤", "a part of it has stopped"),
    "MEMORY_PRESSURE": _text("메모리가 거의 참", "memory is running out"),
    "LEAK": _text("메모리가 계속 늘어남", "memory keeps growing"),
    "FD_EXHAUSTION": _text("열어 둔 파일이 너무 많음", "too many files are open"),
    "STARTUP_FAILED": _text("시작하지 못함", "it could not start"),
    "CRASH_LOOP": _text("거듭 종료됨", "it keeps failing"),
    "CONFIG_INVALID": _text("설정이 잘못됨", "it can't start as it is set up"),
    "STARVED": _text("컴퓨터가 바빠서 차례가 오지 않음", "the machine is too busy to let it run"),
    "SLEPT": _text("컴퓨터가 잠들었다 깨어남", "the machine has slept"),
    "SENTINEL_LOST": _text("감시자가 종료됨", "the guard itself has died"),
    "GATEWAY_LOST": _text("관문이 종료됨", "the gateway has died"),
    "SPARE_LOST": _text("예비 서버가 종료됨", "the spare core has died"),
    "OPERATOR": _text("사람이 다시 켜게 함", "somebody asked for a restart"),
    "PLANNED_SWITCH": _text("계획된 교체", "a planned switch"),
}


#: What a policy leaves out that somebody would miss -> (ko, en)
NOTES: Final[Mapping[str, tuple[str, str]]] = {
    "no_channels": _text(
        "알림 통로가 없어요. 무슨 일이 생겨도 밖으로 알리지 않아요 (alerts).",
        "There is no channel: nobody would be told of anything (alerts).",
    ),
    "no_apprise": _text(
        "Apprise가 설치돼 있지 않아서 apprise 채널로는 알리지 못해요 (pip install apprise).",
        "Apprise is not installed: channels of kind apprise can't be told (pip install apprise).",
    ),
    "observe": _text(
        "observe 모드예요. 기록만 하고, 서버가 꺼져도 다시 켜지 않아요 (mode).",
        "The mode is observe: it only records, and starts nothing that has died (mode).",
    ),
    "assist": _text(
        "assist 모드예요. 무슨 일이 생기면 알리고 기다려요 (mode).",
        "The mode is assist: whatever happens, it tells and waits (mode).",
    ),
}


def note_words(name: str, lang: str) -> str:
    """Return what a policy leaves out, as one sentence."""
    return NOTES[name][LANGUAGES.index(lang)]


def diagnosis_words(name: str, lang: str) -> str:
    """Return what a diagnosis means, in a few words."""
    return DIAGNOSES[name][LANGUAGES.index(lang)]


def explained(key: str, numbers: Mapping[str, int], lang: str) -> str:
    """Return one sentence with its numbers."""
    return EXPLAINED[key][LANGUAGES.index(lang)].format(**numbers)
