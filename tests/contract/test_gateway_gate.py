"""The gate over the wire: who may come in once a password is set, from the form to the cookie to the core's request."""

import contextlib
import http.client
import json
import re
import socket
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlencode

import pytest

from hardcore.access import files, passwords
from hardcore.access.doorway import Doorway
from hardcore.access.people import OWNER, Invitation, People, Person, Scope, Token, digest_of
from tests.contract.gateway_world import Core, Request, Response, World, echo, world
from tests.waiting import until

PASSWORD = "canary-long-enough"
WRITES = "fst_writes"
READS = "fst_reads"
#: As costs nothing: the cost is the library's own matter.
OWNERS = Person(OWNER, passwords.kept(PASSWORD))
MEMBERS = Person("mina", passwords.kept(PASSWORD + "2"))
PEOPLE = People(
    (OWNERS, MEMBERS),
    (
        Token("script", digest_of(WRITES), Scope.WRITE, "2026-01-01T00:00:00Z"),
        Token("viewer", digest_of(READS), Scope.READ, "2026-01-01T00:00:00Z"),
    ),
)
OWN = "Sec-Fetch-Site: same-origin"
TAB = ("Accept: text/html", "Sec-Fetch-Mode: navigate", "Sec-Fetch-Dest: document")
FORM = "Content-Type: application/x-www-form-urlencoded"


@pytest.fixture
def made(tmp_path: Path) -> Path:
    state = tmp_path / "state"
    state.mkdir()
    files.write_people(state, PEOPLE)
    return tmp_path


def options(folder: Path) -> tuple[str, ...]:
    return ("--state", str(folder / "state"), "--own-door", str(folder / "own.sock"))


@pytest.fixture
def gate(made: Path) -> Iterator[World]:
    with world(made, *options(made), paper_after_ms=0, access_look_ms=5, stats_ms=20) as one:
        yield one


def asked(core: Core) -> list[Request]:
    """What the core was asked, but for how it is."""
    return [call.request for call in core.calls.all() if call.request.target != "/healthz"]


def sign_in(gate: World, name: str = OWNER, password: str = PASSWORD, **more: str) -> Response:
    body = urlencode({"name": name, "password": password, **more}).encode()
    return gate.ask("POST", "/__hc/sign-in", OWN, FORM, *TAB, body=body)


def cookie(answer: Response) -> str:
    found = re.match(
        r"(hc-session=[\w-]{43}); Path=/; HttpOnly; SameSite=Strict$", answer.header("Set-Cookie") or ""
    )
    assert found is not None, answer
    return f"Cookie: {found[1]}"


def test_nobody_comes_in_without_a_session_or_a_token(gate: World) -> None:
    core = gate.serving(echo)
    page = gate.ask("GET", "/register?q=1", *TAB)
    assert (page.status, page.header("Cache-Control")) == (401, "no-store")
    assert b'action="/__hc/sign-in"' in page.body
    assert b'name="to" value="/register?q=1"' in page.body
    told = gate.ask("POST", "/api/ledger/transactions", OWN, body=b"{}")
    assert (told.status, told.json()["type"]) == (401, "/problems/sign-in-needed")
    assert gate.ask("GET", "/__hc/status.json").status == 401
    assert gate.ask("GET", "/admin/", *TAB).status == 401
    assert not asked(core)


def test_what_holds_no_word_of_the_ledger_is_answered_to_everybody(gate: World) -> None:
    gate.serving(echo)
    assert gate.ask("GET", "/livez").status == 200
    assert gate.ask("GET", "/readyz").status == 200
    assert gate.ask("GET", "/__hc/client.css").status == 200


def test_who_signs_in_is_led_back_and_the_core_hears_a_name_and_no_cookie(gate: World) -> None:
    core = gate.serving(echo)
    answer = sign_in(gate, to="/register")
    assert (answer.status, answer.header("Location")) == (303, "/register")
    held = cookie(answer)
    assert gate.ask("GET", "/register", f"{held}; lang=ko", "X-Actor: somebody", *TAB).status == 200
    (heard,) = asked(core)
    told = [(name, value) for name, value in heard.headers if name.lower() in {"x-actor", "cookie"}]
    assert told == [("Cookie", "lang=ko"), ("X-Actor", "owner")]


