"""An archive of a handful of rows, a guard of three lines and a browser without a screen, for the tests of the pages."""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from msgspec import structs
from starlette.applications import Starlette

from postmortem.views import (
    Act,
    Bulk,
    Drill,
    DryRun,
    Filter,
    Group,
    IncidentLine,
    Letter,
    LetterState,
    Page,
    Proposal,
    ProposalState,
    Refusal,
    Standing,
)
from postmortem.web.app import routes
from postmortem.web.places import Places
from tests.unit.postmortem import story

TOKEN = "a-token-of-this-test"
LETTER_ID = "0199a000-0000-7000-8000-0000000000aa"


def line(**other: Any) -> IncidentLine:
    """One incident of the list."""
    given: dict[str, Any] = {
        "id": story.ID,
        "opened_at": "2026-11-21T14:08:15.000Z",
        "closed_at": "2026-11-21T14:08:18.500Z",
        "diagnosis": "KILLED_FROM_OUTSIDE",
        "grade": "certain",
        "summary": {
            "ko": "장부 서버가 밖에서 강제 종료됐고 912 ms 만에 다시 응답했어요.",
            "en": "The ledger was killed.",
        },
        "outcome": "recovered",
        "outage_ms": 912.3,
        "detected_ms": 0.8,
        "fingerprint": "f" * 16,
        "account_ids": ("assets:bank:kb",),
        "planned": False,
        "drill": None,
    }
    return IncidentLine(**{**given, **other})


def letter(**other: Any) -> Letter:
    """One letter that waits."""
    given: dict[str, Any] = {
        "id": LETTER_ID,
        "state": LetterState.QUARANTINED,
        "reason": "CRASHED_CORE",
        "name": "a" * 32,
        "command_id": "cmd-1",
        "idempotency_key": "key-1",
        "kind": "transaction.post",
        "source": "browser:0123456789abcdef",
        "account_ids": ("assets:bank:kb", "expenses:food"),
        "transaction_id": "tx-1",
        "fingerprint": "b" * 64,
        "incident_ids": (story.ID,),
        "deaths": 1,
        "attempts": (),
        "quarantined_at": "2026-11-21T14:08:17.000Z",
        "method": "POST",
        "path": "/api/ledger/entries",
        "payload": {"amount": "-12000", "currency": "KRW", "description": "점심"},
        "row": None,
        "seq": None,
        "dry_run": None,
        "note": "",
        "discarded_because": None,
        "sums": ("12000 KRW",),
    }
    return Letter(**{**given, **other})


def proposal(**other: Any) -> Proposal:
    """One proposal that a machine can enforce."""
    given: dict[str, Any] = {
        "id": "p-1",
        "incident": story.ID,
        "kind": "fingerprint",
        "text": {"ko": "이 요청을 처리하지 않아요.", "en": "Refuse this request."},
        "state": ProposalState.OPEN,
        "rule": {"type": "fingerprint", "fingerprint": "b" * 64},
        "tested": None,
        "hits": 0,
        "last_hit_at": None,
        "owner": "",
        "note": "",
    }
    return Proposal(**{**given, **other})


