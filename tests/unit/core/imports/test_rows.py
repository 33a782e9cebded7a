import msgspec
import pytest

from core.imports.looking import results as read_by
from core.imports.reading import rows as room
from core.imports.reading.balance import BalanceVerdict
from core.imports.reading.candidates import Candidate, Refusal, RefusedRow, Skip, SkippedRow
from core.imports.reading.fingerprints import fingerprint
from core.imports.reading.formats import builtin_formats
from core.imports.reading.mapping import (
    DateOrder,
    Decimal,
    FaultKind,
    Mapping,
    MappingFault,
    Positive,
    faults_of,
)
from core.imports.reading.names import unique_names
from core.imports.reading.proposal import NO_FORMAT, guessed_anew, propose
from core.imports.records import Manifest
from core.imports.states import State
from core.ledger import fields
from tests.unit.core.imports.files import CHASE, balance_of, results, table, workbook


def candidates(data: str | bytes, currency: str | None = "KRW", **changes: object) -> list[Candidate]:
    return [result for result in results(data, currency, **changes) if isinstance(result, Candidate)]


def refusals(data: str, currency: str | None = "KRW", **changes: object) -> list[Refusal]:
    return [result.reason for result in results(data, currency, **changes) if isinstance(result, RefusedRow)]


def skips(data: str) -> list[Skip]:
    return [result.reason for result in results(data, "KRW") if isinstance(result, SkippedRow)]


def test_every_row_is_a_candidate_a_refusal_or_a_skip() -> None:
    data = "날짜,내용,금액\n2026-01-02,가상,-100\n2026-02-30,가상,-1\n합계,,-101\n,,\n"
    assert [type(result) for result in results(data, "KRW")] == [Candidate, RefusedRow, SkippedRow]


def test_a_bad_row_costs_that_row_and_tells_its_line_and_column() -> None:
    data = "제목\n\n날짜,내용,금액\n2026-01-02,가상,-100\n2026-01-03,가상,많이\n2026-01-04,가상,-300\n"
    good, bad, also_good = results(data, "KRW")
    assert isinstance(good, Candidate)
    assert isinstance(also_good, Candidate)
    assert bad == RefusedRow(5, ("2026-01-03", "가상", "많이"), Refusal.BAD_AMOUNT, "금액")


def test_minus_means_spent_also_where_a_card_writes_it_positive() -> None:
    assert [c.amount for c in candidates("날짜,내용,금액\n2026-01-02,가상,-100\n")] == ["-100"]
    assert [c.amount for c in candidates("이용일,가맹점명,이용금액\n2026-01-02,가상,100\n")] == ["-100"]
    assert [c.amount for c in candidates("날짜,내용,금액\n2026-01-02,가상,100\n", positive=Positive.OUT)] == [
        "-100"
    ]


def test_money_in_two_columns_is_one_amount() -> None:
    data = "거래일자,내용,출금액,입금액\n2026-01-02,가상,100,0\n2026-01-03,가상,,50\n2026-01-04,가상,-30,\n"
    assert [c.amount for c in candidates(data)] == ["-100", "50", "30"]


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("2026-01-02,가상,100,50", Refusal.BOTH_SIDES),
        ("2026-01-02,가상,,", Refusal.NO_AMOUNT),
        ("2026-01-02,가상,백원,", Refusal.BAD_AMOUNT),
        ("2026-02-31,가상,100,", Refusal.NO_SUCH_DATE),
        (",가상,100,", Refusal.NO_DATE),
        ("내일,가상,100,", Refusal.BAD_DATE),
        ("2026-01-02,가상,12.5,", Refusal.TOO_MANY_DIGITS),
    ],
)
def test_what_cannot_be_booked_is_refused_with_its_reason(row: str, reason: Refusal) -> None:
    assert refusals(f"거래일자,내용,출금액,입금액\n2026-01-01,가상,1,\n{row}\n") == [reason]


