"""Docs in step: what a page of ours names (a file, a make target, another page) is there."""

import re
import subprocess
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
TOPS: Final = (
    "hardcore",
    "core",
    "postmortem",
    "frontend",
    "templates",
    "tests",
    "bench",
    "examples",
    "docs",
    "scripts",
)

_LINK: Final = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)(#[^)]*)?\)")
_CODE: Final = re.compile(r"`([^`\n]+)`")
_PATH: Final = re.compile(rf"(?:{'|'.join(TOPS)})/[\w./-]*")
_MAKE: Final = re.compile(r"\bmake ([a-z][a-z-]*)")


def _pages() -> list[Path]:
    return sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])


def _targets() -> set[str]:
    return set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text("utf-8"), flags=re.MULTILINE))


def _broken_links(page: Path, text: str) -> list[str]:
    return [link for link, _ in _LINK.findall(text) if not (page.parent / link).exists()]


def _missing_paths(text: str) -> list[str]:
    """Paths of the checkout that stand alone between backquotes and lead nowhere."""
    named = [code for code in _CODE.findall(text) if _PATH.fullmatch(code)]
    return [path for path in named if not (ROOT / path).exists()]


def _unknown_targets(text: str) -> list[str]:
    """Make targets in code, between backquotes or in a block, that the Makefile doesn't have."""
    blocks = re.findall(r"```.*?```", text, flags=re.DOTALL)
    named = [target for code in [*_CODE.findall(text), *blocks] for target in _MAKE.findall(code)]
    return [target for target in named if target not in _targets()]


def test_every_link_between_pages_leads_somewhere() -> None:
    assert {
        str(page): bad for page in _pages() if (bad := _broken_links(page, page.read_text("utf-8")))
    } == {}


def test_every_path_named_on_a_page_exists() -> None:
    assert {str(page): bad for page in _pages() if (bad := _missing_paths(page.read_text("utf-8")))} == {}


def test_every_make_target_named_on_a_page_exists() -> None:
    assert {str(page): bad for page in _pages() if (bad := _unknown_targets(page.read_text("utf-8")))} == {}


def test_make_alone_teaches_every_target_a_person_may_want() -> None:
    told = subprocess.run(["make"], cwd=ROOT, capture_output=True, text=True, timeout=20, check=True).stdout
    inner = {"help", "venv", "venv-dev", "lint", "fast"}
    assert set(_MAKE.findall(told)) == _targets() - inner


def test_what_leads_nowhere_is_noticed() -> None:
    text = "[a](no/such.md) `core/no_such.py` `make nothing`\n```sh\nmake nowhere PORT=1\n```\n"
    assert _broken_links(ROOT / "README.md", text) == ["no/such.md"]
    assert _missing_paths(text) == ["core/no_such.py"]
    assert _unknown_targets(text) == ["nothing", "nowhere"]
