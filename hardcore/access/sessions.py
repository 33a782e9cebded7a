"""Who is signed in: sessions by the digest of what the browser holds, each with an end. Pure.

A session ends when nobody used it for a while, when it is old, when its password changed, and when its person signs out.
What somebody did lately, a password typed again, is kept here too: some deeds ask for it. The browser's half is random and
says nothing; a signed cookie that says everything itself was not chosen, because it could not be ended.
Times are monotonic nanoseconds of this boot: after a reboot of the machine people sign in again.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Final

import msgspec

from hardcore.access.people import People, Person, digest_of

SESSIONS_MAX: Final = 1_000


class Session(msgspec.Struct):
    """One browser that is signed in. `mark`: of the password it came in with; `proven_ns`: when that was typed last."""

    digest: str
    name: str
    mark: str
    begun_ns: int
    seen_ns: int
    proven_ns: int


class Spans(msgspec.Struct, frozen=True):
    """How long a session lasts unused, how long at most, and how long a password that was typed counts as just typed."""

    idle_ns: int
    longest_ns: int
    proven_ns: int


class Sessions:
    """All that are open."""

    def __init__(self, spans: Spans, before: Iterable[Session] = ()) -> None:
        self._spans = spans
        self._open = {one.digest: one for one in before}
        self.changed: Callable[[], None] = lambda: None

    def __iter__(self) -> Iterator[Session]:
        """All of them."""
        return iter(tuple(self._open.values()))

    def begin(self, secret: str, person: Person, now_ns: int) -> None:
        """Somebody has signed in; the browser holds `secret`. Where there are too many, the one unused longest ends."""
        if len(self._open) >= SESSIONS_MAX:
            oldest = min(self._open.values(), key=lambda one: one.seen_ns)
            del self._open[oldest.digest]
        digest = digest_of(secret)
        self._open[digest] = Session(digest, person.name, person.mark, now_ns, now_ns, now_ns)
        self.changed()

    def of(self, secret: str, people: People, now_ns: int) -> Session | None:
        """The session that a browser holds, if it is still open."""
        session = self._open.get(digest_of(secret))
        return session if session is not None and self.is_open(session, people, now_ns) else None

    def is_open(self, session: Session, people: People, now_ns: int) -> bool:
        """Whether a session has not come to its end."""
        person = people.person(session.name)
        return (
            session.digest in self._open
            and person is not None
            and person.mark == session.mark
            and 0 <= now_ns - session.seen_ns <= self._spans.idle_ns
            and now_ns - session.begun_ns <= self._spans.longest_ns
        )

    def is_proven(self, session: Session, now_ns: int) -> bool:
        """Whether its password was typed just now."""
        return now_ns - session.proven_ns <= self._spans.proven_ns

    def prove(self, session: Session, now_ns: int) -> None:
        """Its password was typed again."""
        session.proven_ns = session.seen_ns = now_ns
        self.changed()

    def end(self, digest: str) -> None:
        """Somebody signs out."""
        if self._open.pop(digest, None) is not None:
            self.changed()

    def prune(self, people: People, now_ns: int) -> None:
        """Now and then: forget those that are over."""
        over = [one.digest for one in self._open.values() if not self.is_open(one, people, now_ns)]
        for digest in over:
            del self._open[digest]
        if over:
            self.changed()