def test_a_wrong_password_and_an_unknown_name_are_answered_alike(gate: World) -> None:
    gate.serving(echo)
    wrong, unknown = sign_in(gate, password="no"), sign_in(gate, name="nobody", password="no")
    assert wrong.status == unknown.status == 401
    assert wrong.header("Set-Cookie") is None
    assert wrong.body.replace(b'value="owner"', b"") == unknown.body.replace(b'value="nobody"', b"")


def test_who_guesses_waits_and_the_right_password_is_not_tried_either(made: Path) -> None:
    limits = {"sign_in_tries_max": 2, "sign_in_every_ms": 3_600_000, "paper_after_ms": 0}
    with world(made, *options(made), **limits) as gate:
        gate.serving(echo)
        assert [sign_in(gate, password="no").status for _ in range(2)] == [401, 401]
        late = sign_in(gate)
        assert late.status == 429
        assert int(late.header("Retry-After") or 0) > 0


def test_a_password_that_is_led_elsewhere_stays_here(gate: World) -> None:
    gate.serving(echo)
    for to in ("//elsewhere.example", "/\\elsewhere.example", "https://elsewhere.example", "/__hc/sign-in"):
        assert sign_in(gate, to=to).header("Location") == "/"


def test_with_a_cookie_only_a_page_of_ours_changes_anything(gate: World) -> None:
    core = gate.serving(echo)
    held = cookie(sign_in(gate))
    for silent in ((), ("Sec-Fetch-Site: none",)):
        refused = gate.ask("POST", "/api/ledger/transactions", held, *silent, body=b"{}")
        assert (refused.status, refused.json()["type"]) == (403, "/problems/foreign-page")
    assert not asked(core)
    assert gate.ask("POST", "/api/ledger/transactions", held, OWN, body=b"{}").status == 200
    origin = "Origin: http://localhost"
    assert gate.ask("POST", "/api/ledger/transactions", held, origin, body=b"{}").status == 200


def test_a_session_outlives_the_core_and_the_gateway(made: Path) -> None:
    with world(made, *options(made), paper_after_ms=0) as gate:
        core = gate.serving(echo)
        held = cookie(sign_in(gate))
        gate.die(core)
        gate.feed.wait("holding")
        assert gate.ask("GET", "/__hc/me", held).json()["name"] == OWNER
        until((made / "state" / files.SESSIONS).exists, "the session to be kept")
    with world(made, *options(made), paper_after_ms=0) as gate:
        gate.serving(echo)
        assert gate.ask("GET", "/__hc/me", held).json()["name"] == OWNER


def test_who_signs_out_is_out_everywhere(gate: World) -> None:
    gate.serving(echo)
    held = cookie(sign_in(gate))
    assert gate.ask("POST", "/__hc/sign-out", held, body=b"").status == 403, "another page can't do it"
    out = gate.ask("POST", "/__hc/sign-out", held, OWN, *TAB, body=b"")
    assert (out.status, out.header("Clear-Site-Data")) == (303, '"storage"')
    assert gate.ask("GET", "/__hc/me", held).status == 401


def test_a_new_password_ends_the_sessions_of_the_old_one(gate: World, made: Path) -> None:
    gate.serving(echo)
    held, other = cookie(sign_in(gate)), cookie(sign_in(gate, "mina", PASSWORD + "2"))
    files.write_people(made / "state", PEOPLE.with_person(Person(OWNER, passwords.kept("another-one"))))
    until(lambda: gate.ask("GET", "/__hc/me", held).status == 401, "the change to be seen")
    assert gate.ask("GET", "/__hc/me", other).status == 200


