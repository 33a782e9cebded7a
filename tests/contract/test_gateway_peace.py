"""What a gateway does while a core serves: requests are written anew, in order, and answered."""

from pathlib import Path

from tests.contract.gateway_world import Call, world


def test_a_request_is_passed_to_the_serving_core(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        answer = w.ask("GET", "/api/x?y=1")
        assert answer.status == 200
        assert answer.json() == {"epoch": 1, "target": "/api/x?y=1"}


def test_the_epoch_is_not_shown_to_the_client(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        assert w.ask("GET", "/").header("X-Core-Epoch") is None
