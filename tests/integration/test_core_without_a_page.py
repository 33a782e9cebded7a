"""A core whose recorder page is no evidence any more: it is said at once, and a hang is found all the same."""

import signal

from tests.integration.conftest import MakeHouse
from tests.integration.house import House


def _spoil_the_page(house: House) -> None:
    """Write over the first byte of the living core's page."""
    pages = [path for path in house.folders.run.glob("recorder-*") if not path.suffix]
    assert len(pages) == 1, pages
    with pages[0].open("r+b") as page:
        page.write(b"X")


def test_a_page_that_was_written_over_is_named_and_the_core_that_serves_is_left_alone(
    new_house: MakeHouse,
) -> None:
    house = new_house().up()
    house.open_accounts()
    pid = house.running()["core"]["pid"]
    _spoil_the_page(house)
    status = house.until(lambda status: status["state"] == "DEGRADED", "the worry to be shown")
    assert status["core"]["pid"] == pid
    assert "header was changed" in (house.folders.logs / "sentinel.log").read_text("utf-8")
    assert house.book("all-the-same").status == 201
    assert house.incidents() == []


def test_a_core_without_a_page_that_stands_still_is_found_by_the_kernel_and_its_silence(
    new_house: MakeHouse,
) -> None:
    house = new_house().up()
    house.open_accounts()
    epoch = house.running()["core"]["epoch"]
    _spoil_the_page(house)
    house.hit("core", signal.SIGSTOP)
    story = house.closed(1)
    assert (story["diagnosis"], story["grade"], story["outcome"]) == ("FROZEN", "likely", "recovered"), story
    assert house.running()["core"]["epoch"] == epoch + 1
    assert house.book("after-it").status == 201
