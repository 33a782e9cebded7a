"""Nobody guards any more, but gateway and core live and hold the address: the next `up` goes on there."""

import signal
import socket
from urllib.parse import urlsplit

from hardcore import up
from tests.integration.conftest import MakeHouse
from tests.integration.house import START_S
from tests.waiting import until


def test_up_goes_on_at_the_address_that_gateway_and_core_have_kept(new_house: MakeHouse) -> None:
    house = new_house(actions={"SENTINEL_LOST": ["SEND_ALERT"]}).up()  # no agent starts another
    before, launcher, sentinel = house.status(), house.launcher, house.hold("sentinel")
    assert launcher is not None
    launcher.kill()
    launcher.wait(START_S)
    sentinel.hit(signal.SIGKILL)
    until(lambda: sentinel.gone, "the guard to be gone", START_S)
    assert house.ask("GET", "/livez").status == 200

    house.begin("--port", str(urlsplit(before["url"]).port))
    after = house.running()
    assert after["sentinel"]["pid"] != before["sentinel"]["pid"]
    assert after["url"] == before["url"]
    assert after["core"]["pid"] == before["core"]["pid"]
    assert after["gateway"]["pid"] == before["gateway"]["pid"]
    assert house.ask("GET", "/readyz").status == 200


def test_an_address_that_is_given_up_takes_no_connections_whoever_holds_it_still() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as ours,
        socket.create_server(("127.0.0.1", 0)) as theirs,
    ):
        up._give_up(theirs.dup(), ours)
        with socket.socket() as asking:
            assert asking.connect_ex(theirs.getsockname()) != 0
        up._give_up(ours.dup(), ours)
        with socket.socket() as asking:
            assert asking.connect_ex(ours.getsockname()) == 0
