"""The sentinel's page: what it says is read back, what is no page says nothing."""

from pathlib import Path

import pytest

from hardcore.host.sentinel_page import SIZE, SentinelPage, read_page
from tests.waiting import until

NONCE = "0123456789abcdef0123456789abcdef"


def test_what_a_sentinel_says_of_itself_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "sentinel.page"
    page = SentinelPage(path, 7, 4242, NONCE)
    first = read_page(path)
    assert first is not None
    assert (first.generation, first.start, first.nonce, first.loop_ns) == (7, 4242, NONCE, 0)
    assert first.last_ns >= first.began_ns > 0
    page.beat()
    page.beat()
    later = read_page(path)
    assert later is not None
    assert later.loop_count == 2
    assert later.loop_ns >= first.began_ns
    until(lambda: (read_page(path) or first).thread_ns > first.thread_ns, "the thread to beat")
    assert path.stat().st_size == SIZE
    assert path.stat().st_mode & 0o777 == 0o600


def test_the_page_of_the_one_before_is_not_written_into(tmp_path: Path) -> None:
    path = tmp_path / "sentinel.page"
    old = SentinelPage(path, 1, 1, NONCE)
    SentinelPage(path, 2, 2, NONCE)
    old.beat()
    told = read_page(path)
    assert told is not None
    assert (told.generation, told.loop_count) == (2, 0)


@pytest.mark.parametrize("content", [b"", b"HCSENT01", b"x" * SIZE])
def test_what_is_no_page_says_nothing(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "sentinel.page"
    path.write_bytes(content)
    assert read_page(path) is None
    assert read_page(tmp_path / "nothing") is None


def test_without_room_for_a_page_the_watch_goes_on(tmp_path: Path) -> None:
    page = SentinelPage(tmp_path / "nowhere" / "sentinel.page", 1, 1, NONCE)
    page.beat()
    assert page.fault
