"""The dashboard's texts, Korean and English, as plain data: everything but what is said of dead letters.

Calm, short and true: a sentence stands here only if a recorded fact can carry it, and the page picks the neutral
one where there is none. A Korean particle never stands right after a value, because it would depend on how it ends.
"""

from collections.abc import Mapping
from typing import Final

from frontend import catalogue_prevention, catalogue_reports

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


TEXTS: Final[Mapping[str, Text]] = {
    "app_name": _text("장부 감시", "Ledger guard"),
    "skip": _text("본문으로 가기", "Skip to the content"),
    "nav_label": _text("관리 화면", "Dashboard"),
    "nav_now": _text("지금", "Now"),
    "nav_incidents": _text("사건", "Incidents"),
    "nav_dlq": _text("보관함", "Dead letters"),
    "nav_snapshots": _text("증거", "Snapshots"),
    "nav_trends": _text("추세", "Trends"),
    "nav_settings": _text("설정", "Settings"),
    "to_ledger": _text("장부로 가기", "To the ledger"),
    "cancel": _text("그대로 두기", "Keep as it is"),
    "back": _text("돌아가기", "Back"),
    "more": _text("더 보기", "More"),
    "none": _text("없음", "none"),
    "certain": _text("확실", "certain"),
    "likely": _text("추정", "likely"),
    "unknown": _text("모름", "unknown"),
    "as_table": _text("표로 보기", "As a table"),
    "filter": _text("걸러 보기", "Filter"),
    "filter_clear": _text("모두 보기", "Show all"),
    "any": _text("모두", "any"),
    # The state, in the header and on the first page
    "state_OPERATIONAL": _text("정상", "Working"),
    "state_STARTING": _text("시작하는 중", "Starting"),
    "state_DEGRADED": _text("주의", "Degraded"),
    "state_RECOVERY": _text("복구하는 중", "Recovering"),
    "state_SAFE_MODE": _text("읽기 전용", "Read-only"),
    "state_MANUAL_INTERVENTION": _text("사람을 기다리는 중", "Waiting for a person"),
    "state_SHUTDOWN": _text("꺼져 있음", "Turned off"),
    "state_UNKNOWN": _text("감시자가 응답하지 않음", "The guard does not answer"),
    "told_OPERATIONAL": _text("장부가 요청을 받고 있어요.", "The ledger is taking requests."),
    "told_STARTING": _text("장부 서버를 켜고 있어요.", "The ledger's server is being started."),
    "told_DEGRADED": _text(
        "장부는 열려 있지만 살펴볼 것이 있어요.", "The ledger is open, but something deserves a look."
    ),
    "told_RECOVERY": _text(
        "장부 서버를 다시 켜고 있어요. 그동안 온 요청은 기다려요.",
        "The ledger's server is being restarted. Requests wait meanwhile.",
    ),
    "told_SAFE_MODE": _text(
        "볼 수는 있지만 지금은 바꿀 수 없어요.", "It can be read, but not changed for now."
    ),
    "told_MANUAL_INTERVENTION": _text(
        "자동 복구를 멈췄어요. 마지막 사건을 읽고 결정해 주세요.",
        "Automatic recovery has stopped. Please read the last incident and decide.",
    ),
    "told_SHUTDOWN": _text("누군가 장부를 껐어요.", "Somebody turned the ledger off."),
    "told_UNKNOWN": _text(
        "감시자와 이야기할 수 없어서, 아래 내용은 마지막으로 기록된 것이에요.",
        "The guard can't be asked; what stands below is what was recorded last.",
    ),
    "state_serving": _text("정상", "Working"),
    "state_slow": _text("느림", "Slow"),
    "state_safe": _text("읽기 전용", "Read-only"),
    "state_down": _text("복구 중", "Recovering"),
    "state_off": _text("꺼짐", "Off"),
    "state_stopped": _text("복구 멈춤", "Recovery stopped"),
    "state_away": _text("연결 안 됨", "Not connected"),
    "since": _text("{at}부터", "since {at}"),
    # Now
    "now_title": _text("지금", "Now"),
    "now_day": _text("지난 24시간", "The last 24 hours"),
    "now_open": _text("지금 처리 중인 사건 보기", "See the incident under way"),
    "now_worries": _text(
        "감시자가 자기 상태와 주변을 살펴본 것", "What the guard noticed of itself and around it"
    ),
    "now_calm": _text("{n}일 동안 사건이 없었어요", "No incident in {n} days"),
    "now_calm_one": _text("하루 동안 사건이 없었어요", "No incident in a day"),
    "now_calm_hours": _text("지난 하루 안에 사건이 있었어요", "There was an incident within the last day"),
    "now_never": _text("아직 기록된 사건이 없어요", "No incident on record yet"),
    "now_only_drills": _text("연습 말고는 사건이 없었어요", "No incident besides drills"),
    "now_proof": _text(
        "마지막 연습: {at}, {took} 만에 돌아왔어요. 조용한 것은 증거가 아니지만, 연습은 증거예요.",
        "Last drill: {at}, back after {took}. Silence proves nothing; a drill does.",
    ),
    "now_proof_failed": _text(
        "마지막 연습이 약속대로 끝나지 않았어요: {at}", "The last drill did not end as promised: {at}"
    ),
    "now_proof_untimed": _text(
        "마지막 연습: {at}. 조용한 것은 증거가 아니지만, 연습은 증거예요.",
        "Last drill: {at}. Silence proves nothing; a drill does.",
    ),
    "now_unproven": _text(
        "아직 연습한 적이 없어요. 아래에서 한 번 해 보면 복구가 되는지 알 수 있어요.",
        "Recovery has never been drilled here. One drill below shows whether it works.",
    ),
    "now_last": _text("마지막 사건", "The last incident"),
    "now_facts": _text("상태", "How it is"),
    "now_letters": _text("따로 보관한 요청", "Set aside"),
    "now_letters_n": _text("{n}건", "{n} requests"),
    "now_letters_n_one": _text("1건", "1 request"),
    "now_beat": _text("마지막 심장 박동", "Last heartbeat"),
    "now_beat_ms": _text("{n} ms 전", "{n} ms ago"),
    "now_memory": _text("메모리", "Memory"),
    "now_memory_of": _text("{held} (한도 {limit})", "{held} (limit {limit})"),
    "now_curve": _text("메모리가 지나온 길", "Memory over time"),
    "now_curve_none": _text(
        "아직 그릴 만큼 보지 못했어요. 켜고 얼마 동안은 원래 늘어서 보지 않아요.",
        "Not enough was seen yet: what every start takes in its first minutes is not looked at.",
    ),
    "now_forecasts": _text("곧 모자랄 것", "What will run out"),
    "forecast_due": _text(
        "{resource}: 이대로 늘면 {at} 무렵 한도에 닿아요 (한 시간에 {rate}).",
        "{resource}: at this pace it reaches its limit at about {at} ({rate} an hour).",
    ),
    "forecast_much": _text("{resource}: 평소보다 훨씬 많아요.", "{resource}: far more than usual."),
    "resource_memory": _text("메모리", "Memory"),
    "resource_fds": _text("열린 파일", "Open files"),
    "resource_threads": _text("스레드", "Threads"),
    "resource_queue": _text("차례를 기다리는 작업", "Commands that wait"),
    "resource_disk": _text("디스크", "Disk"),
    "resource_errors": _text("오류와 경고", "Errors and warnings"),
    "now_held": _text("기다리는 요청", "Requests waiting"),
    "now_tabs": _text("연결된 화면", "Pages connected"),
    "now_spare": _text("예비 서버", "Spare"),
    "now_spare_ready": _text("준비됨", "ready"),
    "now_spare_not": _text("준비 중", "getting ready"),
    "now_budget": _text("최근 비정상 종료", "Recent deaths"),
    "now_budget_of": _text("{used} / {limit} ({window}초 안)", "{used} of {limit} in {window} s"),
    "now_checked": _text("마지막 장부 확인", "Last ledger check"),
    "now_core": _text("장부 서버", "Core"),
    "now_core_of": _text("프로세스 {pid}, 세대 {epoch}", "process {pid}, epoch {epoch}"),
    "act_restart": _text("장부 서버 다시 켜기", "Restart the core"),
    "act_restart_more": _text(
        "예비 서버가 먼저 준비되고, 그동안 온 요청은 기다렸다가 처리돼요.",
        "A spare is made ready first; requests wait meanwhile and are then handled.",
    ),
    "restart_title": _text("장부 서버를 다시 켤까요?", "Restart the core?"),
    "restart_held": _text(
        "지금 기다리는 요청({n}건)과 그사이 오는 요청은 잠시 기다려요.",
        "The {n} requests waiting now, and those that come meanwhile, will wait a moment.",
    ),
    "restart_held_one": _text(
        "지금 기다리는 요청 1건과 그사이 오는 요청은 잠시 기다려요.",
        "The request waiting now, and those that come meanwhile, will wait a moment.",
    ),
    "restart_type": _text(
        "확인을 위해 restart 라고 적어 주세요.", "Please type the word restart to confirm."
    ),
    "restart_wrong": _text("적은 낱말이 달라요.", "That is another word."),
    "act_drill": _text("연습하기", "Run a drill"),
    "act_drill_more": _text(
        "장부 서버를 일부러 고장 내고, 약속대로 돌아오는지 봐요.",
        "The core is broken on purpose, to see that it comes back as promised.",
    ),
    "drill_which": _text("어떤 연습", "Which drill"),
    "drill_title": _text("연습을 시작할까요?", "Start the drill?"),
    "drill_sure": _text("시작하기", "Start"),
    "drill_crash": _text("갑자기 종료", "sudden death"),
    "drill_segv": _text("메모리 오류", "a memory fault"),
    "drill_exit": _text("스스로 종료", "ending by itself"),
    "drill_freeze": _text("통째로 정지", "stopped in its tracks"),
    "drill_block": _text("한곳에서 멈춤", "stuck in one place"),
    "drill_deadlock": _text("서로 기다림", "a deadlock"),
    "drill_spare": _text("예비 서버 종료", "death of the spare"),
    "drill_poison": _text("처리하면 죽는 요청", "a request that kills"),
    "said_restarted": _text("다시 켜도록 부탁했어요.", "The restart was asked for."),
    "said_drilled": _text("연습을 시작했어요.", "The drill has begun."),
    "said_guard_away": _text(
        "감시자가 응답하지 않아서 아무것도 하지 않았어요.", "The guard does not answer; nothing was done."
    ),
    "said_guard_refused": _text(
        "감시자가 지금은 안 된다고 했어요. 아무것도 하지 않았어요.",
        "The guard refused for now; nothing was done.",
    ),
    "said_done": _text("처리했어요.", "Done."),
    "said_refused": _text("그렇게 하지 않았어요", "That was not done"),
    "said_revealed": _text("가린 값을 표시했고, 이 일을 기록해 뒀어요.", "Shown; that was written down."),
    # Errors as pages
    "lost_title": _text("여기에는 아무것도 없어요", "There is nothing here"),
    "lost_more": _text(
        "번호가 틀렸거나, 보관 기간이 지나 지워졌을 수 있어요.",
        "The number may be wrong, or what it named was removed when its time was over.",
    ),
    "stale_title": _text("이 양식은 오래됐어요", "This form is out of date"),
    "stale_more": _text(
        "아무것도 하지 않았어요. 페이지를 다시 열고 한 번 더 해 주세요.",
        "Nothing was done. Please open the page again and repeat it.",
    ),
    # Incidents
    "incidents_title": _text("사건", "Incidents"),
    "incidents_lead": _text(
        "같은 원인으로 멈춘 일은 한 묶음으로 보여요.", "Deaths of the same kind stand together as one group."
    ),
    "incidents_groups": _text("묶어서 보기", "Grouped"),
    "incidents_all": _text("모두 보기", "Every incident"),
    "incidents_none": _text("사건이 없었어요", "No incident so far"),
    "incidents_none_more": _text(
        "장부 서버가 멈추면 감시자가 여기에 무슨 일이 있었는지, 누구에게, 얼마나 오래, 돈은 어떻게 됐는지 남겨요.",
        "When the core stops, the guard tells here what happened, to whom, for how long, and what became of the money.",
    ),
    "incidents_no_match": _text("이 조건에 맞는 사건이 없어요.", "No incident fits this filter."),
    "incidents_files": _text("이 목록을 파일로", "This list as a file"),
    "col_what": _text("무슨 일", "What"),
    "col_standing": _text("상태", "Standing"),
    "col_count": _text("횟수", "Times"),
    "col_first": _text("처음", "First"),
    "col_last": _text("마지막", "Last"),
    "col_median": _text("멈춘 시간(중앙값)", "Median outage"),
    "col_outage": _text("멈춘 시간", "Outage"),
    "col_accounts": _text("계좌", "Accounts"),
    "col_when": _text("언제", "When"),
    "col_outcome": _text("결과", "Outcome"),
    "standing_new": _text("새로움", "new"),
    "standing_known": _text("알려짐", "known"),
    "standing_fixed": _text("고쳐짐", "fixed"),
    "standing_back": _text("되돌아옴", "back again"),
    "filter_cause": _text("원인", "Cause"),
    "filter_outcome": _text("결과", "Outcome"),
    "filter_account": _text("계좌", "Account"),
    "filter_since": _text("언제부터", "From"),
    "filter_until": _text("언제까지", "Until"),
    "filter_drills": _text("연습도 보기", "Drills too"),
    "why_group": _text("왜 한 묶음인가요", "Why they are one group"),
    "fix_title": _text("고쳐졌다고 표시하기", "Mark as fixed"),
    "fix_version": _text("어느 버전에서", "In which version"),
    "fix_more": _text(
        "다시 일어나면 '되돌아옴'으로 알려 드려요.", "If it happens again, it is shown as back again."
    ),
    "merge_into": _text("같은 원인으로 묶기", "The same cause as"),
    "merge": _text("묶기", "Merge"),
    "merged_n": _text("사람이 묶은 묶음: {n}개", "{n} groups were put into it by hand"),
    "merged_n_one": _text("사람이 묶은 묶음: 1개", "1 group was put into it by hand"),
    "split": _text("다시 나누기", "Take apart"),
    "split_one": _text("이 사건은 다른 원인이에요", "This one had another cause"),
    "fixed_in": _text("고친 버전: {version}", "Fixed in {version}"),
    "is_drill": _text("연습", "drill"),
    "is_planned": _text("계획됨", "planned"),
    # One incident
    "incident_title": _text("사건", "Incident"),
    "incident_when": _text("시작 {at}", "Began {at}"),
    "incident_for": _text("{took} 동안", "for {took}"),
    "incident_met": _text("요청 {n}건이 만났어요", "{n} requests met it"),
    "incident_met_one": _text("요청 1건이 만났어요", "1 request met it"),
    "incident_met_none": _text("이 시간에 온 요청은 기록에 없어요", "no request on record met it"),
    "incident_found_in": _text("{took} 만에 발견", "found after {took}"),
    "money": _text("돈은", "The money"),
    "timeline": _text("진행 순서", "The course of it"),
    "timeline_none": _text("진행 순서가 기록되지 않았어요.", "The course of it was not recorded."),
    "cause": _text("원인", "Cause"),
    "cause_why": _text("그렇게 보는 까닭", "Why we think so"),
    "culprit": _text("관련된 요청", "What was being done"),
    "culprit_masked": _text(
        "계좌와 거래 번호는 가려져 있어요.", "Account and transaction numbers are masked."
    ),
    "culprit_reveal": _text("가린 값 보기(기록에 남아요)", "Show them (this is written down)"),
    "command": _text("명령", "Command"),
    "account": _text("계좌", "Account"),
    "transaction": _text("거래", "Transaction"),
    "stage": _text("어디까지", "How far"),
    "blamed": catalogue_reports.WORDS["blamed"],
    "ring": _text("서로를 기다린 고리", "The ring of waiting"),
    "stacks": _text("모든 스레드의 위치", "Where every thread was"),
    "stacks_none": _text("스택이 기록되지 않았어요.", "No stacks were recorded."),
    "stack_system": _text("시스템 프레임 {n}개", "{n} frames of the system"),
    "stack_system_one": _text("시스템 프레임 1개", "1 frame of the system"),
    "stack_gil": _text("전체 잠금을 쥠", "held the interpreter"),
    "memory": _text("메모리", "Memory"),
    "memory_none": _text("메모리 기록이 없어요.", "No memory record."),
    "memory_types": _text("가장 많은 것", "What there was most of"),
    "crumbs": _text("그 직전의 명령들", "The last commands before"),
    "crumbs_none": _text("직전에 끝난 명령이 기록되지 않았어요.", "No finished command on record before it."),
    "requests": catalogue_reports.WORDS["requests"],
    "request": _text("요청", "Request"),
    "waited": _text("기다린 시간", "Waited"),
    "answer": _text("응답", "Answer"),
    "changed": catalogue_prevention.WORDS["changes"],
    "changed_none": _text("달라진 것이 기록되지 않았어요.", "No change is on record."),
    "similar": _text("같은 원인의 사건", "The same cause before"),
    "similar_none": _text("처음 있는 일이에요.", "This is the first of its kind."),
    "proposals": _text("다시 일어나지 않게", "So that it does not happen again"),
    "proposals_none": _text("자동으로 권할 것이 없어요.", "There is nothing to propose by itself."),
    "proposal_open": _text("제안", "proposed"),
    "proposal_accepted": _text("적용 중", "in force"),
    "proposal_declined": _text("받아들이지 않음", "declined"),
    "proposal_done": _text("끝냄", "done"),
    "proposal_revoked": _text("거둠", "revoked"),
    "proposal_tested": _text("시험해 봤어요", "Tested"),
    "proposal_hits": _text("지금까지 {n}번 막았어요.", "It has stopped {n} so far."),
    "proposal_hits_one": _text("지금까지 1번 막았어요.", "It has stopped 1 so far."),
    "proposal_owner": _text("맡은 사람", "Owner"),
    "proposal_note": _text("메모", "Note"),
    "proposal_accept": _text("적용하기", "Accept"),
    "proposal_decline": _text("받아들이지 않기", "Decline"),
    "proposal_mark_done": _text("끝냈어요", "Mark done"),
    "proposal_revoke": _text("거두기", "Revoke"),
    "export": _text("내보내기", "Export"),
    "export_md": _text("Markdown", "Markdown"),
    "export_html": _text("HTML", "HTML"),
    "export_json": _text("JSON", "JSON"),
    "export_zip": _text("가린 묶음(zip)", "Redacted bundle (zip)"),
    "export_title": _text("가린 묶음 미리 보기", "What the redacted bundle holds"),
    "export_lead": _text(
        "묶음에는 아래 파일이 들어가요. 비밀일 수 있는 값은 빠져요.",
        "The bundle holds these files. Values that may be secret are left out.",
    ),
    "export_get": _text("내려받기", "Download"),
    "export_left_out": _text("빠지는 것", "Left out"),
    "export_kept": _text("들어가는 것", "Kept"),
    "evidence": _text("남아 있는 증거", "The evidence kept"),
    "evidence_whole": _text("증거가 모두 있고 확인됐어요.", "All evidence is there and checked."),
    "evidence_partial": _text("증거 일부가 없어요", "Part of the evidence is missing"),
    "evidence_fault": _text("확인하니 맞지 않는 부분이 있어요", "What the check found"),
    "letters_of": _text("이 사건으로 보관한 요청", "Requests set aside by it"),
    "file": _text("파일", "File"),
    "size": _text("크기", "Size"),
    "reading_failed": _text(
        "이 사건의 폴더를 읽을 수 없어요. 목록에 있던 내용만 보여요.",
        "This incident's folder can't be read; only what the list knows is shown.",
    ),
    # Snapshots
    "snapshots_title": _text("남겨 둔 증거", "Snapshots"),
    "snapshots_lead": _text(
        "사건마다 남은 기록이에요. 오래된 것부터 저절로 정리돼요.",
        "What each incident left behind. The oldest go by themselves.",
    ),
    "snapshots_none": _text("남은 증거가 없어요", "No evidence is kept"),
    "snapshots_none_more": _text(
        "사건이 생기면 멈춘 순간의 기록이 여기에 모여요.",
        "When an incident happens, what was recorded of its moment is kept here.",
    ),
    "snapshots_room": _text("디스크에 남은 공간: {free}", "Room left on the disk: {free}"),
    "snapshots_low": _text(
        "디스크에 1 GB보다 적게 남았어요. 다음 증거를 남기지 못할 수 있어요.",
        "Less than 1 GB is left; the next evidence may not fit.",
    ),
    "snapshots_masked": _text(
        "번호와 금액처럼 허용된 값만 남기고, 암호나 토큰 같은 값은 처음부터 기록하지 않아요.",
        "Only allowed values such as ids and amounts are kept; passwords, tokens and the like are never recorded.",
    ),
    "files_n": _text("파일 {n}개", "{n} files"),
    "files_n_one": _text("파일 1개", "1 file"),
    "complete": _text("모두 있음", "complete"),
    "incomplete": _text("일부 없음", "partial"),
    "snapshot_remove": _text("증거 지우기", "Delete"),
    "remove_title": _text("이 사건의 증거를 지울까요?", "Delete the evidence of this incident?"),
    "remove_told": _text(
        "되돌릴 수 없어요. 목록에는 무슨 일이 있었는지 한 문장으로 남아요.",
        "It does not come back. The list keeps what happened, in one sentence.",
    ),
    "said_removed": _text("증거를 지웠어요.", "The evidence is deleted."),
    # Trends
    "trends_title": _text("추세", "Trends"),
    "trends_weeks": _text(
        "주마다 사건 수(연습과 계획한 것 제외)", "Incidents a week (without drills and planned ones)"
    ),
    "trends_week": _text("주", "Week"),
    "trends_recovery": _text("원인별 멈춘 시간", "Outage by cause"),
    "trends_p50": _text("절반은 이보다 빨리", "Half are back within"),
    "trends_p90": _text("열에 아홉은 이보다 빨리", "Nine in ten within"),
    "trends_mtbf": _text("사건 사이의 평균 시간", "Mean time between incidents"),
    "trends_hours": _text("{n}시간", "{n} h"),
    "trends_few": _text(
        "사건이 다섯 건보다 적어서 아직 추세를 말할 수 없어요.",
        "Fewer than five incidents: too few to speak of a trend.",
    ),
    "trends_growth": _text("늘어나는 것", "What grows"),
    "trends_growth_none": _text(
        "평소의 오르내림을 넘어서 늘어나는 것이 없어요.", "Nothing grows beyond its ordinary ups and downs."
    ),
    "trends_growth_away": _text(
        "감시하는 쪽이 답하지 않아서 알 수 없어요.", "The guard does not answer, so nothing is known."
    ),
    "trends_level": _text("지금", "Now"),
    "trends_limit": _text("한도", "Limit"),
    "trends_rate": _text("한 시간에 느는 양", "Growth an hour"),
    "trends_due": _text("한도에 닿는 때", "Limit reached at about"),
    "trends_far": _text("석 달보다 뒤", "in more than three months"),
    "trends_promises": _text("예상 시간과 실제", "What was estimated, and what it took"),
    "trends_kept": _text(
        "예상을 말한 {n}건 중 {kept}건은 그 안에 돌아왔어요.",
        "Of {n} estimates {kept} held: it was back by then.",
    ),
    "trends_kept_one": _text(
        "예상을 말한 1건 중 {kept}건은 그 안에 돌아왔어요.", "Of 1 estimate {kept} held: it was back by then."
    ),
    "trends_told": _text("예상", "Estimated"),
    "trends_range": _text("{low}~{high}초", "{low} to {high} s"),
    "trends_truth": _text("실제", "It took"),
    "promise_kept": _text("예상대로", "in time"),
    "promise_broken": _text("예상보다 오래", "longer"),
    "trends_promises_none": _text(
        "예상을 말한 멈춤이 아직 없어요. 기록이 다섯 번 모이면 예상을 말해요.",
        "No estimate was given so far: it takes five outages on record.",
    ),
    "trends_drills": _text("연습 결과", "Drills"),
    "trends_drills_none": _text("아직 연습한 적이 없어요.", "No drill so far."),
    "drill_col": _text("연습", "Drill"),
    "drill_ok": _text("약속대로", "as promised"),
    "drill_bad": _text("약속과 다름", "not as promised"),
    "drill_scheduled": _text("예약된 연습", "scheduled"),
    # Settings and audit
    "settings_title": _text("설정과 기록", "Settings and audit"),
    "settings_rules": _text("언제 무엇을 하나요", "When something is done"),
    "settings_away": _text(
        "감시자가 응답하지 않아서 지금 기준을 볼 수 없어요.",
        "The guard does not answer, so its thresholds can't be shown.",
    ),
    "setting": _text("이름", "Name"),
    "setting_value": _text("값", "Value"),
    "settings_raw": _text("모든 값", "Every value"),
    "settings_version": _text("버전", "Version"),
    "version_code": _text("코드", "Code"),
    "version_python": _text("Python", "Python"),
    "audit_title": _text("누가 무엇을 했나요", "Who did what"),
    "audit_none": _text("아직 기록된 일이 없어요.", "Nothing was done so far."),
    "audit_who": _text("누가", "Who"),
    "audit_verb": _text("한 일", "Act"),
    "audit_what": _text("대상", "On what"),
    "audit_reason": _text("이유", "Reason"),
    "audit_outcome": _text("결과", "Outcome"),
    "means_health_check_interval_ms": _text("감시자가 {n} ms마다 살펴봐요.", "The guard looks every {n} ms."),
    "means_confirm_deadlock_ms": _text(
        "서로 기다리는 고리를 {n} ms 동안 확인한 뒤에 종료해요.",
        "A ring of waiting is ended after it was confirmed for {n} ms.",
    ),
    "means_confirm_hang_ms": _text(
        "다른 멈춤은 {n} ms 동안 확인한 뒤에 종료해요.",
        "Any other hang is ended after it was confirmed for {n} ms.",
    ),
    "means_transaction_timeout_ms": _text(
        "요청 하나가 {n} ms 넘게 걸리면 종료해요.",
        "One command may take {n} ms before the core is ended for it.",
    ),
    "means_startup_timeout_ms": _text(
        "새 서버가 {n} ms 안에 준비되지 않으면 다시 켜요.", "A new core has {n} ms to become ready."
    ),
    "means_max_restart_count": _text(
        "정해진 시간 안에 {n}번보다 자주 죽으면 자동 복구를 멈춰요.",
        "More deaths than {n} within the window stop automatic recovery.",
    ),
    "means_restart_window_sec": _text(
        "죽은 횟수를 지난 {n}초 동안 세어요.", "Deaths are counted over the last {n} s."
    ),
    "means_snapshot_budget_ms": _text(
        "증거를 남기는 데 길어도 {n} ms를 써요.", "The evidence may take {n} ms at most."
    ),
    "means_disk_floor_mb": _text(
        "디스크에 {n} MB보다 적게 남으면 알려요.", "Less than {n} MB left on the disk is told."
    ),
}
