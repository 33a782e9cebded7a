"""What is said about a bank's file and its rows: one sentence for each reason, in Korean and English.

Plain data, so that a translator can read it and a test can hold it against the closed lists of reasons. A
sentence says what was seen and, where there is one, the next step. None names a value: the row itself, its
line and its cells stand beside the sentence.
"""

from typing import Final

#: Why a file gave no rows: slug -> language -> sentence.
UNREADABLE: Final[dict[str, dict[str, str]]] = {
    "empty": {
        "ko": "파일이 비어 있어요. 은행에서 다시 내려받아 주세요.",
        "en": "The file is empty. Please download it from the bank again.",
    },
    "binary": {
        "ko": "표로 읽을 수 있는 파일이 아니에요. CSV나 엑셀 파일을 골라 주세요.",
        "en": "This is not a file that holds a table. Please choose a CSV or Excel file.",
    },
    "unsupported": {
        "ko": "이 종류의 파일은 읽을 수 없어요. CSV, xlsx, xls 파일을 골라 주세요.",
        "en": "This kind of file cannot be read. Please choose a CSV, xlsx or xls file.",
    },
    "too-large": {
        "ko": "파일이 너무 커요. 기간을 나누어 내려받아 주세요.",
        "en": "The file is too large. Please download a shorter period at a time.",
    },
    "wrong-encoding": {
        "ko": "이 문자 인코딩으로는 글자를 읽을 수 없어요. 다른 인코딩을 골라 주세요.",
        "en": "The letters cannot be read in this encoding. Please choose another one.",
    },
    "unknown-encoding": {
        "ko": "모르는 문자 인코딩이에요. 목록에서 골라 주세요.",
        "en": "This encoding is not known here. Please choose one from the list.",
    },
    "no-table": {
        "ko": "파일에서 표를 찾지 못했어요. 거래 내역이 들어 있는 파일인지 확인해 주세요.",
        "en": "No table was found in the file. Please check that it holds transactions.",
    },
    "locked": {
        "ko": "잠긴 파일이에요. 비밀번호를 입력해 주세요. 은행 파일의 비밀번호는 생년월일 여섯 자리일 때가 많아요. 비밀번호는 저장하지 않아요.",
        "en": "The file is locked. Please enter its password; with Korean banks it is often the six-digit birth date. The password is not stored.",
    },
    "wrong-password": {
        "ko": "비밀번호가 맞지 않아요. 다시 입력해 주세요.",
        "en": "The password is not right. Please enter it again.",
    },
    "zip-bomb": {
        "ko": "풀면 지나치게 커지는 파일이라 열지 않았어요. 은행에서 다시 내려받아 주세요.",
        "en": "The file would unpack to far too much and was not opened. Please download it from the bank again.",
    },
    "too-many-rows": {
        "ko": "한 파일에서 200,000줄까지 읽어요. 기간을 나누어 내려받아 주세요.",
        "en": "Up to 200,000 rows are read from one file. Please download a shorter period at a time.",
    },
    "too-many-columns": {
        "ko": "표의 칸이 너무 많아요. 한 표에서 100칸까지 읽어요.",
        "en": "The table has too many columns. Up to 100 are read.",
    },
    "cell-too-long": {
        "ko": "한 칸이 끝나지 않아요. 닫히지 않은 따옴표가 있는지 확인해 주세요.",
        "en": "A cell does not end. Please check the file for a quotation mark that was never closed.",
    },
    "unreadable": {
        "ko": "파일이 망가져 있어 읽을 수 없어요. 다시 내려받거나, 엑셀에서 열어 xlsx로 저장해 주세요.",
        "en": "The file is damaged and cannot be read. Please download it again, or open it and save it as xlsx.",
    },
    "too-slow": {
        "ko": "읽는 데 너무 오래 걸려서 멈췄어요. 기간을 나누어 내려받아 주세요.",
        "en": "Reading took too long and was stopped. Please download a shorter period at a time.",
    },
    "out-of-memory": {
        "ko": "읽는 데 메모리가 너무 많이 필요해서 멈췄어요. CSV로 저장하거나 기간을 나누어 주세요.",
        "en": "Reading needed too much memory and was stopped. Please save it as CSV or take a shorter period.",
    },
}

