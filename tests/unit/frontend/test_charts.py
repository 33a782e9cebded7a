"""A year on paper: where its points and columns stand."""

import msgspec

from frontend.charts import COLUMN_HEIGHT, LINE_HEIGHT, LINE_TOP, WIDTH, chart


class Month(msgspec.Struct, frozen=True):
    month: str
    income: str
    expense: str
    worth: str


def test_the_highest_worth_stands_on_top_and_the_lowest_below() -> None:
    drawn = chart(
        [
            Month("2026-10", "0", "0", "-5.50"),
            Month("2026-11", "0", "0", "1000000.00"),
            Month("2026-12", "0", "0", "499997.25"),
        ]
    )
    ys = [int(point.split(",")[1]) for point in drawn.line.split(" ")]
    assert ys == [LINE_TOP + LINE_HEIGHT, LINE_TOP, LINE_TOP + LINE_HEIGHT // 2]
    assert drawn.last_y == ys[2]


def test_a_worth_that_never_moved_is_a_line_half_way() -> None:
    drawn = chart([Month("2026-10", "0", "0", "7"), Month("2026-11", "0", "0", "7")])
    middle = LINE_TOP + LINE_HEIGHT - LINE_HEIGHT // 2
    assert [point.split(",")[1] for point in drawn.line.split(" ")] == [str(middle)] * 2


def test_columns_share_one_scale_and_what_is_more_than_nothing_can_be_seen() -> None:
    first, second = chart([Month("2025-12", "400", "100", "0"), Month("2026-01", "1", "-30", "0")]).columns
    assert (first.income_height, first.expense_height) == (COLUMN_HEIGHT, round(COLUMN_HEIGHT / 4))
    assert second.income_height > 0
    assert second.expense_height == 0


def test_columns_stay_on_the_paper_and_apart() -> None:
    columns = chart([Month(f"2026-{n:02d}", "1", "1", "1") for n in range(1, 13)]).columns
    edges = [
        edge
        for one in columns
        for edge in (one.income_x, one.income_x + one.width, one.expense_x, one.expense_x + one.width)
    ]
    assert edges == sorted(edges)
    assert edges[0] >= 0
    assert edges[-1] <= WIDTH
