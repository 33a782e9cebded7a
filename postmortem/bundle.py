"""The black box: one folder per incident, written whole or not at all, that proves its own contents.

A bundle is made in a hidden folder beside its place (`.<id>.partial`), every file is synced, the manifest
with the size and SHA-256 of each comes last, and one rename makes it visible. So a folder under its real
name is whole, and whatever a death in the middle leaves behind says by its name that it is not. An
archive file was not chosen: what became of an incident (facts, report, evidence of a second death) arrives
later, and a person with nothing but a shell must be able to read it. What goes wrong on the disk is the
value `BundleFailed`; only a name that no reader could trust is a bug of ours and an assertion.
"""

import json
import os
import re
import shutil
import stat
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path

import msgspec
from msgspec import structs

from postmortem import placing

VERSION = 1
MANIFEST = "manifest.json"

#: One file, one bundle, and how many files: above it, the manifest says what was left out.
FILE_BYTES_MAX = 8 << 20
BUNDLE_BYTES_MAX = 32 << 20
FILES_MAX = 128
MANIFEST_BYTES_MAX = 256 << 10
#: Folders looked at when a place is listed.
FOLDERS_MAX = 20_000

#: By this name a memory image is missing.
IMAGE = "image"
#: So many memory images are kept of one incident.
IMAGES_MAX = 4

FACTS = "incident.json"
#: What was known of it while it was open; without FACTS it is the story.
OPENING = "opening.json"
#: The last that is written of a report.
REPORT = "report.md"
_HAS_ONE = "this incident has a bundle already"

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,95}")
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_PARTIAL = re.compile(rf"\.({_ID.pattern})\.partial")
_IMAGE = re.compile(r"core\.[1-9][0-9]?")


class BundleFailed(msgspec.Struct, frozen=True):
    """A bundle could not be written or read; `reason` is one sentence for people."""

    reason: str


class Entry(msgspec.Struct, frozen=True):
    """What the manifest says of one file."""

    sha256: str
    size_bytes: int


class Manifest(msgspec.Struct, frozen=True):
    """The contents of a bundle. `complete`: nothing more of its evidence is to come.

    `missing` maps what should be there to the reason why it is not. `images` are memory images with their sizes
    in bytes; they are too large for a digest while somebody waits, and for any reader of the other files.
    """

    incident: str
    written_at: str
    complete: bool
    files: Mapping[str, Entry] = msgspec.field(default_factory=dict)
    missing: Mapping[str, str] = msgspec.field(default_factory=dict)
    images: Mapping[str, int] = msgspec.field(default_factory=dict)


class Found(msgspec.Struct, frozen=True):
    """One incident's folder. `partial`: its writing never came to an end."""

    id: str
    path: Path
    partial: bool


def write_bundle(
    parent: Path,
    incident_id: str,
    files: Mapping[str, bytes],
    missing: Mapping[str, str],
    *,
    complete: bool = True,
) -> Path | BundleFailed:
    """Write a new bundle and return its folder, or why there is none.

    After a failure nothing of it is left that could be removed, so that a full disk gets its room back.
    `complete=False` announces that `add_files` will follow.
    """
    assert is_incident_id(incident_id), incident_id
    final, temporary = parent / incident_id, parent / f".{incident_id}.partial"
    try:
        parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        if is_there(final):
            return BundleFailed(_HAS_ONE)
        with suppress(FileExistsError):
            temporary.mkdir(mode=0o700)
        with placing.writing(temporary) as held:
            # Waited for another writer: the folder may be called by its real name by now, or be gone.
            if is_there(final):
                # Overtaken between the look and the mkdir: this draft is our own empty one, and would be
                # taken for a half-written incident. rmdir, so that nothing anybody wrote can go.
                if held():
                    with suppress(OSError):
                        temporary.rmdir()
                return BundleFailed(_HAS_ONE)
            if not held():
                return BundleFailed("another writer had the evidence in hand")
            try:
                placing.empty(temporary)  # of a writer that died: this one says it anew
                manifest = _put_all(temporary, Manifest(incident_id, placing.now(), complete), files, missing)
                write_manifest(temporary, manifest)
                placing.sync_folder(temporary)
                temporary.rename(final)
            except OSError:
                shutil.rmtree(temporary, ignore_errors=True)
                raise
            placing.sync_folder(parent)
    except OSError as error:
        return BundleFailed(placing.why(error, "the evidence could not be written"))
    return final