def test_a_word_gives_the_direction_of_an_unsigned_amount_and_an_unknown_word_stops_the_row() -> None:
    data = "날짜,내용,금액,구분\n2026-01-02,가상,100,출금\n2026-01-03,가상,100,입금\n"
    assert [c.amount for c in candidates(data)] == ["-100", "100"]
    assert refusals(data + "2026-01-04,가상,100,이체\n", direction="구분") == [Refusal.UNKNOWN_DIRECTION]
    assert refusals(data + "2026-01-04,가상,-100,입금\n") == [Refusal.SIGN_CONFLICT]


def test_a_column_whose_words_are_no_directions_is_not_taken_for_one() -> None:
    held = table("날짜,내용,금액,구분\n2026-01-02,가상,100,일시불\n")
    assert propose(held, builtin_formats()).mapping.direction is None


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        ("합계,,,100", Skip.FOOTER),
        (",총 3건,,100", Skip.FOOTER),
        ("날짜,내용,금액,잔액", Skip.HEADER),
        ("※ 이 내역은 증빙으로 쓸 수 없습니다,,,", Skip.NOTE),
        ("2026-01-03,가상,0,100", Skip.NO_MOVEMENT),
    ],
)
def test_what_is_no_transaction_is_skipped_with_its_reason(row: str, reason: Skip) -> None:
    assert skips(f"날짜,내용,금액,잔액\n2026-01-02,가상,1,1\n{row}\n") == [reason]


def test_a_merchant_called_total_is_no_total() -> None:
    assert len(candidates("날짜,내용,금액\n2026-01-02,합계마트,-100\n2026-01-03,Total Wine,-1\n")) == 2


def test_pending_and_reverted_rows_wait_and_an_unknown_status_stops_the_row() -> None:
    data = "Date,Description,Amount,Status\n2026-01-02,a,1,Pending\n2026-01-03,b,1,Cancelled\n2026-01-04,c,1,Posted\n"
    assert skips(data) == [Skip.PENDING, Skip.REVERTED]
    assert refusals(data + "2026-01-05,d,1,Strange\n") == [Refusal.UNKNOWN_STATUS]


def test_a_currency_comes_from_the_row_then_the_mapping_then_the_account() -> None:
    own = "Date,Description,Amount,Currency\n2026-01-02,a,1.50,EUR\n"
    assert [c.currency for c in candidates(own)] == ["EUR"]
    bare = "Date,Description,Amount\n2026-01-02,a,1\n"
    assert [c.currency for c in candidates(bare, currency_code="USD")] == ["USD"]
    assert [c.currency for c in candidates(bare)] == ["KRW"]
    assert refusals(bare, None) == [Refusal.NO_CURRENCY]
    assert refusals(own.replace("EUR", "€?"), None) == [Refusal.BAD_CURRENCY]


def test_without_a_date_order_every_row_is_refused_and_the_person_is_asked() -> None:
    data = "Date,Description,Amount\n05/06/2026,a,1\n07/08/2026,b,1\n"
    assert propose(table(data), {}).problems == (MappingFault("date_format", FaultKind.NO_DATE_FORMAT),)
    assert refusals(data) == [Refusal.AMBIGUOUS_DATE] * 2
    assert [c.date for c in candidates(data, date_format=DateOrder.DMY)] == ["2026-06-05", "2026-08-07"]


def test_dangerous_text_stays_text_and_invisible_characters_go() -> None:
    data = "Date,Description,Amount\n2026-01-02,\"<script>alert(1)</script>\",1\n2026-01-03,=cmd|' /C calc'!A0,1\n"
    assert [c.description for c in candidates(data)] == ["<script>alert(1)</script>", "=cmd|' /C calc'!A0"]
    hidden = 'Date,Description,Amount\n2026-01-02,"\u202egnp.exe\u2066 a\nb\u200bc",1\n'
    (candidate,) = candidates(hidden)
    assert candidate.description == "gnp.exe a b c"


