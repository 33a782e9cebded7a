"""Takes the evidence of one life and puts it on disk, inside its budget: the shell around the collectors.

The collectors run on a thread of the caller's pool (`gathering`) and fill a `Haul`; the loop only waits, and
when the budget is over it stores what the haul holds at that moment, even if a collector hangs in the kernel.
To wait for the collectors themselves was not chosen: the kill would wait for whatever they wait for. The pool
needs at least two threads, so that a hanging collector can't keep the haul from the disk. Nothing here kills
the subject.
"""

import asyncio
import json
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import msgspec
from msgspec import structs

from hardcore.model.looks import ProcessSample
from hardcore.snapshot import recipe, storing
from hardcore.snapshot.facts import ABANDONED, abandoned, left_open, served_again
from hardcore.snapshot.form import as_bytes
from hardcore.snapshot.gathering import Gathering, abandon, gather, prepare
from hardcore.snapshot.image import ImageLimits, write_image
from hardcore.snapshot.recipe import Piece
from hardcore.snapshot.subject import Evidence, EvidenceFailed, Haul, Kept, Subject, Tools
from postmortem import bundle, keeping

#: How much longer than the budget the disk may take before the kill goes on without it.
STORE_GRACE_MS = 250
#: Evidence of a dead core holds nobody up: the disk gets this long.
DEAD_STORE_MS = 10_000
#: Requests that the facts of one incident name.
REQUESTS_MAX = 4096
#: Incidents in which recovery had stopped that are told when a core serves again: the newest.
STOPPED_MAX = 64
#: Incidents that a new guard looks through for a report that was not made.
UNREPORTED_MAX = 16

Abandoned = bundle.Found
#: What the guard heard and ordered; `hardcore replay` reads it.
RECORDING = storing.RECORDING


class _Sheltered(msgspec.Struct, frozen=True):
    """The disk refused, the shelter did not."""

    reason: str


async def take_live(
    subject: Subject,
    budget_ms: int,
    pool: Executor,
    tools: Tools,
    *,
    stop: bool = True,
    image: ImageLimits | None = None,
) -> Evidence | EvidenceFailed:
    """Stop the living process and take its evidence; it stays stopped. `stop` False: it is only looked at.

    `image`: write its memory out too, of a stopped process only. Returns after `budget_ms` + STORE_GRACE_MS at
    the latest, with an image after its budget and another STORE_GRACE_MS on top. A bundle whose writing takes
    longer is still finished on its thread; the answer says so in `missing`.
    """
    shares = recipe.LIVING if stop else recipe.LOOKED_AT
    work = Gathering(subject, tools, Haul())
    start_ns = await _collect(pool, shares, budget_ms, work)
    until_ns = recipe.end_ns(start_ns, budget_ms + STORE_GRACE_MS)
    taken = await _store(pool, subject, work.haul, start_ns, until_ns)
    if not isinstance(taken, EvidenceFailed) or taken.kept is Kept.ELSEWHERE:
        taken = structs.replace(taken, steps=(*taken.steps, ("dumped", time.monotonic_ns())))
    if image is None or isinstance(taken, EvidenceFailed):
        return taken
    if not stop:
        return await _without_image(pool, taken, "a core that goes on serving is not stopped for it")
    return await _with_image(pool, subject, tools, taken, image)


async def take_dead(
    subject: Subject, budget_ms: int, pool: Executor, sample: ProcessSample | None
) -> Evidence | EvidenceFailed:
    """Take what a dead core left behind; meant to run beside the restart.

    Returns after `budget_ms` + DEAD_STORE_MS at the latest.
    """
    work = Gathering(subject, Tools(None), Haul(), sample)
    start_ns = await _collect(pool, recipe.DEAD, budget_ms, work)
    until_ns = recipe.end_ns(start_ns, budget_ms + DEAD_STORE_MS)
    return await _store(pool, subject, work.haul, start_ns, until_ns)


