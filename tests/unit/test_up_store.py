"""Where a ledger lies is written down before a household starts: what is taken, and what never is."""

import stat
from pathlib import Path

import pytest
from click.testing import CliRunner

from core.settings import Settings
from core.store_file import STORE_FILE
from hardcore import up
from hardcore.cli import main
from hardcore.host.folders import Folders, locate, prepare

ADDRESS = "postgresql://keeper:hidden@db.home/ledger"


def kept(data: Path, store: str) -> up.Refused | None:
    folders = prepare(data)
    assert isinstance(folders, Folders)
    return up._keep_store(folders, store, "en")


def test_an_address_is_kept_for_its_owner_alone_and_every_core_finds_it(tmp_path: Path) -> None:
    assert kept(tmp_path, ADDRESS) is None
    path = tmp_path / STORE_FILE
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert locate(tmp_path).store == path
    found = Settings.read({}, tmp_path)
    assert isinstance(found, Settings)
    assert found.store is not None
    assert found.store.url.password == "hidden"
    assert "hidden" not in repr(found)


def test_what_is_no_address_is_refused_and_nothing_is_kept(tmp_path: Path) -> None:
    refused = kept(tmp_path, "mysql://h/d")
    assert isinstance(refused, up.Refused)
    assert not (tmp_path / STORE_FILE).exists()


@pytest.mark.parametrize("address", [ADDRESS, "postgresql://db.home/ledger?password=hidden"])
def test_a_password_on_the_command_line_is_refused_with_the_place_where_it_belongs(
    tmp_path: Path, address: str
) -> None:
    done = CliRunner().invoke(main, ["--data", str(tmp_path / "data"), "up", "--store", address])
    assert done.exit_code == 2
    assert "HARDCORE_STORE" in done.output
    assert "hidden" not in done.output
    assert not (tmp_path / "data" / STORE_FILE).exists()
