"""Files as banks give them, every row invented: made anew for each test, so that none is ever a real person's."""

import io
from pathlib import Path
from typing import Final

import openpyxl
from msoffcrypto.format.ooxml import OOXMLFile  # type: ignore[import-untyped]  # it has no types

PASSWORD: Final = "900214"

#: An account's list as one bank writes it: cells, thousands separated, the newest line last.
HANA_ROWS: Final = (
    ("2026-06-02 09:00", "이체", "가상인", "7,000", "0", "1,007,000"),
    ("2026-06-03 11:05", "카드결제", "가상마트", "0", "35,000", "972,000"),
    ("2026-06-04 18:20", "카드결제", "똠방각하 분식", "0", "9,500", "962,500"),
)


def hana_csv(folder: Path, rows: int = len(HANA_ROWS), refused: int = 0) -> Path:
    """A list saved as CSV by a Korean spreadsheet: CP949, with a letter that EUC-KR does not have.

    More than the three rows of HANA_ROWS are made up by counting. `refused`: so many rows at the end have a
    date that does not exist.
    """
    lines = [
        "예금주명,,가상인,,,,,,",
        "거래일시,적요,의뢰인/수취인,입금,출금,거래후잔액,구분,거래점,거래특이사항",
        *(
            f'{at},{kind},{who},"{came}","{went}","{left}",체크,가상점,'
            for at, kind, who, came, went, left in HANA_ROWS[:rows]
        ),
    ]
    left = 962_500
    for number in range(rows - len(HANA_ROWS)):
        left -= 100
        day, minute = divmod(number, 1000)
        lines.append(
            f'2026-06-{5 + day:02} {minute // 60 + 1:02}:{minute % 60:02},카드결제,가상가게 {number},0,100,"{left:,}",체크,가상점,'
        )
    lines += [
        f'2026-06-31 10:{number:02},카드결제,없는 날,0,500,"1,000",체크,가상점,' for number in range(refused)
    ]
    path = folder / "거래내역.csv"
    path.write_bytes("\r\n".join([*lines, ""]).encode("cp949"))
    return path


def kakao_xlsx(folder: Path) -> Path:
    """A list as it comes by mail: a locked workbook whose table begins in the second column of row 11."""
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None, "a new workbook has a sheet"
    sheet.title = "카카오뱅크 거래내역"
    sheet["B2"] = "카카오뱅크 거래내역"
    sheet["B7"] = "거래금액의 - 표시는 출금을 뜻해요"
    for column, name in enumerate(
        ["거래일시", "구분", "거래금액", "거래 후 잔액", "거래구분", "내용", "메모"], 2
    ):
        sheet.cell(11, column, name)
    rows = [
        ("2026.05.16 09:00:12", "입금", "500,000", "1,736,700", "일반입금", "가상회사", ""),
        ("2026.05.17 18:23:42", "출금", "-14,700", "1,722,000", "체크카드결제", "가상다방", "모임"),
    ]
    for number, row in enumerate(rows, 12):
        for column, text in enumerate(row, 2):
            sheet.cell(number, column, text)
    plain = io.BytesIO()
    book.save(plain)
    plain.seek(0)
    path = folder / "카카오뱅크_거래내역.xlsx"
    with path.open("wb") as file:
        OOXMLFile(plain).encrypt(PASSWORD, file)
    return path
