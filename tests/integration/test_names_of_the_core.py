"""Under which names a core that runs alone is asked, over real HTTP."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.integration.lone_core import Core, ready, started


@pytest.fixture
def core(tmp_path: Path) -> Iterator[Core]:
    with started(tmp_path / "data") as made:
        ready(made).open("bank")
        yield made


def told(core: Core, method: str, path: str, host: str, **headers: str) -> tuple[int, str]:
    answer = core.ask(method, path, None, Host=host, Accept="*/*", **headers)
    return answer.status, str(answer.body.get("type", "")) if isinstance(answer.body, dict) else ""


@pytest.mark.parametrize(
    "name", ["evil.example", "127.0.0.1.evil.example", "localhost.evil", "evil@127.0.0.1"]
)
def test_a_name_that_was_made_to_point_here_is_answered_nothing(core: Core, name: str) -> None:
    host = f"{name}:{core.port}"
    refused = (403, "/problems/foreign-page")
    for path in (
        "/api/ledger/accounts",
        "/api/ledger/summary",
        "/api/ledger/events",
        "/api/openapi.json",
        "/healthz",
        "/",
    ):
        assert told(core, "GET", path, host) == refused, path
    # Both agree with each other, as they do in a browser that was deceived.
    own = {"Origin": f"http://{host}", "Sec_Fetch_Site": "same-origin"}
    for method, path in (
        ("POST", "/api/ledger/accounts/bank/close"),
        ("POST", "/start"),
        ("PUT", f"/api/ledger/entries/{'0' * 36}"),
        ("DELETE", f"/api/ledger/entries/{'0' * 36}"),
        ("POST", "/api/ledger/imports"),
    ):
        assert told(core, method, path, host, **own) == refused, (method, path)
        assert told(core, method, path, host) == refused, (method, path)
    assert core.ask("GET", "/api/ledger/accounts/bank").body["closed"] is False


def test_this_machines_own_names_are_answered_and_links_from_elsewhere_too(core: Core) -> None:
    for name in ("127.0.0.1", "localhost", "LOCALHOST", "[::1]"):
        host = f"{name}:{core.port}"
        assert told(core, "GET", "/api/ledger/accounts", host)[0] == 200
        assert told(core, "GET", "/healthz", host, Sec_Fetch_Site="cross-site")[0] == 200
        own = {"Origin": f"http://{host.lower()}"}
        assert told(core, "POST", "/api/ledger/accounts/nobody/close", host, **own)[0] == 422


def test_on_the_socket_of_its_life_whoever_may_open_it_has_judged(tmp_path: Path) -> None:
    path = tmp_path / "core.sock"
    with started(tmp_path / "data", sock=path) as core:
        ready(core)
        assert told(core, "GET", "/healthz", "ledger.example")[0] == 200
        assert told(core, "POST", "/api/ledger/accounts/nobody/close", "ledger.example")[0] == 422
