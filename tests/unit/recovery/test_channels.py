import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from hardcore.recovery.channels import (
    CHANNELS_MAX,
    Channel,
    Held,
    Kind,
    Memory,
    Moment,
    Occasion,
    Quiet,
    Stage,
    after_held,
    after_told,
    as_shown,
    good_channels,
    held,
    lifts_ms,
    masked,
    read_channels,
)

HOOK = {"kind": "webhook", "url": "https://hooks.example/services/T0KEN-CANARY?key=CANARY"}
MINUTE_MS = 60_000


def _one(**given: object) -> Channel:
    read = read_channels([{**HOOK, **given}])
    assert isinstance(read, tuple), read
    return read[0]


def _why(value: object) -> str:
    read = read_channels([value])
    assert isinstance(read, list)
    assert all(fault.name == "alerts" for fault in read)
    return "; ".join(fault.reason for fault in read)


@pytest.mark.parametrize(
    "value",
    [
        HOOK,
        {"kind": "webhook", "url": "http://127.0.0.1:9/x", "secret_file": "/etc/hook"},
        {"kind": "ntfy", "url": "https://ntfy.example/household", "lang": "ko", "min_interval_s": 0},
        {"kind": "smtp", "url": "smtps://me@mail.example:465/?from=a@b.example&to=c@d.example"},
        {"kind": "smtp", "url": "smtp://mail.example/?from=a@b.example&to=c@d.example", "name": "집"},
        {"kind": "webhook", "url": "https://가계부.example/x"},
        {"kind": "apprise", "url": "tgram://123:abc/456", "quiet_hours": "22:30-06:00"},
    ],
)
def test_a_channel_of_each_kind_can_be_written_down(value: dict[str, object]) -> None:
    read = read_channels([value])
    assert isinstance(read, tuple)
    assert read[0].kind == value["kind"]


@pytest.mark.parametrize(
    ("value", "why"),
    [
        ("x", "must be an object"),
        ({"kind": "pager", "url": "https://a.example"}, "kind must be one of"),
        ({"kind": "webhook"}, "url is missing"),
        ({"kind": "webhook", "url": "http://hooks.example/x"}, "must begin with https"),
        ({"kind": "webhook", "url": "file:///etc/passwd"}, "must begin with https"),
        ({"kind": "webhook", "url": "https://user:pw@hooks.example/x"}, "must not hold a user"),
        ({"kind": "webhook", "url": "https://hooks.example:99999/x"}, "can't be read"),
        ({"kind": "webhook", "url": "https://hooks.example/a\r\nHost: b"}, "one line"),
        ({"kind": "ntfy", "url": "https://ntfy.example/"}, "topic"),
        ({"kind": "smtp", "url": "smtps://mail.example"}, "from=… and to=…"),
        ({"kind": "smtp", "url": "smtps://mail.example?from=a@b&to=c@d&cc=e@f"}, "not 'cc'"),
        ({"kind": "smtp", "url": "smtps://mail.example?from=a@b&to=c@d%0d%0aBcc:x@y"}, "from=… and to=…"),
        ({"kind": "webhook", "url": "https://hooks.example/훅"}, "plain letters"),
        ({"kind": "webhook", "url": "https://a..b/x"}, "can't be reached"),
        ({"kind": "webhook", "url": f"https://{'a' * 64}.example/x"}, "can't be reached"),
        ({"kind": "webhook", "url": "https://hooks.example:0/x"}, "can't be reached"),
        ({"kind": "webhook", "url": "https://[::1%25eth0]/x"}, "can't be reached"),
        ({"kind": "smtp", "url": "smtps://mail.example?from=a@b&to=엄마@d"}, "plain letters"),
        ({"kind": "smtp", "url": "smtps://mail.example?from=a@b&to=a;b:c@d"}, "plain letters"),
        ({**HOOK, "min_interval_s": -1}, "min_interval_s"),
        ({**HOOK, "min_interval_s": True}, "min_interval_s"),
        ({**HOOK, "name": ""}, "name must be"),
        ({**HOOK, "name": "a\x1b[2J"}, "name must be"),
        ({**HOOK, "lang": "fr"}, "lang must be"),
        ({**HOOK, "quiet_hours": "25:00-07:00"}, "quiet_hours"),
        ({**HOOK, "quiet_hours": "07:00-07:00"}, "quiet_hours"),
        ({**HOOK, "secret_file": "key"}, "whole path"),
        ({**HOOK, "token": "x"}, "'token' is not known"),
    ],
)
def test_what_is_wrong_with_a_channel_is_said_with_its_number(value: object, why: str) -> None:
    said = _why(value)
    assert why in said
    assert said.startswith("channel 1: ")


