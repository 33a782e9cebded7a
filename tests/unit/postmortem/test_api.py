"""What programs may ask of `/admin/api/`, and what they are told."""

import json
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette

from postmortem.api import Api, routes
from postmortem.guard_line import GuardLine
from postmortem.web.places import Places
from tests.unit.postmortem.web_archive import LETTER_ID, Acts, Answer, Archive, Visitor, letter

BULK = "letters/bulk"
LETTER = f"letters/{LETTER_ID}"


class Program(Visitor):
    """Somebody who asks the addresses for programs."""

    def app(self) -> Starlette:
        async def ask_guard(_: object) -> None:
            return None

        async def write_down(*words: str) -> None:
            self.written.append((words[0], words[1], words[2], words[3]))

        places = Places(self.folder, self.folder, "token", ask_guard, write_down, "0.0")
        api = Api(self.archive, Acts(self.archive), places, GuardLine(self.folder / "none.sock"))
        return Starlette(routes=routes(api))

    def tell(self, path: str, told: Any) -> Answer:
        return self._send("POST", f"/admin/api/{path}", json.dumps(told).encode(), [])

    def ask(self, path: str) -> Answer:
        return self.get(f"/admin/api/{path}")


@pytest.fixture
def program(tmp_path: Path) -> Program:
    return Program(tmp_path, Archive(kept=[letter()]))


@pytest.mark.parametrize(
    "where",
    [
        {},
        {"acount": "assets:gone"},
        {"state": 5},
        {"account": ["x"]},
        {"state": "QUARANTINED", "acount": "x"},
        {"state": "QUARANTINED", "drills": "perhaps"},
        {"account": ""},
        {"drills": False},
        {"account": "\ud800"},
        "all",
        None,
    ],
)
def test_a_filter_that_is_not_understood_whole_means_no_letter_at_all(
    program: Program, where: object
) -> None:
    answer = program.tell(BULK, {"verb": "discard", "where": where, "reason": "old"})
    assert answer.status == 400
    assert program.archive.done == []


@pytest.mark.parametrize(
    ("path", "told"),
    [
        (BULK, {"verb": "hold", "ids": [LETTER_ID, 5]}),
        (BULK, {"verb": "hold", "ids": [LETTER_ID], "where": {"state": "HELD"}}),
        (BULK, {"verb": "hold", "where": {"state": "HELD"}, "reson": "x"}),
        (BULK, {"verb": ["hold"], "ids": [LETTER_ID]}),
        (f"{LETTER}/discard", {"reason": 5}),
        (f"{LETTER}/discard", {"reason": "old", "force": True}),
        (f"{LETTER}/retry", {"anyway": "yes please"}),
        (f"{LETTER}/retry", {"any_way": True}),
        (f"{LETTER}/hold", {"reason": "x"}),
        (f"{LETTER}/note", ["x"]),
        ("groups/f/merge", {"into": "\ud800"}),
        ("groups/f/split", {"incidnet": "x"}),
        ("proposals/p-1/accept", {"owner": {}}),
    ],
)
def test_a_body_that_is_not_understood_whole_does_nothing(program: Program, path: str, told: object) -> None:
    assert program.tell(path, told).status == 400
    assert program.archive.done == []


def test_a_list_is_not_narrowed_by_a_name_that_nobody_knows(program: Program) -> None:
    assert program.ask("letters?acount=assets:gone").status == 400
    assert json.loads(program.ask("letters?state=QUARANTINED&drills=0&limit=5&lang=ko").body)["total"] == 1


def test_a_filter_that_is_understood_means_what_it_says(program: Program) -> None:
    answer = program.tell(BULK, {"verb": "hold", "where": {"state": "QUARANTINED", "drills": "0"}})
    assert answer.status == 202
    (_, verb, wanted, _) = program.archive.done[0]
    assert (verb, wanted.state, wanted.drills) == ("hold", "QUARANTINED", False)


def test_the_secrets_of_a_letter_are_shown_once_that_is_written_down(program: Program) -> None:
    program.archive.kept[0] = letter(payload={"password": "c4nary"}, path="/x?token=c4nary")
    for path in (LETTER, "letters"):
        assert "c4nary" not in program.ask(path).text
    assert program.written == []
    assert "c4nary" in program.tell(f"{LETTER}/reveal", {}).text
    assert program.written == [("reveal", f"letter {LETTER_ID}", "", "shown")]
    assert program.tell("letters/unknown/reveal", {}).status == 404
    assert len(program.written) == 1
