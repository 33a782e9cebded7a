"""How a core may leave, as values: exit code, one word for the guard, one sentence for a person.

The codes are a wire (`docs/wires.md` section 2): the guard tells a configuration that can't work from a store
that is damaged by them, and restarts, waits or stops accordingly. Every way out that is not asked for is made
by one function below, so the code, the word and the sentence can't go apart.
"""

from enum import IntEnum

import msgspec


class ExitCode(IntEnum):
    """What the process ends with."""

    ASKED = 0
    STORE_CORRUPT = 65
    DB_LOCKED = 69
    BUG = 70
    DISK_FULL = 73
    COMMIT_FAILED = 74
    FENCED = 75
    CONFIG_INVALID = 78


class Departure(msgspec.Struct, frozen=True):
    """Why this core leaves. `sentence` says what is wrong and what to do next.

    `finer` names the cause where one code stands for several.
    """

    code: ExitCode
    sentence: str
    finer: str = ""

    @property
    def word(self) -> str:
        """The word of the last words, which is the name of the diagnosis: the code's, or the finer one."""
        return self.finer or self.code.name


def config_invalid(sentence: str) -> Departure:
    """What it was told can't work."""
    return Departure(ExitCode.CONFIG_INVALID, sentence)


def corrupt(place: str) -> Departure:
    """The proof failed at `place`."""
    sentence = (
        f"The ledger is not whole: {place}. Nothing was changed; compare with a backup before going on."
    )
    return Departure(ExitCode.STORE_CORRUPT, sentence)


def unproven(text: str) -> Departure:
    """The proof itself raises: a mistake of ours, or a book that it was not written for."""
    sentence = (
        f"The ledger can't be proven, its proof fails ({text}). "
        "Nothing was changed; compare with a backup before going on."
    )
    return Departure(ExitCode.STORE_CORRUPT, sentence)


def fenced(mine: int, actual: int) -> Departure:
    """A core with a higher epoch may write now."""
    sentence = (
        f"The ledger stands at epoch {actual}, past {mine}: another core has taken over, this one leaves."
    )
    return Departure(ExitCode.FENCED, sentence)


def locked(text: str) -> Departure:
    """Somebody else holds the store's lock at the fence."""
    sentence = f"Another program holds the ledger's lock ({text}): end it, then start again."
    return Departure(ExitCode.DB_LOCKED, sentence)


def away(text: str) -> Departure:
    """The server that the ledger lies in can't be reached: like a lock that somebody holds, it passes."""
    sentence = (
        f"The ledger's database can't be reached ({text}): see that its server runs and lets this user in."
    )
    return Departure(ExitCode.DB_LOCKED, sentence, finer="STORE_AWAY")


def unfit(text: str) -> Departure:
    """The server that the ledger lies in is there, and no ledger can be kept in it as it is set up."""
    return Departure(
        ExitCode.CONFIG_INVALID, f"The ledger's database can't be used: {text}. See docs/postgresql.md."
    )


def no_room(text: str) -> Departure:
    """The disk takes no write: it is full."""
    sentence = f"The ledger's disk takes no write ({text}): make room, then start again."
    return Departure(ExitCode.DISK_FULL, sentence)


def read_only(text: str) -> Departure:
    """The ledger's disk, or its file, may not be written."""
    sentence = f"The ledger's disk or file is read-only ({text}): make it writable, then start again."
    return Departure(ExitCode.DISK_FULL, sentence, "DISK_READ_ONLY")


def commit_failed(text: str) -> Departure:
    """The store raised inside a transaction."""
    sentence = f"Storing failed half-way ({text}): what became of the last commands is seen by the next core."
    return Departure(ExitCode.COMMIT_FAILED, sentence)


def bug(text: str) -> Departure:
    """The core met a mistake of ours."""
    return Departure(ExitCode.BUG, f"The core stopped at a mistake of our own ({text}): please report it.")
