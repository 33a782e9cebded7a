"""The table of components on a recorder page: parts of the core that work by themselves, each with its own beat.

An importer or an auditor may stop while the loop goes on, and no request would show it. So each says when it
has work, how long it may be silent then, and beats in between; without work silence means nothing. Each word
stands alone, like the beats of the process. Not chosen: fixed words for each known component, because then a
new one would be a new version of the page.
"""

import threading
from collections.abc import Callable

from core.guarded import page

_NAME_WORDS = page.COMPONENT_NAME_BYTES_MAX // 8
_BEAT, _SINCE, _LIMIT, _DONE = (_NAME_WORDS + n for n in range(4))


class ComponentBeat:
    """What one component says of itself. One thread at a time; `Components.component` makes it."""

    def __init__(self, words: memoryview, word: int, clock: Callable[[], int]) -> None:
        """Write from `word` on, in words of 8 bytes; `clock` tells monotonic ns."""
        self._words = words
        self._word = word
        self._clock = clock
        self._done = 0

    def beat(self) -> None:
        """Say that it gets on with its work."""
        self._words[self._word + _BEAT] = self._clock()

    def works(self, on: bool) -> None:  # noqa: FBT001  there is nothing else to say
        """Say that it has something to do, or nothing any more."""
        now_ns = self._clock()
        # The beat first: work that has just come must not stand beside the silence of an idle hour.
        self._words[self._word + _BEAT] = now_ns
        self._words[self._word + _SINCE] = now_ns if on else 0

    def done(self, count: int = 1) -> None:
        """Say that `count` more pieces of its work are done, whatever a piece is to it; this is a beat too."""
        self._done += count
        self._words[self._word + _DONE] = self._done
        self.beat()


class Components:
    """All components of this process."""

    def __init__(self, view: memoryview, words: memoryview, clock: Callable[[], int]) -> None:
        """Keep the table on a whole page, given as bytes and as words; `clock` tells monotonic ns."""
        self._bytes = view
        self._words = words
        self._clock = clock
        self._components: dict[str, ComponentBeat] = {}
        self._components_lock = threading.Lock()

    def component(self, name: str, limit_ms: int) -> ComponentBeat:
        """Return the beat of the component of this name (24 bytes), which may be silent for `limit_ms` at work.

        A name has one place, whoever asks again: a component that is started anew goes on where it was. Any
        thread.
        """
        raw = name.encode()
        assert 0 < len(raw) <= page.COMPONENT_NAME_BYTES_MAX, f"{name!r} does not fit into its place"
        with self._components_lock:
            if name in self._components:
                return self._components[name]
            assert len(self._components) < page.COMPONENTS, f"there is no place left for {name!r}"
            at = page.COMPONENTS_AT + len(self._components) * page.COMPONENT_BYTES
            self._bytes[at : at + len(raw)] = raw
            self._words[(at >> 3) + _LIMIT] = limit_ms * 1_000_000
            made = self._components[name] = ComponentBeat(self._words, at >> 3, self._clock)
        return made
