"""The locks hold names, versions and hashes of everything that is installed, and no addresses."""

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest

ROOT: Final = Path(__file__).parents[2]
RUN_LOCK: Final = "requirements.lock"
DEV_LOCK: Final = "requirements-dev.lock"
BUILD_BACKEND: Final = {"hatchling", "editables", "packaging", "pathspec", "pluggy", "trove-classifiers"}

_PIN: Final = re.compile(
    r"(?P<name>[a-z0-9][a-z0-9.-]*)==(?P<version>[^\s;]+)( ; (?P<marker>[^\\]+?))?(?P<rest>( \\)?)"
)
_HASH: Final = re.compile(r"    --hash=sha256:[0-9a-f]{64}( \\)?")
_ADDRESS: Final = re.compile(
    r"://|@ ?file|(^|\s)(-i|-f|--index-url|--extra-index-url|--find-links|--trusted-host)\b|^\s*/"
)


@dataclass(frozen=True, slots=True)
class Pin:
    """One package of a lock."""

    name: str
    version: str
    hashes: int


def _pins(text: str) -> list[Pin]:
    """The pins of a lock; a line that is neither a pin, one of its hashes nor a comment is an error."""
    pins: list[Pin] = []
    for line in text.splitlines():
        if line.lstrip().startswith("#") or not line.strip():
            continue
        if _HASH.fullmatch(line):
            pins[-1] = Pin(pins[-1].name, pins[-1].version, pins[-1].hashes + 1)
        elif found := _PIN.fullmatch(line):
            pins.append(Pin(found["name"], found["version"], 0))
        else:
            raise ValueError(f"not a pin: {line}")
    return pins


def _addresses(text: str) -> list[str]:
    return [line for line in text.splitlines() if _ADDRESS.search(line)]


def _read(lock: str) -> str:
    return (ROOT / lock).read_text("utf-8")


def _declared(names: list[str]) -> set[str]:
    return {re.split(r"[<>=!~ \[;]", name)[0].lower().replace("_", "-") for name in names}


@pytest.mark.parametrize("lock", [RUN_LOCK, DEV_LOCK])
def test_a_lock_holds_no_address(lock: str) -> None:
    assert _addresses(_read(lock)) == []


@pytest.mark.parametrize("lock", [RUN_LOCK, DEV_LOCK])
def test_every_package_is_pinned_with_hashes(lock: str) -> None:
    pins = _pins(_read(lock))
    assert pins != []
    assert [pin.name for pin in pins if not pin.hashes] == []
    assert len({pin.name for pin in pins}) == len(pins)


def test_the_locks_hold_every_declared_package_and_the_build_backend() -> None:
    settings = tomllib.loads(_read("pyproject.toml"))
    run = _declared(settings["project"]["dependencies"]) | BUILD_BACKEND
    dev = run | _declared([name for name in settings["dependency-groups"]["dev"] if isinstance(name, str)])
    assert run <= {pin.name for pin in _pins(_read(RUN_LOCK))}
    assert dev <= {pin.name for pin in _pins(_read(DEV_LOCK))}


def test_the_development_lock_holds_the_other_lock_unchanged() -> None:
    assert set(_pins(_read(RUN_LOCK))) <= set(_pins(_read(DEV_LOCK)))


def test_what_runs_needs_no_test_tool() -> None:
    assert not {"pytest", "mypy", "ruff", "beancount"} & {pin.name for pin in _pins(_read(RUN_LOCK))}


@pytest.mark.parametrize(
    "line",
    [
        "click @ https://example.org/click.whl",
        "click @ file:///tmp/click.whl",
        "--index-url https://example.org/simple",
        "--extra-index-url=x",
        "-i x",
        "    # from https://example.org/simple",
        "/opt/click.whl",
    ],
)
def test_an_address_is_noticed(line: str) -> None:
    assert _addresses(f"click==8.1\n{line}\n") == [line]


@pytest.mark.parametrize("text", ["click>=8\n", "click\n", "-e .\n", "click==8.1 --hash=md5:00\n"])
def test_a_loose_line_is_noticed(text: str) -> None:
    with pytest.raises(ValueError, match="not a pin"):
        _pins(text)


def test_a_pin_without_a_hash_is_noticed() -> None:
    assert _pins("click==8.1\nh11==1 ; python_version < '3' \\\n    --hash=sha256:" + "0" * 64 + "\n") == [
        Pin("click", "8.1", 0),
        Pin("h11", "1", 1),
    ]
