"""The gateway as the second witness: which commit it passed on, told to the sentinel and to nobody else."""

from pathlib import Path

from tests.contract.gateway_world import Call, World, world

HASHES = [f"{number:064x}" for number in range(10)]


class Booking:
    """A core's script: it says that it committed `seq`."""

    def __init__(self, seq: int) -> None:
        self.seq = seq

    def __call__(self, call: Call) -> None:
        said = f"X-Core-Commit: {self.seq}:{HASHES[self.seq]}"
        call.answer(201, b"{}", headers=(said,))


def _told(w: World) -> list[tuple[int, int, str]]:
    return [
        (line["epoch"], line["seq"], line["hash"]) for line in w.feed.heard.all() if line["type"] == "witness"
    ]


def test_a_commit_that_was_passed_on_is_told_to_the_sentinel_and_not_to_the_client(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        w.serving(Booking(5))
        answer = w.ask("POST", "/t", body=b"")
        assert answer.status == 201
        assert answer.header("X-Core-Commit") is None
        w.feed.wait("witness")
        assert _told(w) == [(1, 5, HASHES[5])]


def test_a_form_that_was_done_and_leads_on_stands_for_its_commit(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        said = ("Location: /", f"X-Core-Commit: 5:{HASHES[5]}")
        w.serving(lambda call: call.answer(303, b"", headers=said))
        assert w.ask("POST", "/t", body=b"").status == 303
        w.feed.wait("witness")
        assert _told(w) == [(1, 5, HASHES[5])]


def test_only_the_highest_commit_is_told(tmp_path: Path) -> None:
    with world(tmp_path, witness_ms=0) as w:
        core = w.serving(Booking(5))
        w.ask("POST", "/t", body=b"")
        core.script = Booking(3)
        w.ask("POST", "/t", body=b"")
        core.script = Booking(7)
        w.ask("POST", "/t", body=b"")
        w.feed.wait("witness", lambda line: line["seq"] == 7)
        assert _told(w) == [(1, 5, HASHES[5]), (1, 7, HASHES[7])]


def test_what_was_not_told_yet_is_told_before_the_gateway_holds(tmp_path: Path) -> None:
    with world(tmp_path, witness_ms=60_000) as w:
        core = w.serving(Booking(1))
        for seq in (1, 2, 3):
            core.script = Booking(seq)
            w.ask("POST", "/t", body=b"")
        w.die(core)
        w.feed.wait("holding", count=2)
        kinds = [line["type"] for line in w.feed.heard.all() if line["type"] in {"witness", "holding"}]
        assert kinds[-2:] == ["witness", "holding"]
        assert _told(w) == [(1, 1, HASHES[1]), (1, 3, HASHES[3])]


def test_a_sentinel_that_has_just_begun_hears_the_last_commit_again(tmp_path: Path) -> None:
    with world(tmp_path) as w:
        core = w.serving(Booking(4))
        w.ask("POST", "/t", body=b"")
        w.feed.wait("witness")
        w.feed.generation = 2
        w.feed.serve(core)
        w.feed.wait("witness", count=2)
        assert _told(w) == [(1, 4, HASHES[4])] * 2


def test_a_commit_of_an_answer_that_was_no_success_or_that_nobody_can_read_is_none(tmp_path: Path) -> None:
    def odd(call: Call) -> None:
        call.answer(200, b"{}", headers=("X-Core-Commit: seven:abc",))

    def failed(call: Call) -> None:
        call.answer(409, b"{}", headers=(f"X-Core-Commit: 6:{HASHES[6]}",))

    with world(tmp_path, witness_ms=0) as w:
        core = w.serving(odd)
        assert w.ask("POST", "/t", body=b"").status == 200
        core.script = failed
        assert w.ask("POST", "/t", body=b"").status == 409
        core.script = Booking(2)
        w.ask("POST", "/t", body=b"")
        w.feed.wait("witness")
        assert _told(w) == [(1, 2, HASHES[2])]
