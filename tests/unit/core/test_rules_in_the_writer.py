"""The guard's rules where commands are carried out: marked accounts, entries that are left out, what is done already."""

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

from core.guarded.poison import name_of
from core.guarded.quarantine import Quarantine
from core.journal import queries
from core.journal.answers import Answer, Done, KeyTaken, Limited, ReadOnly, SetAside
from core.journal.store import LEDGER_FILE, open_reading
from core.ledger.commands import Command, fingerprint_of
from core.rulings import Rulings
from core.service import Service
from core.settings import Settings
from tests.unit.core.books import Pen, closing, entering, moving, opening, order, pen, replacing, reversing
from tests.unit.core.test_writer import Heard, writing

DIGEST = b"\x0b" * 32


def rule(quarantine: Quarantine, *rules: Any) -> None:
    assert quarantine.path is not None
    quarantine.path.write_text(json.dumps({"version": 1, "serial": 1, "rules": rules}))
    assert quarantine.read() is None


def parked(seq: int, *accounts: str) -> dict[str, Any]:
    return {"id": "L", "type": "parked", "seq": seq, "account_ids": accounts}


def limit(**named: Any) -> dict[str, Any]:
    return {"id": "R", "type": "limit", "kind": "test", "per_minute": None, "body_bytes_max": None, **named}


def letter(name: str, **named: Any) -> dict[str, Any]:
    return {"id": "L", "type": "letter", "name": name, "reason": "CRASHED_CORE", **named}


def ruled(made: Pen, path: Path, *rules: Any) -> None:
    made.journal._quarantine = Quarantine(path / "rules.json")
    rule(made.journal._quarantine, *rules)