def test_a_member_of_the_household_is_no_administrator(gate: World) -> None:
    gate.serving(echo)
    held = cookie(sign_in(gate, "mina", PASSWORD + "2"))
    assert gate.ask("GET", "/register", held).status == 200
    assert gate.ask("GET", "/admin/", held).json()["type"] == "/problems/not-allowed"


def test_a_token_does_what_it_was_made_for(gate: World) -> None:
    core = gate.serving(echo)
    writes, reads = f"Authorization: Bearer {WRITES}", f"Authorization: Bearer {READS}"
    assert gate.ask("POST", "/t", writes, body=b"x").status == 200
    assert gate.ask("GET", "/t", reads).status == 200
    assert gate.ask("POST", "/t", reads, body=b"x").json()["type"] == "/problems/not-allowed"
    assert gate.ask("GET", "/admin/", writes).status == 403
    wrong = gate.ask("GET", "/t", "Authorization: Bearer fst_none")
    assert (wrong.status, wrong.header("WWW-Authenticate")) == (401, "Bearer")
    assert [one.header("authorization") for one in asked(core)] == [None, None]


def test_no_page_opens_a_socket_without_a_session(gate: World) -> None:
    gate.serving(echo)
    shake = (
        "Connection: Upgrade",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
    )
    for path in ("/__hc/live", "/ws"):
        assert gate.ask("GET", path, *shake).status == 401
    held = cookie(sign_in(gate))
    assert gate.client().ask("GET", "/__hc/live", held, *shake).read(head=True).status == 101


def test_an_invitation_sets_a_password_once(gate: World, made: Path) -> None:
    gate.serving(echo)
    files.write_people(made / "state", PEOPLE.with_invitation(Invitation("joon", digest_of("key"), 1 << 40)))
    until(
        lambda: b'value="joon"' in gate.ask("GET", "/__hc/invited?key=key", *TAB).body,
        "the invitation to be seen",
    )

    def choose(password: str, again: str) -> Response:
        body = urlencode({"key": "key", "password": password, "again": again}).encode()
        return gate.ask("POST", "/__hc/invited", OWN, FORM, *TAB, body=body)

    assert choose("short", "short").status == 422
    assert choose("long enough", "long enougH").status == 422
    held = cookie(choose("long enough", "long enough"))
    assert gate.ask("GET", "/__hc/me", held).json()["name"] == "joon"
    assert choose("long enough", "long enough").status == 410
    assert sign_in(gate, "joon", "long enough").status == 303


def test_the_owners_own_programs_come_by_a_socket_that_nobody_else_may_open(gate: World, made: Path) -> None:
    gate.serving(echo)
    assert (made / "own.sock").stat().st_mode & 0o777 == 0o600
    own = http.client.HTTPConnection("localhost")
    own.sock = socket.socket(socket.AF_UNIX)
    with contextlib.closing(own.sock):
        own.sock.connect(str(made / "own.sock"))
        own.request("GET", "/api/ledger/accounts")
        assert own.getresponse().status == 200


def test_a_list_that_cannot_be_read_lets_nobody_in(gate: World, made: Path) -> None:
    gate.serving(echo)
    (made / "state" / files.PEOPLE).write_bytes(b"{")
    until(lambda: gate.ask("GET", "/t").status == 503, "the change to be seen")
    assert gate.ask("GET", "/t").json()["type"] == "/problems/access-unreadable"
    assert gate.ask("GET", "/t", f"Authorization: Bearer {WRITES}").status == 503


def test_behind_a_proxy_its_word_counts_and_nobody_elses(made: Path) -> None:
    files.write_doorway(made / "state", Doorway(open=True, proxies=("127.0.0.1",), names=("money.example",)))
    with world(
        made, *options(made), paper_after_ms=0, sign_in_tries_max=1, sign_in_every_ms=3_600_000
    ) as gate:
        gate.serving(echo)
        https, client = "X-Forwarded-Proto: https", "X-Forwarded-For: 203.0.113.9, 198.51.100.7"
        body = urlencode({"name": OWNER, "password": PASSWORD}).encode()
        answer = gate.ask("POST", "/__hc/sign-in", OWN, FORM, https, client, body=body)
        assert (answer.header("Set-Cookie") or "").startswith("__Host-hc-session=")
        assert "Secure" in (answer.header("Set-Cookie") or "")


