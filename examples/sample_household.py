"""A household to look at: a year of one family's money, always the same, sent in through the ledger's own door.

Every line is invented. What is bought and when follows from the month alone (each month has its own seeded
dice), so a second run books nothing twice, because every request carries the same key, and a run in a later
month adds what is new. A dump of a finished ledger was not chosen: this way the year comes in as a year of typing
would, and a core that is killed meanwhile shows what it is for. Amounts are won, names Korean or English.

    python -m examples.sample_household --url http://127.0.0.1:3000 --lang ko
"""

import argparse
import os
import random
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date, datetime, timedelta
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import urlsplit

from examples.line import Answer, Broken, Line

MONTHS: Final = 12
TRIES_MAX: Final = 60
PAUSE_S: Final = 0.5
API: Final = "/api/ledger"

LIVING, SAVINGS, WALLET, CARD = (
    "assets:bank:living",
    "assets:bank:savings",
    "assets:cash:wallet",
    "liabilities:card",
)
OPENING, SALARY_DAY, CARD_DAY = "equity:opening", 10, 14

#: id -> (type, Korean name, English name)
ACCOUNTS: Final = {
    LIVING: ("asset", "생활비 통장", "Everyday account"),
    SAVINGS: ("asset", "비상금 통장", "Rainy-day savings"),
    WALLET: ("asset", "지갑", "Wallet"),
    CARD: ("liability", "신용카드", "Credit card"),
    OPENING: ("equity", "처음 잔액", "Opening balances"),
}
#: What was there before the first month, in won.
OPENED_WITH: Final = {LIVING: 2_184_500, SAVINGS: 6_400_000, WALLET: 83_000}


@dataclass(frozen=True, slots=True)
class Words:
    """A word in both languages."""

    ko: str
    en: str

    def said(self, lang: str) -> str:
        """The word in one of them."""
        return self.ko if lang == "ko" else self.en


@dataclass(frozen=True, slots=True)
class Habit:
    """Something the family spends on now and then: `times` a month, `low` to `high` won, in steps of `step`."""

    category: Words
    account: str
    times: int
    low: int
    high: int
    step: int
    names: tuple[Words, ...]


@dataclass(frozen=True, slots=True)
class Fixed:
    """Something that comes every month on its day; `months`: only in these (empty: in all)."""

    day: int
    amount: int
    category: Words
    account: str
    name: Words
    months: tuple[int, ...] = ()


FOOD, COFFEE, EATING_OUT = Words("식비", "Groceries"), Words("카페", "Coffee"), Words("외식", "Eating out")
HOME, BILLS, PHONE = (
    Words("주거", "Housing"),
    Words("공과금", "Utilities"),
    Words("통신", "Phone and internet"),
)
TRANSPORT, HEALTH, CHILD = Words("교통", "Transport"), Words("건강", "Health"), Words("아이", "Child")
FAMILY, FUN, CLOTHES = Words("경조사", "Family occasions"), Words("여가", "Leisure"), Words("의류", "Clothes")
SALARY, INTEREST = Words("급여", "Salary"), Words("이자", "Interest")

HABITS: Final = (
    Habit(FOOD, CARD, 12, 12_000, 94_000, 10, (
        Words("동네 마트", "Corner market"), Words("장보기", "Weekly shopping"), Words("정육점", "Butcher"),
        Words("과일 가게", "Fruit stand"), Words("빵집", "Bakery"))),
    Habit(EATING_OUT, CARD, 6, 8_000, 58_000, 500, (
        Words("김밥과 떡볶이", "Gimbap and tteokbokki"), Words("국숫집", "Noodle shop"),
        Words("점심 백반", "Lunch set"), Words("치킨 배달", "Chicken delivery"), Words("가족 외식", "Family dinner"))),
    Habit(COFFEE, CARD, 8, 2_500, 9_800, 100, (
        Words("아메리카노", "Americano"), Words("카페라테", "Latte"), Words("커피와 케이크", "Coffee and cake"))),
    Habit(TRANSPORT, CARD, 5, 1_400, 32_000, 50, (
        Words("버스와 지하철", "Bus and subway"), Words("택시", "Taxi"), Words("주차", "Parking"),
        Words("주유", "Petrol"))),
    Habit(FUN, CARD, 2, 9_000, 47_000, 500, (
        Words("영화", "Cinema"), Words("책", "Books"), Words("수영장", "Swimming pool"), Words("전시", "Exhibition"))),
    Habit(HEALTH, CARD, 1, 4_500, 38_000, 100, (
        Words("약국", "Pharmacy"), Words("치과", "Dentist"), Words("소아과", "Children's clinic"))),
    Habit(CLOTHES, CARD, 1, 19_000, 89_000, 100, (
        Words("아이 운동화", "Child's trainers"), Words("셔츠", "Shirt"), Words("양말과 속옷", "Socks and underwear"))),
    Habit(FOOD, WALLET, 3, 1_500, 12_000, 500, (
        Words("시장 나물", "Market greens"), Words("붕어빵", "Fish-shaped pastry"), Words("두부", "Tofu"))),
)  # fmt: skip

