"""Tells the service manager what this core has reached, in datagrams on its notify socket.

What must not get lost (the epoch, READY, the proof, leaving) is kept in order and sent again until the manager's
socket takes it: a sentinel that is just being replaced, or whose buffer is full, hears it a moment later.
What is true for a moment only (a watchdog's sign, more time) is sent once or not at all. Nothing
blocks and nothing raises: a core does not stall because its guard does. Not chosen: a connected socket,
which would stay bound to a sentinel that is gone.
"""

import socket
from collections import deque
from collections.abc import Sequence

from core.guarded.locks import NamedLock

#: More facts than one life has: that it is a spare, the epoch, READY, the proof, a blocked fence, some TERMs, STOPPING.
KEPT_MAX = 32
#: A sentence for people; even in Hangul it fits into one datagram many times.
SENTENCE_CHARACTERS_MAX = 400


class Mail:
    """Takes datagrams to the socket at `address`: a path, an abstract name with a leading `@`, or None."""

    def __init__(self, address: str | None) -> None:
        """Without an address every word is a no-op: nobody listens."""
        self._address = address
        self._kept: deque[bytes] = deque()
        self._lock = NamedLock("beacon")
        self._socket: socket.socket | None = None
        if address is not None:
            self._address = "\0" + address[1:] if address.startswith("@") else address
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)

    def resend(self) -> bool:
        """Send what is kept, oldest first; return whether nothing is left. Safe from any thread."""
        with self._lock:
            while self._kept:
                if not self._send(self._kept[0]):
                    return False
                self._kept.popleft()
            return True

    def close(self) -> None:
        """Say no more."""
        with self._lock:
            if self._socket is not None:
                self._socket.close()
                self._socket = None

    def _keep(self, message: str) -> None:
        with self._lock:
            # What was said first matters most: a flood of TERMs must not push READY out.
            if self._socket is not None and len(self._kept) < KEPT_MAX:
                self._kept.append(message.encode())
        self.resend()

    def _send(self, message: bytes) -> bool:
        if self._socket is None or self._address is None:
            return True
        try:
            self._socket.sendto(message, self._address)
        except OSError:
            # No reader, a full buffer, a replaced socket: all of them may be over at the next beat.
            return False
        return True


class Beacon(Mail):
    """The words for what a core has reached."""

    def spare(self, build: str, control: int, schema: int, *, migrates: bool) -> None:
        """Say that this core can be promoted: its code, the version of its control socket, the store's schema.

        `migrates`: taking over would bring the store up to a newer schema.
        """
        said = f"X_SPARE=1\nX_BUILD={build}\nX_CONTROL={control}\nX_SCHEMA={schema}"
        self._keep(f"{said}\nX_MIGRATES=1" if migrates else said)

    def epoch_raised(self, epoch: int) -> None:
        """Say that the fence is committed."""
        self._keep(f"X_EPOCH={epoch}")

    def ready(self, epoch: int, seq: int, hash_hex: str, proof: str, tail: int) -> None:
        """Say that the ledger is proven and the socket bound. `proof` is `witness`, `chain` or `none`."""
        self._keep(
            f"READY=1\nX_EPOCH={epoch}\nX_SEQ={seq}\nX_HASH={hash_hex}\nX_PROOF={proof}\nX_TAIL={tail}"
        )

    def verified(self, seq: int) -> None:
        """Say that the whole ledger was proven, from its first event to `seq`."""
        self._keep(f"X_VERIFIED={seq}")

    def unsound(self, sentence: str) -> None:
        """Say that the ledger is not whole, and where. A long sentence is cut."""
        self._keep("X_UNSOUND=" + " ".join(sentence.split())[:SENTENCE_CHARACTERS_MAX])

    def store(self, fault: str) -> None:
        """Say that the store takes no write any more (`FULL`, `READ_ONLY`), or does again (`OK`)."""
        self._keep(f"X_STORE={fault}")

    def cases(self, names: Sequence[str]) -> None:
        """Say that the cases of suspects were filed, rows of an import: in one datagram, for one court."""
        self._keep(f"X_CASE={' '.join(names)}")

    def fence_blocked(self) -> None:
        """Say that the fence could not be written because the store stayed busy."""
        self._keep("X_FENCE=BLOCKED")

    def term_from(self, pid: int) -> None:
        """Say who sent a TERM; 0: nobody knows."""
        self._keep(f"X_TERM={pid}")

    def stopping(self) -> None:
        """Say that this core begins to leave."""
        self._keep("STOPPING=1")

    def watchdog(self) -> None:
        """Give a sign of life, after whatever could not be sent before."""
        if self.resend():
            self._send(b"WATCHDOG=1")

    def extend(self, usec: int) -> None:
        """Ask for `usec` more microseconds to start in."""
        self._send(f"EXTEND_TIMEOUT_USEC={usec}".encode())
