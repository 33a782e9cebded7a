"""What a report says of the culprit, of repetition and of prevention, and the fields of a post-mortem, as plain data.

Kept apart from the other texts of reports because they answer another question: not what happened, but what is to be
done so that it does not happen again. Calm words and no blame for people. A Korean particle never stands right after a
value.
"""

from collections.abc import Mapping

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


#: Proposals, by what they say.
PROPOSALS: Mapping[str, Text] = {
    "refuse_the_wish": _text(
        "같은 내용의 요청을 다른 번호로 와도 받지 않기 ({kind}, 보관 번호 {letter})",
        "Refuse the same wish under any key ({kind}, letter {letter})",
    ),
    "limit_the_size": _text(
        "이 종류의 요청 크기 제한: {kind}, {kib} KiB까지",
        "Limit the size of this kind: {kind}, up to {kib} KiB",
    ),
    "limit_the_rate": _text(
        "이 종류의 요청 수 제한: {kind}, 1분에 {count}건까지",
        "Limit how often this kind may come: {kind}, up to {count} a minute",
    ),
    "more_time": _text(
        "느리지만 진행되고 있었어요. 허용 시간 늘리기: {kind}, {seconds}초",
        "It was slow but went on. Give it more time: {kind}, {seconds} s",
    ),
    "less_time": _text(
        "멈춘 뒤 오래 기다렸어요. 허용 시간 줄이기: {kind}, {seconds}초",
        "It hung, and was waited for long. Give it less time: {kind}, {seconds} s",
    ),
    "off_the_lock": _text(
        "장부 파일을 쥔 프로그램 닫기: {name} (프로세스 {pid})",
        "Close the program that held the ledger: {name} (process {pid})",
    ),
    "free_the_disk": _text("장부가 있는 디스크에 빈 공간 만들기", "Make room on the ledger's disk"),
    "make_writable": _text(
        "장부가 있는 디스크를 다시 쓸 수 있게 하기", "Make the ledger's disk writable again"
    ),
    "look_at_the_disk": _text(
        "디스크 점검하기: 쓰기가 제때 끝나지 않았어요",
        "Have the disk looked at: its writes did not end in time",
    ),
    "go_back_to_a_copy": _text(
        "`hardcore verify`로 어긋난 곳을 확인하고 사본으로 되돌리기",
        "Find the place with `hardcore verify` and go back to a copy",
    ),
    "correct_the_setting": _text(
        "마지막 말에 적힌 설정 고치기", "Correct the setting that the last words name"
    ),
    "ease_the_machine": _text("이 컴퓨터의 다른 일 줄이기", "Take other work off this machine"),
    "who_stopped_it": _text(
        "서버를 정지시킨 프로그램 찾기 (디버거, 절전 도구)",
        "Find what stopped the core (a debugger, a power saver)",
    ),
    "who_killed_it": _text(
        "서버를 강제 종료한 프로그램이나 사람 찾기", "Find which program or person killed the core"
    ),
    "find_the_leak": _text(
        "무엇이 메모리를 붙들고 놓지 않는지 찾기: 예비 서버로 바꾼 것은 시간을 번 것뿐이에요",
        "Find what keeps the memory: the change of cores has only bought time",
    ),
    "find_the_open_files": _text(
        "어느 코드가 파일을 열고 닫지 않는지 찾기: 예비 서버로 바꾼 것은 시간을 번 것뿐이에요",
        "Find which code opens files and does not close them: the change of cores has only bought time",
    ),
    "mend_the_code": _text("이 위치의 코드 고치기: {place}", "Mend the code at this place: {place}"),
}

#: Why a command is named.
CULPRITS: Mapping[str, Text] = {
    "reproduced": _text(
        "사본에서 다시 실행했더니 또 일어났어요.", "Run again on a copy of the ledger, it did it again."
    ),
    "blamed": _text("감시자의 판단이 이 요청을 지목했어요.", "The guard's own judgement named it."),
    "in_frame": _text(
        "서버가 멈춘 위치의 기록에 이 거래가 있었어요.",
        "The place where the core stood carried this transaction.",
    ),
    "at_work": _text(
        "종료될 때 이 요청만 처리 단계에 있어서 추정했어요. 사본에서 확인한 원인은 아니에요.",
        "Likely, because it alone was being worked on when the core ended. No trial has proven it.",
    ),
    "near": _text(
        "여러 번 종료 바로 전에 있었어요. 확인된 원인은 아니에요.",
        "It was near several deaths. That alone proves nothing.",
    ),
    "nobody": _text("원인으로 볼 요청이 없어요.", "No command is named as the cause."),
}

