"""What is said of dead letters outside of the dashboard: why something can't be done, and the words of `hardcore dlq`.

What a letter is (its reasons, states and ordeals) stands in `catalogue_admin_letters`, for pages and terminal alike. A
Korean particle never stands right after a value.
"""

from collections.abc import Mapping
from typing import Final

from frontend.catalogue_admin_letters import LETTER_TEXTS

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


#: Why an act can't be done, by the code of the refusal, each with the next step where there is one.
REFUSALS: Final[Mapping[str, Text]] = {
    "letter_unknown": _text("이 번호의 요청은 없어요.", "There is no letter of this number."),
    "letter_busy": _text(
        "이 요청은 지금 다시 처리되고 있어요. 두 번 처리하지 않아요.",
        "This request is being retried right now; it is not run twice.",
    ),
    "letter_held": _text("이미 붙잡아 둔 요청이에요.", "It is held already."),
    "letter_resolved": _text("이미 해결된 요청이에요.", "It is resolved already."),
    "letter_discarded": _text("이미 버린 요청이에요.", "It is discarded already."),
    "letter_not_discarded": _text("버린 요청이 아니에요.", "It is not discarded."),
    "letter_without_request": _text(
        "요청의 내용이 남아 있지 않아 실행할 수 없어요. 보낸 사람이 다시 보내야 해요.",
        "Nobody has what was sent, so it can't be run. Whoever sent it has to send it again.",
    ),
    "letter_without_key": _text(
        "중복 방지 키가 없는 요청은 다시 처리하지 않아요. 필요하면 새로 입력해 주세요.",
        "A request without an idempotency key is never run again. Enter it anew if it is still wanted.",
    ),
    "letter_corrected": _text(
        "고친 요청을 이미 보냈어요. 되돌리지 않아요.",
        "Its correction has been booked, so this can't be undone.",
    ),
    "correction_unreadable": _text(
        "고친 내용을 읽을 수 없어요. 원래와 같은 모양의 JSON으로 적어 주세요.",
        "The corrected contents can't be read. Write JSON of the same shape as before.",
    ),
    "correction_masked": _text(
        "가린 값이 들어 있어요. 가린 값을 먼저 보고 고쳐 주세요.",
        "It holds a masked value. Show the values first, then correct it.",
    ),
    "correction_same": _text(
        "바뀐 내용이 없어요. 그대로 다시 처리하려면 '다시 처리'를 써 주세요.",
        "Nothing is different. To run it as it is, retry it.",
    ),
    "dry_run_needed": _text(
        "최근 {minutes}분 안의 시험 실행이 없어요. 먼저 시험 실행을 해 주세요.",
        "There is no dry run of the last {minutes} minutes. Make one first.",
    ),
    "dry_run_failed": _text(
        "시험 실행이 잘 끝나지 않았어요({ordeal}). 그래도 하려면 따로 정해야 해요.",
        "The dry run did not go well ({ordeal}). To run it all the same has to be said.",
    ),
    "ledger_away": _text(
        "장부가 켜져 있지 않아요. hardcore up으로 켠 뒤 다시 해 주세요.",
        "The ledger is not up. Start it with `hardcore up` and try again.",
    ),
    "guard_away": _text(
        "감시자가 응답하지 않아 아무것도 바꾸지 않았어요. hardcore status로 확인해 주세요.",
        "The guard does not answer, so nothing was changed. See `hardcore status`.",
    ),
    "guard_refused": _text("감시자가 받아들이지 않았어요: {why}", "The guard refused: {why}"),
    "outcome_unknown": _text(
        "결과를 아직 알 수 없어요. 장부가 돌아오면 키로 확인해요.",
        "What became of it is not known yet. Its key is looked up once the ledger is back.",
    ),
    "reason_needed": _text("이유를 적어 주세요.", "Please give a reason."),
    "too_late": _text("{seconds}초가 지나 되돌릴 수 없어요.", "It can be undone for {seconds} seconds only."),
    "nothing_matches": LETTER_TEXTS["dlq_no_match"],
    "too_many": _text(
        "한 번에 {max}건까지예요. 더 좁혀 주세요.", "At most {max} at a time. Please narrow it down."
    ),
    "verb_unknown": _text("모르는 일이에요: {verb}", "This is nothing that can be done: {verb}"),
    "bulk_unknown": _text("이 번호의 작업은 없어요.", "There is no such work."),
    "proposal_unknown": _text("이 번호의 제안은 없어요.", "There is no such proposal."),
    "proposal_not_so": _text(
        "이 제안에는 지금 할 수 없는 일이에요.", "This does not fit the proposal as it is now."
    ),
    "proposal_for_a_person": _text(
        "사람이 해야 하는 제안이에요. 하신 뒤에 '끝냄'으로 표시해 주세요.",
        "This is for a person to do. Mark it as done afterwards.",
    ),
    "proposal_for_a_machine": _text(
        "감시자가 지키는 제안이에요. 받아들이거나 거절해 주세요.",
        "The guard enforces this one: accept or decline it.",
    ),
    "group_unknown": _text("이런 묶음은 없어요.", "There is no such group."),
    "group_itself": _text("같은 묶음이에요.", "These are one and the same group."),
    "group_whole": _text("나눌 것이 없는 묶음이에요.", "There is nothing in this group to take apart."),
    "merges_too_many": _text(
        "합친 묶음은 {max}개까지예요. 먼저 하나를 나눠 주세요.",
        "At most {max} groups can be put into others. Take one apart first.",
    ),
    "evidence_absent": _text("증거가 이미 지워졌어요.", "Its evidence is gone already."),
    "evidence_in_use": _text(
        "아직 기록하고 있는 사건이에요. 끝난 뒤에 다시 해 주세요.",
        "This incident is still being written. Try again once it is over.",
    ),
    "not_found": _text("이 주소에는 아무것도 없어요.", "There is nothing at this address."),
    "incident_unknown": _text("이 번호의 사건은 없어요.", "There is no incident of this number."),
    "our_fault": _text(
        "프로그램의 잘못으로 답하지 못했어요. 로그에 적어 뒀어요.",
        "This could not be answered, by a fault of ours. It stands in the log.",
    ),
    "not_readable": _text("보낸 내용을 읽을 수 없어요.", "What was sent can't be read."),
}

