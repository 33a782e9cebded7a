"""Who may come in: sessions that end, guesses that wait, proxies that are believed."""

from pathlib import Path
from unicodedata import normalize

import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st

from hardcore.access import files, passwords
from hardcore.access.attempts import ADDRESSES_MAX, Attempts
from hardcore.access.doorway import Doorway, Names, Proxies
from hardcore.access.people import OWNER, Invitation, People, Person, Scope, Token, digest_of, is_name
from hardcore.access.sessions import SESSIONS_MAX, Sessions, Spans
from hardcore.access_words import passwd
from hardcore.host.folders import Unusable, prepare_data

OWNERS = Person(OWNER, "one")
PEOPLE = People((OWNERS,))
SPANS = Spans(idle_ns=100, longest_ns=1_000, proven_ns=50)


def test_a_session_ends_when_it_is_not_used() -> None:
    sessions = Sessions(SPANS)
    sessions.begin("s", OWNERS, 0)
    session = sessions.of("s", PEOPLE, 100)
    assert session is not None
    session.seen_ns = 100
    assert sessions.of("s", PEOPLE, 200) is session
    assert sessions.of("s", PEOPLE, 201) is None


def test_a_session_ends_however_much_it_is_used() -> None:
    sessions = Sessions(SPANS)
    sessions.begin("s", OWNERS, 0)
    session = sessions.of("s", PEOPLE, 0)
    assert session is not None
    session.seen_ns = 1_001
    assert sessions.of("s", PEOPLE, 1_001) is None


def test_a_session_ends_with_its_password_and_with_its_person() -> None:
    sessions = Sessions(SPANS)
    sessions.begin("s", OWNERS, 0)
    assert sessions.of("s", PEOPLE.with_person(Person(OWNER, "two")), 1) is None
    assert sessions.of("s", People((Person("mina", "one"),)), 1) is None


def test_a_session_of_another_boot_is_none() -> None:
    sessions = Sessions(SPANS)
    sessions.begin("s", OWNERS, 500)
    assert sessions.of("s", PEOPLE, 400) is None, "the clock began anew"


def test_a_password_counts_as_just_typed_for_a_while_and_again_when_it_is_typed_again() -> None:
    sessions = Sessions(SPANS)
    sessions.begin("s", OWNERS, 0)
    session = sessions.of("s", PEOPLE, 0)
    assert session is not None
    assert sessions.is_proven(session, 50)
    assert not sessions.is_proven(session, 51)
    sessions.prove(session, 60)
    assert sessions.is_proven(session, 110)


def test_the_place_of_the_longest_unused_session_goes_to_who_comes_when_all_are_taken() -> None:
    sessions = Sessions(Spans(10_000, 10_000, 0))
    for number in range(SESSIONS_MAX + 1):
        sessions.begin(f"s{number}", OWNERS, number)
    assert sessions.of("s0", PEOPLE, SESSIONS_MAX) is None
    assert sessions.of("s1", PEOPLE, SESSIONS_MAX) is not None


def test_sessions_that_are_over_are_forgotten_and_the_change_is_told() -> None:
    told: list[int] = []
    sessions = Sessions(SPANS)
    sessions.begin("s", OWNERS, 0)
    sessions.changed = lambda: told.append(1)
    sessions.prune(PEOPLE, 50)
    assert not told
    sessions.prune(PEOPLE, 500)
    assert (told, list(sessions)) == ([1], [])


def test_an_address_that_guesses_waits_and_another_one_does_not() -> None:
    attempts = Attempts(2, 10)
    assert [attempts.wait_ns("a", 0) for _ in range(3)] == [0, 0, 10]
    assert attempts.wait_ns("b", 0) == 0
    assert attempts.wait_ns("a", 10) == 0


def test_many_addresses_together_wait_too() -> None:
    attempts = Attempts(2, 10)
    waits = [attempts.wait_ns(f"a{n}", 0) for n in range(40)]
    assert waits[:20] == [0] * 20
    assert all(waits[20:])


