"""The investigators' gate where a password is set: what can't be taken back asks for it again."""

import asyncio
from typing import Any

import pytest
from starlette.types import Receive, Scope, Send

from postmortem.gate import Gate

TOKEN = "t" * 8
LETTER = "/admin/dlq/01J/discard"


async def _page(_scope: Scope, _receive: Receive, send: Send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b""})


def ask(method: str, path: str, **headers: str) -> tuple[int, dict[str, str]]:
    """Ask the gate; headers with dashes are written with underscores."""
    told = {"x_admin": "1", "x_csrf": TOKEN, "sec_fetch_site": "same-origin", **headers}
    scope = {
        "type": "http",
        "method": method,
        "path": path,
        "headers": [(name.replace("_", "-").encode(), value.encode()) for name, value in told.items()],
    }
    said: list[Any] = []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Any) -> None:
        said.append(message)

    asyncio.run(Gate(_page, TOKEN)(scope, receive, send))
    return said[0]["status"], {name.decode(): value.decode() for name, value in said[0]["headers"]}


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", LETTER),
        ("POST", "/admin/dlq/bulk"),
        ("POST", "/admin/restart"),
        ("POST", "/admin/restart\n"),
        ("POST", "/admin/incidents/i/reveal"),
        ("POST", "/admin/incidents/i/remove"),
        ("GET", "/admin/incidents/i/bundle"),
        ("GET", "/admin/dlq/01J/payload"),
        ("GET", "/admin/incidents/i/export.json"),
    ],
)
def test_what_cannot_be_taken_back_or_is_private_asks_for_the_password_again(method: str, path: str) -> None:
    status, headers = ask(
        method, path, x_proven="0", accept="text/html", referer="http://t/admin/dlq/01J?x=1"
    )
    back = path if method == "GET" else "/admin/dlq/01J"
    assert (status, headers["location"]) == (303, f"/__hc/sign-in?again=1&to={back.replace('/', '%2F')}")
    assert ask(method, path, x_proven="1")[0] == 200
    assert ask(method, path)[0] == 200, "where no password is set"


def test_a_program_is_told_and_not_led_anywhere() -> None:
    assert ask("POST", "/admin/api/letters/01J/discard", x_proven="0", accept="application/json")[0] == 403


def test_nobody_is_led_out_of_the_dashboard() -> None:
    _, headers = ask("POST", LETTER, x_proven="0", accept="text/html", referer="http://elsewhere.example/x")
    assert headers["location"].endswith("to=%2Fadmin%2F")


@pytest.mark.parametrize("path", ["/admin/", "/admin/dlq", LETTER.replace("/discard", ""), "/admin/policy"])
def test_looking_asks_for_nothing_more(path: str) -> None:
    assert ask("GET", path, x_proven="0")[0] == 200