def test_no_fault_repeats_an_address() -> None:
    assert "CANARY" not in _why({"kind": "webhook", "url": "http://hooks.example/CANARY"})
    assert "CANARY" not in _why({**HOOK, "min_interval_s": "CANARY"})
    assert "CANARY" not in _why({**HOOK, "https://hooks.example/CANARY": 1})
    assert "CANARY" not in _why({"kind": "smtp", "url": "smtps://mail.example?from=a@b&to=c@d&CANARY=x"})


def test_too_many_channels_are_refused() -> None:
    assert isinstance(read_channels([HOOK] * CHANNELS_MAX), tuple)
    assert isinstance(read_channels([HOOK] * (CHANNELS_MAX + 1)), list)


_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=9),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from([*HOOK, "lang", "quiet_hours", "min_interval_s"]), inner)
    ),
    max_leaves=9,
)


@given(_json)
def test_no_value_of_any_kind_raises(value: object) -> None:
    assert isinstance(read_channels(value), tuple | list)


def test_of_an_address_only_scheme_and_host_are_shown() -> None:
    assert masked("https://hooks.example/T0KEN?x=1") == "https://hooks.example/…"
    assert masked("tgram://123456:abcdef/7") == "tgram://…"
    assert masked("smtps://me:secret@mail.example:465/?to=a@b.example") == "smtps://mail.example/…"
    channel = _one(secret_file="/etc/CANARY-path")
    assert "CANARY" not in json.dumps(as_shown(channel)) + repr(channel)


def _moment(minutes: float = 0, *, of_day: int = 720, muted_until_ms: int = 0) -> Moment:
    return Moment(10_000_000_000 + int(minutes * MINUTE_MS), of_day, muted_until_ms)


def _opened(incident: str = "i1", fingerprint: str = "CRASHED") -> Occasion:
    return Occasion(Stage.OPENED, fingerprint, incident)


def _closed(incident: str = "i1") -> Occasion:
    return Occasion(Stage.CLOSED, "CRASHED", incident)


def test_a_storm_is_one_message_and_one_closing_message() -> None:
    channel, memory, sent = _one(), Memory(), []
    for number in range(20):
        for what in (_opened(f"i{number}"), _closed(f"i{number}")):
            now = _moment(number)
            if held(channel, memory, what, now) is None:
                memory = after_told(memory, what, now.at_ms)
                sent.append(what.stage)
            else:
                memory = after_held(memory, what)
    assert sent == [Stage.OPENED, Stage.CLOSED]
    assert memory.count("CRASHED") == 19


def test_an_end_does_not_lift_the_floor() -> None:
    channel = _one()
    memory = after_told(after_told(Memory(), _opened(), _moment().at_ms), _closed(), _moment(1).at_ms)
    assert held(channel, memory, _opened("i2"), _moment(2)) is Held.FLOOR
    assert held(channel, memory, _opened("i2"), _moment(30)) is None


def test_another_kind_of_trouble_is_told_at_once() -> None:
    memory = after_told(Memory(), _opened(), _moment().at_ms)
    assert held(_one(), memory, _opened("i2", "FROZEN"), _moment(1)) is None


def test_one_outage_begins_once_however_many_deaths_it_takes() -> None:
    memory = after_told(Memory(), _opened(), _moment().at_ms)
    assert held(_one(), memory, _opened("i1", "STARTUP_FAILED"), _moment(1)) is Held.FLOOR


def test_who_is_waited_for_is_told_although_the_beginning_was() -> None:
    memory = after_told(Memory(), _opened(), _moment().at_ms)
    waits = Occasion(Stage.WAITS, "CRASHED", "i1")
    assert held(_one(), memory, waits, _moment(1)) is None
    again = after_told(memory, waits, _moment(1).at_ms)
    assert held(_one(), again, waits, _moment(2)) is Held.FLOOR


def test_the_end_of_what_was_not_told_is_not_told() -> None:
    assert held(_one(), Memory(), _closed(), _moment()) is Held.UNTOLD
    assert after_held(Memory(), _closed()) == Memory()


