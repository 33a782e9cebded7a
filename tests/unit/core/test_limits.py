"""How long work may be decided: a write by the policy's number, a read never less than it may honestly take."""

from dataclasses import replace

import pytest

from core.limits import limit_ms
from core.settings import Settings


@pytest.mark.parametrize("kind", ["transaction.post", "entry.record", "import.row", "drill", "account.open"])
def test_whatever_writes_has_the_limit_of_the_policy(kind: str) -> None:
    assert limit_ms(kind, replace(Settings(), command_deadline_ms=250)) == 250


def test_a_read_is_not_late_before_it_has_missed_its_own_end() -> None:
    settings = replace(Settings(), command_deadline_ms=250)
    assert limit_ms("read.register", settings) > 2 * (settings.read_ms_max + settings.write_busy_ms)


def test_a_read_may_take_at_least_as_long_as_a_write() -> None:
    assert limit_ms("read.register", replace(Settings(), command_deadline_ms=60_000)) == 60_000


def test_a_rule_for_a_kind_counts_in_the_place_of_the_policy() -> None:
    settings = replace(Settings(), command_deadline_ms=250)
    ruled = {"entry.record": 40, "read.register": 1, "read.summary": 90_000}
    assert limit_ms("entry.record", settings, ruled) == 40
    assert limit_ms("account.open", settings, ruled) == 250
    assert limit_ms("read.summary", settings, ruled) == 90_000


def test_no_rule_calls_a_read_late_before_its_own_end() -> None:
    settings = Settings()
    own_end_ms = settings.read_ms_max + settings.write_busy_ms
    assert limit_ms("read.register", settings, {"read.register": 1}) == own_end_ms