def test_after_a_password_was_taken_away_again_an_open_door_serves_nobody_from_outside(made: Path) -> None:
    files.write_people(made / "state", People())
    files.write_doorway(made / "state", Doorway(open=True, proxies=("127.0.0.1",)))
    with world(made, *options(made)) as gate:
        gate.serving(echo)
        refused = gate.ask("GET", "/t", "X-Forwarded-For: 203.0.113.9")
        assert (refused.status, json.loads(refused.body)["type"]) == (403, "/problems/no-password-set")
        assert gate.ask("GET", "/t").status == 200, "this machine is served as before"


def test_nothing_of_a_strangers_body_is_kept(made: Path) -> None:
    """Strangers that send slowly must not take the room of whoever waits in an outage."""
    with world(made, *options(made), hold_bytes_max=40_000, paper_after_ms=0) as gate:
        core = gate.serving(echo)
        for path in ("/t", "/__hc/sign-in"):
            stranger = gate.client()
            stranger.send(f"POST {path} HTTP/1.1\r\nHost: localhost\r\n".encode())
            stranger.send(b"Content-Length: 39000\r\n\r\n" + b"x" * 20_000)  # and no more, for now
        held = cookie(sign_in(gate))
        answer = gate.ask("POST", "/t", held, OWN, body=b"y" * 30_000)
        assert answer.status == 200
        assert [len(one.body) for one in asked(core)] == [30_000]


def test_an_invitation_that_two_tabs_use_at_once_is_used_once(gate: World, made: Path) -> None:
    gate.serving(echo)
    files.write_people(made / "state", PEOPLE.with_invitation(Invitation("joon", digest_of("key"), 1 << 40)))
    until(lambda: b'value="joon"' in gate.ask("GET", "/__hc/invited?key=key", *TAB).body, "it to be seen")
    body = urlencode({"key": "key", "password": "long enough", "again": "long enough"}).encode()
    clients = [gate.client().ask("POST", "/__hc/invited", OWN, FORM, body=body) for _ in range(2)]
    assert sorted(client.read().status for client in clients) == [303, 410]


def test_what_says_who_somebody_is_is_the_gateways_to_say(gate: World) -> None:
    core = gate.serving(echo)
    token = f"Authorization: Bearer {WRITES}"
    assert gate.ask("GET", "/t", token, "X-Actor: owner", "X-Admin: 1", "X-Proven: 1").status == 200
    (heard,) = asked(core)
    assert [heard.header(name) for name in ("X-Actor", "X-Admin", "X-Proven")] == ["token:script", None, None]


@pytest.mark.parametrize(
    "target", ["//admin/", "/%61dmin/", "/__hc/../admin/", "/ADMIN/", "/admin%2f", "/__hc%2fme"]
)
def test_no_spelling_of_an_address_leads_around_the_gate(gate: World, target: str) -> None:
    core = gate.serving(echo)
    assert gate.ask("GET", target).status in {401, 404}
    assert not asked(core)


def test_who_changes_something_in_a_gateways_first_moment_is_let_in_once(made: Path) -> None:
    """It waits until the receipts are read, and no longer says what opened the door: nobody asks for that again."""
    with world(made, *options(made), "--receipts", str(made / "receipts.db"), paper_after_ms=0) as gate:
        token = f"Authorization: Bearer {WRITES}"
        early = [
            gate.client().ask("POST", "/t", token, f"Idempotency-Key: k{n}", body=b"{}") for n in range(3)
        ]
        core = gate.serving(echo)  # they stand before its door when it opens
        assert [client.read().status for client in early] == [200] * 3
        assert [one.header("X-Actor") for one in asked(core)] == ["token:script"] * 3