#: What a person should know of a table that could be read.
NOTES: Final[dict[str, dict[str, str]]] = {
    "encoding-guessed": {
        "ko": "문자 인코딩은 짐작이에요. 글자가 깨져 보이면 다른 인코딩을 골라 주세요.",
        "en": "The encoding is a guess. If letters look wrong, please choose another one.",
    },
    "no-header": {
        "ko": "제목 줄을 찾지 못했어요. 칸의 이름은 [A], [B]처럼 표시해요.",
        "en": "No header row was found. Columns are called [A], [B] and so on.",
    },
    "exponent": {
        "ko": "긴 숫자가 6.1E+25처럼 줄어든 칸이 있어요. 원래 숫자는 이 파일에 남아 있지 않아요.",
        "en": "Some long numbers were shortened, as in 6.1E+25. This file no longer holds their digits.",
    },
    "format-broken": {
        "ko": "직접 추가한 형식 파일 {file} 하나는 쓰지 못했어요 ({why}). 고친 뒤 다시 올려 주세요. 다른 형식은 그대로 쓸 수 있어요.",
        "en": "Your own format file {file} could not be used ({why}). Put it right and give the file again. All other formats work.",
    },
    "cell-cut": {
        "ko": "너무 긴 칸은 4,000자까지만 읽었어요.",
        "en": "Very long cells were read up to 4,000 characters.",
    },
}

#: Why a row can't be booked as it stands.
REFUSED: Final[dict[str, dict[str, str]]] = {
    "no-date": {"ko": "날짜가 없어요.", "en": "There is no date."},
    "bad-date": {"ko": "날짜로 읽을 수 없어요.", "en": "This cannot be read as a date."},
    "no-such-date": {"ko": "달력에 없는 날짜예요.", "en": "There is no such day."},
    "no-year": {"ko": "날짜에 연도가 없어요.", "en": "The date has no year."},
    "ambiguous-date": {
        "ko": "날짜의 순서를 알 수 없어요. 연월일 순서를 골라 주세요.",
        "en": "The order of day and month is not clear. Please choose it.",
    },
    "no-amount": {"ko": "금액이 없어요.", "en": "There is no amount."},
    "bad-amount": {"ko": "금액으로 읽을 수 없어요.", "en": "This cannot be read as an amount."},
    "exponent-amount": {
        "ko": "금액이 6.1E+25처럼 줄어 있어요. 원래 파일을 확인해 주세요.",
        "en": "The amount was shortened, as in 6.1E+25. Please look into the original file.",
    },
    "too-many-digits": {
        "ko": "이 통화에 없는 소수 자리가 있어요.",
        "en": "The amount has more decimals than its currency.",
    },
    "amount-out-of-range": {
        "ko": "금액이 장부에 담을 수 있는 크기를 넘어요.",
        "en": "The amount is larger than the ledger can hold.",
    },
    "both-sides": {
        "ko": "입금과 출금이 함께 적혀 있어요.",
        "en": "Money in and money out stand in the same row.",
    },
    "sign-conflict": {
        "ko": "금액의 부호와 입출금 구분이 서로 달라요.",
        "en": "The sign of the amount and its direction contradict each other.",
    },
    "unknown-direction": {
        "ko": "입금인지 출금인지 알 수 없어요.",
        "en": "It does not say whether money came in or went out.",
    },
    "unknown-status": {
        "ko": "거래 상태를 알 수 없어요. 끝난 거래인지 확인해 주세요.",
        "en": "The status is not known here. Please check whether it was completed.",
    },
    "no-currency": {
        "ko": "통화를 알 수 없어요. 계정이나 통화를 골라 주세요.",
        "en": "The currency is not known. Please choose an account or a currency.",
    },
    "bad-currency": {"ko": "통화 코드로 읽을 수 없어요.", "en": "This cannot be read as a currency."},
    "too-many-categories": {
        "ko": "분류가 200가지를 넘어요. 분류로 고른 칸이 맞는지 확인해 주세요.",
        "en": "The file has more than 200 categories. Please check the column chosen for them.",
    },
    "bad-fee": {"ko": "수수료를 읽을 수 없어요.", "en": "The fee cannot be read."},
}