def test_nothing_is_booked_on_a_marked_account_and_everything_else_is(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(*[opening(name) for name in "abc"], moving(1, "a", "b"))
        ruled(made, tmp_path, parked(4, "a"))
        moved, beside, closed = made.carry_out(moving(2, "a", "b"), moving(3, "c", "b"), closing("a"))
        assert (moved, closed) == (SetAside("L", "a"), SetAside("L", "a"))
        assert isinstance(beside, Done)


def test_an_account_that_is_only_named_by_a_word_is_marked_as_well(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("bank"), entering("-5", category="food"))
        food = next(one.id for one in queries.all_accounts(made.connection) if one.id != "bank")
        ruled(made, tmp_path, parked(3, food))
        again, beside = made.carry_out(entering("-6", category="food"), entering("-6", category="rent"))
        assert again == SetAside("L", food)
        assert isinstance(beside, Done)


def test_an_entry_that_stands_in_a_parked_event_is_not_even_read_for_a_change(tmp_path: Path) -> None:
    with pen(tmp_path) as made:
        entry = entering("-5", category="food")
        made.carry_out(opening("bank"))
        made.write(order(entry, "k"))
        ruled(made, tmp_path, parked(made.journal.head_seq))
        assert made.carry_out(replacing(entry.id, "-7"), reversing(entry.id)) == (
            SetAside("L"),
            SetAside("L"),
        )
        assert isinstance(made.write(order(entry, "k"))[0], Done), "what is done is told again"


def test_what_was_set_aside_leaves_nothing_under_its_key_and_runs_once_the_rule_is_gone(
    tmp_path: Path,
) -> None:
    with pen(tmp_path) as made:
        made.carry_out(opening("a"), opening("b"))
        ruled(made, tmp_path, parked(1, "a"))
        wish = moving(2, "a", "b")
        assert made.write(order(wish, "k")) == (SetAside("L", "a"),)
        made.journal._quarantine = Quarantine()
        assert isinstance(made.write(order(wish, "k"))[0], Done)


@asynccontextmanager
async def serving(path: Path) -> AsyncIterator[Service]:
    made = Pen(path)
    async with writing(made, Heard()) as writer:
        readers = open_reading(path / LEDGER_FILE, 2, 1_000)
        rulings = Rulings.beside(path / "rules.json")
        yield Service(writer, readers, made.recorder, Settings(), made.epoch, rulings=rulings)
        readers.dispose()


async def asked(service: Service, command: Command, key: str | None, **named: Any) -> Answer:
    slot = service.begin("test", b"", key=key)
    assert isinstance(slot, int)
    answer = await service.carry_out(
        command, key, named.pop("digest", DIGEST), "c", slot, kind="test", **named
    )
    service.finish(slot, 0)
    return answer


def test_a_letter_is_refused_by_name_bytes_and_wish_and_nothing_else_is(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            rules, wish = service.rulings.quarantine, opening("a")
            other = {"digest": b"\x0c" * 32}
            rule(rules, letter(name_of("k")))
            assert await asked(service, wish, "k") == SetAside("L")
            rule(rules, letter("0f" * 16, digest=DIGEST.hex()))
            assert await asked(service, wish, "k2") == SetAside("L")
            rule(rules, letter("0f" * 16, fingerprint=sha256(fingerprint_of(wish)).hexdigest()))
            assert await asked(service, wish, "k3", **other) == SetAside("L")
            rule(rules, letter("0f" * 16, reason="UNPROVEN", digest=DIGEST.hex()))
            assert isinstance(await asked(service, wish, "k"), Done), "no key was used up by a refusal"
            rule(rules, letter("0d" * 16))
            assert await asked(service, opening("b"), None, name="0d" * 16) == SetAside("L")
            assert isinstance(await asked(service, opening("b"), None, name="0e" * 16), Done)

    asyncio.run(scenario())


def test_what_is_done_is_told_again_whatever_the_rules_say(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            rules = service.rulings.quarantine
            done = await asked(service, opening("a"), "k")
            assert isinstance(done, Done)
            for rules_now in (
                letter(name_of("k"), digest=DIGEST.hex()),
                limit(per_minute=0),
                limit(body_bytes_max=0),
            ):
                rule(rules, rules_now)
                again = await asked(service, opening("a"), "k", body_bytes=1)
                assert isinstance(again, Done)
                assert (again.body, again.replayed) == (done.body, True)
                assert isinstance(await asked(service, opening("b"), "k", body_bytes=1), KeyTaken)
            assert await asked(service, opening("b"), "k2", digest=b"", body_bytes=1) == Limited("R", None)

    asyncio.run(scenario())


def test_a_kind_that_is_limited_is_refused_until_there_is_room_again(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with serving(tmp_path) as service:
            rule(service.rulings.quarantine, limit(per_minute=2))
            answers = [await asked(service, opening(name), name) for name in "abc"]
            assert [type(answer) for answer in answers] == [Done, Done, Limited]

    asyncio.run(scenario())


def test_a_drill_is_there_for_the_armed_key_alone(tmp_path: Path) -> None:
    async def exercised(service: Service, key: str) -> Answer | None:
        slot = service.begin("drill", b"", key=key)
        assert isinstance(slot, int)
        answer = await service.exercise(key, DIGEST, "c", "system:drill", slot)
        service.finish(slot, 0)
        return answer

    async def scenario() -> None:
        async with serving(tmp_path) as service:
            assert await exercised(service, "k") is None
            drill = {"version": 1, "fault": "poison", "name": name_of("k"), "at": "log", "seq": 99}
            (tmp_path / "drill.json").write_text(json.dumps(drill))
            service.rulings.read()
            head_seq = service.head_seq
            assert await exercised(service, "k") == Done(200, b"{}")
            assert service.head_seq == head_seq, "it has no effect"
            assert await exercised(service, "k2") is None
            service.safe = "DISK_FULL"
            assert await exercised(service, "k") == ReadOnly("DISK_FULL")
            service.safe = None
            rule(service.rulings.quarantine, letter(name_of("k")))
            assert await exercised(service, "k") == SetAside("L")

    asyncio.run(scenario())
