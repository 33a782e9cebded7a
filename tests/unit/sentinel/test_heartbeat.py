"""One datagram of a notify socket as a value, whatever is in it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardcore.sentinel.heartbeat import NOTICE_BYTES_MAX, MalformedNotice, Notice, SpareNotice, read_notice

NAMES = ("0a" * 16, "0b" * 16)
SPARE = b"X_SPARE=1\nX_BUILD=0123456789abcdef\nX_CONTROL=2\nX_SCHEMA=4"
PROOF = b"X_EPOCH=7\nX_SEQ=5\nX_HASH=" + b"ab" * 32 + b"\nX_PROOF=chain\nX_TAIL=3"


@pytest.mark.parametrize(
    ("datagram", "notice"),
    [
        (b"", Notice()),
        (b"READY=1", Notice(ready=True)),
        (b"READY=1\n", Notice(ready=True)),
        (b"READY=1\nREADY=1", Notice(ready=True)),
        (b"READY=1\n" + PROOF, Notice(ready=True, epoch=7, seq=5, hash="ab" * 32, proof="chain", tail=3)),
        (b"WATCHDOG=1\nSTATUS=fine", Notice(watchdog=True, status="fine")),
        (b"STATUS=a=b", Notice(status="a=b")),
        (b"STATUS=\x1b[2Jred\x07", Notice(status="[2Jred")),
        (b"MAINPID=4\nMAINPID=5\nFDSTORE=1", Notice()),
        (b"STOPPING=1", Notice(stopping=True)),
        (b"X_FENCE=BLOCKED", Notice(fence_blocked=True)),
        (b"X_TERM=0", Notice(term_pid=0)),
        (b"X_CASE=" + NAMES[0].encode(), Notice(cases=NAMES[:1])),
        (b"X_CASE=" + " ".join(NAMES).encode(), Notice(cases=NAMES)),
        (b"X_VERIFIED=0", Notice(verified_seq=0)),
        (b"X_UNSOUND=event 5 is\x1b[2J odd", Notice(unsound="event 5 is[2J odd")),
        (b"X_UNSOUND=" + b"a" * 900, Notice(unsound="a" * 400)),
        (SPARE, Notice(spare=SpareNotice("0123456789abcdef", 2, 4))),
        (SPARE + b"\nX_MIGRATES=1", Notice(spare=SpareNotice("0123456789abcdef", 2, 4, migrates=True))),
        (b"EXTEND_TIMEOUT_USEC=9223372036854775807", Notice(extend_usec=2**63 - 1)),
    ],
)
def test_what_a_datagram_says(datagram: bytes, notice: Notice) -> None:
    assert read_notice(datagram) == notice


@pytest.mark.parametrize(
    "datagram",
    [
        b"READY=0",
        b"READY",
        b"\xff=1",
        b"X_FENCE=OPEN",
        b"X_EPOCH=",
        b"X_EPOCH=-1",
        b"X_EPOCH= 1",
        b"X_EPOCH=1_000",
        "X_EPOCH=\u0661".encode(),
        b"X_EPOCH=9223372036854775808",
        b"X_EPOCH=" + b"1" * 3000,
        b"X_EPOCH=1\nX_EPOCH=2",
        b"X_HASH=" + b"AB" * 32,
        b"X_PROOF=faith",
        b"X_VERIFIED=all",
        b"X_CASE=",
        b"X_CASE=" + NAMES[0].encode() + b" ",
        b"X_CASE=../" + NAMES[0].encode(),
        b"X_UNSOUND=",
        b"X_VERIFIED=5\nX_UNSOUND=event 5 is odd",
        b"READY=1\nX_SEQ=5",
        b"X_SPARE=0",
        b"X_SPARE=1",
        b"X_MIGRATES=1",
        SPARE.removeprefix(b"X_SPARE=1\n"),
        SPARE.replace(b"cdef", b"CDEF"),
        SPARE + b"\nX_EPOCH=7",
        SPARE + b"\nREADY=1",
        b"READY=1\nX_EPOCH=7\nX_SEQ=5\nX_PROOF=chain\nX_TAIL=3",
        PROOF,
        b"READY=1\n" + PROOF.replace(b"X_EPOCH=7\n", b""),
        b"A=1\n" * 65,
        b"STATUS=" + b"a" * NOTICE_BYTES_MAX,
    ],
)
def test_what_is_said_wrongly_is_malformed_as_a_whole(datagram: bytes) -> None:
    assert isinstance(read_notice(datagram), MalformedNotice)


LINES = st.lists(
    st.tuples(
        st.sampled_from(
            ["READY", "X_EPOCH", "X_SEQ", "X_HASH", "X_PROOF", "X_TAIL", "STATUS", "X_TERM", "OTHER"]
        ),
        st.one_of(st.sampled_from(["1", "", "BLOCKED", "chain", "ab" * 32]), st.text(max_size=30)),
    ),
    max_size=12,
)


@given(st.binary(max_size=NOTICE_BYTES_MAX + 50))
def test_no_bytes_can_raise(datagram: bytes) -> None:
    assert isinstance(read_notice(datagram), Notice | MalformedNotice)


@given(LINES)
def test_no_lines_can_raise_and_a_ready_core_is_proven_or_claims_nothing(
    lines: list[tuple[str, str]],
) -> None:
    notice = read_notice("\n".join(f"{key}={value}" for key, value in lines).encode("utf-8", "surrogatepass"))
    if isinstance(notice, Notice):
        claims = {notice.seq is None, notice.hash is None, notice.proof is None, notice.tail is None}
        assert len(claims) == 1
        assert claims == {True} or (notice.ready and notice.epoch is not None)
        assert notice.status is None or notice.status.isprintable()
