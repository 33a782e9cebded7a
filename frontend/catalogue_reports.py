"""The texts of reports and of the list of incidents, Korean and English, as plain data.

Keys are facts (a diagnosis, an outcome, a rule), values are sentences; what is filled in stands in braces.
A Korean particle never stands right after a value, because it would depend on how the value ends. Nothing
here may claim what no recorded fact says: the caller picks the neutral line instead.
"""

from collections.abc import Mapping

LANGUAGES = ("ko", "en")

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


#: First half of the summary: what happened. The Korean one leads on to the second half.
CAUSES: Mapping[str, Text] = {
    "CRASHED": _text("장부 서버가 비정상 종료됐고", "the ledger crashed"),
    "EXITED": _text("장부 서버가 스스로 종료됐고", "the ledger ended by itself"),
    "KILLED_FROM_OUTSIDE": _text("장부 서버가 밖에서 강제 종료됐고", "the ledger was killed from outside"),
    "STOPPED_FROM_OUTSIDE": _text(
        "장부 서버가 밖에서 종료 요청을 받았고", "the ledger was asked to stop from outside"
    ),
    "OUT_OF_MEMORY": _text("장부 서버의 메모리가 부족했고", "the ledger ran out of memory"),
    "FENCED": _text("새 서버가 장부를 넘겨받았고", "a newer ledger process had taken over"),
    "COMMIT_FAILED": _text("장부에 기록하는 마지막 단계가 실패했고", "a commit to the ledger failed"),
    "FROZEN": _text("장부 서버가 밖에서 정지됐고", "the ledger was stopped in its tracks from outside"),
    "LOOP_BLOCKED": _text("장부 서버가 한곳에서 멈췄고", "the ledger hung in one place"),
    "SPINNING": _text(
        "장부 서버가 끝나지 않는 계산에 빠졌고", "the ledger was caught in an endless calculation"
    ),
    "GIL_HELD": _text("장부 서버가 응답하지 못했고", "one piece of work held up the whole ledger"),
    "DEADLOCK": _text("장부 서버의 작업들이 서로를 기다렸고", "parts of the ledger waited for each other"),
    "TRANSACTION_TIMEOUT": _text(
        "요청 하나가 제시간에 끝나지 않았고", "one command did not finish in its time"
    ),
    "NO_PROGRESS": _text("장부 서버가 요청을 끝내지 못했고", "the ledger finished nothing any more"),
    "DB_LOCKED": _text("다른 프로그램이 장부 파일을 잡고 있었고", "something else held the ledger's store"),
    "STORE_AWAY": _text(
        "장부가 있는 데이터베이스에 연결할 수 없었고", "the ledger's database could not be reached"
    ),
    "DISK_FULL": _text("디스크에 빈 공간이 없었고", "the disk was full"),
    "DISK_READ_ONLY": _text("디스크에 쓸 수 없었고", "the disk could not be written to"),
    "DISK_STALLED": _text("디스크가 응답하지 않았고", "the disk did not answer"),
    "STORE_CORRUPT": _text("장부 확인에서 맞지 않는 부분이 나왔고", "the check of the ledger found a fault"),
    "COMPONENT_STALLED": _text("장부 서버의 한 부분이 멈췄고", "a part of the ledger had stopped"),
    "MEMORY_PRESSURE": _text("장부 서버의 메모리가 거의 찼고", "the ledger was running out of memory"),
    "LEAK": _text("장부 서버의 메모리가 계속 늘었고", "the ledger's memory kept growing"),
    "FD_EXHAUSTION": _text("장부 서버가 열어 둔 파일이 너무 많아졌고", "the ledger had too many files open"),
    "STARVED": _text(
        "컴퓨터가 몹시 바빠 장부 서버의 차례가 오지 않았고", "the machine was too busy to let the ledger run"
    ),
    "SLEPT": _text("컴퓨터가 잠들었다 깨어났고", "the machine had slept and woken up"),
    "GATEWAY_LOST": _text("접속을 맡은 부분이 멈춰서 다시 켰고", "the gateway had died and was started anew"),
    "SPARE_LOST": _text("예비 서버가 멈췄고", "the spare core was lost"),
    "STARTUP_FAILED": _text("장부 서버가 시작하지 못했고", "the ledger could not start"),
    "CRASH_LOOP": _text("장부 서버가 거듭 멈췄고", "the ledger kept failing"),
    "CONFIG_INVALID": _text("설정에 잘못된 부분이 있었고", "the configuration is not usable"),
    "OPERATOR": _text("요청에 따라 장부 서버를 다시 켰고", "the ledger was restarted on purpose"),
    "SENTINEL_LOST": _text(
        "장부를 지키던 감시자가 멈춰서 새 감시자가 이어받았고",
        "the guard of the ledger had died, and another took over",
    ),
    "PLANNED_SWITCH": _text("계획대로 장부 서버를 다시 켰고", "the ledger was restarted as planned"),
    "UNKNOWN": _text("장부 서버에 문제가 생겼고", "something went wrong with the ledger"),
}

