"""What a browser's tab gets: pages with the script in them, the recovery page, and the gateway's own files."""

import gzip
import re
import socket
import threading
from pathlib import Path

import pytest

from tests.contract.gateway_world import Call, Client, Response, World, silent, world
from tests.waiting import until

A_TAB = (
    "Sec-Fetch-Mode: navigate",
    "Sec-Fetch-Dest: document",
    "Sec-Fetch-Site: none",
    "Accept: text/html,*/*",
)
A_SCRIPT = (
    "Sec-Fetch-Mode: cors",
    "Sec-Fetch-Dest: empty",
    "Sec-Fetch-Site: same-origin",
    "Accept: text/html",
)
TAG = b'<script type="module" src="/__hc/client.js"></script>'
PAGE = b"<!doctype html><html><head><title>t</title></head><body>b</body></html>"
TAGGED = PAGE.replace(b"</head>", TAG + b"</head>")
HTML = "Content-Type: text/html; charset=utf-8"
KO = "Accept-Language: ko"


def page(call: Call) -> None:
    call.answer(200, PAGE, headers=(HTML, 'ETag: "a"'))


def in_pieces(call: Call) -> None:
    """A page that comes byte by byte, and is long."""
    call.raw(
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\nX-Core-Epoch: 1\r\n" + HTML.encode() + b"\r\n\r\n"
    )
    call.raw(b"".join(b"1\r\n%c\r\n" % byte for byte in PAGE))
    rest = b"x" * (128 << 10)
    call.raw(b"%x\r\n%b\r\n0\r\n\r\n" % (len(rest), rest))


def rendered(w: World) -> None:
    """Until the gateway's own pages are there."""
    until(lambda: w.ask("GET", "/__hc/client.js").status == 200, "the gateway's pages to be rendered")


def shown(answer: Response) -> str:
    """The text of a page, unpacked."""
    packed = answer.header("Content-Encoding") == "gzip"
    return (gzip.decompress(answer.body) if packed else answer.body).decode()


def is_recovery_page(answer: Response) -> bool:
    policy = answer.header("Content-Security-Policy") or ""
    return answer.status == 503 and "script-src 'sha256-" in policy


# -- pages of the core -----------------------------------------------------------------------------------