FIXED: Final = (
    Fixed(1, -780_000, HOME, LIVING, Words("월세", "Rent")),
    Fixed(4, -214_000, HEALTH, LIVING, Words("가족 보험", "Family insurance")),
    Fixed(5, -33_000, PHONE, LIVING, Words("집 인터넷", "Home internet")),
    Fixed(7, -64_900, PHONE, CARD, Words("휴대전화 요금", "Mobile phones")),
    Fixed(10, -180_000, CHILD, LIVING, Words("태권도 학원", "Taekwondo school")),
    Fixed(12, -13_500, FUN, CARD, Words("음악 구독", "Music subscription")),
    Fixed(18, -148_000, BILLS, LIVING, Words("아파트 관리비", "Building maintenance")),
    Fixed(20, -71_300, BILLS, LIVING, Words("도시가스", "Gas heating"), (1, 2, 3, 11, 12)),
    Fixed(20, -18_700, BILLS, LIVING, Words("도시가스", "Gas"), (4, 5, 6, 7, 8, 9, 10)),
    Fixed(22, -42_800, BILLS, LIVING, Words("전기 요금", "Electricity")),
    Fixed(SALARY_DAY, 3_420_000, SALARY, LIVING, Words("월급", "Salary")),
    Fixed(3, 640_000, SALARY, LIVING, Words("주말 과외", "Weekend tutoring")),
    Fixed(28, 7_840, INTEREST, SAVINGS, Words("예금 이자", "Savings interest"), (3, 6, 9, 12)),
    Fixed(8, -200_000, FAMILY, LIVING, Words("부모님 용돈", "Gift to parents"), (2, 5, 9)),
    Fixed(16, -100_000, FAMILY, LIVING, Words("친구 결혼식", "A friend's wedding"), (4, 10)),
    Fixed(3, -386_000, FUN, CARD, Words("여름 바다 여행", "Summer trip to the sea"), (8,)),
)


@dataclass(frozen=True, slots=True)
class Booking:
    """One request to the ledger: what is asked, and under which key."""

    key: str
    path: str
    body: dict[str, Any]


def household(until: date, lang: str) -> Iterator[Booking]:
    """Return every request of the year that ends with `until`, in their order."""
    for account, (kind, ko, en) in ACCOUNTS.items():
        body = {"id": account, "name": ko if lang == "ko" else en, "type": kind, "currency": "KRW"}
        yield Booking(f"sample-{account}", "/accounts", body)
    first = _first_month(until)
    for account, amount in OPENED_WITH.items():
        name = Words("처음 잔액", "Opening balance").said(lang)
        yield _moved(f"sample-opened-{account}", first, name, OPENING, account, amount)
    month = first
    while month <= until:
        spent = [
            entry
            for entry in _month(month, lang, first=month == first)
            if date.fromisoformat(entry.body["date"]) <= until
        ]
        yield from sorted(spent, key=lambda entry: str(entry.body["date"]))
        month = _next(month)


def _month(month: date, lang: str, *, first: bool) -> Iterator[Booking]:
    due = [fixed for fixed in FIXED if not fixed.months or month.month in fixed.months]
    spent = [(one.category, one.account, one.day, one.amount, one.name) for one in due]
    spent += [
        (habit.category, habit.account, day, -amount, name) for habit, day, amount, name in _bought(month)
    ]
    for number, (category, account, day, amount, name) in enumerate(spent, 1):
        body = {
            "date": month.replace(day=day).isoformat(),
            "amount": str(amount),
            "currency": "KRW",
            "account": account,
            "category": category.said(lang),
            "description": name.said(lang),
            "tags": [],
        }
        yield Booking(f"sample-{month:%Y-%m}-{number}", "/entries", body)
    if not first:
        owed = sum(_on_card(month - timedelta(days=1)))
        bill = Words("카드 대금", "Card bill").said(lang)
        due_on = month.replace(day=CARD_DAY)
        yield _moved(f"sample-card-{month:%Y-%m}", due_on, bill, LIVING, CARD, owed)
    saved = Words("비상금 저축", "To savings").said(lang)
    yield _moved(f"sample-saved-{month:%Y-%m}", month.replace(day=26), saved, LIVING, SAVINGS, 500_000)
    cash = Words("현금 찾기", "Cash withdrawal").said(lang)
    yield _moved(f"sample-cash-{month:%Y-%m}", month.replace(day=2), cash, LIVING, WALLET, 20_000)