@dataclass
class Archive:
    """What was put in by hand, and every act that was asked for."""

    lines: list[IncidentLine] = field(default_factory=list)
    kept: list[Letter] = field(default_factory=list)
    proposed: list[Proposal] = field(default_factory=list)
    drilled: list[Drill] = field(default_factory=list)
    written: list[Act] = field(default_factory=list)
    bulks: dict[str, Bulk] = field(default_factory=dict)
    refuses: str = ""
    done: list[tuple[Any, ...]] = field(default_factory=list)

    def incidents(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        found = [
            one
            for one in self.lines
            if wanted.fingerprint in {"", one.fingerprint}
            and wanted.diagnosis in {"", one.diagnosis}
            and (wanted.drills or one.drill is None)
        ]
        return _page(found, limit, cursor)

    def groups(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        prints = dict.fromkeys(one.fingerprint for one in self.incidents(wanted, 1000).items)
        found = tuple(group for one in prints if (group := self.group(one)) is not None)
        return _page(found, limit, cursor)

    def group(self, fingerprint: str) -> Group | None:
        same = [one for one in self.lines if one.fingerprint == fingerprint]
        if not same:
            return None
        return Group(
            fingerprint, same[0].summary, same[0].diagnosis, Standing.NEW, len(same), same[-1].opened_at,
            same[0].opened_at, same[0].outage_ms, same[0].account_ids, None, ("signal 9",), same[0].id,
        )  # fmt: skip

    def incident(self, incident_id: str) -> IncidentLine | None:
        return next((one for one in self.lines if one.id == incident_id), None)

    def proposals(self, incident_id: str = "") -> Sequence[Proposal]:
        return [one for one in self.proposed if incident_id in {"", one.incident}]

    def letters(self, wanted: Filter, limit: int, cursor: str = "") -> Page:
        found = [
            one for one in self.kept if wanted.state in {"", one.state} and wanted.reason in {"", one.reason}
        ]
        return _page(found, limit, cursor)

    def letter(self, letter_id: str) -> Letter | None:
        return next((one for one in self.kept if one.id == letter_id), None)

    def counts(self) -> Mapping[str, int]:
        waiting = [one.reason for one in self.kept if one.state == LetterState.QUARANTINED]
        return {reason: waiting.count(reason) for reason in dict.fromkeys(waiting)}

    def bulk(self, bulk_id: str) -> Bulk | None:
        return self.bulks.get(bulk_id)

    def audit(self, limit: int, cursor: str = "") -> Page:
        return _page(self.written, limit, cursor)

    def drills(self, limit: int) -> Sequence[Drill]:
        return self.drilled[:limit]

    def trends(self, weeks: int) -> Mapping[str, Any]:
        told = [{"from": f"2026-11-{day:02d}", "incidents": day % 4} for day in range(1, weeks + 1)]
        cause = {"diagnosis": "CRASHED", "count": 4, "p50_ms": 80.0, "p90_ms": 900.0}
        return {"weeks": told, "incidents": len(self.lines), "mtbf_hours": 31.5, "causes": [cause]}


def _page(found: Sequence[Any], limit: int, cursor: str) -> Page:
    begin = int(cursor or 0)
    more = str(begin + limit) if len(found) > begin + limit else None
    return Page(tuple(found[begin : begin + limit]), len(found), more)


@dataclass
class IncidentActs:
    """Acts on incidents and groups, written into the archive's list."""

    archive: Archive

    async def merge(self, fingerprint: str, into: str) -> Group | Refusal:
        self.archive.done.append(("merge", fingerprint, into))
        return self.archive.group(into) or Refusal("group_unknown", {})

    async def split(self, fingerprint: str, incident_id: str = "") -> Group | Refusal:
        self.archive.done.append(("split", fingerprint, incident_id))
        return self.archive.group(fingerprint) or Refusal("group_unknown", {})

    async def note(self, incident_id: str, text: str) -> IncidentLine | Refusal:
        self.archive.done.append(("note", text, incident_id))
        return self.archive.incident(incident_id) or Refusal("incident_unknown", {})

    async def remove_evidence(self, incident_id: str) -> IncidentLine | Refusal:
        self.archive.done.append(("remove", incident_id))
        return self.archive.incident(incident_id) or Refusal("incident_unknown", {})


@dataclass
class Acts:
    """Acts that are done on the archive's rows, and written into its list."""

    archive: Archive

    @property
    def incidents(self) -> IncidentActs:
        return IncidentActs(self.archive)

    def _did(self, letter_id: str, *what: Any, **change: Any) -> Letter | Refusal:
        self.archive.done.append((*what, letter_id))
        if self.archive.refuses:
            return Refusal(self.archive.refuses, {})
        at = next(n for n, one in enumerate(self.archive.kept) if one.id == letter_id)
        self.archive.kept[at] = structs.replace(self.archive.kept[at], **change)
        return self.archive.kept[at]

    async def dry_run(self, letter_id: str) -> Letter | Refusal:
        run = DryRun("2026-11-22T10:00:00Z", "survived", 201, 40, {"id": "x"}, "")
        return self._did(letter_id, "dry-run", dry_run=run)

    async def retry(self, letter_id: str, *, anyway: bool = False) -> Letter | Refusal:
        return self._did(letter_id, "retry", anyway, state=LetterState.RESOLVED)

    async def requeue(self, letter_id: str) -> Letter | Refusal:
        return self._did(letter_id, "requeue")

    async def hold(self, letter_id: str) -> Letter | Refusal:
        return self._did(letter_id, "hold", state=LetterState.HELD)

    async def discard(self, letter_id: str, reason: str) -> Letter | Refusal:
        return self._did(letter_id, "discard", reason, state=LetterState.DISCARDED, discarded_because=reason)

    async def undo_discard(self, letter_id: str) -> Letter | Refusal:
        return self._did(letter_id, "undo", state=LetterState.QUARANTINED, discarded_because=None)

    async def correct(self, letter_id: str, body: str) -> Letter | Refusal:
        return self._did(letter_id, "correct", body, state=LetterState.DISCARDED, corrected_by="key-2")

    async def bulk(self, verb: str, wanted: Filter | Sequence[str], reason: str = "") -> Bulk | Refusal:
        self.archive.done.append(("bulk", verb, wanted, reason))
        self.archive.bulks["b-1"] = Bulk("b-1", verb, 3, 1, 0, "", LETTER_ID)
        return self.archive.bulks["b-1"]

    async def cancel_bulk(self, bulk_id: str) -> Bulk | Refusal:
        if bulk_id not in self.archive.bulks:
            return Refusal("bulk_unknown", {})
        ended = structs.replace(self.archive.bulks[bulk_id], ended="cancelled")
        self.archive.bulks[bulk_id] = ended
        return ended

    async def decide(self, proposal_id: str, verb: str, owner: str, note: str) -> Proposal | Refusal:
        self.archive.done.append(("decide", proposal_id, verb, owner, note))
        return self.archive.proposed[0]

    async def mark_fixed(self, fingerprint: str, version: str) -> Group | Refusal:
        self.archive.done.append(("fixed", fingerprint, version))
        found = self.archive.group(fingerprint)
        return found if found is not None else Refusal("group_unknown", {})

    async def note(self, letter_id: str, text: str) -> Letter | Refusal:
        return self._did(letter_id, "note", text, note=text)


@dataclass
class Answer:
    """What came back."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def text(self) -> str:
        return self.body.decode()


@dataclass
class Visitor:
    """Somebody who looks at the pages of `archive`; the guard says `status`, or is away (None)."""

    folder: Path
    archive: Archive = field(default_factory=Archive)
    status: Mapping[str, Any] | None = None
    lang: str = "en"
    resources: list[Mapping[str, Any]] = field(default_factory=list)  # what the guard knows over time
    asked: list[Mapping[str, Any]] = field(default_factory=list)
    answers: dict[str, Mapping[str, Any] | None] = field(
        default_factory=dict
    )  # to a verb, in place of the usual
    written: list[tuple[str, str, str, str]] = field(default_factory=list)

    def app(self) -> Starlette:
        """The pages alone, as the investigator serves them."""

        async def ask_guard(order: Mapping[str, Any]) -> Mapping[str, Any] | None:
            self.asked.append(order)
            if order["verb"] in self.answers:
                return self.answers[str(order["verb"])]
            if self.status is None:
                return None
            if order["verb"] == "policy":
                return {"ok": True, "policy": {"memory_limit_mb": 512}}
            if order["verb"] == "curve":
                return {"ok": True, "resources": self.resources}
            return self.status if order["verb"] == "status" else {"ok": True}

        async def write_down(verb: str, what: str, reason: str, outcome: str) -> None:
            self.written.append((verb, what, reason, outcome))

        places = Places(self.folder / "incidents", self.folder, TOKEN, ask_guard, write_down, "0.0")
        return Starlette(routes=routes(self.archive, Acts(self.archive), places))

    def get(self, path: str) -> Answer:
        """Look at a page."""
        return self._send("GET", path, b"", [])

    def post(self, path: str, *, token: str = TOKEN, site: str = "same-origin", **fields: Any) -> Answer:
        """Send a form; a list is a field that is there several times."""
        body = urlencode({"_csrf": token, **fields}, doseq=True).encode()
        kind = b"application/x-www-form-urlencoded"
        return self._send("POST", path, body, [(b"content-type", kind), (b"sec-fetch-site", site.encode())])

    def _send(self, method: str, path: str, body: bytes, more: list[tuple[bytes, bytes]]) -> Answer:
        return asyncio.run(self._exchange(method, path, body, more))

    async def _exchange(self, method: str, path: str, body: bytes, more: list[tuple[bytes, bytes]]) -> Answer:
        route, _, query = path.partition("?")
        length = str(len(body)).encode()
        headers = [
            (b"host", b"t"),
            (b"accept-language", self.lang.encode()),
            (b"content-length", length),
            *more,
        ]
        scope = {
            "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "method": method, "scheme": "http",
            "path": route, "raw_path": route.encode(), "query_string": query.encode(), "root_path": "",
            "headers": headers, "client": None, "server": ("t", 80),
        }  # fmt: skip
        said: list[dict[str, Any]] = []

        async def receive() -> dict[str, Any]:
            return {"type": "http.request", "body": body, "more_body": False}

        async def send(message: Any) -> None:
            said.append(message)

        await self.app()(scope, receive, send)
        told = {name.decode(): value.decode() for name, value in said[0]["headers"]}
        return Answer(said[0]["status"], told, b"".join(one.get("body", b"") for one in said[1:]))