#: What `hardcore dlq` prints.
WORDS: Final[Mapping[str, Text]] = {
    "none": _text("따로 보관한 요청이 없어요.", "Nothing set aside."),
    "none_fits": _text("이 조건에 맞는 요청이 없어요.", "No letter fits this."),
    "counted": _text("{total}건 중 {shown}건을 보여요.", "{shown} of {total} are shown."),
    "head_since": _text("언제부터", "Since"),
    "head_what": _text("요청", "Request"),
    "head_accounts": _text("계좌", "Accounts"),
    "head_deaths": _text("서버가 멈춘 수", "Deaths"),
    "reason": _text("까닭", "Reason"),
    "next": _text("다음에 할 일", "What to do next"),
    "source": _text("어디에서", "From"),
    "key": _text("중복 방지 키", "Key"),
    "sums": _text("금액", "Amounts"),
    "fingerprint": _text("지문", "Fingerprint"),
    "incidents": _text("사건", "Incidents"),
    "payload": _text("내용", "Contents"),
    "row": _text("가져오기의 줄", "Row of an import"),
    "event": _text("장부의 기록", "Event of the ledger"),
    "dry_run": _text("마지막 시험 실행", "Last dry run"),
    "dry_run_none": _text("아직 없음: hardcore dlq dry-run {id}", "none yet: hardcore dlq dry-run {id}"),
    "discarded": _text("버린 까닭", "Discarded because"),
    "note": _text("메모", "Note"),
    "history": _text("지금까지의 시도", "What was tried so far"),
    "tried": _text("시험 실행: {ordeal}", "Dry run: {ordeal}"),
    "is_now": _text("번호 {id}: 이제 {state}", "Number {id}: now {state}"),
    "why": _text("까닭: {why}", "Why: {why}"),
    "not_so": _text(
        "처리되지 않았어요. 요청은 보관함에 그대로 있어요.", "It was not done; it stays in the queue."
    ),
    "corrected": _text(
        "고친 요청을 처리했어요. 키: {key}", "The corrected request is booked. Its key: {key}"
    ),
    "corrected_by": _text("고쳐 보낸 요청", "Sent instead"),
    "queued": _text("줄의 맨 뒤에 넣었어요.", "It is at the end of the line."),
    "ask": _text(
        "{verb} · {count}건, 계좌 {accounts}개, 합계 {sums}. 계속할까요?",
        "{verb}: {count} letters, {accounts} accounts, total {sums}. Go on?",
    ),
    "ask_one": _text("{verb} · 번호 {id}. 계속할까요?", "{verb}: number {id}. Go on?"),
    "no_sums": _text("알려진 금액 없음", "no known amount"),
    "capped": _text(
        "한 번에 {max}건까지예요. 오래된 것부터 할게요.", "At most {max} at a time; the oldest are taken."
    ),
    "kept": _text("아무것도 바꾸지 않았어요.", "Nothing was changed."),
    "needs_yes": _text("물어볼 사람이 없어요. --yes를 붙여 주세요.", "There is nobody to ask: add --yes."),
    "progress": _text(
        "{total}건 중 {done}건, 안 된 것 {failed}건", "{done} of {total}, {failed} did not work"
    ),
    "ended_done": LETTER_TEXTS["bulk_ended_done"],
    "ended_cancelled": LETTER_TEXTS["bulk_ended_cancelled"],
    "ended_stopped": _text(
        "장부가 멈춰서 중단했어요. 나머지는 보관함에 그대로 있어요.",
        "The ledger went down, so it stopped; the others are where they were.",
    ),
    "choose": _text(
        "번호를 적거나 --all을 붙여 주세요. --where로 좁힐 수 있어요.",
        "Name a letter, or add --all; --where narrows it down.",
    ),
    "bad_where": _text(
        "--where {given}: state, reason, account 가운데 하나를 이름=값으로 적어 주세요.",
        "--where {given}: say state, reason or account as name=value.",
    ),
    "no_investigator": _text(
        "조사 프로그램을 시작하지 못했어요: {why}", "The investigator could not be started: {why}"
    ),
    "failed_told": _text(
        "안 된 까닭은 요청마다 적혀 있어요: hardcore dlq show 번호",
        "Why stands with each of them: hardcore dlq show NUMBER",
    ),
    "interrupted": _text(
        "조사 프로그램이 도중에 꺼졌어요. 하던 일은 기록돼 있어요. hardcore dlq list로 확인해 주세요.",
        "The investigator went away meanwhile. What it was doing is on disk; see `hardcore dlq list`.",
    ),
    "goes_on": _text(
        "조사 프로그램에 다시 닿지 못했어요. 작업 {id}: 조사 프로그램이 켜지면 저절로 이어져요.",
        "The investigator could not be reached again. Work {id} goes on by itself once it is up.",
    ),
    "dry_refused": LETTER_TEXTS["dry_refused"],
    "next_refused": LETTER_TEXTS["next_refused"],
    "no_data": _text("여기에는 아직 장부가 없어요: {path}", "There is no ledger here yet: {path}"),
}


def refusal(code: str, lang: str, values: Mapping[str, object]) -> str:
    """Say why something can't be done; a code that is not known here is told as it is."""
    found = REFUSALS.get(code)
    return code if found is None else found[lang].format_map(_Shown(values))


def word(code: str, lang: str, **values: object) -> str:
    """Return a text of the terminal."""
    return WORDS[code][lang].format(**values)


def told(kind: str, code: str, lang: str) -> str:
    """Say a `state`, a `reason`, an `ordeal`, an `attempt` or the `next` step of one; unknown ones as they are."""
    other = LETTER_TEXTS.get("next_other") if kind == "next" else None
    found = LETTER_TEXTS.get(f"{kind}_{code.replace(' ', '_')}") or other
    return code if found is None else found[lang]


class _Shown(dict[str, object]):
    """Values of a sentence; one that is missing is told as a question mark instead of an error."""

    def __missing__(self, key: str) -> str:
        return "?"