def add_files(
    path: Path,
    files: Mapping[str, bytes],
    missing: Mapping[str, str],
    *,
    complete: bool | None = None,
    found: Collection[str] = (),
) -> BundleFailed | None:
    """Add or replace files of a bundle, each as a whole; the manifest follows last. None: all is written.

    `complete` None: as it was. `found`: names that are not missing any more. A manifest that can't be read is
    begun anew and says so: facts are worth more than a neat folder.
    """
    try:
        with placing.writing(path):
            placing.remove_drafts(path)
            before = read_manifest(path)
            if isinstance(before, BundleFailed):
                reason = f"begun anew, files from before are not listed: {before.reason}"
                before = Manifest(path.name, placing.now(), complete=False, missing={MANIFEST: reason})
                complete = False
            absent = {name: why for name, why in before.missing.items() if name not in found}
            finished = before.complete if complete is None else complete
            after = _put_all(path, structs.replace(before, complete=finished, missing=absent), files, missing)
            placing.sync_folder(path)
            write_manifest(path, after)
            placing.sync_folder(path)
    except OSError as error:
        return BundleFailed(placing.why(error, "a file could not be added to the bundle"))
    return None


def add_file(path: Path, name: str, data: bytes) -> BundleFailed | None:
    """Add or replace one file of a bundle; its evidence stays as complete as it was."""
    return add_files(path, {name: data}, {})


def add_image(path: Path, written: Path) -> str | BundleFailed:
    """Take a memory image that was written into the bundle's folder into the bundle; return its name there."""
    try:
        with placing.writing(path):
            before = read_manifest(path)
            if isinstance(before, BundleFailed):
                return before
            names = (f"core.{number}" for number in range(1, IMAGES_MAX + 1))
            name = next((name for name in names if name not in before.images), None)
            if name is None:
                return BundleFailed(f"this incident has {IMAGES_MAX} memory images already")
            size_bytes = written.stat().st_size
            written.rename(path / name)
            missing = {other: why for other, why in before.missing.items() if other != IMAGE}
            images = {**before.images, name: size_bytes}
            write_manifest(path, structs.replace(before, images=images, missing=missing))
            placing.sync_folder(path)
    except OSError as error:
        return BundleFailed(placing.why(error, "the memory image could not be kept"))
    return name


def read_manifest(path: Path) -> Manifest | BundleFailed:
    """Return what the bundle in folder `path` says of itself, whatever bytes stand there."""
    data = read_file(path, MANIFEST, MANIFEST_BYTES_MAX)
    if isinstance(data, BundleFailed):
        return data
    try:
        raw = json.loads(data)
    except (ValueError, RecursionError):
        return BundleFailed("its manifest is not JSON")
    if not isinstance(raw, dict) or raw.get("version") != VERSION:
        return BundleFailed("its manifest is of no version known here")
    entries = _read_entries(raw.get("files"))
    missing = raw.get("missing")
    if entries is None or not isinstance(missing, dict):
        return BundleFailed("its manifest is not in the form of a manifest")
    return Manifest(
        incident=str(raw.get("incident", "")),
        written_at=str(raw.get("written_at", "")),
        complete=raw.get("complete") is True,
        files=entries,
        missing={str(name): str(reason) for name, reason in missing.items()},
        images=_read_images(raw.get("images")),
    )