def _bought(month: date) -> Iterator[tuple[Habit, int, int, Words]]:
    """Roll what was bought in a month: what, on which day, for how much, where."""
    dice = random.Random(f"household {month:%Y-%m}")
    days = (_next(month) - month).days
    for habit in HABITS:
        for _ in range(habit.times + dice.randint(-1, 1)):
            amount = dice.randrange(habit.low, habit.high, habit.step)
            yield habit, dice.randint(1, days), amount, dice.choice(habit.names)


def _on_card(in_month: date) -> Iterator[int]:
    """What a month has put on the card, in won."""
    month = in_month.replace(day=1)
    for fixed in FIXED:
        if fixed.account == CARD and (not fixed.months or month.month in fixed.months):
            yield -fixed.amount
    for habit, _day, amount, _name in _bought(month):
        if habit.account == CARD:
            yield amount


def _moved(key: str, day: date, name: str, source: str, to: str, amount: int) -> Booking:
    lines = [
        {"account": to, "amount": str(amount), "currency": "KRW"},
        {"account": source, "amount": str(-amount), "currency": "KRW"},
    ]
    body = {"date": day.isoformat(), "description": name, "tags": [], "postings": lines}
    return Booking(key, "/transactions", body)


def _first_month(until: date) -> date:
    first = until.replace(day=1)
    for _ in range(MONTHS - 1):
        first = (first - timedelta(days=1)).replace(day=1)
    return first


def _next(month: date) -> date:
    return (month.replace(day=1) + timedelta(days=32)).replace(day=1)


def book(line: Line, bookings: Iterator[Booking]) -> int:
    """Send everything in, in order; return how many requests that took. Raises RefusedError."""
    count = 0
    for booking in bookings:
        answer = _send(line, booking)
        if not answer.good and not _was_there(answer):
            raise RefusedError(f"{booking.path} {booking.body} was not booked: {answer}")
        count += 1
    return count


class RefusedError(Exception):
    """The ledger did not take something; the sentence says what and why."""


def _send(line: Line, booking: Booking) -> Answer | Broken:
    """Ask until there is an answer that counts: not done means that asking again is right, and safe."""
    tries = 1
    while True:
        answer = line.post(API + booking.path, booking.body, booking.key)
        waits = isinstance(answer, Broken) or answer.status == HTTPStatus.SERVICE_UNAVAILABLE
        if not waits or tries == TRIES_MAX:
            return answer
        tries += 1
        time.sleep(PAUSE_S)


def _was_there(answer: Answer | Broken) -> bool:
    """Whether this key has booked before, in the other language or with a name that was changed since."""
    return isinstance(answer, Answer) and answer.body.get("type") in {
        "/problems/key-reused",
        "/problems/account-exists",
    }


def spoken(environ: Mapping[str, str]) -> str:
    """Return the language of a terminal: ko or en."""
    named = environ.get("LC_ALL") or environ.get("LC_MESSAGES") or environ.get("LANG") or ""
    return "ko" if named.lower().startswith("ko") else "en"


def main() -> int:
    """Book the household."""
    parser = argparse.ArgumentParser(prog="sample_household", description="A year of an invented household.")
    parser.add_argument("--url", default="http://127.0.0.1:3000", help="the ledger's address")
    parser.add_argument("--lang", choices=("ko", "en"), default=spoken(os.environ))
    parser.add_argument(
        "--until", type=date.fromisoformat, default=datetime.now().astimezone().date(), help="the last day"
    )
    asked = parser.parse_args()
    where = urlsplit(asked.url)
    try:
        with Line((where.hostname or "127.0.0.1", where.port or 80)) as line:
            count = book(line, household(asked.until, asked.lang))
    except RefusedError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{count} requests: the year up to {asked.until} is in the ledger of {asked.url}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