async def take_gateway(
    subject: Subject,
    budget_ms: int,
    pool: Executor,
    tools: Tools,
    *,
    living: bool,
    found: Mapping[str, bytes],
) -> Evidence | EvidenceFailed:
    """Take the evidence of a gateway, which is only looked at; `found` are files that are known already.

    Returns after `budget_ms` and the time that the disk has, as above: little if it lives, for it is to be killed.
    """
    work = Gathering(subject, tools, Haul(files=dict(found)))
    shares = recipe.OF_A_LIVING_GATEWAY if living else recipe.OF_A_DEAD_GATEWAY
    start_ns = await _collect(pool, shares, budget_ms, work)
    grace_ms = STORE_GRACE_MS if living else DEAD_STORE_MS
    return await _store(pool, subject, work.haul, start_ns, recipe.end_ns(start_ns, budget_ms + grace_ms))


def write_facts(path: Path, facts: Mapping[str, Any]) -> bundle.BundleFailed | None:
    """Write `incident.json` into the incident's folder, which is made if no evidence was taken.

    Blocks on the disk: to be called on a thread. None: written and synced.
    """
    return _put(path, bundle.FACTS, as_bytes(facts))


def write_opening(path: Path, facts: Mapping[str, Any]) -> bundle.BundleFailed | None:
    """Write what is known of an incident that goes on, in place of what was known before. Blocks on the disk."""
    return _put(path, bundle.OPENING, as_bytes(facts))


def _put(path: Path, name: str, data: bytes) -> bundle.BundleFailed | None:
    if not bundle.is_there(path):
        made = bundle.write_bundle(path.parent, path.name, {name: data}, {})
        if not isinstance(made, bundle.BundleFailed):
            return None
        if not bundle.is_there(path):  # else its evidence came meanwhile
            return made
    return bundle.add_file(path, name, data)


def add_requests(path: Path, requests: Sequence[Mapping[str, Any]]) -> bundle.BundleFailed | None:
    """Add requests that settled after the incident was closed to its facts, the first ones where too many."""
    facts = _read(path, bundle.FACTS)
    if isinstance(facts, bundle.BundleFailed):
        return facts
    known = facts.get("requests")
    before = known if isinstance(known, list) else []
    return write_facts(path, {**facts, "requests": [*before, *requests][:REQUESTS_MAX]})


def add_audit(path: Path, audit: Mapping[str, Any]) -> bundle.BundleFailed | None:
    """Add to the facts of a closed incident what the proof of the whole ledger said."""
    facts = _read(path, bundle.FACTS)
    return facts if isinstance(facts, bundle.BundleFailed) else write_facts(path, {**facts, "audit": audit})


def add_trials(path: Path, trials: Sequence[Mapping[str, Any]]) -> bundle.BundleFailed | None:
    """Put what came of its trials into the facts of a closed incident; nothing where that was pruned meanwhile."""
    if not bundle.is_there(path):
        return None
    facts = _read(path, bundle.FACTS)
    return (
        facts
        if isinstance(facts, bundle.BundleFailed)
        else write_facts(path, {**facts, "trials": list(trials)})
    )


def add_recording(path: Path, write: Callable[[], bytes]) -> bundle.BundleFailed | None:
    """Add what the guard heard and ordered, as `write` tells it; nothing without a folder to put it in."""
    return bundle.add_file(path, RECORDING, write()) if bundle.is_there(path) else None


def find_stopped(incidents: Path) -> list[str]:
    """Return the ids of the newest incidents after which nothing has served, as far as they say.

    Recovery had stopped in them, or the guard had ended.
    """
    told = [
        (found, _read(found.path, bundle.FACTS)) for found in bundle.find_bundles(incidents)[:STOPPED_MAX]
    ]
    return [found.id for found, facts in told if isinstance(facts, Mapping) and _stopped(facts)]