#: The whole of the first half where a trial has shown which request it was, by what that does to the core.
CONVICTED: Mapping[str, Text] = {
    "died": _text(
        "요청 하나가 장부 서버를 종료시켜서 따로 보관했어요.", "One request ends the ledger; it is set aside."
    ),
    "hung": _text(
        "요청 하나가 장부 서버를 멈추게 해서 따로 보관했어요.",
        "One request hangs the ledger; it is set aside.",
    ),
    "grew": _text(
        "요청 하나가 메모리를 넘치게 해서 따로 보관했어요.",
        "One request fills the ledger's memory; it is set aside.",
    ),
    "many": _text(
        "요청 {count}개가 장부 서버를 멈추게 해서 따로 보관했어요.",
        "{count} requests bring the ledger down; they are set aside.",
    ),
}

#: Put before the cause, by grade.
GRADE_LEADS: Mapping[str, Text] = {
    "certain": _text("", ""),
    "likely": _text("아마도 ", "most likely "),
    "unknown": _text("확실하지는 않지만 ", "as far as can be told, "),
}
GRADES: Mapping[str, Text] = {
    "certain": _text("확실", "certain"),
    "likely": _text("추정", "likely"),
    "unknown": _text("모름", "unknown"),
}

#: Second half of the summary: what came of it.
OUTCOMES: Mapping[str, Text] = {
    "recovered_in": _text("{after} 만에 다시 응답했어요.", "it answered again after {after}."),
    "recovered": _text("지금은 다시 응답해요.", "it answers again."),
    "went_on": _text("장부는 계속 응답했어요.", "the ledger went on answering all the while."),
    "manual": _text("자동 복구를 멈추고 사람의 확인을 기다려요.", "recovery waits for a person."),
    "served": _text(
        "자동 복구를 멈췄지만 나중에 다시 열렸어요.", "recovery had stopped, and it was open again later."
    ),
    "safe_mode": _text("그동안 읽기 전용으로 열어 뒀어요.", "meanwhile it was open for reading only."),
    "assist": _text("사람의 결정을 기다려요.", "a person is to decide."),
    "open": _text("복구가 아직 끝나지 않았어요.", "the recovery has not ended yet."),
    "untold": _text(
        "복구 중에 감시 프로세스도 종료돼서 결과를 기록하지 못했어요.",
        "the guard itself ended before it could tell how it came out.",
    ),
    "taken_over": _text(
        "복구 중에 감시 프로세스도 종료됐고, 그 뒤에 장부가 다시 응답했어요.",
        "the guard itself ended before it was over; the ledger answered again later.",
    ),
    "taken_over_in": _text(
        "복구 중에 감시 프로세스도 종료됐지만 {after} 만에 다시 응답했어요.",
        "the guard itself ended before it was over; it answered again after {after}.",
    ),
    "left_open": _text(
        "다른 사건을 처리하던 중이었어요. 그동안 기다린 요청은 그 사건에 있어요 ({incident}).",
        "it was in the middle of another incident, which tells what people waited for: {incident}.",
    ),
}

#: What recovery waits for, put behind the second half: only where another try alone changes nothing.
WAITS: Mapping[str, Text] = {
    "CRASH_LOOP": _text(
        "허용된 횟수보다 자주 멈췄어요.", "it failed more often than the restart budget allows."
    ),
    "STORE_CORRUPT": _text(
        "장부가 마지막 서버가 남긴 것과 달라요.", "the ledger is not what the last core left."
    ),
    "CONFIG_INVALID": _text("이 설정으로는 시작할 수 없어요.", "it can't start as it is set up."),
    "STARTUP_FAILED": _text("장부 서버가 시작하지 못해요.", "the ledger can't start."),
    "DB_LOCKED": _text(
        "다른 프로그램이 장부의 잠금을 쥐고 있어요.", "another program holds the ledger's lock."
    ),
    "DISK_FULL": _text("디스크에 빈 공간이 없어요.", "there is no room on the ledger's disk."),
    "DISK_READ_ONLY": _text("디스크에 쓸 수 없어요.", "the ledger's disk can't be written to."),
    "DISK_STALLED": _text("디스크가 응답하지 않아요.", "the ledger's disk does not answer."),
}

