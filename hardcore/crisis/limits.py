"""The gateway's settings: what the operator may turn, and beneath it the pace of its own machinery.

The operator's numbers are `settings.Limits`. Those added here nobody needs to turn in a household, but
they are waiting times and bounds all the same, so they have names and a test can shorten them. Both come
in the same JSON object (`HARDCORE_LIMITS`); constants in the rooms that use them were not chosen, because
two rooms would soon disagree.
"""

import json
from dataclasses import dataclass

from hardcore.settings import Fault, Limits, read, setting


@dataclass(frozen=True, slots=True)
class GatewayLimits(Limits):
    """`settings.Limits` and the pace of the gateway's own machinery."""

    upstream_connections_max: int = setting(256, "connections to the core at a time", low=1, high=10_000)
    #: Shorter than the core keeps an idle connection (5 s): a request sent into a closing one would be
    #: taken for a core's death.
    upstream_idle_ms: int = setting(2_000, "an unused connection to the core is closed", low=10, high=600_000)
    retire_ms: int = setting(
        500, "a drained core's last answers are heard for so long after the next is named", low=0, high=60_000
    )
    probe_ms: int = setting(100, "a core in doubt is asked again after this", low=5, high=60_000)
    ask_again_ms: int = setting(
        500, "the core that lost a request's answer is asked about it again after this", low=5, high=60_000
    )
    doubt_told_ms: int = setting(500, "pages are told of a doubt that nobody confirmed", low=0, high=60_000)
    feed_retry_ms: int = setting(100, "a lost feed is dialled again after this", low=5, high=60_000)
    paper_after_ms: int = setting(
        200,
        "the gateway's own pages are made this long after its start, or when one is asked for",
        low=0,
        high=60_000,
    )
    stats_ms: int = setting(200, "numbers are told at most this often", low=5, high=60_000)
    witness_ms: int = setting(
        100, "a commit that was passed on is told at most this often", low=0, high=60_000
    )
    receipt_store_ms: int = setting(5_000, "the disk must have stored a promise by then", low=10, high=60_000)
    receipts_first_ms: int = setting(
        1_000, "after a release a browser's promises go before what it sends then", low=0, high=60_000
    )
    account_hold_ms: int = setting(
        10_000, "what touches a suspect's account waits behind it this long", low=0, high=600_000
    )
    investigator_ms: int = setting(
        8_000, "the investigators' pages have this long to come up", low=10, high=600_000
    )
    receipt_pause_ms: int = setting(1_000, "a promise not kept yet is tried again", low=5, high=3_600_000)
    connections_per_address_max: int = setting(
        1536, "client connections from one address at a time", low=1, high=100_000
    )
    turned_away_max: int = setting(
        256, "connections above the limit that are heard out with their answer", low=1, high=10_000
    )
    door_callers_max: int = setting(
        64, "connections above the limit that may still ask a door", low=0, high=10_000
    )
    door_head_ms: int = setting(1_000, "such a one must have said what it asks by then", low=10, high=60_000)
    body_bytes_per_s_min: int = setting(
        1_000, "a body that comes or is taken slower ends", low=1, high=1 << 20
    )
    answers_bytes_max: int = setting(
        64 << 20, "kept and untaken of all answers together", low=1 << 10, high=1 << 34
    )
    client_stall_ms: int = setting(30_000, "a client takes nothing for so long", low=10, high=3_600_000)
    session_proven_ms: int = setting(
        300_000, "a password that was typed counts as just typed", low=1, high=86_400_000
    )
    sign_in_tries_max: int = setting(5, "passwords that one address may try at once", low=1, high=1000)
    sign_in_every_ms: int = setting(12_000, "and one more after this", low=1, high=3_600_000)
    access_look_ms: int = setting(500, "changes of who may come in are seen after this", low=5, high=60_000)
    tls_handshake_ms: int = setting(5_000, "a client has agreed on encryption by then", low=10, high=60_000)
    flush_ms: int = setting(500, "at the end: how long the last answers may leave", low=0, high=60_000)
    linger_ms: int = setting(2_000, "hears a client out that says nothing more", low=10, high=60_000)
    linger_total_ms: int = setting(60_000, "hears a client out that still sends", low=10, high=3_600_000)
    live_beat_ms: int = setting(
        5_000, "while no core serves: pages hear at least this often", low=5, high=60_000
    )
    #: A person is asked to tell somebody then: not because what takes one second took two.
    longer_floor_ms: int = setting(5_000, "no outage is called long before this", low=0, high=3_600_000)
    socket_ping_ms: int = setting(25_000, "a socket that says nothing is asked", low=10, high=600_000)
    socket_close_ms: int = setting(2_000, "how long a browser may take to close", low=0, high=60_000)
    socket_unsent_bytes_max: int = setting(1 << 20, "more unsent ends a socket", low=1 << 10, high=1 << 30)
    socket_message_bytes_max: int = setting(1 << 20, "a longer message ends it", low=1, high=1 << 30)
    sockets_bytes_max: int = setting(
        64 << 20, "unsent and unfinished in all sockets together", low=1 << 10, high=1 << 34
    )
    socket_dials_max: int = setting(32, "sockets that ask the core at a time", low=1, high=10_000)
    answer_buffer_bytes_max: int = setting(1 << 20, "a longer safe answer is streamed", low=0, high=1 << 30)
    unsafe_answer_bytes_max: int = setting(4 << 20, "a longer unsafe answer is broken", low=1, high=1 << 30)


def limits_from(text: str) -> GatewayLimits | list[Fault]:
    """The limits in a JSON object (empty text: the defaults), or everything that is wrong with it."""
    try:
        values = json.loads(text) if text else {}
    except json.JSONDecodeError as error:
        return [Fault("HARDCORE_LIMITS", f"is not JSON: {error.msg} at column {error.colno}")]
    if not isinstance(values, dict):
        return [Fault("HARDCORE_LIMITS", "must be a JSON object")]
    return read(GatewayLimits, values)
