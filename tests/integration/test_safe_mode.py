"""The operator's safe mode: reads are served, writes are refused in plain words, over every death, until it is ended."""

import signal

from tests.integration.house import START_S, Answer, House
from tests.integration.houses import MakeHouse
from tests.waiting import until


def refuses(house: House, key: str) -> Answer:
    """Try to book; it must be refused for good, as reading only."""
    answer = house.book(key)
    assert answer.status == 503, answer
    assert answer.headers["content-type"].startswith("application/problem+json")
    assert answer.body["type"] == "/problems/safe-mode"
    assert answer.outcome == "not_done"
    return answer


def reads(house: House) -> None:
    assert house.ask("GET", "/api/ledger/accounts").status == 200


def safe(house: House) -> None:
    """Wait until a core serves reads only because somebody wants it."""

    def so(s: dict[str, object]) -> bool:
        return (s["state"], s["wanted"], s["safe_by"]) == ("SAFE_MODE", "SAFE", "operator")

    house.url = house.until(so, "the safe mode")["url"]


def test_safe_mode_serves_reads_and_refuses_writes_over_a_kill_and_over_down_and_up(
    new_house: MakeHouse,
) -> None:
    house = new_house().up()
    house.open_accounts()
    assert house.book("before").status == 201
    done = house.cli("safe-mode", "on", "--reason", "audit")
    assert done.code == 0, done
    safe(house)
    assert house.status()["safe_reason"] == "audit"
    reads(house)
    refuses(house, "in-safe-mode")

    victim = house.hit("core", signal.SIGKILL)
    house.until(lambda s: s["core"]["pid"] not in {None, victim.pid}, "another core")
    safe(house)
    reads(house)
    refuses(house, "after-a-kill")

    serving = house.status()["core"]["pid"]
    sentinel = house.hit("sentinel")
    until(lambda: sentinel.gone, "the sentinel's end", START_S)
    safe(house)
    refuses(house, "under-another-guard")
    assert house.status()["core"]["pid"] == serving, "the loss of a guard ends no core that is well"

    assert house.cli("down").code == 0
    house.up_unproven()
    safe(house)
    reads(house)
    refuses(house, "after-down-and-up")

    house.order("resume")
    safe(house)

    assert house.cli("safe-mode", "off").code == 0
    house.running()
    assert house.status()["safe_by"] is None
    for key in ("in-safe-mode", "after-a-kill", "now"):
        assert house.book(key).status == 201, "a 503 was final: it may be sent again, and is booked once"
    assert sorted(house.booked()) == sorted(["before", "in-safe-mode", "after-a-kill", "now"])
    states = [change["after"] for change in house.order("history")["changes"]]
    assert "SAFE_MODE" in states


def test_a_safe_mode_that_is_asked_for_while_all_is_stopped_holds_at_the_next_start(
    new_house: MakeHouse,
) -> None:
    house = new_house().up()
    assert house.cli("down").code == 0
    assert house.cli("safe-mode", "on").code == 0
    house.up_unproven()
    safe(house)
    assert house.cli("status").code == 3
    assert house.cli("safe-mode", "off", "--json").told["state"] != "SAFE_MODE"
