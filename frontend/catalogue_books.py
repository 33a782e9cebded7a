"""The texts of the pages about transactions as the books have them: in full, pending, reversed. Korean and English, plain data.

A part of `catalogue_pages`, which holds these texts like all others.
"""

from collections.abc import Mapping
from typing import Final

TEXTS: Final[Mapping[str, Mapping[str, str]]] = {
    "tx_new": {"ko": "복식으로 적기", "en": "Write it in double entry"},
    "tx_new_lead": {
        "ko": "돈이 어디에서 나와 어디로 들어갔는지 줄마다 적어요. 통화마다 두 쪽의 합이 같아야 해요.",
        "en": "Line by line: where the money went, and where it came from. In each currency both sides add up to the same.",
    },
    "tx_one": {"ko": "거래", "en": "Transaction"},
    "tx_account": {"ko": "계정", "en": "Account"},
    "tx_account_none": {"ko": "비워 둠", "en": "none"},
    "tx_line": {"ko": "{n}번째 줄", "en": "Line {n}"},
    "tx_debit": {"ko": "들어감 (차변)", "en": "In (debit)"},
    "tx_credit": {"ko": "나감 (대변)", "en": "Out (credit)"},
    "tx_more": {"ko": "줄 더 쓰기", "en": "More lines"},
    "tx_state": {"ko": "지금 적을까요", "en": "When"},
    "tx_state_posted": {"ko": "지금 장부에 적기", "en": "Book it now"},
    "tx_state_pending": {"ko": "대기로 두기 (금액만 묶어 둠)", "en": "Keep it pending (the money is held)"},
    "tx_even": {"ko": "두 쪽이 같아요.", "en": "Both sides are equal."},
    "tx_uneven": {"ko": "아직 맞지 않아요. 차이: {off}", "en": "Not even yet. The difference: {off}"},
    "tx_save": {"ko": "적기", "en": "Book it"},
    "tx_saved": {"ko": "장부에 적었어요", "en": "It is in the books"},
    "tx_kept_pending": {"ko": "대기로 두었어요", "en": "It is pending"},
    "tx_sides_both": {
        "ko": "한 줄에는 한쪽 금액만 적어 주세요.",
        "en": "Please write one side only in a line.",
    },
    "tx_state_is_posted": {"ko": "장부에 적음", "en": "booked"},
    "tx_state_is_pending": {"ko": "대기 중", "en": "pending"},
    "tx_state_is_pending-posted": {"ko": "확정함", "en": "booked since"},
    "tx_state_is_voided": {"ko": "무효로 함", "en": "voided"},
    "tx_state_is_expired": {"ko": "기한이 지남", "en": "expired"},
    "tx_state_is_set-aside": {"ko": "따로 둔 기록", "en": "set aside"},
    "tx_reversed_by": {"ko": "이 거래는 취소했어요.", "en": "This transaction was reversed."},
    "tx_reverses": {
        "ko": "이 거래는 다른 거래를 취소한 거예요.",
        "en": "This transaction takes another one back.",
    },
    "tx_posted_by": {"ko": "확정한 거래가 따로 있어요.", "en": "It was booked as another transaction."},
    "tx_from_pending": {
        "ko": "대기 중이던 거래를 확정한 거예요.",
        "en": "It books a transaction that was pending.",
    },
    "tx_of_entry": {"ko": "내역에 딸린 거래예요.", "en": "It belongs to an entry."},
    "tx_see": {"ko": "보기", "en": "See it"},
    "tx_reverse": {"ko": "이 거래 취소하기", "en": "Reverse this transaction"},
    "tx_reverse_truth": {
        "ko": "같은 날짜에 반대 거래를 적어서 되돌려요. 두 거래 모두 기록에 남아요.",
        "en": "The opposite is booked on the same day. Both stay on record.",
    },
    "tx_reverse_do": {"ko": "취소 거래 적기", "en": "Book the reversal"},
    "tx_reversed": {"ko": "취소했어요", "en": "Reversed"},
    "tx_post": {"ko": "확정하기", "en": "Book all of it"},
    "tx_post_truth": {
        "ko": "묶어 둔 금액을 모두 장부에 적어요.",
        "en": "All that is held is booked.",
    },
    "tx_posted": {"ko": "확정했어요", "en": "Booked"},
    "tx_void": {"ko": "무효로 하기", "en": "Give it up"},
    "tx_void_truth": {
        "ko": "장부에 적지 않고, 묶어 둔 금액을 풀어요.",
        "en": "Nothing is booked, and the money is free again.",
    },
    "tx_voided": {
        "ko": "무효로 했어요. 묶어 둔 금액을 풀었어요.",
        "en": "Given up. The money is free again.",
    },
    "tx_until": {"ko": "기한 {at}", "en": "until {at}"},
    "tx_full": {"ko": "차변과 대변 보기", "en": "See both sides"},
    "pending_title": {"ko": "대기 중인 거래", "en": "Pending"},
    "pending_held": {"ko": "대기", "en": "pending"},
    "pending_available": {"ko": "쓸 수 있는 돈", "en": "available"},
}
