"""Many transactions in one request: all of them or none, or each by itself.

All or none is one command under the key of its request. Each by itself is as many commands, each under the key of the
request with its place after it (`KEY:0017`), all in one piece of the writer's work and so in one transaction of the store:
sent again, each gets the answer that it got. The key of the whole is then kept nowhere, so whoever asks what became of it
is told from the keys of its parts. A status for the whole that speaks of its parts (207) was not chosen: programs read the
parts, and for the whole there is nothing to say but that it was taken.
"""

import asyncio
from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response

from core.admission import Wish
from core.guarded.poison import name_of
from core.journal.answers import Answer, Done, KeyTaken, Order, Refused, replay
from core.journal.shelf import PLACE_DIGITS, read_parts
from core.journal.store import StoreError
from core.ledger.commands import (
    BATCH_TRANSACTIONS_MAX,
    BatchBody,
    accounts_of,
    fingerprint_of,
    post_batch,
    post_transaction,
)
from core.ledger.reasons import Fault, Reason, Rejection, within
from core.service import ReadTooLong, Service
from core.web.asking import (
    Routes,
    accepted,
    begin,
    carry_out,
    named,
    problem_of,
    respond_with,
    service_of,
)
from core.web.door import note_commit
from core.web.intake import decode_body, digest_of, read_body
from core.web.problems import Problem, ProblemError, problem_json, refusal
from frontend.render import Language, language

KIND: Final = "transaction.batch"
KEY_CHARACTERS_MAX: Final = 250  # the place of each part is put behind it
_Made = dict[int, Order | Rejection]


class _Booked(msgspec.Struct):
    """What is told of a part that was carried out."""

    id: str
    seq: int
    state: str = ""


async def create_batch(request: Request) -> Response:
    """POST /api/ledger/transactions/batch."""
    service = service_of(request)
    body = await read_body(request, service.settings.batch_bytes_max)
    # Megabytes of JSON on the loop's thread would look to a guard as if nothing went on there.
    said = await asyncio.to_thread(decode_body, body, BatchBody)
    _check_size(said)
    if said.atomic:
        ids = [service.new_id() for _ in said.transactions]
        command = accepted(await asyncio.to_thread(post_batch, said, ids, said.expected_versions))
        return await carry_out(request, KIND, command, body)
    if said.expected_versions:
        raise _invalid("/expected_versions", Reason.NOT_SUPPORTED)
    return await _each(request, service, said, body)


async def _each(request: Request, service: Service, said: BatchBody, body: bytes) -> Response:
    key, name = named(request)
    if key is not None and len(key) > KEY_CHARACTERS_MAX:
        raise ProblemError(Problem("invalid-key"))
    command_id, digest = service.new_id(), digest_of(request, body)
    slot = begin(request, KIND, body, key=key, name=name, command_id=command_id)
    made = await asyncio.to_thread(_orders, service, said, key, digest, slot)
    orders = {place: one for place, one in made.items() if isinstance(one, Order)}
    wish = Wish(KIND, name or (name_of(key) if key is not None else ""), digest, digest, len(body))
    answers = await service.carry_out_each(tuple(orders.values()), slot, wish)
    assert answers is not None, "what is held against the rules as one is answered"
    if answers and not any(isinstance(answer, Done | Refused | KeyTaken) for answer in answers):
        return respond_with(request, answers[0])  # none of them was begun, or nobody knows: true of all
    given: dict[int, Answer] = dict(zip(orders, answers, strict=True))
    for answer in answers:
        if isinstance(answer, Done) and answer.commit is not None:
            note_commit(request.scope, answer.commit)
    results = {
        place: _told(given[place], request) if place in given else _refused(one, request)
        for place, one in made.items()
    }
    return _respond(results, replayed=bool(answers) and all(map(_is_replayed, answers)))


async def recall(request: Request, key: str, digest: bytes | None, slot: int) -> dict[str, Any] | None:
    """Return what the parts of a batch under this key were answered, None where the book knows no such parts."""
    found = await service_of(request).read(slot, lambda connection: read_parts(connection, key, digest))
    if isinstance(found, ReadTooLong | StoreError):
        raise ProblemError(Problem("outcome-unknown"))
    if not found:
        return None
    return _summed({place: _told(replay(row), request) for place, row in found.items()})


def _orders(service: Service, said: BatchBody, key: str | None, digest: bytes, slot: int) -> _Made:
    made: _Made = {}
    for place, body in enumerate(said.transactions):
        command = post_transaction(body, service.new_id(), body.expected_versions)
        if isinstance(command, Rejection):
            made[place] = within(command, f"/transactions/{place}")
            continue
        part = f"{key}:{place:0{PLACE_DIGITS}d}" if key is not None else None
        accounts = accounts_of(command)
        made[place] = Order(
            command, part, fingerprint_of(command), digest, command.id, command.id, accounts, slot
        )
    return made


def _told(answer: Answer, request: Request) -> dict[str, Any]:
    if isinstance(answer, Done):
        booked = msgspec.json.decode(answer.body, type=_Booked)
        return {"status": answer.status, "id": booked.id, "seq": booked.seq, "state": booked.state}
    return _problem(problem_of(answer), request)


def _refused(rejection: Order | Rejection, request: Request) -> dict[str, Any]:
    assert isinstance(rejection, Rejection), "a part that was not asked for was malformed"
    return _problem(refusal(rejection), request)


def _problem(problem: Problem, request: Request) -> dict[str, Any]:
    lang: Language = language(request.headers.get("accept-language"))
    return {
        "status": problem.told_status,
        "problem": problem_json(problem, lang, service_of(request).settings),
    }


def _respond(results: dict[int, dict[str, Any]], *, replayed: bool) -> Response:
    headers = {"Idempotent-Replayed": "true"} if replayed else None
    return Response(msgspec.json.encode(_summed(results)), 200, headers, media_type="application/json")


def _summed(results: dict[int, dict[str, Any]]) -> dict[str, Any]:
    done = sum("id" in result for result in results.values())
    return {
        "done": done,
        "refused": len(results) - done,
        "results": [{"index": place, **results[place]} for place in sorted(results)],
    }


def _is_replayed(answer: Answer) -> bool:
    return isinstance(answer, Done | Refused) and answer.replayed


def _check_size(said: BatchBody) -> None:
    if not said.transactions:
        raise _invalid("/transactions", Reason.TOO_FEW)
    if len(said.transactions) > BATCH_TRANSACTIONS_MAX:
        raise _invalid("/transactions", Reason.TOO_MANY)


def _invalid(pointer: str, reason: Reason) -> ProblemError:
    return ProblemError(Problem("invalid-body", (Fault(pointer, reason),)))


ROUTES: Final[Routes] = {"/api/ledger/transactions/batch": {"POST": create_batch}}
