"""Guard and core give the same code the same name, each by a rule of its own."""

import shutil
from pathlib import Path

import pytest

from core.build import ROOT, build_of
from hardcore.host.build import build_id, guard_build_id


@pytest.fixture
def code(tmp_path: Path) -> Path:
    for name, text in {
        "core/main.py": "print(1)\n",
        "core/imports/formats/bank.toml": "name = 'bank'\n",
        "frontend/static/page.js": "export const one = 1;\n",
        "templates/page.html.j2": "<p>{{ one }}</p>\n",
        "hardcore/cli.py": "print(2)\n",
    }.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_both_name_the_code_that_lies_here_alike() -> None:
    assert build_id() == build_of(ROOT)


@pytest.mark.parametrize(
    "changed", ["core/main.py", "core/imports/formats/bank.toml", "templates/page.html.j2", "core/new.py"]
)
def test_both_see_a_change_of_any_file_that_a_core_loads(code: Path, changed: str) -> None:
    before = build_id(code)
    (code / changed).write_text("changed")
    assert build_id(code) == build_of(code) != before


def test_the_guards_own_code_is_no_part_of_the_cores_name_nor_is_the_place_where_it_lies(
    code: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    before, guard = build_id(code), guard_build_id(code)
    (code / "hardcore/cli.py").write_text("changed")
    assert build_id(code) == before
    assert guard_build_id(code) != guard
    moved = shutil.copytree(code, tmp_path_factory.mktemp("moved") / "code")
    assert build_id(moved) == build_of(moved) == before
