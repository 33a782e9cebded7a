"""What the dashboard says of dead letters, Korean and English: states, reasons, acts and their dialogs.

A reason has a sentence and a next step, because a code alone helps nobody. No sentence says that no money moved,
unless the page has the fact.
"""

from collections.abc import Mapping
from typing import Final

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


LETTER_TEXTS: Final[Mapping[str, Text]] = {
    "dlq_title": _text("따로 보관한 요청", "Dead letters"),
    "dlq_lead": _text(
        "다시 처리하면 위험할 수 있어 따로 보관한 요청이에요. 먼저 시험 실행으로 확인해 주세요.",
        "Requests set aside because running them again may be dangerous. Begin with a dry run.",
    ),
    "dlq_none": _text("보관한 요청이 없어요", "Nothing set aside"),
    "dlq_none_more": _text(
        "어떤 요청이 장부 서버를 멈추면, 그 요청만 여기로 오고 나머지는 평소처럼 처리돼요.",
        "If a request makes the core stop, that one comes here and everything else goes on as usual.",
    ),
    "dlq_no_match": _text("이 조건에 맞는 요청이 없어요.", "No request fits this filter."),
    "dlq_total": _text("모두 {n}건", "{n} in all"),
    "dlq_oldest": _text("여기서 가장 오래된 것: {at}", "Oldest here: {at}"),
    "dlq_select": _text("{id} 선택", "Select {id}"),
    "dlq_select_page": _text("이 페이지의 모두 선택", "Select all on this page"),
    "dlq_select_all": _text("이 조건에 맞는 {n}건 모두", "All {n} matching this filter"),
    "dlq_selected": _text("선택한 요청으로", "With the selected requests"),
    "dlq_paused": _text(
        "선택한 동안에는 목록이 바뀌지 않아요.", "The list stands still while something is selected."
    ),
    "dlq_deaths": _text("멈춘 횟수", "Deaths"),
    "dlq_state": _text("상태", "State"),
    "dlq_reason": _text("까닭", "Reason"),
    "dlq_command": _text("요청", "Request"),
    "dlq_age": _text("언제부터", "Since"),
    "state_QUARANTINED": _text("보관함", "set aside"),
    "state_HELD": _text("붙잡아 둠", "held"),
    "state_RETRYING": _text("다시 처리 중", "being retried"),
    "state_RESOLVED": _text("해결됨", "resolved"),
    "state_DISCARDED": _text("버림", "discarded"),
    "reason_CRASHED_CORE": _text(
        "이 요청을 처리하면 장부 서버가 죽어요.", "Handling this request makes the core die."
    ),
    "reason_HUNG_CORE": _text(
        "이 요청을 처리하면 장부 서버가 멈춰요.", "Handling this request makes the core hang."
    ),
    "reason_DEADLOCK": _text(
        "이 요청을 처리하면 작업들이 서로를 기다려요.",
        "Handling this request makes parts of the core wait for each other.",
    ),
    "reason_MEMORY_LIMIT": _text(
        "이 요청을 처리하면 메모리가 모자라요.", "Handling this request takes more memory than there is."
    ),
    "reason_INVALID_FOR_STATE": _text(
        "지금 장부에서는 받아들일 수 없는 요청이에요.", "The ledger can't accept this as it is now."
    ),
    "reason_SCHEMA_UNKNOWN": _text(
        "이 버전이 모르는 모양의 요청이에요.", "This version does not know this kind of request."
    ),
    "reason_DUPLICATE_KEY_OTHER_PAYLOAD": _text(
        "같은 키로 다른 내용의 요청이 있었어요.", "Another request with other contents had the same key."
    ),
    "reason_EXPIRED_WAITING": _text(
        "너무 오래 기다려서 저절로 처리하지 않았어요.", "It waited too long to be run by itself."
    ),
    "reason_ACCOUNT_QUARANTINED": _text(
        "이 요청이 쓰는 계좌가 잠시 멈춰 있어요.", "An account it needs is set aside."
    ),
    "reason_OPERATOR_HOLD": _text("사람이 붙잡아 뒀어요.", "A person holds it back."),
    "reason_UNPROVEN": _text(
        "두 번 함께 멈췄지만, 이 요청 때문이라고 확인되지는 않았어요.",
        "It was there at two deaths, but nothing proves that it caused them.",
    ),
    "next_CRASHED_CORE": _text(
        "시험 실행으로 새 버전에서 괜찮은지 보고, 괜찮으면 다시 처리해 주세요.",
        "A dry run shows whether this version survives it; if it does, retry.",
    ),
    "next_HUNG_CORE": _text(
        "시험 실행으로 끝나는지 보고, 끝나면 다시 처리해 주세요.",
        "A dry run shows whether it comes to an end; if it does, retry.",
    ),
    "next_INVALID_FOR_STATE": _text(
        "장부를 먼저 고치거나, 까닭을 적고 버려 주세요.",
        "Mend the ledger first, or discard it with a reason.",
    ),
    "next_UNPROVEN": _text(
        "시험 실행에서 아무 일이 없으면 다시 처리해도 돼요.", "If a dry run shows nothing, it may be retried."
    ),
    "next_other": _text("먼저 시험 실행을 해 보고 결정해 주세요.", "Make a dry run first, then decide."),
    # One letter
    "letter_title": _text("보관한 요청", "Dead letter"),
    "letter_number": _text("번호 {id}", "Number {id}"),
    "letter_since": _text("{at}부터 보관", "Set aside since {at}"),
    "letter_facts": _text("요청에 대해", "About the request"),
    "letter_source": _text("어디에서", "From"),
    "letter_key": _text("중복 방지 키", "Idempotency key"),
    "letter_key_none": _text("키가 없어서 다시 처리하지 않아요.", "It has no key, so it is never run again."),
    "letter_fingerprint": _text("지문", "Fingerprint"),
    "letter_sums": _text("금액", "Amounts"),
    "letter_payload": _text("내용", "Contents"),
    "letter_payload_none": _text("내용을 가진 곳이 없어요.", "Nobody has its contents."),
    "letter_payload_get": _text(
        "전체 내용 내려받기(기록에 남아요)", "Download all of it (this is written down)"
    ),
    "letter_masked": _text("비밀로 보이는 값은 가려져 있어요.", "What looks like a secret is masked."),
    "letter_row_told": _text(
        "가져온 파일의 한 줄이에요. 다시 처리하는 대신 그 줄을 다시 가져올 수도 있어요.",
        "One row of an imported file. Instead of a retry the row can be imported again.",
    ),
    "letter_attempts": _text("지금까지의 시도", "What was tried so far"),
    "letter_attempts_none": _text("아직 시도가 없어요.", "Nothing was tried yet."),
    "letter_dry": _text("마지막 시험 실행", "The last dry run"),
    "letter_dry_none": _text(
        "아직 시험해 보지 않았어요. 장부의 사본에서 실행하므로 아무것도 바뀌지 않아요.",
        "Not tried yet. A dry run works on a copy of the ledger and changes nothing.",
    ),
    "letter_dry_context": _text(
        "시험 실행의 날짜와 순서는 처음 보냈을 때와 다를 수 있어요.",
        "A dry run has today's date and order, which may differ from when it was sent.",
    ),
    "ordeal_survived": _text("아무 일 없이 끝났어요.", "It came to its end without harm."),
    "ordeal_died": _text("시험 서버가 죽었어요.", "The throw-away core died."),
    "ordeal_hung": _text("시험 서버가 멈췄어요.", "The throw-away core hung."),
    "ordeal_grew": _text("메모리 한도를 넘었어요.", "It grew past the memory limit."),
    "ordeal_committed": _text("이미 장부에 있어요.", "It is in the ledger already."),
    "ordeal_untried": _text("시험하지 못했어요.", "It could not be tried."),
    "ordeal_refused": _text("장부가 받아들이지 않았어요.", "The ledger refused it."),
    "ordeal_not_run": _text("실행하지 않았어요.", "It was not run."),
    "ordeal_not_done": _text("처리되지 않았어요.", "It was not done."),
    "ordeal_already_done": _text("이미 처리돼 있었어요.", "It had been done already."),
    "ordeal_set_aside_again": _text("다시 따로 보관했어요.", "It was set aside again."),
    "ordeal_released": _text("다시 가져올 수 있게 풀어 줬어요.", "It was let go, to be imported again."),
    "ordeal_done": _text("처리됐어요.", "It was done."),
    "dry_refused": _text(
        "서버는 멈추지 않았지만 장부가 받아들이지 않았어요. 응답: {status}",
        "It did no harm, but the ledger would refuse it: {status}.",
    ),
    "next_refused": _text(
        "다시 처리해도 거절돼요. 고쳐서 새로 보내거나, 까닭을 적고 버려 주세요.",
        "A retry would be refused as well. Correct it and send it anew, or discard it with a reason.",
    ),
    "dry_status": _text("응답 {status}, {took}", "Answer {status}, {took}"),
    "letter_incidents": _text("관련된 사건", "Incidents"),
    "letter_note": _text("메모", "Note"),
    "letter_note_save": _text("메모 남기기", "Save the note"),
    "letter_discarded": _text("버린 까닭: {reason}", "Discarded because: {reason}"),
    "attempt_death": _text("멈춤", "death"),
    "attempt_trial": _text("시험", "trial"),
    "attempt_dry-run": _text("시험 실행", "dry run"),
    "attempt_retry": _text("다시 처리", "retry"),
    "attempt_correction": _text("고쳐서 보내기", "correction"),
    # Acts
    "do_dry-run": _text("시험 실행", "Dry run"),
    "do_retry": _text("다시 처리", "Retry"),
    "do_requeue": _text("맨 뒤에서 다시", "Requeue at the end"),
    "do_hold": _text("붙잡아 두기", "Hold"),
    "do_discard": _text("버리기", "Discard"),
    "do_correct": _text("고쳐서 보내기", "Send the corrected one"),
    "correct_open": _text("내용을 고쳐서 새로 보내기", "Correct it and send it anew"),
    "correct_title": _text("고친 요청을 보낼까요?", "Send the corrected request?"),
    "correct_told": _text(
        "새 키로 한 번 보내는 새 요청이에요. 이 요청은 버린 것으로 표시하고 서로 이어 둬요.",
        "It is a new request, sent once under a new key. This one is marked as discarded, with a link between them.",
    ),
    "letter_corrected": _text(
        "고쳐서 새로 보낸 요청의 키: {key}", "Corrected and sent anew under the key {key}"
    ),
    "said_correct": _text("고친 요청을 보냈어요.", "The corrected request was sent."),
    "do_undo": _text("되돌리기", "Undo"),
    "keep": _text("그대로 두기", "Keep"),
    "discard_title": _text("이 요청을 버릴까요?", "Discard this request?"),
    "discard_told": _text("금액은 움직이지 않아요. 기록에는 남아요.", "No money moves. It stays on record."),
    "discard_reason": _text("이유를 적어 주세요.", "Please give a reason."),
    "discard_needs": _text("이유가 비어 있어요.", "The reason is empty."),
    "retry_title": _text("이 요청을 다시 처리할까요?", "Retry this request?"),
    "retry_told": _text(
        "원래 키로 한 번만 보내요. 이미 처리됐다면 두 번 처리되지 않아요.",
        "It is sent once under its own key; if it was done already, it is not done twice.",
    ),
    "retry_fresh": _text(
        "10분 안의 시험 실행에서 아무 일이 없었어요.", "A dry run within the last 10 minutes went well."
    ),
    "retry_stale": _text(
        "10분 안에 잘 끝난 시험 실행이 없어요. 그래도 하면 장부 서버가 한 번 더 멈출 수 있어요.",
        "There is no good dry run of the last 10 minutes. If it is retried anyway, the core may die once more.",
    ),
    "retry_anyway": _text("그래도 다시 처리하기", "Retry anyway"),
    "requeue_title": _text("맨 뒤에서 다시 처리할까요?", "Requeue this request?"),
    "bulk_dry-run": _text("{n}건을 시험 실행할까요?", "Dry run {n} requests?"),
    "bulk_dry-run_one": _text("1건을 시험 실행할까요?", "Dry run 1 request?"),
    "bulk_retry": _text("{n}건을 다시 처리할까요?", "Retry {n} requests?"),
    "bulk_retry_one": _text("1건을 다시 처리할까요?", "Retry 1 request?"),
    "bulk_requeue": _text("{n}건을 맨 뒤에서 다시 처리할까요?", "Requeue {n} requests?"),
    "bulk_requeue_one": _text("1건을 맨 뒤에서 다시 처리할까요?", "Requeue 1 request?"),
    "bulk_hold": _text("{n}건을 붙잡아 둘까요?", "Hold {n} requests?"),
    "bulk_hold_one": _text("1건을 붙잡아 둘까요?", "Hold 1 request?"),
    "bulk_discard": _text("{n}건을 버릴까요?", "Discard {n} requests?"),
    "bulk_discard_one": _text("1건을 버릴까요?", "Discard 1 request?"),
    "bulk_sums": _text("계좌 {k}개, 합계 {sum}.", "{k} accounts, total {sum}."),
    "bulk_no_sums": _text("계좌 {k}개, 알려진 금액 없음.", "{k} accounts, no known amount."),
    "bulk_pace": _text(
        "하나씩 처리하고, 서버가 한 번이라도 멈추면 바로 중단해요.",
        "One at a time; stops at once if the server goes down.",
    ),
    "bulk_capped": _text(
        "한 번에 할 수 있는 최대: {cap}건. 더 좁혀 주세요.",
        "At most {cap} at a time. Please narrow the filter.",
    ),
    "refused_bulk_nothing": _text("먼저 요청을 골라 주세요.", "Please select requests first."),
    "bulk_title": _text("여러 요청을 한꺼번에", "Many at once"),
    "bulk_progress": _text("{total}건 중 {done}건 끝남", "{done} of {total} finished"),
    "bulk_failed": _text("안 된 것 {n}건", "{n} did not work"),
    "bulk_current": _text("지금: {id}", "Now: {id}"),
    "bulk_cancel": _text("여기까지만 하기", "Stop here"),
    "bulk_cancel_more": _text(
        "지금 하던 것은 끝내고, 나머지는 보관함에 그대로 있어요.",
        "The one under way is finished; all others stay where they are.",
    ),
    "bulk_ended_done": _text("모두 끝났어요.", "All are finished."),
    "bulk_ended_cancelled": _text(
        "중간에 멈췄어요. 나머지는 보관함에 그대로 있어요.",
        "Stopped half-way; the others are where they were.",
    ),
    "bulk_ended_stopped": _text(
        "서버가 멈춰서 중단했어요. 나머지는 보관함에 그대로 있어요.",
        "The server went down, so it stopped; the others are where they were.",
    ),
    "said_dry-run": _text("시험 실행을 마쳤어요.", "The dry run is over."),
    "said_retry": _text("다시 처리했어요. 결과는 아래에 있어요.", "Retried; the outcome stands below."),
    "said_requeue": _text("맨 뒤에서 다시 처리해요.", "Requeued at the end."),
    "said_hold": _text("붙잡아 뒀어요.", "It is held."),
    "said_discard": _text(
        "버렸어요. 30초 안에 되돌릴 수 있어요.", "Discarded. It can be undone for 30 seconds."
    ),
    "said_undo": _text("되돌렸어요.", "Undone."),
    "said_note": _text("메모를 남겼어요.", "The note is saved."),
}
