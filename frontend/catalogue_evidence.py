"""The words of evidence in Korean: who says it, and the sentences that the witnesses say most often, as plain data.

Facts carry the witnesses' own sentences, in English, because programs compare them. For a Korean reader each
sentence known here is said anew: the left side is the English one with its values in braces, the right side the
Korean one. What is not known here is shown as it is. A Korean particle never stands right after a value.
"""

import re
from collections.abc import Mapping
from functools import cache

#: Who says it.
WITNESSES: Mapping[str, str] = {
    "answers": "응답",
    "beats": "심장 박동",
    "clocks": "시계",
    "collection": "메모리 정리",
    "conduct": "행동",
    "core": "장부 서버",
    "death": "종료",
    "disk": "디스크",
    "guard": "감시자",
    "judge": "판단",
    "last words": "마지막 말",
    "log": "로그",
    "machine": "컴퓨터",
    "memory": "메모리",
    "operator": "사람",
    "page": "상태 기록",
    "pidfd": "운영체제",
    "probe": "상태 확인",
    "process": "프로세스",
    "processor": "프로세서",
    "progress": "진행",
    "proof": "장부 확인",
    "resources": "자원",
    "run folder": "실행 폴더",
    "spawn": "시작",
    "stacks": "실행 위치",
    "sentinel page": "감시자 기록",
    "start": "시작",
    "store": "장부 파일",
    "transactions": "거래",
}

#: How far a command had come.
STAGES: Mapping[str, Mapping[str, str]] = {
    "QUEUED": {"ko": "차례 기다림", "en": "waiting its turn"},
    "DECIDING": {"ko": "처리 중", "en": "at work"},
    "WRITING": {"ko": "기록 중", "en": "being written"},
    "COMMITTED": {"ko": "기록됨", "en": "written"},
    "ANSWERING": {"ko": "응답 중", "en": "being answered"},
}

#: What a command was.
KINDS: Mapping[str, str] = {
    "transaction.post": "거래 기록",
    "entry.record": "내역 기록",
    "entry.replace": "내역 수정",
    "entry.reverse": "내역 취소",
    "account.open": "계좌 만들기",
    "account.close": "계좌 닫기",
    "command.look_up": "결과 조회",
    "import.row": "가져오기",
}

#: What became of a suspect on a copy of the ledger.
ORDEALS: Mapping[str, Mapping[str, str]] = {
    "died": {"ko": "또 종료됨", "en": "it ended the core again"},
    "hung": {"ko": "또 멈춤", "en": "it hung again"},
    "grew": {"ko": "또 메모리를 넘침", "en": "it filled the memory again"},
    "survived": {"ko": "문제 없음", "en": "nothing happened"},
    "committed": {"ko": "이미 기록돼 있음", "en": "was recorded already"},
    "untried": {"ko": "확인하지 못함", "en": "could not be tried"},
}