def test_a_page_for_a_tab_gets_the_script_and_its_browser_a_name(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving(page)
        answer = w.ask("GET", "/", *A_TAB, "Accept-Encoding: gzip, br", 'If-None-Match: "a"')
        assert answer.body == TAGGED
        assert answer.header("ETag") is None
        named = re.fullmatch(
            r"__hc=([0-9a-f]{32}); Path=/; HttpOnly; SameSite=Lax", answer.header("Set-Cookie") or ""
        )
        assert named
        request = core.wait("/")[0].request
        assert (request.header("Accept-Encoding"), request.header("If-None-Match")) == (None, None)
        again = w.ask("GET", "/", *A_TAB, f"Cookie: __hc={named[1]}")
        assert (again.body, again.header("Set-Cookie")) == (TAGGED, None)


def test_two_browsers_never_get_the_same_name(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving(page)
        assert w.ask("GET", "/", *A_TAB).header("Set-Cookie") != w.ask("GET", "/", *A_TAB).header(
            "Set-Cookie"
        )


@pytest.mark.parametrize("asked", [A_SCRIPT, (), ("Accept: */*",)])
def test_what_a_program_asks_for_keeps_its_bytes(tmp_path: Path, asked: tuple[str, ...]) -> None:
    with world(tmp_path) as w:
        core = w.serving(page)
        answer = w.ask("GET", "/", *asked, "Accept-Encoding: gzip")
        assert (answer.body, answer.header("ETag"), answer.header("Set-Cookie")) == (PAGE, '"a"', None)
        assert core.wait("/")[0].request.header("Accept-Encoding") == "gzip"


@pytest.mark.parametrize(
    ("status", "headers"),
    [(200, ("Content-Type: text/csv",)), (200, (HTML, "Content-Encoding: gzip")), (206, (HTML,))],
)
def test_what_is_no_whole_plain_page_keeps_its_bytes(
    tmp_path: Path, status: int, headers: tuple[str, ...]
) -> None:
    with world(tmp_path) as w:
        w.serving(lambda call: call.answer(status, PAGE, headers=headers))
        answer = w.ask("GET", "/", *A_TAB)
        assert (answer.body, answer.header("Set-Cookie")) == (PAGE, None)


def test_a_page_that_comes_in_pieces_gets_the_script_in_one(tmp_path: Path) -> None:
    with world(tmp_path, answer_buffer_bytes_max=100) as w:
        w.serving(in_pieces)
        assert w.ask("GET", "/", *A_TAB).body == TAGGED + b"x" * (128 << 10)


def test_the_page_that_answers_a_form_gets_the_script_too(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving(lambda call: call.answer(422, PAGE, headers=(HTML,)))
        answer = w.ask("POST", "/form", *A_TAB, body=b"a=1")
        assert (answer.status, answer.body) == (422, TAGGED)


# -- the recovery page -----------------------------------------------------------------------------------


def test_a_tab_that_waited_gets_the_recovery_page_on_its_own_address(tmp_path: Path) -> None:
    with world(tmp_path, navigation_hold_ms=20) as w:
        w.holding()
        rendered(w)
        answer = w.ask("GET", "/accounts?x=1", *A_TAB, KO, "Accept-Encoding: gzip")
        assert is_recovery_page(answer)
        assert answer.header("Content-Type") == "text/html; charset=utf-8"
        assert answer.header("Retry-After") is not None
        assert answer.header("Cache-Control") == "no-store"
        assert answer.header("X-Content-Type-Options") == "nosniff"
        assert answer.header("Content-Language") == "ko"
        assert answer.header("Content-Encoding") == "gzip"
        assert len(answer.body) <= 20_000
        assert '<html lang="ko"' in shown(answer)
        policy = answer.header("Content-Security-Policy") or ""
        rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
        assert rules["default-src"] == rules["base-uri"] == rules["frame-ancestors"] == "'none'"
        assert rules["connect-src"] == rules["form-action"] == "'self'"
        assert re.fullmatch(r"'sha256-[\w+/]{43}='", rules["style-src"])


def test_the_language_chosen_on_a_page_is_that_of_the_recovery_page(tmp_path: Path) -> None:
    with world(tmp_path, navigation_hold_ms=0) as w:
        w.holding()
        rendered(w)
        assert w.ask("GET", "/", *A_TAB, KO, "Cookie: lang=en").header("Content-Language") == "en"
        assert '<html lang="ko"' in shown(w.ask("GET", "/", *A_TAB, "Cookie: lang=ko"))


def test_a_program_is_told_in_fields_what_a_tab_is_shown(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=20) as w:
        w.holding()
        answer = w.ask("GET", "/", *A_SCRIPT)
        assert answer.header("Content-Type") == "application/problem+json"
        assert answer.json()["outcome"] == "not_done"


@pytest.mark.parametrize("face", ["REFUSE", "CLOSED"])
def test_a_tab_does_not_wait_where_no_core_will_come(tmp_path: Path, face: str) -> None:
    with world(tmp_path, hold_ms=600_000, navigation_hold_ms=0) as w:
        w.holding()
        rendered(w)
        recovering = shown(w.ask("GET", "/", *A_TAB))
        w.feed.phase(face, phase="X", state="MANUAL_INTERVENTION")
        until(lambda: f"-> {face}".encode() in w.log.read_bytes(), "the gateway to have heard it")
        answer = w.ask("GET", "/", *A_TAB)
        assert is_recovery_page(answer)
        assert shown(answer) != recovering


def test_a_tab_that_waits_is_told_at_once_that_no_core_will_come(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=600_000, navigation_hold_ms=60_000) as w:
        w.holding()
        rendered(w)
        waiting = w.client().ask("GET", "/", *A_TAB)
        w.wait_held(1)
        w.feed.phase("REFUSE", phase="FATAL", state="MANUAL_INTERVENTION")
        assert is_recovery_page(waiting.read())


def test_a_planned_restart_is_told_as_one(tmp_path: Path) -> None:
    with world(tmp_path, navigation_hold_ms=20) as w:
        w.holding()
        rendered(w)
        unplanned = shown(w.ask("GET", "/", *A_TAB))
        w.feed.phase("HOLD", phase="STOPPING", state="RECOVERY", planned=True)
        until(lambda: shown(w.ask("GET", "/", *A_TAB)) != unplanned, "the page of a planned restart")


def test_a_form_that_waited_was_not_done_and_never_will_be(tmp_path: Path) -> None:
    with world(tmp_path, navigation_hold_ms=20) as w:
        w.holding()
        rendered(w)
        answer = w.ask("POST", "/entries", *A_TAB, "Origin: http://localhost", body=b"a=1")
        assert is_recovery_page(answer)
        assert shown(answer) != shown(w.ask("GET", "/entries", *A_TAB))
        core = w.core(2)
        w.feed.serve(core, incident="i1")
        (line,) = w.feed.wait("outcomes")
        assert [r["outcome"] for r in line["requests"] if r["method"] == "POST"] == ["not_done"]
        assert w.ask("GET", "/later").status == 200
        assert core.targets() == ["/later"]


def test_a_form_whose_core_died_is_shown_as_unknown(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving(silent)
        rendered(w)
        client = w.client().ask("POST", "/t", *A_TAB, body=b"a=1")
        core.wait("/t")
        w.die(core)
        unknown = client.read()
        assert is_recovery_page(unknown)
        not_done = w.ask("POST", "/t", *A_TAB, body=b"a=1")
        assert shown(unknown) != shown(not_done)


def test_a_page_that_was_at_a_core_when_it_died_comes_from_the_next(tmp_path: Path) -> None:
    with world(tmp_path, navigation_hold_ms=60_000) as w:
        first = w.serving(silent)
        client = w.client().ask("GET", "/t", *A_TAB)
        first.wait("/t")
        w.die(first)
        w.feed.serve(w.core(2, page))
        assert client.read().body == TAGGED


def test_a_page_that_was_at_a_core_waits_no_longer_than_another(tmp_path: Path) -> None:
    with world(tmp_path, hold_ms=600_000, navigation_hold_ms=20) as w:
        first = w.serving(silent)
        rendered(w)
        client = w.client().ask("GET", "/t", *A_TAB)
        first.wait("/t")
        w.die(first)
        assert is_recovery_page(client.read())


def test_a_fault_that_is_no_outage_is_a_bare_page(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving(lambda call: call.answer(200, PAGE, epoch=None, headers=(HTML,)))
        answer = w.ask("GET", "/", *A_TAB, KO)
        assert answer.status == 502
        assert answer.header("Content-Type") == "text/html; charset=utf-8"
        assert "<h1>서버의 응답이 온전하지 않아요</h1>" in answer.body.decode()
        assert "http-equiv" not in answer.body.decode()


# -- files of our own ------------------------------------------------------------------------------------


def test_what_is_asked_for_in_a_gateways_first_moment_is_there(tmp_path: Path) -> None:
    with world(tmp_path, "--demo") as w:
        w.feed.open()
        early = [w.client().ask("GET", path) for path in ("/__hc/client.js", "/__hc/demo", "/__hc/no.js")]
        w.start()  # they stand before its door when it opens
        assert [client.read().status for client in early] == [200, 200, 404]
        assert [client.ask("GET", "/__hc/client.js").read().status for client in early] == [200] * 3


def test_who_asked_early_and_left_keeps_nobody_else_waiting(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.feed.open()
        gone, early = (w.client().ask("GET", "/__hc/client.js") for _ in range(2))
        gone.socket.shutdown(socket.SHUT_RDWR)
        w.start()
        assert early.read().status == 200


def test_own_files_have_their_type_and_are_confirmed_by_their_tag(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.holding()
        rendered(w)
        answer = w.ask("GET", "/__hc/client.js")
        tag = answer.header("ETag")
        assert (answer.header("Content-Type"), answer.header("Cache-Control")) == (
            "text/javascript; charset=utf-8",
            "no-cache",
        )
        packed = w.ask("GET", "/__hc/client.js", "Accept-Encoding: gzip")
        assert gzip.decompress(packed.body) == answer.body
        assert packed.header("ETag") != tag
        same = w.ask("GET", "/__hc/client.js", f"If-None-Match: W/{tag}")
        assert (same.status, same.body, same.header("ETag")) == (304, b"", tag)
        assert w.ask("GET", "/__hc/client.js", 'If-None-Match: "other"').status == 200
        head = w.ask("HEAD", "/__hc/client.js")
        assert head.header("Content-Length") == str(len(answer.body))
        assert w.ask("GET", "/__hc/client.css").header("Content-Type") == "text/css; charset=utf-8"


@pytest.mark.parametrize(
    "path", ["/__hc/", "/__hc/nothing.js", "/__hc/../client.js", "/__hc/demo", "/__hc/drill/crash"]
)
def test_what_is_not_ours_is_not_found_and_never_reaches_a_core(tmp_path: Path, path: str) -> None:
    with world(tmp_path) as w:
        core = w.serving()
        for method in ("GET", "POST"):
            if (method, path[:12]) != ("POST", "/__hc/drill/"):
                assert w.ask(method, path, body=None if method == "GET" else b"").status in {404, 405}
        assert core.targets() == []


def test_own_files_are_served_while_everything_else_waits_or_is_refused(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving(silent)
        rendered(w)
        w.client().ask("GET", "/slow")
        core.wait("/slow")
        for face in ("HOLD", "REFUSE", "CLOSED"):
            w.feed.phase(face)
            assert w.ask("GET", "/__hc/client.js").status == 200


# -- the demo's door -------------------------------------------------------------------------------------


def test_a_demo_asks_the_guard_to_break_the_core(tmp_path: Path) -> None:
    with world(tmp_path, "--demo") as w:
        w.serving()
        answer = w.ask(
            "POST", "/__hc/drill/freeze", "Origin: http://localhost", "Sec-Fetch-Site: same-origin", body=b""
        )
        assert (answer.status, answer.json()) == (202, {"ok": True, "fault": "freeze"})
        assert w.feed.orders.all() == [{"verb": "drill", "fault": "freeze", "yes": True}]


def test_only_a_demo_has_a_door_for_drills(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving()
        answer = w.ask("POST", "/__hc/drill/crash", body=b"")
        assert (answer.status, answer.json()["type"]) == (404, "/problems/not-found")
        assert w.feed.orders.all() == []


@pytest.mark.parametrize(
    "said", [("Origin: http://evil.example",), ("Sec-Fetch-Site: cross-site",), ("Origin: null",)]
)
def test_another_sites_page_cannot_break_the_core(tmp_path: Path, said: tuple[str, ...]) -> None:
    with world(tmp_path, "--demo") as w:
        w.serving()
        assert w.ask("POST", "/__hc/drill/crash", *said, body=b"").status == 403
        assert w.feed.orders.all() == []


def test_a_drill_is_asked_for_by_its_name_and_never_by_a_link(tmp_path: Path) -> None:
    with world(tmp_path, "--demo") as w:
        w.serving()
        assert w.ask("GET", "/__hc/drill/crash").status == 405
        assert w.ask("POST", "/__hc/drill/format", body=b"").status == 404
        assert w.feed.orders.all() == []


def test_a_guard_that_refuses_a_drill_or_is_away_is_told_as_that(tmp_path: Path) -> None:
    with world(tmp_path, "--demo") as w:
        w.serving()
        w.feed.says = {"ok": False, "code": "not-running", "error": "It restarts."}
        refused = w.ask("POST", "/__hc/drill/crash", body=b"")
        assert (refused.status, refused.json()["reason"]) == (409, "not-running")
        w.feed.says = None
        assert w.ask("POST", "/__hc/drill/crash", body=b"").json()["type"] == "/problems/guard-away"
        w.feed.close()
        w.feed.path.unlink()
        assert w.ask("POST", "/__hc/drill/crash", body=b"").status == 503


# -- uploads ---------------------------------------------------------------------------------------------


def send_slowly(client: Client, size: int, pieces: int, pause_s: float) -> None:
    """As a browser on a busy machine: it looks for no answer until all is sent."""
    pause = threading.Event()
    client.send(f"POST /upload HTTP/1.1\r\nHost: localhost\r\nContent-Length: {size}\r\n\r\n".encode())
    for _ in range(pieces):
        client.send(bytes(size // pieces))
        pause.wait(pause_s)


@pytest.mark.parametrize(("pieces", "pause_s"), [(50, 0), (60, 0.025)])
def test_a_file_that_is_too_large_is_answered_though_its_sender_reads_only_at_the_end(
    tmp_path: Path, pieces: int, pause_s: float
) -> None:
    with world(tmp_path, linger_ms=1_000) as w:
        core = w.serving()
        client = w.client()
        send_slowly(client, 60_000_000, pieces, pause_s)
        answer = client.read()
        assert (answer.status, answer.json()["type"]) == (413, "/problems/body-too-large")
        assert core.targets() == []


def test_a_sender_that_never_ends_is_heard_out_for_a_time_only(tmp_path: Path) -> None:
    with world(tmp_path, linger_total_ms=200) as w:
        w.serving()
        client = w.client()
        with pytest.raises(OSError, match=r"Broken pipe|reset"):
            send_slowly(client, 1 << 50, 1 << 50, 0.001)