def test_whoever_has_many_addresses_of_ipv6_tries_no_more_often_for_it() -> None:
    attempts = Attempts(2, 10)
    assert [attempts.wait_ns(f"2001:db8:0:1::{n}", 0) > 0 for n in range(1, 5)] == [False, False, True, True]
    assert attempts.wait_ns("2001:db8:0:2::1", 0) == 0, "a neighbour"
    assert [attempts.wait_ns(one, 0) for one in ("::ffff:192.0.2.1", "192.0.2.1", "192.0.2.1")] == [0, 0, 10]


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 30)), max_size=60))
def test_no_address_is_let_try_more_often_than_it_may(tries: list[tuple[int, int]]) -> None:
    attempts, now_ns, made = Attempts(3, 10), 0, dict.fromkeys(range(4), 0)
    for address, later_ns in tries:
        now_ns += later_ns
        made[address] += attempts.wait_ns(str(address), now_ns) == 0
    assert all(count <= 3 + now_ns // 10 for count in made.values())


def test_what_is_remembered_of_guesses_has_a_bound() -> None:
    attempts = Attempts(1, 1)
    for number in range(3 * ADDRESSES_MAX):
        attempts.wait_ns(str(number), number)
    assert len(attempts._buckets) <= ADDRESSES_MAX + 1


@pytest.mark.parametrize(
    ("hops", "client"),
    [
        (b"203.0.113.9", "203.0.113.9"),
        (b"198.51.100.1, 203.0.113.9", "203.0.113.9"),
        (b"203.0.113.9, 10.0.0.7", "203.0.113.9"),
        (b"", "10.0.0.5"),
        (b"nonsense", "10.0.0.5"),
    ],
)
def test_behind_a_proxy_the_last_address_that_is_none_of_ours_is_the_clients(
    hops: bytes, client: str
) -> None:
    found = Proxies(("10.0.0.0/24",)).client("10.0.0.5", hops, b"https")
    assert found is not None
    assert (found.address, found.https) == (client, True)


def test_who_is_no_proxy_is_not_believed() -> None:
    assert Proxies(("10.0.0.5",)).client("10.0.0.6", b"203.0.113.9", b"https") is None


def test_with_the_door_open_an_address_is_a_name_of_ours_and_a_strange_name_is_not() -> None:
    inside, beyond = Names(("localhost",), addresses=False), Names(("localhost",), addresses=True)
    assert "192.168.0.7" not in inside
    assert "192.168.0.7" in beyond
    assert "[fe80::1]" in beyond
    assert "evil.example" not in beyond


def test_a_door_beyond_this_machine_needs_something_that_keeps_passwords_from_being_read() -> None:
    assert not Doorway(open=True).safe
    assert not Doorway(open=True, tls_cert="c").safe
    assert Doorway(open=True, tls_cert="c", tls_key="k").safe
    assert Doorway(open=True, proxies=("10.0.0.5",)).safe
    assert Doorway(open=True, insecure_lan=True).safe


def test_what_is_kept_opens_nothing_for_whoever_reads_it() -> None:
    people = PEOPLE.with_token(Token("t", digest_of("fst_secret"), Scope.READ, ""))
    assert people.token("fst_secret") is not None
    assert people.token(digest_of("fst_secret")) is None


def test_an_invitation_holds_until_its_time_and_until_it_is_used() -> None:
    people = PEOPLE.with_invitation(Invitation("mina", digest_of("k"), 100))
    assert people.invitation("k", 99) is not None
    assert people.invitation("k", 100) is None
    assert people.with_person(Person("mina", "x")).invitation("k", 0) is None


def test_whoever_is_removed_comes_back_by_no_link() -> None:
    people = PEOPLE.with_invitation(Invitation("mina", digest_of("k"), 100)).without_person("mina")
    assert people.invitation("k", 0) is None


def test_the_owners_password_goes_last_while_a_link_would_let_somebody_in(tmp_path: Path) -> None:
    people = PEOPLE.with_invitation(Invitation("mina", digest_of("k"), 100))
    folders = prepare_data(tmp_path / "house")
    assert not isinstance(folders, Unusable)
    files.write_people(folders.state, people)

    def removed(name: str) -> Result:
        return CliRunner().invoke(passwd, [name, "--remove", "--data", str(folders.data)])

    assert removed(OWNER).exit_code == 1
    assert files.read_people(folders.state) == people
    assert removed("mina").exit_code == 0
    assert removed(OWNER).exit_code == 0
    assert files.read_people(folders.state) == People()


@pytest.mark.parametrize("name", ["", "Mina", "a b", "../x", "a" * 33, "-a", "ㅁ", "a\n"])
def test_a_name_can_stand_in_a_header_and_in_a_log(name: str) -> None:
    assert not is_name(name)


@pytest.mark.parametrize(
    "damaged", [b"", b"{", b'{"people":[{"name":"\xff","secret":"x"}]}', b'{"x":' + b"[" * 20_000]
)
def test_a_file_that_is_damaged_is_told_as_such_and_raises_nothing(tmp_path: Path, damaged: bytes) -> None:
    for name in (files.PEOPLE, files.SESSIONS, files.DOORWAY):
        (tmp_path / name).write_bytes(damaged)
    assert isinstance(files.read_people(tmp_path), files.Unreadable)
    assert files.read_sessions(tmp_path, "boot") == ()
    assert files.read_doorway(tmp_path) == Doorway()


def test_a_password_is_the_same_however_a_keyboard_spells_its_letters() -> None:
    assert passwords.is_right(normalize("NFD", "가나다라마바사아"), passwords.kept("가나다라마바사아"))


def test_what_is_no_text_is_no_password_and_the_reason_is_said(tmp_path: Path) -> None:
    folders = prepare_data(tmp_path / "house")
    assert not isinstance(folders, Unusable)
    words = ["--stdin", "--data", str(folders.data)]
    found = CliRunner().invoke(passwd, words, input=b"\xff\xfe12345678\n")
    assert (found.exit_code, "UTF-8" in found.output) == (1, True), found
    assert files.read_people(folders.state) == People()
