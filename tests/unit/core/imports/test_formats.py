import pytest

from core.imports.reading.candidates import Candidate, RefusedRow, SkippedRow
from core.imports.reading.formats import Format, Sample, builtin_formats, read_format
from core.imports.reading.names import canonical
from core.imports.reading.proposal import propose
from core.imports.reading.rows import parse_rows
from tests.unit.core.imports.files import balance_of, table

SAMPLES = [(format_, sample) for format_ in builtin_formats().values() for sample in format_.test]

PLAIN = """
schema = 1
id = "xx.plain"
name = { ko = "가상은행", en = "Sample Bank" }
kind = "account"
sure = "C"
identity = ["date", "amount"]
[header]
required = ["거래일", "금액"]
[columns]
date = ["거래일"]
amount = ["금액"]
[date]
order = "ymd"
[[test]]
input = ""
expect = []
"""


@pytest.mark.parametrize(("format_", "sample"), SAMPLES, ids=[format_.id for format_, _ in SAMPLES])
def test_every_format_reads_its_own_sample(format_: Format, sample: Sample) -> None:
    read = table(sample.input)
    proposal = propose(read, builtin_formats())
    assert proposal.format == format_.id
    assert proposal.problems == ()
    results = list(parse_rows(read, proposal.mapping, format_, None, format_))
    candidates = [result for result in results if isinstance(result, Candidate)]
    assert len(candidates) == len(sample.expect)
    for candidate, expected in zip(candidates, sample.expect, strict=True):
        for name in expected.__struct_fields__:
            wanted = getattr(expected, name)
            assert wanted is None or getattr(candidate, name) == wanted, (name, candidate)
    assert sum(isinstance(result, SkippedRow) for result in results) == sample.skipped
    assert sum(isinstance(result, RefusedRow) for result in results) == sample.refused
    assert balance_of(results) == sample.balance_check


@pytest.mark.parametrize("format_", builtin_formats().values(), ids=builtin_formats())
def test_no_sample_fits_a_second_format(format_: Format) -> None:
    for sample in format_.test:
        assert propose(table(sample.input), builtin_formats()).fitting == (format_.id,)


def test_the_banks_that_were_promised_are_there() -> None:
    banks = {name.rsplit(".", 1)[0] if name.count(".") == 3 else name for name in builtin_formats()}
    assert banks >= {
        "kr.kakaobank.account",
        "kr.tossbank.account",
        "kr.shinhan.account",
        "kr.hana.account",
        "kr.ibk.account",
        "kr.banksalad.ledger",
        "us.chase.card",
        "us.chase.checking",
        "eu.revolut.account",
        "de.dkb.account",
        "de.ing.account",
        "de.sparkasse.camt",
        "de.sparkasse.mt940",
        "eu.n26.account",
        "eu.wise.statement",
        "gb.monzo.account",
        "jp.mufg.account",
        "jp.rakuten.account",
        "jp.smbc.account",
        "kr.woori.account",
        "nl.ing.account",
        "ofx.statement",
        "us.amex.card",
        "us.bofa.card",
        "us.bofa.checking",
        "us.capitalone.card",
    }


def test_a_format_without_a_fault_is_read() -> None:
    assert isinstance(read_format(PLAIN, "xx.plain"), Format)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('id = "xx.plain"', 'id = "other"', "not the name of its file"),
        ("schema = 1", "schema = 2", "schema 2"),
        ('ko = "가상은행", ', "", "ko and en"),
        ('date = ["거래일"]', "", "columns.date is missing"),
        ('amount = ["금액"]', 'amount = ["금액"]\nin = ["입금"]', "either amount, or in and out"),
        ('amount = ["금액"]', 'amount = ["금액"]\nflavour = ["맛"]', "columns.flavour is no role"),
        ('identity = ["date", "amount"]', 'identity = ["memo"]', "'memo', which has no column"),
        ('order = "ymd"', 'order = "ydm"', "$.date.order"),
        ('sure = "C"', 'sure = "C"\nregex = ".*"', "regex"),
        ('sure = "C"', 'sure = "C"\ncurrency = "won"', "'won' is no currency"),
        ('amount = ["금액"]', 'amount = ["금액"]\nstatus = ["상태"]', "[status] need each other"),
        ("[header]", "[header", "xx.plain"),
    ],
)
def test_every_fault_of_a_format_is_named(old: str, new: str, said: str) -> None:
    faults = read_format(PLAIN.replace(old, new, 1), "xx.plain")
    assert not isinstance(faults, Format)
    assert any(said in fault for fault in faults), faults


def test_all_faults_are_told_at_once() -> None:
    broken = PLAIN.replace("schema = 1", "schema = 9").replace('id = "xx.plain"', 'id = "xx.other"')
    assert len(read_format(broken, "xx.plain")) == 2  # type: ignore[arg-type]


def test_names_are_compared_without_blanks_and_width_but_with_brackets() -> None:
    assert canonical("거래 후\n잔액") == canonical("거래후잔액")
    assert canonical("ＡＭＯＵＮＴ（ＵＳＤ）") == canonical("Amount (USD)")
    assert canonical("승인금액(USD)") != canonical("승인금액")
    assert canonical("\ufeff날짜") == canonical("날짜") == canonical("\u1102\u1161\u11af\u110d\u1161")
