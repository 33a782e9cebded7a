"""What is said of a journal that comes in from another program, Korean and English, as plain data."""

from collections.abc import Mapping
from typing import Final

#: key -> (ko, en)
WORDS: Final[Mapping[str, tuple[str, str]]] = {
    "read": (
        "거래 {transactions}건, 계정 {accounts}개를 읽었어요.",
        "{transactions} transactions on {accounts} accounts were read.",
    ),
    "booked": ("장부에 있는 거래: {count}건", "In the ledger: {count} transactions"),
    "progress": ("{of}건 중 {done}건", "{done} of {of}"),
    "not_taken": ("적지 않은 것 · {line}번째 줄: {why}", "not taken, line {line}: {why}"),
    "more": ("그 밖에 {count}건 (--json으로 모두 볼 수 있어요)", "and {count} more (--json tells all)"),
    "why_virtual": (
        "짝이 없는 가상 기입이 있어요.",
        "it has a virtual posting that nothing balances.",
    ),
    "why_nothing": ("금액이 없어요 (잔액 확인 등).", "it moves nothing (a balance assertion, perhaps)."),
    "why_currency": ("통화로 쓸 수 없는 이름이에요: {what}", "no currency can be called {what}."),
    "why_kind": (
        "어떤 계정인지 알 수 없어요: {what} (--type '{what}=asset'처럼 알려 주세요)",
        "what kind of account is {what}? Say it: --type '{what}=asset'",
    ),
    "no_hledger": (
        "hledger가 필요해요: 설치한 뒤 다시 해 주세요 (데비안, 우분투: apt install hledger).",
        "hledger is needed to read it: install it and try again (Debian, Ubuntu: apt install hledger).",
    ),
    "no_beancount": (
        "beancount가 필요해요: 이 프로그램의 파이썬에 설치한 뒤 다시 해 주세요 (.venv/bin/pip install beancount).",
        "Beancount is needed to read it: install it beside this program and try again (.venv/bin/pip install beancount).",
    ),
    "too_slow": ("읽는 데 너무 오래 걸려요: {file}", "It takes too long to read {file}."),
    "refused": (
        "{file}: 읽지 못했어요. 그 프로그램이 이렇게 말했어요.",
        "{file} could not be read. Its own program says:",
    ),
    "off": (
        "장부가 켜져 있지 않아요. `hardcore up`으로 켠 뒤 다시 해 주세요.",
        "The ledger is not running. Start it with `hardcore up` and try again.",
    ),
    "broken": (
        "중간에 끊겼어요. 같은 명령을 다시 하면 이어서 하고, 두 번 적지 않아요.",
        "It was cut off. The same words again go on from there, and book nothing twice.",
    ),
    "bad_type": (
        "--type은 이름=asset|liability|equity|income|expense로 써 주세요: {given}",
        "--type is NAME=asset|liability|equity|income|expense, not {given}.",
    ),
}


def journal_text(key: str, lang: str, **values: object) -> str:
    """Return a text of this room."""
    return WORDS[key][0 if lang == "ko" else 1].format_map(values)