def test_a_long_text_is_cut_where_the_book_would_refuse_it_and_the_cell_is_kept() -> None:
    (candidate,) = candidates(f"Date,Description,Category,Amount\n2026-01-02,{'가' * 3_000},{'나' * 300},1\n")
    assert len(candidate.description) == room.DESCRIPTION_CHARACTERS_MAX
    assert candidate.category is not None
    assert len(candidate.category) == room.NAME_CHARACTERS_MAX <= fields.NAME_CHARACTERS_MAX
    assert candidate.cells[1] == "가" * 3_000


def test_identical_rows_get_fingerprints_of_their_own_and_the_same_file_the_same_ones() -> None:
    row = "2026-01-02,가상다방,-4500\n"
    first = [fingerprint("cash", c) for c in candidates("날짜,내용,금액\n" + row * 3)]
    again = [fingerprint("cash", c) for c in candidates("날짜,내용,금액\n" + row * 3)]
    assert len(set(first)) == 3
    assert first == again
    assert {len(mark) for mark in first} == {32}
    assert set(first).isdisjoint(fingerprint("other", c) for c in candidates("날짜,내용,금액\n" + row))


def test_a_fingerprint_is_the_same_from_a_workbook_and_from_text() -> None:
    rows = [["거래일자", "내용", "금액"], ["2026.01.02", "가상다방", "-4,500"]]
    numbers = [rows[0], ["2026-01-02", "가상다방", -4500]]
    texts = {fingerprint("cash", c) for c in candidates('거래일자,내용,금액\n2026.01.02,가상다방,"-4,500"\n')}
    assert texts == {fingerprint("cash", c) for c in candidates(workbook(rows))}
    assert texts == {fingerprint("cash", c) for c in candidates(workbook(numbers))}


def test_money_in_and_the_same_money_out_are_not_the_same_row() -> None:
    held = "거래일자,내용,출금액,입금액\n2026-01-02,가상,100,\n2026-01-02,가상,,100\n"
    assert len({fingerprint("cash", c) for c in candidates(held)}) == 2


def test_the_number_of_a_row_and_an_editable_memo_are_not_in_the_fingerprint() -> None:
    first = "No,거래일자,내용,금액\n1,2026-01-02,가상,-1\n"
    assert [fingerprint("a", c) for c in candidates(first)] == [
        fingerprint("a", c) for c in candidates(first.replace("\n1,", "\n7,"))
    ]
    toss = ",거래 일시,적요,거래 유형,거래 기관,계좌번호,거래 금액,거래 후 잔액,메모\n"
    row = ",2026.08.14 20:32:16,가상분식,체크카드결제,,1,-1,9,{}\n"
    assert [fingerprint("a", c) for c in candidates(toss + row.format("점심"))] == [
        fingerprint("a", c) for c in candidates(toss + row.format("저녁"))
    ]


BALANCED = ["2026-01-02,가,-100,900", "2026-01-03,나,50,950", "2026-01-04,다,-950,0"]


@pytest.mark.parametrize(
    ("lines", "verdict"),
    [
        (BALANCED, BalanceVerdict.MATCH),
        (BALANCED[::-1], BalanceVerdict.MATCH),
        ([*BALANCED[:2], "2026-01-04,다,-950,1"], BalanceVerdict.MISMATCH),
        (["2026-01-02,가,100,900", "2026-01-03,나,-50,950"], BalanceVerdict.MISMATCH),
        (BALANCED[:1], BalanceVerdict.ABSENT),
        (["2026-01-02,가,-100,", "2026-01-03,나,50,"], BalanceVerdict.ABSENT),
        ([BALANCED[0], "2026-02-30,나,50,950", BALANCED[2]], BalanceVerdict.ABSENT),
    ],
)
def test_the_running_balance_is_a_witness_in_either_order(lines: list[str], verdict: BalanceVerdict) -> None:
    assert balance_of(results("날짜,내용,금액,잔액\n" + "\n".join(lines) + "\n", "KRW")) is verdict


