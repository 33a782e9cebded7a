"""The gate's first question: from where does somebody come, and is the door open there."""

import asyncio
import time
from pathlib import Path

import pytest

from hardcore.access import files
from hardcore.access.doorway import Doorway
from hardcore.access.people import OWNER, People, Person
from hardcore.crisis.gate import Entered, Gate
from hardcore.crisis.heads import RequestHead, read_request
from hardcore.crisis.limits import GatewayLimits
from hardcore.crisis.problems import Problem
from hardcore.crisis.routing import Route


def entry(state: Path, address: str, doorway: Doorway, *lines: tuple[bytes, bytes]) -> Entered | Problem:
    head = read_request(
        "GET", b"/", "1.1", ((b"Host", b"localhost"), *lines), {"localhost"}, keep_alive=True, upgrade=False
    )
    assert isinstance(head, RequestHead)

    async def ask() -> Entered | Problem:
        gate = Gate(asyncio.get_running_loop(), GatewayLimits(), state, time.monotonic_ns, doorway)
        return gate.entry(head, address, Route.FORWARD)

    return asyncio.run(ask())


@pytest.mark.parametrize("doorway", [Doorway(), Doorway(open=True, insecure_lan=True)])
def test_without_a_password_nobody_from_beyond_this_machine_is_its_owner(
    tmp_path: Path, doorway: Doorway
) -> None:
    assert isinstance(entry(tmp_path, "127.0.0.1", doorway), Entered)
    assert entry(tmp_path, "203.0.113.9", doorway) is Problem.NO_PASSWORD_SET


def test_where_the_doors_file_is_lost_nobody_from_beyond_this_machine_comes_near_a_form(
    tmp_path: Path,
) -> None:
    """A gateway that begins without it does not encrypt: a password must not be typed there."""
    files.write_people(tmp_path, People((Person(OWNER, "secret"),)))
    assert entry(tmp_path, "203.0.113.9", Doorway()) is Problem.AROUND_THE_PROXY
    assert entry(tmp_path, "127.0.0.1", Doorway()) is Problem.SIGN_IN_NEEDED


def test_behind_a_proxy_on_this_machine_nothing_changes_while_the_door_is_shut(tmp_path: Path) -> None:
    told = (b"X-Forwarded-For", b"203.0.113.9")
    assert isinstance(entry(tmp_path, "127.0.0.1", Doorway(), told), Entered)
    assert (
        entry(tmp_path, "127.0.0.1", Doorway(open=True, proxies=("10.0.0.5",)), told)
        is Problem.NO_PASSWORD_SET
    )