#: What a person is to do; `docs/recover.md` says the same at greater length.
NEXT_STEPS: Mapping[str, Text] = {
    "CRASH_LOOP": _text(
        "최근 사건들을 읽어 보고 `hardcore resume`으로 다시 시도해 주세요.",
        "Read the last incidents, then `hardcore resume` tries again.",
    ),
    "STORE_CORRUPT": _text(
        "장부에 쓰지 마세요. `hardcore verify`로 어긋난 곳을 확인하고, 모두 멈춘 상태에서 만든 데이터 폴더 사본으로 되돌려 주세요.",
        "Do not write. `hardcore verify` names the place; go back to a copy of the data folder made while "
        "everything was stopped.",
    ),
    "CONFIG_INVALID": _text(
        "이 사건의 마지막 말에 적힌 설정을 고치고 `hardcore resume`을 실행해 주세요.",
        "Correct the setting that the last words name, then `hardcore resume`.",
    ),
    "DB_LOCKED": _text(
        "잠금을 쥔 프로그램(데이터베이스 뷰어, 백업 등)을 닫고 `hardcore resume`을 실행해 주세요.",
        "Close that program (a database browser, a backup), then `hardcore resume`.",
    ),
    "DISK_FULL": _text(
        "디스크에 공간을 만들고 `hardcore resume`을 실행해 주세요.", "Make room, then `hardcore resume`."
    ),
    "DISK_READ_ONLY": _text(
        "디스크에 다시 쓸 수 있게 하고 `hardcore resume`을 실행해 주세요.",
        "Make the disk writable again, then `hardcore resume`.",
    ),
    "UNKNOWN": _text(
        "아래 증거를 확인하고 `hardcore resume`으로 다시 시도해 주세요.",
        "Read the evidence below, then `hardcore resume` tries again.",
    ),
}
OUTCOME_WORDS: Mapping[str, Text] = {
    "recovered": _text("복구됨", "recovered"),
    "manual": _text("사람 필요", "needs a person"),
    "served": _text("다시 열림", "open again"),
    "safe_mode": _text("한때 읽기 전용", "was read-only"),
    "assist": _text("결정 대기", "to be decided"),
    "open": _text("진행 중", "open"),
    "untold": _text("결과 모름", "not known"),
    "taken_over": _text("이어받음", "taken over"),
}

STEPS: Mapping[str, Text] = {
    "fault": _text("문제 시작", "fault"),
    "detected": _text("발견", "detected"),
    "alerted": _text("요청 대기 시작", "requests held"),
    "frozen": _text("멈춤(증거 보존)", "stopped for evidence"),
    "dumped": _text("증거 수집", "evidence taken"),
    "killed": _text("강제 종료", "killed"),
    "spawned": _text("새 서버 시작", "next core started"),
    "gateway_spawned": _text("새 관문 시작", "next gateway started"),
    "promoted": _text("예비 서버 승격", "spare promoted"),
    "fenced": _text("옛 서버의 쓰기 차단", "old core fenced off"),
    "ready": _text("장부 확인 후 준비 완료", "ledger proven, ready"),
    "serving": _text("첫 응답", "first answer"),
    "verified": _text("잔액과 기록 확인", "balances and records checked"),
    "closed": _text("사건 종료", "closed"),
}

REQUEST_OUTCOMES: Mapping[str, Text] = {
    "answered": _text("응답함", "answered"),
    "replayed": _text("복구 뒤 처리함", "run once after the recovery"),
    "committed": _text(
        "멈추기 전에 이미 기록됐고, 답은 복구 뒤 보냄", "was recorded before; its answer was given after"
    ),
    "done": _text("이미 처리돼 있었음", "was already done"),
    "not_done": _text("처리하지 않음", "not done"),
    "promised": _text("접수해 두고 나중에 처리하기로 함", "kept, to be done later"),
    "unknown": _text("결과를 모름", "outcome unknown"),
    "gone": _text("요청자가 떠남", "the client had left"),
    "refused": _text("거절함", "refused"),
}

MONEY: Mapping[str, Text] = {
    "witness": _text(
        "잃거나 두 번 들어간 기록이 없어요. 마지막으로 확인된 {witness_seq}번 기록까지 그대로 있어요.",
        "No acknowledged record is lost, and none is there twice: everything up to the last one seen, number {witness_seq}, is there unchanged.",
    ),
    "chain": _text(
        "마지막 기록 {tail}건이 서로 맞게 이어져요. 멈추기 전 마지막 기록을 본 증인이 없어서, 잃은 기록이 있는지는 말할 수 없어요.",
        "The last {tail} records form a whole chain. Nobody saw the last record before the outage, "
        "so nothing is said about losses.",
    ),
    "empty": _text(
        "장부가 비어 있었어요. 잃을 기록이 없었어요.", "The ledger was empty: there was nothing to lose."
    ),
    "none": _text("아직 확인하지 않았어요.", "Not verified yet."),
    "no_proof": _text("이 사건에는 확인 기록이 없어요.", "No proof is on record for this incident."),
    "went_on": _text(
        "장부 서버가 멈추지 않아서 이 사건 때문에 새로 확인하지는 않았어요.",
        "The ledger's core went on all the time, so nothing was checked anew because of this.",
    ),
    "whole": _text(
        "그 뒤에 장부 전체를 처음부터 {seq}번 기록까지 다시 확인했어요.",
        "After that the whole ledger was checked, from its first record to number {seq}.",
    ),
    "unsound": _text(
        "장부 전체를 확인했더니 맞지 않는 곳이 있어요. ({fault})",
        "The whole ledger was checked, and it is not whole. ({fault})",
    ),
}

