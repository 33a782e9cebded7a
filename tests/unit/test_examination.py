"""`hardcore doctor` calls bad what the guard would act on, and nothing else."""

from pathlib import Path

import pytest

from hardcore.access import files as access
from hardcore.access.doorway import Doorway
from hardcore.access.people import OWNER, People, Person
from hardcore.examination import FORMATS, Finding, _formats, _watched, examine
from hardcore.host import muting
from hardcore.host.folders import Folders
from hardcore.model.verdicts import Colour

PEOPLE = People((Person(OWNER, "secret"),))


def _findings(data: Path) -> dict[str, Finding]:
    return {finding.name: finding for finding in examine(Folders(data, data / "run"))}


@pytest.mark.parametrize(("floor_mb", "bad"), [(0, False), (1 << 20, True)])
def test_room_is_bad_only_below_the_floor_that_the_policy_names(
    tmp_path: Path, floor_mb: int, *, bad: bool
) -> None:
    (tmp_path / "failover_policy.json").write_text(f'{{"disk_floor_mb": {floor_mb}}}')
    room = _findings(tmp_path)["room"]
    assert (room.colour is Colour.RED) is bad
    assert dict(room.values)["floor_mb"] == floor_mb


def test_looking_leaves_nothing_behind(tmp_path: Path) -> None:
    examine(Folders(tmp_path, tmp_path / "run"))
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_takes_no_file_is_bad_whatever_its_mode_says() -> None:
    found = _findings(Path("/proc/self"))
    assert (found["data"].colour, found["data"].text) == (Colour.RED, "data_not_writable")


@pytest.mark.parametrize(
    ("policy", "colour", "text"),
    [
        ('{"spare": false}', Colour.YELLOW, "spare_off"),
        ('{"spare_memory_mb": 0}', Colour.GREEN, "spare_room"),
        ('{"spare_memory_mb": 1048576}', Colour.YELLOW, "spare_little"),
    ],
)
def test_whether_a_spare_can_be_kept_is_known_before_it_is_needed(
    tmp_path: Path, policy: str, colour: Colour, text: str
) -> None:
    (tmp_path / "failover_policy.json").write_text(policy)
    spare = _findings(tmp_path)["spare"]
    assert (spare.colour, spare.text) == (colour, text)


def _told(tmp_path: Path) -> Folders:
    channel = '{"kind": "ntfy", "url": "https://ntfy.example.org/a-household"}'
    (tmp_path / "failover_policy.json").write_text(f'{{"alerts": [{channel}]}}')
    folders = Folders(tmp_path, tmp_path / "run")
    folders.state.mkdir()
    return folders


def test_whether_anybody_would_be_told_is_known_before_it_is_needed(tmp_path: Path) -> None:
    assert _findings(tmp_path)["alerts"].text == "alerts_nobody"
    folders = _told(tmp_path)
    assert _findings(tmp_path)["alerts"].text == "alerts"
    folders.alerts.write_text('{"channels": [{"number": 1, "ok": false}]}')
    assert _findings(tmp_path)["alerts"].text == "alerts_failing"


def test_alerts_that_are_muted_are_worth_knowing(tmp_path: Path) -> None:
    folders = _told(tmp_path)
    assert "alerts muted" not in _findings(tmp_path)
    muting.mute(folders, 600)
    assert dict(_findings(tmp_path)["alerts muted"].values) == {"minutes": 10}


def test_a_file_of_the_guards_own_that_can_not_be_read_is_named(tmp_path: Path) -> None:
    folders = _told(tmp_path)
    assert _findings(tmp_path)["own files"].colour is Colour.GREEN
    folders.counters.write_text("{")
    folders.history.write_text('{"version": 1, "changes": []}')
    assert dict(_findings(tmp_path)["own files"].values)["files"] == "counters.json"


def test_a_bank_format_that_can_not_be_meant_is_named(tmp_path: Path) -> None:
    formats = tmp_path / FORMATS
    formats.mkdir(parents=True)
    (formats / "bad.toml").write_text("schema = ")
    [finding] = _formats(Folders(tmp_path, tmp_path / "run"))
    assert (finding.colour, dict(finding.values)["file"]) == (Colour.YELLOW, "bad.toml")


def test_who_would_miss_the_sentinel_is_known_before_it_is_lost(tmp_path: Path) -> None:
    folders = Folders(tmp_path, tmp_path / "run")
    folders.run.mkdir()
    assert _watched(folders, 7).text == "agents_blind"
    for page in (folders.sentinel_page, folders.gateway_page):
        page.write_bytes(b"")
    folders.agents.write_text('{"sentinel": {"pid": 7}, "sentinel_lost": true}')
    assert _watched(folders, 7).text == "agents"
    assert dict(_watched(folders, 8).values) == {"files": "agents.json"}
    folders.agents.write_text('{"sentinel": {"pid": 7}, "sentinel_lost": false}')
    assert _watched(folders, 7).text == "agents_forbidden"


@pytest.mark.parametrize(
    ("people", "doorway", "colour", "text"),
    [
        (None, None, Colour.GREEN, "door_here"),
        (PEOPLE, None, Colour.GREEN, "door_closed"),
        (PEOPLE, Doorway(open=True, proxies=("10.0.0.5",)), Colour.GREEN, "door_open"),
        (PEOPLE, Doorway(open=True, insecure_lan=True), Colour.YELLOW, "door_plain"),
    ],
)
def test_whoever_may_come_in_and_how_is_told(
    tmp_path: Path, people: People | None, doorway: Doorway | None, colour: Colour, text: str
) -> None:
    (tmp_path / "state").mkdir()
    if people is not None:
        access.write_people(tmp_path / "state", people)
    if doorway is not None:
        access.write_doorway(tmp_path / "state", doorway)
    door = _findings(tmp_path)["door"]
    assert (door.colour, door.text) == (colour, text)


def test_a_list_that_nobody_can_sign_in_by_and_a_key_that_is_gone_are_bad(tmp_path: Path) -> None:
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / access.PEOPLE).write_bytes(b"{")
    access.write_doorway(tmp_path / "state", Doorway(tls_cert="/nowhere/cert", tls_key="/nowhere/key"))
    found = _findings(tmp_path)
    assert found["door"].colour is found["door_files"].colour is Colour.RED
