"""The texts of quick entry: moving money between one's own accounts, taking back what was just saved, and the keys.

A part of `catalogue_pages`, which holds these texts like all others.
"""

from collections.abc import Mapping
from typing import Final

TEXTS: Final[Mapping[str, Mapping[str, str]]] = {
    "entry_move": {"ko": "옮기기", "en": "Moved"},
    "entry_to": {"ko": "받는 계좌", "en": "To"},
    "fault_to_exists": {
        "ko": "보내는 계좌와 다른 계좌를 골라 주세요.",
        "en": "Please choose an account other than the first one.",
    },
    "fault_to_missing": {"ko": "받는 계좌를 골라 주세요.", "en": "Please choose where it goes."},
    "accounts_first": {
        "ko": "먼저 계좌를 하나 만들어 주세요. 되풀이하는 내역은 그 계좌에 적어요.",
        "en": "Add an account first. What comes back by itself is booked on it.",
    },
    "so_far": {"ko": "지금까지 모두", "en": "in all, so far"},
    "undo": {"ko": "되돌리기", "en": "Undo"},
    "undoing": {"ko": "되돌리고 있어요", "en": "Undoing"},
    "undone": {"ko": "되돌렸어요. 기록에는 남아요.", "en": "Undone. It stays on record."},
    "keys_title": {"ko": "단축키", "en": "Keyboard shortcuts"},
    "keys_close": {"ko": "닫기", "en": "Close"},
    "keys_new": {"ko": "내역 적기", "en": "New entry"},
    "keys_find": {"ko": "내역 찾기", "en": "Search the entries"},
    "keys_ways": {"ko": "메뉴로 가기", "en": "Go to a page"},
    "keys_undo": {"ko": "방금 저장한 내역 되돌리기", "en": "Undo what was just saved"},
    "keys_help": {"ko": "이 목록 보기", "en": "Show this list"},
    "keys_on": {"ko": "단축키 쓰기", "en": "Use these keys"},
    "keys_more": {
        "ko": "글을 쓰고 있을 때는 듣지 않아요. 이 브라우저에만 기억해요.",
        "en": "They rest while you type. This choice is kept in this browser.",
    },
}
