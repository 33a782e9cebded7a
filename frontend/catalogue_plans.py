"""What the ledger says of plans when it says no: budgets and what comes back by itself.

Plain data in both languages, held against the closed list of problems by a test.
"""

from typing import Final

#: slug -> language -> (title, detail)
PROBLEMS: Final[dict[str, dict[str, tuple[str, str]]]] = {
    "not-a-category": {
        "ko": (
            "예산을 둘 수 없는 계정이에요",
            "예산은 지출이나 수입 계정에 둘 수 있어요. 다른 계정을 골라 주세요: {account}.",
        ),
        "en": (
            "This account cannot have a budget",
            "A budget belongs to an account of expense or income. Please choose another than {account}.",
        ),
    },
    "recurring-not-found": {
        "ko": ("없는 반복 항목이에요", "주소를 확인하거나 반복 목록에서 골라 주세요."),
        "en": (
            "There is no such recurring item",
            "Please check the address, or choose one from the list of recurring items.",
        ),
    },
    "recurring-ended": {
        "ko": (
            "이미 끝난 반복 항목이에요",
            "끝난 것은 바꿀 수 없어요. 다시 필요하면 새로 만들어 주세요. 적힌 내역은 그대로예요.",
        ),
        "en": (
            "This recurring item has ended",
            "It cannot be changed any more; what it has booked stays. Please make a new one if you need it.",
        ),
    },
}
