"""Puts the evidence of one life where it belongs, and into a shelter while the disk of the incidents takes none.

The shelter is a folder beside the sockets, in memory as a rule: what was taken of a core on a full disk exists
once and can't be taken again, and the core is killed a moment later. It has the same form as the incidents'
folder, is bounded in number and bytes, and is emptied into the incidents by whoever finds room there, this guard
or the next one. To keep the bytes in the guard's own memory was not chosen: they would die with it.
"""

import shutil
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from postmortem import bundle

BundleFailed = bundle.BundleFailed

#: Lives whose evidence one incident keeps.
LIVES_MAX = 16
#: What the shelter holds; on most machines it is memory.
SHELTERED_MAX = 16
SHELTERED_BYTES_MAX = 16 << 20

#: What the guard heard and ordered; `hardcore replay` reads it.
RECORDING = "observations.jsonl"
#: Files about the whole incident, of which there is one; all others are evidence of a life.
OF_THE_INCIDENT = (bundle.FACTS, bundle.OPENING, RECORDING, "report.json", bundle.REPORT)
#: By this name evidence is missing that is lost, and by this one what waits for room.
LOST = "evidence"
WAITING = "evidence (kept in the run folder)"


def store_life(
    incidents: Path, incident_id: str, files: Mapping[str, bytes], missing: Mapping[str, str]
) -> Path | BundleFailed:
    """Write a bundle, or beside the first life of this incident the evidence of its next one."""
    path = incidents / incident_id
    if not bundle.is_there(path):
        made = bundle.write_bundle(incidents, incident_id, files, missing)
        if isinstance(made, Path) or not bundle.is_there(path):  # else the one of another life came first
            return made
    before = bundle.read_manifest(path)
    taken = {*before.files, *before.missing} if isinstance(before, bundle.Manifest) else set()
    ours = {*files, *missing}
    prefixes = ("", *(f"life-{number}." for number in range(2, LIVES_MAX + 1)))
    prefix = next((text for text in prefixes if taken.isdisjoint(text + name for name in ours)), None)
    if prefix is None:
        return BundleFailed(f"this incident has the evidence of {LIVES_MAX} lives already")
    added = bundle.add_files(
        path,
        {prefix + name: data for name, data in files.items()},
        {prefix + name: reason for name, reason in missing.items()},
    )
    return added if isinstance(added, BundleFailed) else path


def shelter_life(
    shelter: Path, incident_id: str, files: Mapping[str, bytes], missing: Mapping[str, str]
) -> Path | BundleFailed:
    """Keep the evidence of one life in the shelter, if there is room for it."""
    known = sheltered(shelter)
    if incident_id not in known and len(known) >= SHELTERED_MAX:
        return BundleFailed(f"the evidence of {SHELTERED_MAX} incidents waits in the run folder already")
    held_bytes = sum(_size_bytes(shelter / one) for one in known)
    if held_bytes + sum(map(len, files.values())) > SHELTERED_BYTES_MAX:
        return BundleFailed(f"the run folder keeps {SHELTERED_BYTES_MAX} bytes of evidence at most")
    return store_life(shelter, incident_id, files, missing)


def shelter_facts(shelter: Path, incident_id: str, data: bytes) -> None:
    """Keep the facts of an incident in the shelter as well, if it has room: a guard that dies tells them no more."""
    path = shelter / incident_id
    if bundle.is_there(path):
        bundle.add_file(path, bundle.FACTS, data)
    elif len(sheltered(shelter)) < SHELTERED_MAX:
        bundle.write_bundle(shelter, incident_id, {bundle.FACTS: data}, {})


def sheltered(shelter: Path) -> list[str]:
    """Return the ids of the incidents of which something waits in the shelter, the newest first."""
    return list(dict.fromkeys(one.id for one in bundle.find_bundles(shelter)))


def bring_home(shelter: Path, incidents: Path, incident_id: str) -> BundleFailed | None:
    """Move what waits in the shelter into its incident's folder. None: nothing waits there any more."""
    found = next((one for one in bundle.find_bundles(shelter) if one.id == incident_id), None)
    if found is None:
        return None
    path = bundle.complete_partial(found) if found.partial else found.path
    if isinstance(path, BundleFailed):
        return path
    if path is None:  # a guard that died had only begun with it
        return None
    manifest = bundle.read_manifest(path)
    if isinstance(manifest, BundleFailed):
        shutil.rmtree(path, ignore_errors=True)  # nobody could say what it is
        return None
    files = {name: bundle.read_file(path, name) for name in manifest.files}
    whole = {name: data for name, data in files.items() if isinstance(data, bytes)}
    failed = _move(incidents, incident_id, whole, manifest.missing)
    if failed is None:
        with suppress(OSError):
            shutil.rmtree(path)
    return failed


def _move(
    incidents: Path, incident_id: str, files: Mapping[str, bytes], missing: Mapping[str, str]
) -> BundleFailed | None:
    home = incidents / incident_id
    of_lives = {name: data for name, data in files.items() if name not in OF_THE_INCIDENT}
    if of_lives or missing:
        stored = store_life(incidents, incident_id, of_lives, missing)
        if isinstance(stored, BundleFailed):
            return stored
    told = {
        name: files[name]
        for name in OF_THE_INCIDENT
        if name in files and not bundle.is_there(home / name)  # what stands there is newer
    }
    if not bundle.is_there(home):
        made = bundle.write_bundle(incidents, incident_id, told, {})
        return made if isinstance(made, BundleFailed) else None
    return bundle.add_files(home, told, {}, found=(WAITING,))


def say_missing(
    path: Path,
    missing: Mapping[str, str],
    late: bool = False,  # noqa: FBT001,FBT002  a hand passes it by place
) -> BundleFailed | None:
    """Name evidence that is not in the incident's folder, in its manifest.

    `late`: what is lost was still on its way, so that is said only if nothing of a core's evidence has come.
    """
    manifest = bundle.read_manifest(path)
    known: Mapping[str, object] = manifest.files if isinstance(manifest, bundle.Manifest) else {}
    came = late and any(name not in OF_THE_INCIDENT for name in known)
    told = {name: why for name, why in missing.items() if name != LOST or not came}
    return bundle.add_files(path, {}, told) if told else None


def _size_bytes(path: Path) -> int:
    manifest = bundle.read_manifest(path)
    if isinstance(manifest, BundleFailed):
        return 0
    return sum(entry.size_bytes for entry in manifest.files.values())