def test_a_mapping_names_columns_that_are_there_and_says_all_that_is_missing() -> None:
    columns = ("날짜", "금액", "메모", "메모#2")
    good = Mapping(date="날짜", amount="금액", memo="메모#2", date_format=DateOrder.YMD)
    assert faults_of(good, columns) == ()
    assert faults_of(Mapping(memo="메모#3"), columns) == (
        MappingFault("memo", FaultKind.UNKNOWN_COLUMN),
        MappingFault("date", FaultKind.NO_DATE),
        MappingFault("amount", FaultKind.NO_AMOUNT),
    )
    twice = Mapping(date="날짜", amount="금액", inflow="금액", date_format=DateOrder.YMD, currency_code="원")
    assert [fault.kind for fault in faults_of(twice, columns)] == [
        FaultKind.COLUMN_TWICE,
        FaultKind.TWO_AMOUNTS,
        FaultKind.BAD_CURRENCY,
    ]


def test_twins_and_empty_columns_get_names_of_their_own() -> None:
    assert unique_names(("", "메모", "메모", " ", "a\nb")) == ("[A]", "메모", "메모#2", "[D]", "a b")
    assert unique_names(("메모#2", "메모", "메모")) == ("메모#2", "메모", "메모#3")
    assert unique_names(("",) * 28)[-1] == "[AB]"


def test_a_person_may_read_a_known_bank_without_its_format() -> None:
    held = table(CHASE + "08/10/2026,08/13/2026,SAMPLE BOOKS,Shopping,Sale,-10.59,\n")
    proposal = propose(held, builtin_formats(), NO_FORMAT)
    assert proposal.format is None
    assert proposal.fitting == ("us.chase.card",)
    assert proposal.mapping.date == "Transaction Date"
    assert proposal.mapping.amount == "Amount"


def test_the_same_rows_are_known_again_whatever_format_they_are_read_by() -> None:
    held = table(
        CHASE + "03/21/2026,03/22/2026,SHOP,Food,Sale,-4.50,\n03/21/2026,03/22/2026,SHOP,Food,Sale,-4.50,\n"
    )
    prints = []
    for wanted in (None, NO_FORMAT):
        proposal = propose(held, builtin_formats(), wanted)
        wish = Manifest("id", State.PREVIEW, "x", 1, "00", 0, format=proposal.format, currency="USD")
        wish = msgspec.structs.replace(wish, mapping=proposal.mapping)
        rows = [row for row in read_by(wish, held) if isinstance(row, Candidate)]
        prints.append([fingerprint("card", row) for row in rows])
    assert prints[0] == prints[1]
    assert len(set(prints[0])) == 2


def test_a_column_of_payees_opens_no_account_for_each_of_them() -> None:
    count = room.CATEGORIES_MAX + 5
    lines = [f"2026-01-02,가상,-100,가게{n % count}" for n in range(2 * count)]
    data = "\n".join(["날짜,내용,금액,분류", *lines])
    assert len({c.category for c in candidates(data)}) == room.CATEGORIES_MAX
    assert refusals(data) == [Refusal.TOO_MANY_CATEGORIES] * 10
    refused = [row for row in results(data, "KRW") if isinstance(row, RefusedRow)]
    assert {row.column for row in refused} == {"분류"}


def test_what_nobody_has_chosen_is_guessed_anew_from_the_columns_that_were_chosen() -> None:
    held = table("Wann;Was;Wieviel\n31.01.2026;Brot;-3,20\n01.02.2026;Lohn;1.200,00\n")
    before = propose(held, {}).mapping
    chosen = msgspec.structs.replace(
        before, date="Wann", amount="Wieviel", date_format=None, decimal=Decimal.POINT
    )
    start = Mapping()
    now = guessed_anew(held, start, chosen, ())
    assert (now.date_format, now.decimal) == (DateOrder.DMY, Decimal.COMMA)
    kept = guessed_anew(held, start, chosen, ("date_format", "decimal"))
    assert (kept.date_format, kept.decimal) == (None, Decimal.POINT)
    assert guessed_anew(held, chosen, chosen, ()) == chosen
