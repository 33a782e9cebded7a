"""Which words in a header usually mean what: the guess for a file that no format knows.

Data in Korean, English, and the little German and Japanese that travels. For each role the words stand in
the order in which they are preferred; a column plays one role. Brackets at the end of a name (`출금(원)`) are
dropped for the guess alone. It is only ever a proposal: a person sees the mapping before a row is booked.
"""

import re
from collections.abc import Sequence
from types import MappingProxyType
from typing import Final

from core.imports.reading.names import canonical

WORDS: Final = MappingProxyType(
    {
        "date": (
            "거래일시 거래일자 거래일 거래날짜 이용일시 이용일자 이용일 승인일시 승인일자 승인일 일시 일자 날짜 기간 "
            "transactiondate date bookingdate completeddate postingdate posteddate postdate starteddate datetime "
            "createdon buchungstag buchungsdatum buchung datum valutadatum 取引日 お取引日 利用日 日付 年月日"
        ),
        "time": "거래시간 거래시각 이용시간 승인시각 시각 시간 time",
        "in": (
            "입금액 입금금액 입금 맡기신금액 받으신금액 수입금액 수입 deposit deposits credit creditamount moneyin "
            "paidin inflow お預入れ 預かり金額 預入金額"
        ),
        "out": (
            "출금액 출금금액 출금 찾으신금액 지급액 지급 지출금액 지출 withdrawal withdrawals debit debitamount "
            "moneyout paidout outflow お引出し 支払い金額 引出金額"
        ),
        "amount": (
            "거래금액 금액 이용금액 국내이용금액 승인금액 매출금액 결제금액 amount transactionamount net gross "
            "betrag umsatz 入出金 利用金額 金額"
        ),
        "balance": (
            "거래후잔액 잔액 남은금액 balance runningbalance runningbal. runningbal accountbalance saldo 差引残高 "
            "取引後残高 残高"
        ),
        "description": (
            "보낸분/받는분 의뢰인/수취인 가맹점명 가맹점 이용가맹점 이용가맹점명 이용하신곳 사용처 거래기록사항 기재내용 "
            "내용 거래내용 내역 적요 payee merchant name partnername description narrative details "
            "beguenstigter/zahlungspflichtiger auftraggeber/empfänger verwendungszweck 摘要内容 お取り扱い内容 "
            "入出金先内容 入出金内容 利用店名・商品名 摘要"
        ),
        "detail": "적요 거래유형 거래구분 거래종류 type transactiontype buchungstext 摘要",
        "memo": "메모 거래메모 이체메모 송금메모 비고 memo note notes notiz メモ",
        "category": "카테고리 분류 대분류 category kategorie",
        "payment_method": "결제수단 이용카드 카드명 이용카드명 자산 paymentmethod account",
        "currency": "통화 화폐 거래통화 currency währung waehrung",
        "fee": "fee fees",
        "status": "취소여부 취소상태 상태 status state",
        "direction": "입출금구분 입출구분 수입/지출 입/출금 입출금 구분 direction debit/credit dr/cr afbij",
    }
)
#: Amount columns of card lists, in which a positive number is money spent.
SPENDING: Final = frozenset(["이용금액", "국내이용금액", "승인금액", "매출금액", "결제금액", "利用金額"])
#: Columns that number the rows of one export and mean nothing in the next.
NUMBERING: Final = frozenset(["no", "no.", "순번", "번호", "연번", "#", "nr", "nr.", "番号"])

DIRECTION_IN: Final = frozenset(["입금", "수입", "입", "credit", "cr", "in", "deposit", "bij", "c", "+"])
DIRECTION_OUT: Final = frozenset(["출금", "지출", "출", "debit", "dr", "out", "withdrawal", "af", "d", "-"])
STATUS_BOOKED: Final = frozenset(
    [
        "",
        "-",
        "n",
        *[
            "정상",
            "승인",
            "완료",
            "결제확정",
            "매입",
            "completed",
            "complete",
            "posted",
            "cleared",
            "booked",
            "settled",
            "gebucht",
        ],
    ]
)
STATUS_PENDING: Final = frozenset(
    ["대기", "승인대기", "처리중", "pending", "authorised", "authorized", "vorgemerkt"]
)
STATUS_REVERTED: Final = frozenset(
    [
        "취소",
        "승인취소",
        "전체취소",
        "거절",
        "y",
        "reverted",
        "failed",
        "declined",
        "cancelled",
        "canceled",
        "refused",
    ]
)

_BRACKETS: Final = re.compile(r"\([^()]*\)$")
_RANKS: Final = MappingProxyType(
    {role: {word: rank for rank, word in enumerate(words.split())} for role, words in WORDS.items()}
)


def roles_in(header: Sequence[str]) -> dict[str, int]:
    """The role each header cell may play: role -> index of the best column for it, no column twice."""
    names = [_BRACKETS.sub("", canonical(cell)) or canonical(cell) for cell in header]
    found: dict[str, int] = {}
    for role, ranks in _RANKS.items():
        fitting = [(ranks[name], index) for index, name in enumerate(names) if name in ranks]
        free = [pair for pair in sorted(fitting) if pair[1] not in found.values()]
        if free:
            found[role] = free[0][1]
    return found
