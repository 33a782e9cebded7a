"""Makes recorder pages and reads them while their core lives, is stopped, or is long dead.

Read with `pread` on one descriptor, never mapped: a page that was truncated under a mapping reader killed
the reader with SIGBUS, and the next one after it. The descriptor is kept, so a file that somebody puts in
the page's place changes nothing for a core that has the page mapped, nor for us. Whatever is not a whole
page of this version with the expected nonce is no evidence at all: `PageUnusable` with a reason, or None
where a tick asks ten times a second. Half-written entries are read again a few times, because a living
writer ends them in microseconds; what stays torn is reported as torn.
"""

import os
import stat
from pathlib import Path

import msgspec

from hardcore.host import page
from hardcore.model.looks import LogCounts
from hardcore.model.recorder import Beats, CommandNote, ComponentBeat, Page, Threads, Witness

#: How often a torn entry is read again before it counts as torn.
READS_MAX = 4


class PageUnusable(msgspec.Struct, frozen=True):
    """The file is no evidence; `reason` is a sentence."""

    reason: str


def make_page(path: Path, nonce: str, boot_id: str) -> None:
    """Make the page of one life: allocated to its end, mode 0600, never in another file's place.

    Raises OSError when the file exists already or there is no room for it; nothing is left behind then.
    """
    fd = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        # Allocated, not only sized: a store into a hole on a full file system would be a SIGBUS.
        os.posix_fallocate(fd, 0, page.FILE_BYTES)
        os.pwrite(fd, page.new_page_head(nonce, boot_id), 0)
    except BaseException:
        path.unlink(missing_ok=True)
        raise
    finally:
        os.close(fd)