def add_served(path: Path, at: str) -> bundle.BundleFailed | None:
    """Add to the facts of an incident in which recovery had stopped, or its guard ended, that a core serves again."""
    facts = _read(path, bundle.FACTS)
    if isinstance(facts, bundle.BundleFailed):
        return facts
    return write_facts(path, served_again(facts, at)) if _stopped(facts) else None


def _stopped(facts: Mapping[str, Any]) -> bool:
    return facts.get("outcome") in {"manual", ABANDONED} and facts.get("served_again_at") is None


def is_id(text: str) -> bool:
    """Tell whether `text`, which somebody else said, may be the id of an incident."""
    return bundle.is_incident_id(text)


def find_abandoned(incidents: Path, shelter: Path | None = None, noted: str = "") -> tuple[Abandoned, ...]:
    """Return the incidents that a dead guard left without facts, or with something of them in the shelter.

    `noted`: the one that it had noted beside its last deed; there may be no folder of it yet. To be asked before a new
    one is opened.
    """
    found = [
        one
        for one in bundle.find_bundles(incidents)
        if one.partial or not bundle.is_there(one.path / bundle.FACTS)
    ]
    known = {one.id for one in found}
    waiting = list(storing.sheltered(shelter)) if shelter is not None else []
    if is_id(noted) and noted not in waiting and not bundle.is_there(incidents / noted):
        waiting.append(noted)
    left = (Abandoned(one, incidents / one, partial=False) for one in waiting if one not in known)
    return (*found, *left)


def close_abandoned(
    found: Abandoned, closed_at: str, noted: Mapping[str, Any] | None = None
) -> Path | bundle.BundleFailed | None:
    """Give an incident that a dead guard left open its closing facts, as far as its folder and `noted` tell them.

    None: there was nothing in it worth keeping, and it was removed.
    """
    half = found.partial and bundle.is_there(found.path)  # the second time it has its name already
    path = bundle.complete_partial(found) if half else found.path.with_name(found.id)
    if path is None and noted is not None:
        path = found.path.with_name(found.id)
    if not isinstance(path, Path) or bundle.is_there(path / bundle.FACTS):
        return path
    page, opening = _read(path, "recorder.json"), _read(path, bundle.OPENING)
    told = abandoned(found.id, closed_at, {} if isinstance(page, bundle.BundleFailed) else page)
    known = {} if isinstance(opening, bundle.BundleFailed) else opening
    failed = write_facts(path, left_open({**(noted or {}), **known}, told, (noted or {}).get("released_at")))
    return path if failed is None else failed


def find_unreported(incidents: Path) -> list[Path]:
    """Return the folders of the newest closed incidents that have no report: their guard ended before it was made."""
    newest = [one.path for one in bundle.find_bundles(incidents)[:UNREPORTED_MAX] if not one.partial]
    return [path for path in newest if is_unreported(path)]


def is_unreported(path: Path) -> bool:
    """Tell whether an incident has its facts and no report."""
    return bundle.is_there(path / bundle.FACTS) and not bundle.is_there(path / bundle.REPORT)


def sweep(incidents: Path) -> None:
    """Remove what a dead guard left half written in the folders of its incidents, closed ones too."""
    keeping.sweep(incidents)


def prune(incidents: Path, keep: str) -> list[str]:
    """Remove the oldest closed incidents above what is kept; return their ids."""
    return keeping.prune(incidents, keep)


def _read(path: Path, name: str) -> Mapping[str, Any] | bundle.BundleFailed:
    data = bundle.read_file(path, name)
    if isinstance(data, bundle.BundleFailed):
        return data
    try:
        raw = json.loads(data)
    except (ValueError, RecursionError):
        return bundle.BundleFailed(f"{name} is not JSON")
    return raw if isinstance(raw, dict) else bundle.BundleFailed(f"{name} is no object")