def read_file(path: Path, name: str, bytes_max: int = FILE_BYTES_MAX) -> bytes | BundleFailed:
    """Return the bytes of one file of a bundle. Links and anything but plain files are refused."""
    data = read_head(path, name, bytes_max + 1)
    if isinstance(data, bytes) and len(data) > bytes_max:
        return BundleFailed(f"{name} is larger than {bytes_max} bytes")
    return data


def read_head(path: Path, name: str, bytes_max: int) -> bytes | BundleFailed:
    """Return the first `bytes_max` bytes of one file of a bundle, refused as in `read_file`."""
    if _NAME.fullmatch(name) is None:
        return BundleFailed(f"{name!r} is not the name of a file in a bundle")
    try:
        # NONBLOCK: a pipe laid into the folder must not stop whoever reads it.
        handle = os.open(path / name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        return BundleFailed(f"{name} is not readable: {placing.words(error)}")
    try:
        if not stat.S_ISREG(os.fstat(handle).st_mode):
            return BundleFailed(f"{name} is not a plain file")
        return placing.read_up_to(handle, bytes_max)
    except OSError as error:
        return BundleFailed(f"{name} is not readable: {placing.words(error)}")
    finally:
        os.close(handle)


def verify_bundle(path: Path) -> list[str]:
    """Compare a bundle with its manifest; return one sentence for each fault, none if it is whole."""
    faults = _compare(path)
    if faults:
        # Files come before the manifest that lists them: whoever adds some is waited for, and it is looked again.
        with suppress(OSError), placing.writing(path):
            faults = _compare(path)
    return faults


def _compare(path: Path) -> list[str]:
    manifest = read_manifest(path)
    if isinstance(manifest, BundleFailed):
        return [manifest.reason]
    faults = [] if manifest.complete else ["its evidence was never finished"]
    for name, entry in sorted(manifest.files.items()):
        data = read_file(path, name)
        if isinstance(data, BundleFailed):
            faults.append(data.reason)
        elif len(data) != entry.size_bytes:
            faults.append(f"{name} has {len(data)} bytes, its manifest says {entry.size_bytes}")
        elif placing.digest(data) != entry.sha256:
            faults.append(f"{name} is not what its manifest says")
    faults += [
        fault for name, size in sorted(manifest.images.items()) if (fault := _image_fault(path, name, size))
    ]
    try:
        present = {item.name for item in os.scandir(path)}
    except OSError as error:
        return [*faults, f"its folder is not readable: {placing.words(error)}"]
    unknown = sorted(present - set(manifest.files) - set(manifest.images) - {MANIFEST})
    return faults + [f"{name!r} is not in its manifest" for name in unknown[:FILES_MAX]]


def find_bundles(parent: Path) -> list[Found]:
    """Return the incidents' folders in `parent`, newest id first. No such folder: an empty list."""
    found = []
    with suppress(OSError), os.scandir(parent) as items:
        for _, item in zip(range(FOLDERS_MAX), items, strict=False):
            partial = _PARTIAL.fullmatch(item.name)
            if not item.is_dir(follow_symlinks=False):
                continue
            if partial is not None:
                found.append(Found(partial.group(1), parent / item.name, partial=True))
            elif is_incident_id(item.name):
                found.append(Found(item.name, parent / item.name, partial=False))
    return sorted(found, key=lambda one: (one.id, not one.partial), reverse=True)


def is_image(name: str) -> bool:
    """Tell whether a file of a bundle is a memory image, by its name."""
    return _IMAGE.fullmatch(name) is not None


def is_there(path: Path) -> bool:
    """Tell whether something stands at `path`, a dangling link included. Unreadable counts as nothing."""
    try:
        path.lstat()
    except OSError:
        return False
    return True


def is_incident_id(text: str) -> bool:
    """Tell whether `text` may be the name of an incident's folder."""
    return _ID.fullmatch(text) is not None


def complete_partial(found: Found) -> Path | BundleFailed | None:
    """Give a half-written bundle, whose writer is dead, its real name with what is whole in it.

    None: it held nothing, or its incident has a bundle already, and it was removed.
    """
    final = found.path.with_name(found.id)
    try:
        with placing.writing(found.path) as held:
            if not held():
                return None
            names = [] if is_there(final) else sorted(item.name for item in os.scandir(found.path))
            files = {name: read_file(found.path, name) for name in names if _NAME.fullmatch(name)}
            kept = {
                name: data for name, data in files.items() if name != MANIFEST and isinstance(data, bytes)
            }
            if not kept:
                shutil.rmtree(found.path)
                return None
            missing = {MANIFEST: "begun anew: the guard ended while it wrote the evidence"}
            manifest = Manifest(found.id, placing.now(), complete=False, missing=missing)
            write_manifest(found.path, _put_all(found.path, manifest, kept, {}))
            for name in names:
                if name.endswith(".partial"):
                    (found.path / name).unlink(missing_ok=True)
            placing.sync_folder(found.path)
            found.path.rename(final)
            placing.sync_folder(final.parent)
    except OSError as error:
        return BundleFailed(placing.why(error, "the half-written evidence could not be completed"))
    return final


def _read_entries(raw: object) -> dict[str, Entry] | None:
    if not isinstance(raw, dict) or len(raw) > FILES_MAX:
        return None
    entries = {}
    for name, entry in raw.items():
        if not isinstance(entry, dict) or _NAME.fullmatch(name) is None:
            return None
        size, digest = entry.get("size_bytes"), entry.get("sha256")
        if not isinstance(size, int) or not isinstance(digest, str):
            return None
        entries[name] = Entry(digest, size)
    return entries


def _read_images(raw: object) -> dict[str, int]:
    sizes = raw if isinstance(raw, dict) else {}
    return {name: size for name, size in sizes.items() if _IMAGE.fullmatch(name) and isinstance(size, int)}


def _image_fault(path: Path, name: str, size_bytes: int) -> str | None:
    try:
        found_bytes = (path / name).lstat().st_size
    except OSError as error:
        return f"{name} is not readable: {placing.words(error)}"
    return (
        None
        if found_bytes == size_bytes
        else f"{name} has {found_bytes} bytes, its manifest says {size_bytes}"
    )


def _put_all(
    folder: Path, manifest: Manifest, files: Mapping[str, bytes], missing: Mapping[str, str]
) -> Manifest:
    """Write the files that fit and return the manifest that tells of them and of the rest."""
    entries, absent = dict(manifest.files), {**manifest.missing, **missing}
    fitting: dict[str, bytes] = {}
    for name, data in files.items():
        assert _NAME.fullmatch(name) is not None, name
        assert name != MANIFEST, name
        others_bytes = sum(entry.size_bytes for other, entry in entries.items() if other != name)
        if len(data) > FILE_BYTES_MAX:
            absent[name] = f"has {len(data)} bytes, more than {FILE_BYTES_MAX}"
        elif others_bytes + len(data) > BUNDLE_BYTES_MAX:
            absent[name] = f"the bundle would grow over {BUNDLE_BYTES_MAX} bytes"
        elif name not in entries and len(entries) >= FILES_MAX:
            absent[name] = f"the bundle has {FILES_MAX} files already"
        else:
            fitting[name] = data
            entries[name] = Entry(placing.digest(data), len(data))
            absent.pop(name, None)
    placing.replace_all(folder, fitting)
    return structs.replace(manifest, files=entries, missing=absent)


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """Say what is in the bundle, for whoever holds it alone. Raises OSError."""
    raw = {
        "version": VERSION,
        "incident": manifest.incident,
        "written_at": manifest.written_at,
        "complete": manifest.complete,
        "files": {
            name: {"sha256": entry.sha256, "size_bytes": entry.size_bytes}
            for name, entry in sorted(manifest.files.items())
        },
        "missing": dict(sorted(manifest.missing.items())),
        "images": dict(sorted(manifest.images.items())),
    }
    data = json.dumps(raw, ensure_ascii=False, indent=1).encode("utf-8", "backslashreplace")
    placing.replace(folder, MANIFEST, data)