#: Headings and small words of reports and of the terminal.
WORDS: Mapping[str, Text] = {
    "report": _text("사건 보고서", "Incident report"),
    "incident": _text("사건", "Incident"),
    "no_incidents": _text("기록된 사건이 없어요.", "No incident on record."),
    "diagnosis": _text("진단", "Diagnosis"),
    "evidence": _text("증거", "Evidence"),
    "timeline": _text("진행", "Timeline"),
    "findings": _text("원인 분석", "Findings"),
    "in_flight": _text("처리 중이던 요청", "In flight"),
    "nothing_in_flight": _text("처리 중이던 요청이 없어요.", "Nothing was in flight."),
    "requests": _text("기다린 요청의 결과", "What became of the requests"),
    "no_requests": _text(
        "이 사건을 겪은 요청이 기록돼 있지 않아요.", "No request is on record that met this outage."
    ),
    "refusals_untold": _text(
        "장부 서버는 멈추지 않았어요. 그동안 거절된 요청이 있었는지는 기록하지 않아요.",
        "The core went on all the time. Which requests were refused meanwhile is not on record.",
    ),
    "nothing_stopped": _text("없음", "none: nothing stopped serving"),
    "reads_went_on": _text(
        "없음 (읽기는 계속됨, 쓰기는 한동안 거절됨)", "none: reads went on, writes were refused for a time"
    ),
    "last_words": _text("마지막 말", "Last words"),
    "money": _text("돈", "Money"),
    "files": _text("파일", "Files"),
    "missing": _text("없는 증거", "Evidence that is missing"),
    "faults": _text("파일 검사에서 나온 문제", "Faults of the files"),
    "deaths": _text("서버가 멈춘 기록", "Deaths"),
    "signal": _text("신호", "signal"),
    "code": _text("종료 코드", "code"),
    "fingerprint": _text("지문", "Fingerprint"),
    "opened": _text("시작", "Began"),
    "closed": _text("종료", "Closed"),
    "outage": _text("중단 시간", "Outage"),
    "detection": _text("발견까지", "Noticed after"),
    "outcome": _text("결과", "Outcome"),
    "served_again": _text("다시 열린 시각", "Open again at"),
    "account": _text("계좌", "account"),
    "transaction": _text("거래", "transaction"),
    "accounts": _text("계좌", "Accounts"),
    "transactions": _text("거래", "Transactions"),
    "command": _text("요청", "command"),
    "step": _text("단계", "Step"),
    "offset": _text("경과", "After the fault"),
    "time": _text("시각", "Time"),
    "held": _text("대기", "held"),
    "suspect": _text("다시 실행하지 않고 결과만 조회", "looked up, not run again"),
    "blamed": _text("원인으로 지목됨", "named by the evidence"),
    "next_step": _text("할 일", "What to do"),
    "partial": _text("증거를 쓰다가 중단됐어요.", "Its evidence was never written to the end."),
    "none_in_flight": _text("처리 중인 요청 없음", "none in flight"),
    "nothing_recorded": _text("기록 없음", "not recorded"),
}

ERRORS: Mapping[str, Text] = {
    "unknown": _text(
        "{id}: 이런 사건은 없어요. `hardcore incidents`로 목록을 볼 수 있어요.",
        "There is no incident {id}. `hardcore incidents` lists them.",
    ),
    "ambiguous": _text(
        "{id}: 이렇게 시작하는 사건이 {count}건 있어요. 몇 글자 더 적어 주세요: {examples}",
        "{id} begins {count} incidents. Give a few more characters: {examples}",
    ),
    "bad_ending": _text(
        "{name}: .md, .json, .html, .zip 파일로만 내보낼 수 있어요.",
        "{name}: an incident is exported to a file that ends in .md, .json, .html or .zip.",
    ),
    "not_written": _text("{name}: 쓸 수 없어요({reason}).", "{name} could not be written: {reason}."),
}
