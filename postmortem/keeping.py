"""What is kept of incidents and of memory images, and what has no owner any more.

The newest stories stay, in number and in bytes; memory images are counted by themselves and go first, whole or
half written, so that an image never drives a story out. Removing by age was not chosen: a household that has one
incident a year wants to read last year's.
"""

import os
import re
import shutil
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from msgspec import structs

from postmortem import bundle, placing

#: What is kept of incidents: the newest ones, in number and in bytes; and how many go at one time.
INCIDENTS_MAX = 200
INCIDENTS_BYTES_MAX = 512 << 20
REMOVED_AT_ONCE_MAX = 64
#: What is kept of memory images in all, besides the bytes of the stories.
IMAGES_BYTES_MAX = 2 << 30

_GONE = re.compile(r"\.[A-Za-z0-9][A-Za-z0-9_-]{0,63}\.gone")
#: A memory image while it is being written: nothing of the story, and nothing worth keeping half.
_HALF_IMAGE = re.compile(r"\.core\.[0-9]+")


def sweep(parent: Path) -> None:
    """Remove what writers that died in the middle have left in any bundle. For a guard's beginning.

    It dumps no memory yet: a half image is somebody's who is gone. What a writer holds is left to that writer.
    """
    for found in bundle.find_bundles(parent):
        with suppress(OSError), placing.writing(found.path, wait_ms=0):
            placing.remove_drafts(found.path)
            for name in filter(_HALF_IMAGE.fullmatch, _images_in(found.path)):
                (found.path / name).unlink(missing_ok=True)


def prune(
    parent: Path,
    keep: str,
    count_max: int = INCIDENTS_MAX,
    bytes_max: int = INCIDENTS_BYTES_MAX,
    images_bytes_max: int = IMAGES_BYTES_MAX,
) -> list[str]:
    """Remove the oldest closed incidents above the maxima, the incident `keep` never; return their ids.

    An incident without facts is open, so it stays. What a writer holds stays until the next time. Memory images
    are counted by themselves and go first, the oldest too: an image never drives a story out.
    """
    _remove_gone(parent)
    found = [one for one in bundle.find_bundles(parent) if not one.partial]
    _prune_images([one.path for one in reversed(found) if one.id != keep], parent / keep, images_bytes_max)
    sizes = {one.id: _size_bytes(one.path) for one in found}
    count, size_bytes = len(found), sum(sizes.values())
    removed: list[str] = []
    for one in reversed(found):
        if (count <= count_max and size_bytes <= bytes_max) or len(removed) >= REMOVED_AT_ONCE_MAX:
            break
        if one.id != keep and bundle.is_there(one.path / bundle.FACTS) and remove(one.path):
            removed.append(one.id)
            count, size_bytes = count - 1, size_bytes - sizes[one.id]
    return removed


def _prune_images(oldest_first: list[Path], kept: Path, bytes_max: int) -> None:
    images = {path: _images_in(path) for path in (*oldest_first, kept)}
    size_bytes = sum(sum(sizes.values()) for sizes in images.values())
    for path in oldest_first:
        if size_bytes <= bytes_max:
            return
        if images[path] and _remove_images(path, images[path]):
            size_bytes -= sum(images[path].values())


def _images_in(path: Path) -> dict[str, int]:
    with suppress(OSError), os.scandir(path) as items:
        looked_at = [item for _, item in zip(range(bundle.FOLDERS_MAX), items, strict=False)]
        return {
            item.name: item.stat(follow_symlinks=False).st_size for item in looked_at if _is_image(item.name)
        }
    return {}


def _is_image(name: str) -> bool:
    return bundle.is_image(name) or _HALF_IMAGE.fullmatch(name) is not None


def _remove_images(path: Path, names: Collection[str]) -> bool:
    """Remove the memory images of one incident; its manifest says where they went, also if that fails."""
    try:
        with placing.writing(path, wait_ms=0):
            for name in names:
                (path / name).unlink()
            before = bundle.read_manifest(path)
            if isinstance(before, bundle.Manifest):
                whole = (name for name in names if bundle.is_image(name))
                told = dict.fromkeys(whole, "removed to make room for newer ones")
                bundle.write_manifest(
                    path, structs.replace(before, images={}, missing={**before.missing, **told})
                )
    except OSError:
        return False
    return True


def remove(path: Path) -> bool:
    """Remove a bundle; False: somebody writes it, or the disk refused.

    Its name goes first, so that a death in the middle leaves no half incident.
    """
    gone = path.with_name(f".{path.name}.gone")
    try:
        with placing.writing(path, wait_ms=0):
            path.rename(gone)
            shutil.rmtree(gone)
    except OSError:
        return False
    return True


def _remove_gone(parent: Path) -> None:
    with suppress(OSError), os.scandir(parent) as items:
        for _, item in zip(range(bundle.FOLDERS_MAX), items, strict=False):
            if _GONE.fullmatch(item.name):
                shutil.rmtree(item.path, ignore_errors=True)


def _size_bytes(path: Path) -> int:
    total = 0
    with suppress(OSError), os.scandir(path) as items:
        for _, item in zip(range(bundle.FOLDERS_MAX), items, strict=False):
            if not _is_image(item.name):
                total += item.stat(follow_symlinks=False).st_size
    return total
