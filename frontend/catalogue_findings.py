"""What the rules of the post-mortem have found, Korean and English, as plain data: one sentence for each rule.

A sentence says what its evidence says and no more; what is filled in stands in braces.
"""

from collections.abc import Mapping

from frontend.catalogue_lost import LOST

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


FINDINGS: Mapping[str, Text] = {
    **LOST,
    "drill": _text("연습이었어요: {drill}", "This was a drill: {drill}"),
    "was_in": _text(
        "증거를 모을 때 서버는 여기에 있었어요: {function} ({place})",
        "When the evidence was taken, the core was here: {function} ({place})",
    ),
    "operator": _text("사람이 요청한 일이에요.", "Somebody asked for this."),
    "operator_reason": _text(
        "사람이 요청한 일이에요. 이유: {reason}", "Somebody asked for this. Reason: {reason}"
    ),
    "crashed": _text(
        "서버가 치명적 신호로 종료됐어요: {signal}", "The core ended by a fatal signal: {signal}"
    ),
    "crashed_at": _text(
        "서버가 치명적 신호로 종료됐어요: {signal}, 위치: {place}",
        "The core ended by a fatal signal: {signal}, in {place}",
    ),
    "exited": _text(
        "서버가 요청 없이 종료됐어요. 종료 코드: {code}", "The core left unasked with exit code {code}."
    ),
    "exited_65": _text(
        "장부 확인이 실패해서 시작하지 않았어요.",
        "The check of the ledger failed, so the core did not start.",
    ),
    "exited_69": _text("장부 파일이 계속 잠겨 있었어요.", "The ledger's store stayed locked."),
    "exited_73": _text("디스크에 빈 공간이 없었어요.", "There was no room left on the disk."),
    "exited_74": _text(
        "장부에 기록하는 마지막 단계가 실패해서, 결과를 새 서버에서 다시 확인했어요.",
        "A commit failed; what became of it is looked up by the next core.",
    ),
    "exited_75": _text("더 새로운 서버가 장부를 맡고 있었어요.", "A newer core was in charge of the ledger."),
    "exited_78": _text("설정을 쓸 수 없어요.", "The configuration is unusable."),
    "killed": _text(
        "다른 누군가가 서버를 강제 종료했어요(SIGKILL). 처리 중이던 요청의 탓이 아니에요.",
        "Somebody else killed the core (SIGKILL). No command in flight is to blame.",
    ),
    "frozen": _text(
        "서버의 모든 작업이 밖에서 정지된 상태였어요. 정지된 스레드: {threads}",
        "The core was stopped from outside. Threads that stood still: {threads}",
    ),
    "blocked": _text(
        "서버가 여기서 멈춰 있었어요: {function} ({place})", "The core hung here: {function} ({place})"
    ),
    "gil_held": _text(
        "작업 하나가 서버 전체를 붙잡고 있었어요: {function} ({place}), 스레드: {thread}",
        "One piece of work held up everything else: {function} ({place}), thread {thread}",
    ),
    "deadlock": _text(
        "작업들이 서로가 쥔 잠금을 기다렸어요: {ring}", "These waited for each other's locks: {ring}"
    ),
    "deadlock_likely": _text(
        "두 작업이 같은 잠금들을 두고 서로 기다린 것으로 보여요: {ring}",
        "These two seem to have waited for each other's locks: {ring}",
    ),
    "over_time": _text(
        "요청 하나가 허용된 시간을 넘겼어요: {kind}. 걸린 시간 {seconds}초, 허용 {limit}초",
        "One command took longer than it may: {kind}, {seconds} s of {limit} s",
    ),
    "locked_out_by": _text(
        "다른 프로그램이 장부의 쓰기 잠금을 쥐고 있었어요: {name} (프로세스 {pid})",
        "Another program held the ledger's write lock: {name} (process {pid})",
    ),
    "locked_out": _text(
        "다른 프로그램이 장부의 쓰기 잠금을 쥐고 있었어요. 어느 프로그램인지는 기록되지 않았어요.",
        "Another program held the ledger's write lock; which one is not on record.",
    ),
    "store_away": _text(
        "장부가 있는 데이터베이스 서버에 연결할 수 없었어요. 요청의 탓이 아니에요.",
        "The server of the ledger's database could not be reached. No command is to blame.",
    ),
    "disk_full": _text(
        "장부가 있는 디스크에 빈 공간이 없었어요. 요청의 탓이 아니에요.",
        "There was no room on the ledger's disk. No command is to blame.",
    ),
    "disk_read_only": _text(
        "장부가 있는 디스크에 쓸 수 없었어요. 요청의 탓이 아니에요.",
        "The ledger's disk took no writes. No command is to blame.",
    ),
    "disk_stalled": _text(
        "장부가 있는 디스크가 쓰기를 제때 끝내지 못했어요. 요청의 탓이 아니에요.",
        "The ledger's disk did not finish its writes in time. No command is to blame.",
    ),
    "out_of_memory": _text(
        "메모리가 모자라 운영체제가 서버를 종료했어요. 마지막으로 본 크기: {mib} MiB",
        "The system ended the core because memory had run out. Its size when last seen: {mib} MiB",
    ),
    "out_of_memory_unsized": _text(
        "메모리가 모자라 운영체제가 서버를 종료했어요.",
        "The system ended the core because memory had run out.",
    ),
    "leak": _text(
        "메모리가 {minutes}분 동안 {first} MiB에서 {last} MiB까지 늘었고 줄지 않았어요.",
        "Memory grew from {first} MiB to {last} MiB in {minutes} min and was not given back.",
    ),
    "ran_short": _text("한도에 닿기 전에 알아챘어요.", "It was seen to run out before it did."),
    "grew": _text("그 전에 가장 많이 늘어난 것: {type}", "What had grown most before that: {type}"),
    "spinning": _text(
        "서버가 여기서 끝나지 않고 돌고 있었어요: {function} ({place})",
        "The core went round here without an end: {function} ({place})",
    ),
    "no_progress": _text(
        "살아 있었지만 끝나는 요청이 없었어요. 기다리던 요청: {count}건",
        "It was alive, but no command came to an end. Commands waiting: {count}",
    ),
    "waits_in": _text(
        "거래 하나가 여기서 기다리고 있었어요: {function} ({place})",
        "A transaction waited here: {function} ({place})",
    ),
    "poison_died": _text(
        "이 요청이 서버를 종료시켜요. 사본에서 다시 실행했더니 또 종료됐어요: {kind} {transaction}",
        "This command ends the core. Run again on a copy, it did so again: {kind} {transaction}",
    ),
    "poison_hung": _text(
        "이 요청이 서버를 멈추게 해요. 사본에서 다시 실행했더니 또 멈췄어요: {kind} {transaction}",
        "This command hangs the core. Run again on a copy, it did so again: {kind} {transaction}",
    ),
    "poison_grew": _text(
        "이 요청이 메모리를 넘치게 해요. 사본에서 다시 실행했더니 또 넘쳤어요: {kind} {transaction}",
        "This command fills the core's memory. Run again on a copy, it did so again: {kind} {transaction}",
    ),
    "unproven": _text(
        "여러 번 함께 있었지만 사본에서는 다시 일어나지 않아 사람의 확인을 기다려요: {kind} {transaction}",
        "It was there more than once, but did not do it again on a copy, so it waits for a person: {kind} {transaction}",
    ),
    "untried": _text(
        "사본에서 실행해 보지 못해 따로 보관했고, 사람의 확인을 기다려요: {kind} {transaction}",
        "It could not be tried on a copy, so it is set aside and waits for a person: {kind} {transaction}",
    ),
    "cleared": _text(
        "의심받은 요청을 사본에서 실행했고 문제가 없었어요. 요청 수: {count}",
        "Suspected commands were run on a copy and did no harm. How many: {count}",
    ),
    "at_work": _text(
        "종료될 때 이 요청을 처리하고 있었어요: {kind} {transaction}",
        "The core was at work on this command: {kind} {transaction}",
    ),
    "batch_at_work": _text(
        "종료될 때 여러 요청을 함께 기록하고 있었어요. 요청 수: {count}",
        "The core was writing several commands together: {count}",
    ),
    "near": _text(
        "처리 중인 요청은 없었어요. 바로 전에 끝난 요청 수: {count}",
        "No command was at work. Commands that had finished right before: {count}",
    ),
    "near_often": _text(
        "비슷한 요청이 여러 번 종료 바로 전에 있었어요. 근거 수: {count}",
        "Commands like these had finished right before several deaths. Signs of it: {count}",
    ),
    "uncaught": _text(
        "처리되지 않은 오류로 서버가 종료됐어요: {kind}, 위치: {place}",
        "An error that nobody caught ended the core: {kind}, in {place}",
    ),
    "uncaught_untold": _text(
        "프로그램의 오류로 서버가 종료됐어요. 위치는 기록되지 않았어요.",
        "A mistake in the program ended the core; where it was is not on record.",
    ),
    "config_invalid": _text("설정을 쓸 수 없어요: {said}", "The configuration can't be used: {said}"),
    "startup_failed": _text("서버가 시작하지 못했어요: {said}", "The core could not start: {said}"),
    "crash_loop": _text("서버가 거듭 종료됐어요: {said}", "The core ended again and again: {said}"),
    "component": _text(
        "서버의 한 부분이 멈춰 있었어요: {name}, {seconds}초",
        "A part of the core had stopped: {name}, for {seconds} s",
    ),
    "component_untold": _text(
        "서버의 한 부분이 멈췄어요. 어느 부분인지는 기록되지 않았어요.",
        "A part of the core had stopped; which one is not on record.",
    ),
    "starved": _text(
        "컴퓨터가 너무 바빠서 차례가 오지 않았어요. 요청의 탓이 아니에요.",
        "The machine was too busy to let it run. No command is to blame.",
    ),
    "slept": _text("컴퓨터가 잠들어 있었어요.", "The machine had been asleep."),
    "busy_machine": _text(
        "컴퓨터가 바빴어요. 감시자가 늦게 살펴본 횟수: {count}",
        "The machine was busy. Looks of the guard itself that came late: {count}",
    ),
    "not_asked": _text(
        "이 분석은 끝내지 못했어요. 나머지 내용은 그대로예요: {rule}",
        "This rule could not be asked; all the rest stands: {rule}",
    ),
}