async def _collect(pool: Executor, shares: Mapping[Piece, int], budget_ms: int, work: Gathering) -> int:
    """Have the evidence gathered until the cut; return when it was begun, in monotonic nanoseconds."""
    start_ns = time.monotonic_ns()
    steps = recipe.plan(shares, start_ns=start_ns, budget_ms=budget_ms)
    prepare(steps, work)
    loop = asyncio.get_running_loop()
    done = loop.run_in_executor(pool, gather, steps, work)
    await asyncio.wait({done}, timeout=_left_s(recipe.cut_ns(start_ns, budget_ms)))
    if not done.done():
        abandon(work)
    return start_ns


async def _store(
    pool: Executor, subject: Subject, haul: Haul, start_ns: int, until_ns: int
) -> Evidence | EvidenceFailed:
    # Copies: a collector that hangs may come back while the files are being written.
    files, missing, page = dict(haul.files), haul.pending | haul.missing, haul.page
    steps = tuple(haul.steps)
    loop = asyncio.get_running_loop()
    work = loop.run_in_executor(pool, _write, subject, files, missing)
    await asyncio.wait({work}, timeout=_left_s(until_ns))
    duration_ms = (time.monotonic_ns() - start_ns) // 1_000_000
    if not work.done():
        why = "the disk had not taken the evidence in time"
        return EvidenceFailed(why, page, steps, duration_ms, Kept.PERHAPS)
    written = work.result()
    if not isinstance(written, Path):
        kept = Kept.ELSEWHERE if isinstance(written, _Sheltered) else Kept.NOWHERE
        return EvidenceFailed(written.reason, page, steps, duration_ms, kept)
    costs_us = dict(haul.costs_us)
    return Evidence(written, not missing, missing, page, steps, duration_ms, costs_us)


async def _with_image(
    pool: Executor, subject: Subject, tools: Tools, taken: Evidence, limits: ImageLimits
) -> Evidence:
    """Add a memory image to evidence that is on disk; what hinders it is named in `missing`."""
    work = asyncio.get_running_loop().run_in_executor(pool, _image, subject, tools, taken.path, limits)
    start_ns = time.monotonic_ns()
    await asyncio.wait({work}, timeout=_left_s(recipe.end_ns(start_ns, limits.budget_ms + STORE_GRACE_MS)))
    why = work.result() if work.done() else "the disk had not taken it in time"
    image_us = (time.monotonic_ns() - start_ns) // 1_000
    taken = structs.replace(
        taken,
        duration_ms=taken.duration_ms + image_us // 1_000,
        costs_us={**taken.costs_us, bundle.IMAGE: image_us},
    )
    return taken if why is None else await _without_image(pool, taken, why)


async def _without_image(pool: Executor, taken: Evidence, why: str) -> Evidence:
    missing = {bundle.IMAGE: why}
    work = asyncio.get_running_loop().run_in_executor(pool, bundle.add_files, taken.path, {}, missing)
    await asyncio.wait({work}, timeout=STORE_GRACE_MS / 1_000)
    return structs.replace(taken, complete=False, missing={**taken.missing, **missing})


def _image(subject: Subject, tools: Tools, folder: Path, limits: ImageLimits) -> str | None:
    written = write_image(subject, tools, folder, limits)
    if isinstance(written, str):
        return written
    kept = bundle.add_image(folder, written)
    if isinstance(kept, str):
        return None
    written.unlink(missing_ok=True)
    return kept.reason


def _write(
    subject: Subject, files: Mapping[str, bytes], missing: Mapping[str, str]
) -> Path | bundle.BundleFailed | _Sheltered:
    stored = storing.store_life(subject.incidents, subject.incident, files, missing)
    if isinstance(stored, Path) or subject.shelter is None:
        return stored
    kept = storing.shelter_life(subject.shelter, subject.incident, files, missing)
    return _Sheltered(stored.reason) if isinstance(kept, Path) else stored


def _left_s(until_ns: int) -> float:
    return max(0.0, (until_ns - time.monotonic_ns()) / 1e9)
