"""The dashboard's texts about guarding: safe mode, parts, modes, history, and the policy with each of its settings.

A part of `catalogue_admin.py` in a file of its own; the same rules hold. Of each setting one sentence says what it
changes for whoever uses the ledger, with its unit in brackets.
"""

from collections.abc import Mapping
from typing import Final

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


GUARD_TEXTS: Final[Mapping[str, Text]] = {
    "nav_policy": _text("정책", "Policy"),
    "now_safe": _text("안전 모드", "Safe mode"),
    "now_safe_off_more": _text(
        "켜면 볼 수는 있지만 아무것도 바꿀 수 없어요. 다시 켜도 그대로 남아요.",
        "While it is on, the ledger can be read and nothing changed, over restarts too.",
    ),
    "now_safe_on_more": _text(
        "지금 켜져 있어요. 사람이 끌 때까지 그대로예요.", "It is on, and stays so until somebody ends it."
    ),
    "now_safe_since": _text("이유: {why}", "Why: {why}"),
    "act_safe_on": _text("안전 모드 켜기", "Turn the safe mode on"),
    "act_safe_off": _text("안전 모드 끄기", "Turn the safe mode off"),
    "safe_on_title": _text("안전 모드를 켤까요?", "Turn the safe mode on?"),
    "safe_off_title": _text("안전 모드를 끌까요?", "Turn the safe mode off?"),
    "safe_on_told": _text(
        "새 입력은 거절되고, 다시 보내면 돼요. 장부는 그대로예요.",
        "New entries are refused and may be sent again later. The ledger stays as it is.",
    ),
    "safe_off_told": _text("다시 입력을 받아요.", "Entries are taken again."),
    "said_safe_on": _text("안전 모드를 켰어요.", "The safe mode is on."),
    "said_safe_off": _text("안전 모드를 껐어요.", "The safe mode is off."),
    "said_policy_read": _text("정책을 다시 읽었어요.", "The policy was read again."),
    "said_policy_faulty": _text(
        "정책 파일에 고칠 곳이 있어요. 지금 정책이 그대로 쓰여요.",
        "The policy file needs mending. The policy before it stays in force.",
    ),
    "now_mode": _text("모드", "Mode"),
    "mode_act": _text("act: 스스로 되살려요", "act: it brings the ledger back by itself"),
    "mode_assist": _text("assist: 알리고 사람을 기다려요", "assist: it tells and waits for a person"),
    "mode_observe": _text("observe: 기록만 해요", "observe: it only records"),
    "now_needs": _text("{at}부터 사람을 기다려요.", "A person has been waited for since {at}."),
    "now_policy_fault": _text("정책 파일에 고칠 곳이 있어요", "The policy file needs mending"),
    "now_parts": _text("핵심 서버의 부분", "Parts of the core"),
    "part_importer": _text("가져오기", "import"),
    "part_exporter": _text("내보내기", "export"),
    "part_notifier": _text("알려 주기", "page updates"),
    "part_auditor": _text("장부 확인", "ledger check"),
    "part_scheduler": _text("때가 된 일", "what falls due"),
    "part_rests": _text("할 일 없음", "nothing to do"),
    "part_works": _text("일하는 중 · {n} ms 전 신호", "at work · sign {n} ms ago"),
    "part_silent": _text("{n} ms째 신호 없음", "no sign for {n} ms"),
    "part_done": _text("{n}건 마침", "{n} done"),
    "now_history": _text("상태가 바뀐 기록", "Changes of the state"),
    "now_history_more": _text(
        "이유는 기록에 남은 말 그대로 보여 드려요. 감시자는 영어로 적어요.",
        "Reasons stand here as they were recorded.",
    ),
    "policy_title": _text("정책", "Policy"),
    "policy_lead": _text(
        "감시자가 지금 따르는 규칙이에요. 파일을 고치면 몇 초 안에 적용돼요.",
        "What the guard goes by now. A changed file is taken within seconds.",
    ),
    "policy_file": _text("파일: {path}", "File: {path}"),
    "policy_away": _text(
        "감시자가 응답하지 않아서 지금 쓰는 정책을 알 수 없어요.",
        "The guard does not answer, so what it goes by is not known.",
    ),
    "policy_fault_title": _text("파일에 고칠 곳이 있어요", "The file needs mending"),
    "policy_fault_more": _text(
        "고칠 때까지 전의 정책이 그대로 쓰여요.", "Until it is mended, the policy before it stays in force."
    ),
    "policy_reload": _text("다시 읽기", "Read it now"),
    "policy_numbers": _text("숫자와 낱말", "Numbers and words"),
    "policy_actions": _text("진단마다 하는 일", "What is done on a diagnosis"),
    "policy_explain": _text(
        "자세한 설명: `hardcore policy explain {name}`", "In sentences: `hardcore policy explain {name}`"
    ),
    "col_diagnosis": _text("진단", "Diagnosis"),
    "col_does": _text("하는 일", "What is done"),
    "col_setting": _text("항목", "Setting"),
    "col_value": _text("값", "Value"),
    "col_means": _text("뜻", "Meaning"),
    "word_SEND_ALERT": _text("알리기", "tell"),
    "word_SNAPSHOT": _text("증거 남기기", "keep evidence"),
    "word_REBOOT_PROCESS": _text("다시 켜기", "restart"),
    "word_PLANNED_SWITCH": _text("조용할 때 바꾸기", "switch in a quiet moment"),
    "word_RESTART_COMPONENT": _text("그 부분만 다시 시작", "restart that part alone"),
    "word_DEGRADE": _text("그대로 두고 주의로 보이기", "leave it, show it as degraded"),
    "word_SAFE_MODE_ENTER": _text("읽기만 받기", "serve reads only"),
    "word_AWAIT_OPERATOR": _text("사람을 기다리기", "wait for a person"),
    "word_SHUTDOWN": _text("꺼 두기", "keep it down"),
    "word_NONE": _text("아무것도 안 하기", "nothing"),
    # One sentence for each setting of the policy.
    "set_version": _text("이 파일의 형식 번호예요.", "The format of this file."),
    "set_mode": _text(
        "감시자가 할 수 있는 일: act는 스스로 되살리고, assist는 알리고 기다리고, observe는 기록만 해요.",
        "What the guard may do: act brings it back by itself, assist tells and waits, observe only records.",
    ),
    "set_health_check_interval_ms": _text(
        "이 간격(ms)으로 핵심 서버를 살펴봐요.", "The core is looked at this often (ms)."
    ),
    "set_health_check_timeout_ms": _text(
        "박동이 이보다(ms) 오래되면 늦은 것으로 봐요.", "A beat older than this (ms) is late."
    ),
    "set_failure_threshold": _text(
        "이만큼 이어서 늦어야 걱정해요.", "So many late looks in a row are a worry."
    ),
    "set_confirm_deadlock_ms": _text(
        "스스로 끝날 수 없는 멈춤은 이만큼(ms) 지나면 대응해요.",
        "A hang that can't end by itself is acted on after this (ms).",
    ),
    "set_confirm_hang_ms": _text(
        "다른 멈춤은 이만큼(ms) 지나면 대응해요.", "Any other hang is acted on after this (ms)."
    ),
    "set_gc_grace_ms": _text(
        "메모리를 정리하는 동안은 이만큼(ms) 더 기다려요.",
        "While it collects garbage it is given this long (ms).",
    ),
    "set_transaction_timeout_ms": _text(
        "명령 하나가 진행 없이 이만큼(ms) 걸리면 대응해요.",
        "One command without progress for this long (ms) is acted on.",
    ),
    "set_probe_interval_ms": _text(
        "이 간격(ms)으로 상태를 물어봐요.", "The core is asked for its health this often (ms)."
    ),
    "set_survey_interval_ms": _text(
        "이 간격(ms)으로 디스크와 메모리를 살펴봐요.", "Disk and memory are looked at this often (ms)."
    ),
    "set_disk_floor_mb": _text(
        "빈 공간이 이보다(MB) 적으면 가득 찬 것으로 봐요.", "Less room than this (MB) counts as full."
    ),
    "set_disk_slow_ms": _text(
        "작은 쓰기가 이보다(ms) 느리면 디스크가 멈춘 것으로 봐요.",
        "A small write slower than this (ms) is a stalled disk.",
    ),
    "set_safe_retry_ms": _text(
        "읽기 전용이 된 뒤 이만큼(ms) 지나 처음 다시 써 봐요.",
        "After this long (ms) of reading only, the first try to write is made.",
    ),
    "set_startup_timeout_ms": _text(
        "이 안에(ms) 준비되지 않은 서버는 실패한 것으로 봐요.",
        "A core that is not ready within this (ms) has failed.",
    ),
    "set_probation_ms": _text(
        "새 서버는 이만큼(ms) 버티면 믿어요.", "A new core is trusted after this (ms)."
    ),
    "set_degraded_after_ms": _text(
        "걱정이 이만큼(ms) 이어지면 주의로 보여요.", "A worry of this length (ms) is shown."
    ),
    "set_clean_after_ms": _text(
        "이만큼(ms) 조용하면 주의가 끝나요.", "After so much calm (ms) it is no longer shown."
    ),
    "set_stop_timeout_ms": _text(
        "나가라고 한 서버를 이만큼(ms) 기다려요.", "A core asked to leave is given this long (ms)."
    ),
    "set_kill_timeout_ms": _text(
        "종료한 서버가 이 안에(ms) 사라지지 않으면 따로 다뤄요.",
        "A killed core not gone by then (ms) is treated apart.",
    ),
    "set_restart_delay_ms": _text(
        "건강했던 서버를 바꾸기 전에 이만큼(ms) 쉬어요.", "Pause (ms) before a proven core is replaced."
    ),
    "set_backoff_initial_ms": _text(
        "실패한 서버 뒤의 첫 쉼(ms)이에요.", "First pause (ms) after a core that proved nothing."
    ),
    "set_backoff_max_ms": _text(
        "그 쉼은 길어도 이만큼(ms)이에요.", "That pause grows no longer than this (ms)."
    ),
    "set_max_restart_count": _text(
        "정해진 시간 안에 이만큼까지 다시 켜요.", "So many restarts are allowed in the window."
    ),
    "set_restart_window_sec": _text("그 시간의 길이(초)예요.", "The length of that window (s)."),
    "set_slow_retry_sec": _text(
        "멈춘 뒤 이만큼(초) 지나 한 번 더 해 봐요. 0이면 하지 않아요.",
        "After giving up, one more try comes after this (s); 0: none.",
    ),
    "set_drain_timeout_ms": _text(
        "바꾸기 전에 하던 일을 이만큼(ms) 기다려요.",
        "Before a switch, what is under way is given this long (ms).",
    ),
    "set_spare": _text("예비 서버를 준비해 둘지 정해요.", "Whether a spare core waits."),
    "set_spare_memory_mb": _text(
        "빈 메모리가 이보다(MB) 적으면 예비 서버를 두지 않아요.",
        "With less free memory than this (MB) none waits.",
    ),
    "set_promote_timeout_ms": _text(
        "예비 서버는 이 안에(ms) 이어받아야 해요.", "A spare has to take over within this (ms)."
    ),
    "set_snapshot_budget_ms": _text(
        "종료하기 전에 증거를 이만큼(ms)까지 모아요.", "Evidence before a kill takes at most this (ms)."
    ),
    "set_memory_image": _text(
        "종료하기 전에 메모리 전체를 남길지 정해요.", "Whether the whole memory is kept before a kill."
    ),
    "set_memory_image_budget_ms": _text(
        "메모리를 남기는 데 이만큼(ms)까지 기다려요.", "That is given this long (ms)."
    ),
    "set_memory_image_mb_max": _text(
        "이보다(MB) 큰 메모리는 남기지 않아요.", "A memory larger than this (MB) is not kept."
    ),
    "set_enable_state_recovery": _text(
        "시작할 때 체크포인트부터 확인할지 정해요. 아니면 처음부터 모두 확인해요.",
        "Whether a start proves the ledger from a checkpoint on, or all of it.",
    ),
    "set_checkpoint_interval_sec": _text(
        "쓰는 동안 이 간격(초)으로 체크포인트를 남겨요.",
        "While something is written, a checkpoint is made this often (s).",
    ),
    "set_checkpoints_kept": _text("체크포인트를 이만큼 남겨요.", "So many checkpoints are kept."),
    "set_checkpoint_age_hours": _text(
        "이보다(시간) 오래된 체크포인트는 지워요.", "Older checkpoints than this (h) are removed."
    ),
    "set_memory_limit_mb": _text(
        "핵심 서버가 쓸 수 있는 메모리(MB)예요.", "Memory that a core may use (MB)."
    ),
    "set_trial_limit": _text("한 번에 이만큼까지 시험해요.", "So many suspects of one death are tried."),
    "set_max_convictions": _text(
        "한 곳에서 온 요청이 1분에 이보다 많이 문제를 일으키면 그곳을 막아요.",
        "More convictions than this in a minute stop their source.",
    ),
    "set_source_stop_sec": _text(
        "막은 곳은 이만큼(초) 동안 쓸 수 없어요.",
        "A source that is stopped changes nothing for this long (s).",
    ),
    "set_drills": _text("훈련을 해도 되는지 정해요.", "Whether drills may break the core."),
    "set_drill_every_hours": _text(
        "이 간격(시간)으로 스스로 훈련해요. 0이면 하지 않아요.", "A drill by itself this often (h); 0: none."
    ),
    "set_drill_faults": _text("스스로 하는 훈련의 종류예요.", "What is drilled by itself."),
    "set_drill_hour": _text("그 훈련을 하는 시각이에요.", "The hour of that drill."),
    "set_forecast_horizon_sec": _text(
        "이 안에(초) 모자랄 것을 미리 알려요.", "What runs out within this (s) is told of before."
    ),
    "set_forecast_warmup_sec": _text(
        "켠 뒤 이만큼(초)은 증가를 보지 않아요.", "Growth is not looked at for this long (s) after a start."
    ),
    "set_forecast_confirm_sec": _text(
        "예측이 이만큼(초) 이어져야 알려요.", "A forecast has to stand this long (s)."
    ),
    "set_forecast_interval_sec": _text(
        "이 시간(초)마다 가장 낮은 값만 봐요.", "Only the lowest value in this time (s) counts."
    ),
    "set_forecast_switches_max": _text(
        "예측 때문에 하루에 이만큼까지 바꿔요.", "So many switches a day because of forecasts."
    ),
    "set_threads_max": _text("스레드는 이만큼까지로 보고 예측해요.", "Threads are forecast against this."),
    "set_await_operator_sec": _text("사람을 이만큼(초) 기다려요.", "A person is waited for this long (s)."),
    "set_on_await_timeout": _text("아무도 오지 않으면 하는 일이에요.", "What is done when nobody has come."),
    "set_enable_leader_election": _text(
        "여러 컴퓨터: 이 버전에는 없어요.", "Several hosts: not in this version."
    ),
}