def test_an_end_that_needs_a_person_is_news_although_its_beginning_was_not_told() -> None:
    ended = replace(_closed("i2"), outcome="manual")
    memory = after_told(Memory(), _opened(), _moment().at_ms)
    assert held(_one(quiet_hours="22:00-07:00"), memory, ended, _moment(1, of_day=0)) is None
    again = after_told(memory, ended, _moment(1).at_ms)
    assert held(_one(), again, replace(ended, incident="i3"), _moment(2)) is Held.FLOOR
    reads = replace(ended, outcome="safe_mode")
    assert held(_one(quiet_hours="22:00-07:00"), memory, reads, _moment(1, of_day=0)) is Held.QUIET


def test_what_is_held_back_has_its_time() -> None:
    channel, memory = _one(quiet_hours="22:00-07:00"), after_told(Memory(), _opened(), _moment().at_ms)
    what, night = _opened("i2"), _moment(1, of_day=23 * 60)
    assert lifts_ms(channel, memory, what, _moment(1), Held.FLOOR) == _moment(30).at_ms
    assert lifts_ms(channel, memory, what, night, Held.QUIET) == _moment(1 + 8 * 60).at_ms
    assert lifts_ms(channel, memory, what, _moment(muted_until_ms=7), Held.MUTED) == 7
    assert lifts_ms(channel, memory, _opened(), _moment(1), Held.FLOOR) is None  # it was told of this outage
    assert lifts_ms(channel, memory, _closed("i2"), _moment(1), Held.UNTOLD) is None


def test_one_bad_channel_leaves_the_others_their_numbers() -> None:
    assert [one.number for one in good_channels([{"kind": "pager"}, HOOK])] == [2]
    assert good_channels({"kind": "webhook"}) == ()


def test_what_was_left_out_is_counted_until_the_next_message() -> None:
    memory = after_told(Memory(), _opened(), _moment().at_ms)
    for number in range(3):
        memory = after_held(memory, _opened(f"i{number + 2}"))
    assert memory.count("CRASHED") == 3
    assert after_told(memory, _opened("i9"), _moment(31).at_ms).count("CRASHED") == 0


def test_quiet_hours_let_through_only_what_waits_for_a_person() -> None:
    channel, night = _one(quiet_hours="22:00-07:00"), _moment(of_day=3 * 60)
    assert held(channel, Memory(), _opened(), night) is Held.QUIET
    assert held(channel, Memory(), Occasion(Stage.FORECAST, "LEAK"), night) is Held.QUIET
    assert held(channel, Memory(), Occasion(Stage.WAITS, "CRASH_LOOP", "i1"), night) is None
    assert held(channel, Memory(), Occasion(Stage.OVERDUE, "CRASH_LOOP", "i1"), night) is None
    assert held(channel, Memory(), _opened(), _moment(of_day=12 * 60)) is None


def test_what_was_told_by_day_is_closed_by_night() -> None:
    channel = _one(quiet_hours="22:00-07:00")
    memory = after_told(Memory(), _opened(), _moment().at_ms)
    assert held(channel, memory, _closed(), _moment(1, of_day=23 * 60)) is None


@given(st.integers(0, 1439), st.integers(0, 1439), st.integers(0, 1439))
def test_quiet_hours_and_the_rest_make_a_day(start: int, end: int, minute: int) -> None:
    assert Quiet(start, end).covers(minute) != Quiet(end, start).covers(minute) or start == end


def test_nothing_is_sent_while_muted_but_a_persons_own_try() -> None:
    muted = _moment(muted_until_ms=_moment(5).at_ms)
    assert held(_one(), Memory(), Occasion(Stage.WAITS, "CRASH_LOOP", "i1"), muted) is Held.MUTED
    assert held(_one(), Memory(), Occasion(Stage.TEST, "test"), muted) is None
    assert held(_one(), Memory(), _opened(), replace(muted, at_ms=muted.muted_until_ms)) is None


def test_a_clock_that_was_set_back_does_not_silence_anybody() -> None:
    memory = after_told(Memory(), _opened(), _moment(600).at_ms)
    assert held(_one(), memory, _opened("i2"), _moment()) is None


def test_a_try_leaves_no_trace_in_the_manners() -> None:
    assert after_told(Memory(), Occasion(Stage.TEST, "test"), 1) == Memory()


def test_each_kind_has_a_word_of_the_policy() -> None:
    assert {str(kind) for kind in Kind} == {"webhook", "ntfy", "smtp", "apprise"}