#: English sentence (or one part of it between semicolons) with its values in braces, and the Korean one.
SENTENCES: tuple[tuple[str, str], ...] = (
    ("the gateway's process ended: {how}", "관문이 종료됨: {how}"),
    ("the guard before stood still, and was ended", "앞의 감시자가 멈춰 있어서 끝냄"),
    ("nobody watched for {ms} ms", "아무도 지켜보지 않은 시간: {ms}ms"),
    ("the core ended by {signal}", "장부 서버가 신호로 종료됨: {signal}"),
    ("the core exited with code {code}", "장부 서버가 종료됨, 종료 코드 {code}"),
    (
        "the core is gone; nobody could read its exit status",
        "장부 서버가 사라졌고 종료 상태를 읽을 수 없었음",
    ),
    ("a TERM had reached it from another process", "다른 프로세스가 종료 신호(TERM)를 보냄"),
    (
        "the kernel's count of kills for memory rose by {count} in this life",
        "메모리 부족으로 운영체제가 종료한 횟수: {count}",
    ),
    ("the core was not ready within {ms} ms", "{ms}ms 안에 준비되지 않음"),
    ("the store is locked by somebody else", "다른 프로그램이 장부 파일을 잠그고 있음"),
    ("the core of a guard that is gone was found", "사라진 감시자의 장부 서버가 발견됨"),
    ("guard and core are gone", "감시자와 장부 서버 모두 사라짐"),
    ("no process could be started: {reason}", "프로세스를 시작할 수 없었음: {reason}"),
    ("no reason was given", "이유를 적지 않음"),
    ("the guard itself ended before this incident was over", "이 사건이 끝나기 전에 감시자도 종료됨"),
    ("it ended in the middle of incident {incident}", "다른 사건을 처리하던 중에 종료됨 ({incident})"),
    ("the core was found to serve reads only: {fault}", "장부 서버가 읽기만 하고 있음: {fault}"),
    ("the loop's last beat is {ms} ms old", "주 작업의 마지막 박동이 {ms}ms 전"),
    ("the thread's last beat is {ms} ms old", "보조 스레드의 마지막 박동이 {ms}ms 전"),
    ("the process is stopped (state T), not by us", "프로세스가 정지됨(상태 T), 감시자가 한 일이 아님"),
    (
        "the loop's thread is asleep on a lock or a timer in {place}, without processor time in two looks",
        "주 스레드가 잠금이나 타이머를 기다리며 잠들어 있음({place}), 두 번 보는 동안 프로세서를 쓰지 않음",
    ),
    (
        "the loop's thread is asleep in a wait in {place}, without processor time in two looks",
        "주 스레드가 기다리며 잠들어 있음({place}), 두 번 보는 동안 프로세서를 쓰지 않음",
    ),
    (
        "no thread of the process had any processor time meanwhile",
        "그동안 어느 스레드도 프로세서를 쓰지 않음",
    ),
    (
        "the loop's thread has computed for {ms} ms without a turn of the loop",
        "주 스레드가 {ms}ms 동안 한 번도 쉬지 않고 계산함",
    ),
    (
        "the loop's thread has burned {ms} ms of processor time in this silence",
        "응답이 없는 동안 주 스레드가 프로세서를 {ms}ms 사용함",
    ),
    (
        "{count} commands wait and none was completed for {ms} ms",
        "요청 {count}건이 기다리고 있고 {ms}ms 동안 끝난 요청이 없음",
    ),
    (
        "{count} probes in a row were not answered, for {ms} ms",
        "상태 확인 {count}번에 잇달아 답이 없음, {ms}ms 동안",
    ),
    (
        "no page to judge by: The recorder page's header was changed.",
        "장부 서버의 상태 기록을 증거로 쓸 수 없음: 머리 부분이 바뀜",
    ),
    (
        "no page to judge by: The recorder page has not the size it was made with, or can't be read.",
        "장부 서버의 상태 기록을 증거로 쓸 수 없음: 크기가 달라졌거나 읽을 수 없음",
    ),
    (
        "no page to judge by: The recorder page holds a life state that nobody writes.",
        "장부 서버의 상태 기록을 증거로 쓸 수 없음: 있을 수 없는 상태 값",
    ),
    (
        "no page to judge by: Its beats are from the future.",
        "장부 서버의 상태 기록을 증거로 쓸 수 없음: 박동 시각이 미래임",
    ),
    (
        "no page to judge by: Its beats were taken back.",
        "장부 서버의 상태 기록을 증거로 쓸 수 없음: 박동 기록이 지워짐",
    ),
    (
        "no page to judge by: {reason}",
        "장부 서버의 상태 기록을 증거로 쓸 수 없음: {reason}",
    ),
    (
        "nobody can look at the core's process: {reason}",
        "장부 서버의 프로세스를 들여다볼 수 없음: {reason}",
    ),
    ("two looks found the loop in the same place: {place}", "두 번 모두 주 작업이 같은 곳에 있었음: {place}"),
    ("the writer's thread sleeps without processor time", "기록 스레드가 프로세서를 쓰지 않고 잠들어 있음"),
    ("the writer's thread is gone", "기록 스레드가 사라짐"),
    (
        "process {pid} ({name}) has held the store's write lock for {ms} ms while the core waits for it",
        "프로세스 {pid}({name}), 장부 파일의 쓰기 잠금을 {ms}ms 동안 쥐고 있고 장부 서버가 기다림",
    ),
    (
        "process {pid} ({name}) has held the store's write lock for {ms} ms",
        "프로세스 {pid}({name}), 장부 파일의 쓰기 잠금을 {ms}ms 동안 쥐고 있음",
    ),
    (
        "the kernel's table of locks: process {pid} ({name}) has the store's write lock",
        "운영체제의 잠금 표: 프로세스 {pid}({name}), 장부 파일의 쓰기 잠금을 쥐고 있음",
    ),
    ("the core says that its store is full", "장부 서버가 알림: 장부 파일을 쓸 공간이 없음"),
    ("the core says that its store takes no writes", "장부 서버가 알림: 장부 파일에 쓸 수 없음"),
    ("the core's store took a write no longer: {fault}", "장부 파일이 더는 쓰기를 받지 않음: {fault}"),
    ("the core could not write for lack of room", "공간이 없어 장부 서버가 쓰지 못함"),
    ("{free} MiB are free, {wanted} MiB are wanted", "빈 공간 {free}MiB, 필요한 공간 {wanted}MiB"),
    ("{free} MiB are free ({fault})", "빈 공간 {free}MiB ({fault})"),
    ("{free} MiB are free", "빈 공간 {free}MiB"),
    ("the data folder's file system takes no writes", "데이터 폴더의 파일 시스템에 쓸 수 없음"),
    ("the file system of the data folder is read-only", "데이터 폴더의 파일 시스템이 읽기 전용임"),
    ("the core may not write its store", "장부 서버가 장부 파일에 쓸 수 없음"),
    ("a small write of ours has taken {ms} ms", "감시자의 작은 쓰기가 {ms}ms 걸림"),
    (
        "a thread of the core waits for a disk, and a small write of ours has taken {ms} ms",
        "장부 서버의 스레드가 디스크를 기다리고, 감시자의 작은 쓰기가 {ms}ms 걸림",
    ),
    ("{kind} {id} has been decided for {ms} ms", "요청 {kind} {id}: {ms}ms 동안 처리 중"),
    ("it may take {ms} ms", "허용 시간 {ms}ms"),
    ("it may take {s} s", "허용 시간 {s}초"),
    ("{kind} {id} in stage DECIDING for {s} s", "요청 {kind} {id}: {s}초 동안 처리 중"),
    (
        "the core holds {mib} MiB of memory; {most} MiB are allowed",
        "장부 서버의 메모리 {mib}MiB, 허용 {most}MiB",
    ),
    ("the ledger is not whole: {fault}", "장부가 온전하지 않음: {fault}"),
    (
        "thread {thread} waits for the lock {lock}, held by thread {holder}",
        "스레드 {thread}: 잠금 {lock} 기다림, 쥔 스레드 {holder}",
    ),
    (
        "thread {thread} sleeps with both locks in its frames",
        "스레드 {thread}: 두 잠금을 모두 쓰는 곳에서 잠들어 있음",
    ),
    ("thread {thread} running in {place}", "스레드 {thread}: 실행 중, 위치 {place}"),
    ("thread {thread} asleep ({wait}) in {place}", "스레드 {thread}: 잠듦({wait}), 위치 {place}"),
    ("thread {thread} asleep in {place}", "스레드 {thread}: 잠듦, 위치 {place}"),
    ("thread {thread} in {place}", "스레드 {thread}, 위치 {place}"),
    ("called from {place}", "부른 곳: {place}"),
    ("it held the interpreter lock", "인터프리터 잠금을 쥐고 있었음"),
    (
        "the first look, at the suspicion, had found it in the same place",
        "처음 의심했을 때도 같은 곳에 있었음",
    ),
    ("the first look, at the suspicion, had found it in {place}", "처음 의심했을 때의 위치: {place}"),
    ("local account_id = {id}", "계좌 {id}"),
    ("local transaction_id = {id}", "거래 {id}"),
    ("exit status: signal {signal}", "종료 상태: 신호 {signal}"),
    ("exit status: code {code}", "종료 상태: 코드 {code}"),
    ("exit status: nobody could read it", "종료 상태: 읽을 수 없음"),
    ("printed by the dying process: {place}", "종료되며 남긴 위치: {place}"),
    ("last words: {words}", "마지막 말: {words}"),
    ("starts that met it: {count}", "그렇게 끝난 시작: {count}번"),
    ("the guard had sent no SIGKILL", "감시자는 강제 종료 신호를 보내지 않음"),
    ("the guard had ordered the drill {drill}", "감시자가 시작한 연습: {drill}"),
    ("reason given: {reason}", "적힌 이유: {reason}"),
    ("commands in flight: {stages}", "처리 중이던 요청: {stages}"),
    (
        "{stopped} of {all} threads were in state T before the evidence was taken",
        "증거를 모으기 전에 스레드 {all}개 중 {stopped}개가 정지 상태(T)",
    ),
    ("the watch's last look: {mib} MiB in memory", "마지막으로 본 메모리 크기: {mib}MiB"),
    ("no holder is on record", "누가 쥐고 있는지 기록되지 않음"),
    (
        "the native frame is not on record: this Python's handler does not print the stack in C",
        "네이티브 위치는 기록되지 않음: 이 파이썬은 C 위치를 남기지 않음",
    ),
    ("native frame: {place}", "네이티브 위치: {place}"),
    (
        "it grew from {first} MiB to {last} MiB in its last {s} s",
        "마지막 {s}초 동안 {first}MiB에서 {last}MiB까지 늘어남",
    ),
    (
        "the recorder's slot: {kind} {id} in stage {stage} (transaction {tx}, accounts {accounts})",
        "상태 기록: 요청 {kind} {id}, 단계 {stage} (거래 {tx}, 계좌 {accounts})",
    ),
    ("the recorder's slot had it in stage {stage}", "상태 기록의 단계: {stage}"),
    ("it is set aside as letter {letter}", "따로 보관함, 번호 {letter}"),
    (
        "tried in a throw-away core: {id} {ordeal} after {ms} ms ({why})",
        "사본에서 실행: {id}, 결과 {ordeal}, {ms}ms ({why})",
    ),
    ("tried in a throw-away core: {id} {ordeal} after {ms} ms", "사본에서 실행: {id}, 결과 {ordeal}, {ms}ms"),
    ("the log's last traceback: {kind} in {place}", "로그의 마지막 오류: {kind}, 위치 {place}"),
    ("{count} ends in this incident", "이 사건에서 종료된 횟수: {count}"),
    (
        "the page: {name} was silent for {s} s and may be for {limit} s",
        "상태 기록: {name}, {s}초 동안 소식 없음, 허용 {limit}초",
    ),
    (
        "{count} of the guard's own looks came late, the longest by {ms} ms",
        "감시자가 늦게 살펴본 횟수 {count}, 가장 늦은 것 {ms}ms",
    ),
    ("our own looks come late again and again", "감시자 자신도 거듭 늦음"),
    (
        "the loop's thread is ready and was not scheduled for {ms} ms",
        "주 스레드가 준비됐지만 {ms}ms 동안 차례가 오지 않음",
    ),
    ("the machine slept for {s} s", "컴퓨터가 {s}초 동안 잠들어 있었음"),
    ("finished right before: {command}", "바로 전에 끝난 요청: {command}"),
    (
        "request {hash} had finished within {s} s before each of the last {count} deaths: likely, not proven",
        "요청 {hash}: 최근 {count}번의 종료 전 {s}초 안에 매번 끝나 있었음, 추정일 뿐 확인되지 않음",
    ),
    (
        "kind {kind} had finished within {s} s before each of the last {count} deaths: likely, not proven",
        "요청 종류 {kind}: 최근 {count}번의 종료 전 {s}초 안에 매번 끝나 있었음, 추정일 뿐 확인되지 않음",
    ),
    ("it took longer than {s} s", "{s}초 안에 끝나지 않음"),
    ("the time of all rules was over", "분석 시간이 끝남"),
    ("it failed: {kind}", "분석 중 오류: {kind}"),
    ("no witness of the disk is on record", "디스크에 대한 증거가 기록되지 않음"),
    # What becomes of a spare, and of a switch.
    ("it ended without a word", "아무 말 없이 종료됨"),
    ("it was not ready within {ms} ms", "{ms}ms 안에 준비되지 않음"),
    ("it has been silent for {ms} ms", "{ms}ms 동안 소식이 없음"),
    ("it is being started", "준비하는 중"),
    ("it is turned off", "꺼 둠"),
    ("less than {mb} MB of memory are free", "빈 메모리가 {mb}MB보다 적음"),
    ("no spare was ready in time", "예비 서버가 제때 준비되지 않음"),
    ("an old core is still there", "앞의 서버가 아직 끝나지 않음"),
    ("An earlier order to drain is being carried out.", "앞서 부탁한 마무리를 아직 하는 중"),
    ("Not drained in time: the writer is not done.", "하던 일을 제때 마치지 못함"),
)

_FIELD = re.compile(r"\\\{(\w+)\\\}")


def in_korean(line: str) -> str:
    """Return a sentence, or its parts between semicolons, in Korean; what is not known here as it is."""
    whole = _korean(line)
    return whole or "; ".join(_korean(part) or part for part in line.split("; "))


def _korean(sentence: str) -> str | None:
    for pattern, korean in _sentences():
        if (match := pattern.fullmatch(sentence)) is not None:
            return korean.format_map({name: _word(name, said) for name, said in match.groupdict().items()})
    return None


def _word(field: str, said: str) -> str:
    """Return what stands in a sentence's field: a code of ours as its word, everything else as it was said."""
    match field:
        case "stage" if said in STAGES:
            return STAGES[said]["ko"]
        case "ordeal" if said in ORDEALS:
            return ORDEALS[said]["ko"]
        case "kind":
            return KINDS.get(said, said)
        case _:
            return said


@cache
def _sentences() -> tuple[tuple[re.Pattern[str], str], ...]:
    return tuple(
        (re.compile(_FIELD.sub(r"(?P<\1>[^;]+?)", re.escape(english))), korean)
        for english, korean in SENTENCES
    )