#: Why a row is none to be booked.
SKIPPED: Final[dict[str, dict[str, str]]] = {
    "blank": {"ko": "빈 줄이에요.", "en": "A blank row."},
    "header": {"ko": "되풀이된 제목 줄이에요.", "en": "The header again."},
    "footer": {"ko": "합계 줄이에요.", "en": "A total."},
    "note": {"ko": "거래가 아닌 안내 줄이에요.", "en": "A note and no transaction."},
    "pending": {
        "ko": "아직 끝나지 않은 거래예요. 끝난 뒤에 다시 가져와 주세요.",
        "en": "Not completed yet. Please import it again once it is.",
    },
    "reverted": {"ko": "취소된 거래예요.", "en": "It was taken back."},
    "no-movement": {"ko": "금액이 0이에요.", "en": "The amount is nought."},
}

#: What keeps a choice of columns from being used.
MAPPING: Final[dict[str, dict[str, str]]] = {
    "mapping-unknown-column": {
        "ko": "이 파일에 없는 칸이에요.",
        "en": "This file has no such column.",
    },
    "mapping-column-twice": {
        "ko": "한 칸을 두 가지로 골랐어요.",
        "en": "One column was chosen for two things.",
    },
    "mapping-no-date": {"ko": "날짜 칸을 골라 주세요.", "en": "Please choose the column of the date."},
    "mapping-no-amount": {
        "ko": "금액 칸, 또는 입금과 출금 칸을 골라 주세요.",
        "en": "Please choose the column of the amount, or those of money in and money out.",
    },
    "mapping-two-amounts": {
        "ko": "금액 칸과 입출금 칸 가운데 하나만 골라 주세요.",
        "en": "Please choose either the amount, or money in and money out.",
    },
    "ambiguous-date": REFUSED["ambiguous-date"],
    "mapping-bad-currency": {"ko": "통화 코드가 아니에요.", "en": "This is no currency."},
}

#: All of them by slug, for who has a reason in hand and wants its sentence.
REASONS: Final[dict[str, dict[str, str]]] = {**UNREADABLE, **NOTES, **REFUSED, **SKIPPED, **MAPPING}

#: Why a row that was understood is not booked all the same, or an import could not go on.
BOOKING: Final[dict[str, dict[str, str]]] = {
    "other-currency": {
        "ko": "이 줄의 통화는 {given}, 계좌의 통화는 {currency}. 통화가 같은 계좌로 가져와 주세요.",
        "en": "This row is in {given} and the account in {currency}. Please import it into an account of its currency.",
    },
    "internal": {
        "ko": "우리 쪽 실수로 이 줄을 처리하지 못했어요. 직접 적어 주세요.",
        "en": "A mistake of ours kept this row from being booked. Please type it in by hand.",
    },
    "kept-file-lost": {
        "ko": "보관하던 파일을 찾을 수 없어요. 파일을 다시 올려 주세요. 이미 가져온 줄은 건너뛰어요.",
        "en": "The kept file cannot be found. Please upload it again; rows that are booked will be skipped.",
    },
}

#: Why an import that is being booked does not go on at this moment.
WAITING: Final[dict[str, dict[str, str]]] = {
    "trial": {
        "ko": "서버를 멈추게 한 줄이 이 파일에 있는지 확인하고 있어요. 확인이 끝나면 스스로 이어서 해요.",
        "en": "We are checking whether a row of this file stopped the server. The import goes on by itself after that.",
    },
    "source-stopped": {
        "ko": "이 파일의 여러 줄이 서버를 멈추게 해서 잠시 쉬고 있어요. 얼마 뒤에 스스로 이어서 해요.",
        "en": "Several rows of this file stopped the server, so the import rests for a while. It goes on by itself.",
    },
}
