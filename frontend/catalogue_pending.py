"""What the ledger says no to around pending transactions, reversals and versions: title and detail, in both languages.

A part of `catalogue_problems`, which holds these texts like all others.
"""

from typing import Final

#: slug -> language -> (title, detail)
PROBLEMS: Final[dict[str, dict[str, tuple[str, str]]]] = {
    "transaction-reversed": {
        "ko": ("이미 취소한 거래예요", "거래는 한 번만 취소할 수 있어요. 필요하면 새로 적어 주세요."),
        "en": (
            "This transaction has been reversed",
            "A transaction is reversed only once. If you need it, write a new one.",
        ),
    },
    "transaction-pending": {
        "ko": (
            "아직 대기 중인 거래예요",
            "아직 장부에 적지 않았으니 취소할 것이 없어요. 대기를 풀려면 void를 보내 주세요.",
        ),
        "en": (
            "This transaction is still pending",
            "Nothing has been booked that could be reversed. To give it up, void it.",
        ),
    },
    "transaction-of-entry": {
        "ko": ("내역에 딸린 거래예요", "내역을 지우면 이 거래도 함께 취소돼요. 내역: {entry}."),
        "en": (
            "This transaction belongs to an entry",
            "Please delete the entry {entry}; its transaction is reversed with it.",
        ),
    },
    "already-a-reversal": {
        "ko": (
            "취소 거래는 다시 취소할 수 없어요",
            "필요하면 새로 적어 주세요. 이 거래가 취소한 거래: {transaction}.",
        ),
        "en": (
            "A reversal is not reversed again",
            "It took back {transaction}. If you need that again, write a new transaction.",
        ),
    },
    "pending-not-found": {
        "ko": ("대기 중인 거래가 없어요", "주소를 확인해 주세요."),
        "en": ("There is no such pending transaction", "Please check the address."),
    },
    "pending-posted": {
        "ko": ("이미 확정한 거래예요", "대기 중인 거래는 한 번만 끝낼 수 있어요. 되돌리려면 취소해 주세요."),
        "en": (
            "This transaction has been posted already",
            "What is pending ends once. To take it back, reverse what was posted.",
        ),
    },
    "pending-voided": {
        "ko": ("이미 무효로 한 거래예요", "묶어 둔 금액은 풀렸어요. 필요하면 새로 적어 주세요."),
        "en": (
            "This pending transaction has been voided",
            "What it held is free again. If you need it, write a new one.",
        ),
    },
    "pending-expired": {
        "ko": ("기한이 지난 거래예요", "묶어 둔 금액은 풀려요. 필요하면 새로 적어 주세요."),
        "en": (
            "This pending transaction has expired",
            "What it held is released. If you need it, write a new one.",
        ),
    },
    "pending-exceeded": {
        "ko": (
            "대기 중인 금액보다 많아요",
            "줄은 대기 중인 거래와 같아야 하고, 금액은 그보다 클 수 없어요. 나머지는 새 거래로 적어 주세요.",
        ),
        "en": (
            "This is more than was pending",
            "The lines must be those of the pending transaction, and no amount larger. Write the rest as a new one.",
        ),
    },
    "not-yet-expired": {
        "ko": ("아직 기한이 남았어요", "기한이 되면 저절로 풀려요. 지금 풀려면 void를 보내 주세요."),
        "en": (
            "This pending transaction has time left",
            "It is released when its time is over. To release it now, void it.",
        ),
    },
    "account-has-pending": {
        "ko": (
            "대기 중인 거래가 있는 계정이에요",
            "먼저 확정하거나 무효로 한 뒤에 닫아 주세요. 계정: {account}.",
        ),
        "en": (
            "Something is still pending on this account",
            "Please post or void it before you close {account}.",
        ),
    },
    "account-changed": {
        "ko": (
            "그사이에 바뀐 계정이에요",
            "지금 내용을 확인하고 다시 해 주세요. 계정: {account}, 지금 버전: {version}.",
        ),
        "en": (
            "This account has been touched meanwhile",
            "Please look at {account} as it stands now, version {version}, and try again.",
        ),
    },
}