class PageReader:
    """Reads one page. No method raises, whatever is done to the file or written in it."""

    def __init__(self, path: Path, nonce: str | None = None) -> None:
        """Open the page at `path`; `nonce` is that of the life it must belong to, None for any."""
        self._path = path
        self._nonce = nonce
        self._fd: int | None = None
        self._made = b""
        self.fault: PageUnusable | None = None
        self.fault = self._open()

    def _open(self) -> PageUnusable | None:
        try:
            # Non-blocking, or somebody's FIFO in the page's place would stop the watch for ever.
            fd = os.open(self._path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
        except OSError as error:
            return PageUnusable(f"The recorder page could not be opened: {error.strerror}.")
        self._fd = fd
        if not stat.S_ISREG(os.fstat(fd).st_mode):
            return self._refuse("is not a file")
        head = self._pread(page.MADE_BYTES, 0)
        made = page.made(head)
        if made is None:
            return self._refuse("is not a page of this version")
        if self._nonce is not None and made.nonce != self._nonce:
            return self._refuse("belongs to another life")
        self._made = head
        return None

    def _refuse(self, why: str) -> PageUnusable:
        self.close()
        return PageUnusable(f"The recorder page {why}.")

    def _pread(self, length: int, offset: int) -> bytes:
        """Return up to `length` bytes, fewer at the end of the file or when the file can't be read."""
        if self._fd is None:
            return b""
        parts = b""
        while len(parts) < length:
            try:
                part = os.pread(self._fd, length - len(parts), offset + len(parts))
            except OSError:
                return parts
            if not part:
                return parts
            parts += part
        return parts

    def _head(self, length: int = page.HEAD_BYTES) -> bytes | None:
        """Return the first `length` bytes if the file is still the whole page that was opened."""
        head = self._pread(length, 0)
        if len(head) != length or head[: page.MADE_BYTES] != self._made or not self._long_enough():
            return None
        return head

    def _long_enough(self) -> bool:
        return self._fd is not None and os.fstat(self._fd).st_size == page.FILE_BYTES

    def beats(self) -> Beats | None:
        """Return the beats, or None when the page is no evidence (any more)."""
        head = self._head()
        return None if head is None else page.beats(head)

    def look(self) -> tuple[Beats, Witness | None] | None:
        """Return the beats and the last commit, both of one moment; None when the page is no evidence (any more).

        The witness is read after `answered_seq` and stored before it, so that an answer that claims more than
        the witness shows is a claim that no commit stands behind.
        """
        head = self._head(page.LOOK_BYTES)
        if head is None or (beats := page.beats(head)) is None:
            return None
        return beats, page.newest_witness(head)

    def components(self) -> tuple[ComponentBeat, ...]:
        """Return what the core's parts say of themselves; none while the page is no evidence."""
        head = self._head(page.COMPONENTS_AT + page.COMPONENTS * page.COMPONENT_BYTES)
        return () if head is None else page.components(head)

    def why_blind(self) -> str:
        """Return why `look` finds no evidence, as a sentence; cheap, because a tick may ask again and again."""
        if self.fault is not None:
            return self.fault.reason
        head = self._pread(page.LOOK_BYTES, 0)
        if len(head) != page.LOOK_BYTES or not self._long_enough():
            return "The recorder page has not the size it was made with, or can't be read."
        if head[: page.MADE_BYTES] != self._made:
            return "The recorder page's header was changed."
        return "The recorder page holds a life state that nobody writes."

    def threads(self) -> Threads:
        """Return the core's thread ids, 0 where not known."""
        head = self._head()
        return Threads() if head is None else page.threads(head)

    def identity(self) -> tuple[int, int] | None:
        """Return pid and start time (ticks since boot) of the page's owner, or None without one."""
        head = self._head()
        return None if head is None else page.identity(head)

    def log_counts(self) -> LogCounts | None:
        """Return what the core has written to its log so far, or None as in `beats`."""
        head = self._head()
        return None if head is None else page.log_counts(head)

    def in_flight(self) -> tuple[CommandNote, ...] | None:
        """Return the commands in the slots alone, cheaper than a whole `read`; None as in `beats`."""
        if self._head() is None:
            return None
        shape = page.SLOTS
        raw = self._pread(shape.count * shape.size_bytes, shape.at)
        if len(raw) != shape.count * shape.size_bytes:
            return None
        notes = []
        for start in page.slots_in_use(raw):
            entry, torn = self._settled(shape, shape.at + start, raw[start : start + shape.size_bytes])
            # It may have been freed since; then it is in the finished ring, not in flight.
            if page.slot_in_use(entry):
                notes.append(page.slot(entry, torn=torn))
        return tuple(notes)

    def witness(self) -> Witness | None:
        """Return the last commit alone, cheaper than a whole `read`; None as in `beats`, or before the first."""
        head = self._head(page.LOOK_BYTES)
        return None if head is None else page.newest_witness(head)

    def read(self) -> Page | PageUnusable:
        """Return everything on the page, oldest first where there is an order, or why it is no evidence."""
        if self.fault is not None:
            return self.fault
        raw = bytearray(self.raw())
        if len(raw) != page.FILE_BYTES:
            return PageUnusable("The recorder page is shorter than it should be.")
        if raw[: page.MADE_BYTES] != self._made:
            return PageUnusable("The recorder page's header was changed.")
        unsettled = set()
        for shape in page.SHAPES:
            for at in page.used_entries(shape, raw):
                end = at + shape.size_bytes
                raw[at:end], torn = self._settled(shape, at, bytes(raw[at:end]))
                if torn:
                    unsettled.add(at)
        found = page.decode(bytes(raw), unsettled)
        return found or PageUnusable("The recorder page holds a life state that nobody writes.")

    def _settled(self, shape: page.Shape, at: int, entry: bytes) -> tuple[bytes, bool]:
        """Return the entry at `at`, read again until it stands still, and whether it is torn."""
        for _ in range(READS_MAX):
            # The lock once more: a slot's stage is outside its CRC and could be the next command's.
            if page.whole(shape, entry) and self._pread(8, at) == entry[:8]:
                return entry, False
            again = self._pread(shape.size_bytes, at)
            if len(again) != shape.size_bytes:
                break
            entry = again
        return entry, True

    def raw(self) -> bytes:
        """Return the bytes of the page as they are, for the bundle; fewer than a page if it was cut."""
        return self._pread(page.FILE_BYTES, 0)

    def close(self) -> None:
        """Give the descriptor back. After it nothing is evidence."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None
            self.fault = PageUnusable("The recorder page was closed.")