#: What changed since the core before.
CHANGES: Mapping[str, Text] = {
    "build": _text("프로그램: {before} → {after}", "Code: {before} → {after}"),
    "policy": _text("정책: {before} → {after}", "Policy: {before} → {after}"),
    "schema": _text("장부 형식: {before} → {after}", "Schema of the ledger: {before} → {after}"),
    "same": _text("바뀐 것이 없어요: {what}", "Not changed: {what}"),
    "unknown": _text("알 수 없어요: {what}", "Not known: {what}"),
}
WHAT: Mapping[str, Text] = {
    "build": _text("프로그램", "code"),
    "policy": _text("정책", "policy"),
    "schema": _text("장부 형식", "schema"),
}

#: What a group of equal deaths is called.
TITLES: Mapping[str, Text] = {
    "in": _text("{what} · 위치: {place}", "{what} in {place}"),
    "with": _text("{what} · {place}", "{what} · {place}"),
    "plain": _text("{what}", "{what}"),
}

#: Headings and small words of reports.
WORDS: Mapping[str, Text] = {
    "culprit": _text("원인 요청", "The command behind it"),
    "repetition": _text("반복", "Repetition"),
    "first_time": _text("이 지문으로는 처음이에요.", "The first one with this fingerprint."),
    "seen_before": _text(
        "같은 지문의 사건이 {count}건 있었어요. 마지막: {last}",
        "The same fingerprint was there {count} times before. The last one: {last}",
    ),
    "changes": _text("앞의 시작 이후 바뀐 것", "What changed since the start before"),
    "proposals": _text("막을 방법", "What would prevent it"),
    "no_proposals": _text("제안할 것이 없어요.", "Nothing to propose."),
    "trials": _text("사본에서의 확인", "Trials on a copy"),
    "stacks": _text("실행 위치", "Stacks"),
    "took": _text("걸린 시간", "Took"),
    "share": _text("비율", "Share"),
    "why_equal": _text("같은 사건으로 보는 기준", "What equal incidents have in common"),
    # The fields of a post-mortem as many teams write them.
    "title": _text("제목", "Title"),
    "date": _text("날짜", "Date"),
    "authors": _text("작성자", "Authors"),
    "authors_value": _text("감시자가 기록에서 자동으로 작성", "written by the guard from its records"),
    "status": _text("상태", "Status"),
    "summary": _text("요약", "Summary"),
    "impact": _text("영향", "Impact"),
    "root_causes": _text("근본 원인", "Root causes"),
    "trigger": _text("계기", "Trigger"),
    "resolution": _text("해결", "Resolution"),
    "detection_head": _text("발견", "Detection"),
    "action_items": _text("조치 항목", "Action items"),
    "lessons": _text("배운 점", "Lessons learned"),
    "went_well": _text("잘된 점", "What went well"),
    "went_wrong": _text("아쉬운 점", "What went wrong"),
    "lucky": _text("운이 좋았던 점", "Where we got lucky"),
    "for_a_person": _text("사람이 적는 곳이에요.", "For a person to write."),
    "supporting": _text("뒷받침 자료", "Supporting information"),
    "owner": _text("담당", "Owner"),
    "nobody_yet": _text("아직 없음", "nobody yet"),
    "well_nothing_lost": _text("잃은 기록이 없어요.", "No acknowledged record was lost."),
    "well_replayed": _text(
        "기다리던 요청을 이어서 처리했어요. 요청 수: {count}",
        "Requests that waited were answered after all. How many: {count}",
    ),
    "well_evidence": _text("증거가 빠짐없이 남았어요.", "The evidence is complete."),
    "wrong_evidence": _text("빠진 증거가 있어요. 파일 수: {count}", "Evidence is missing. Files: {count}"),
    "wrong_requests": _text(
        "처리하지 못했거나 결과를 모르는 요청 수: {count}",
        "Requests that were not done, or whose outcome is unknown: {count}",
    ),
    "wrong_again": _text("전에도 있던 일이에요.", "It had happened before."),
}

#: The redacted archive.
EXPORT: Mapping[str, Text] = {
    "left_out": _text("{name}: 넣지 않음 ({why})", "{name}: left out ({why})"),
    "not_a_report": _text("값이 그대로 들어 있는 원본", "raw contents with values"),
    "image": _text("메모리 사본", "an image of memory"),
    "too_large": _text("너무 큼", "too large"),
    "unreadable": _text("읽을 수 없음", "unreadable"),
    "damaged": _text("목록과 다름", "not what the manifest says"),
    "masked": _text("{name}: 가린 값 {count}개", "{name}: {count} values hidden"),
}
