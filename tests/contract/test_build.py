"""The name of a code, said by the core of itself and by its guard of what lies on the disk."""

from pathlib import Path

from core.build import build_of, own_build
from hardcore.host.build import build_id


def test_core_and_guard_give_the_same_code_the_same_name() -> None:
    assert own_build() == build_id()


def test_a_changed_template_is_another_code_and_a_compiled_file_is_none(tmp_path: Path) -> None:
    for folder in ("core", "frontend", "templates"):
        (tmp_path / folder).mkdir()
    (tmp_path / "core" / "one.py").write_text("a = 1\n")
    (tmp_path / "templates" / "page.html.j2").write_text("<p>\n")
    before = build_of(tmp_path)
    assert before == build_id(tmp_path)
    (tmp_path / "core" / "__pycache__").mkdir()
    (tmp_path / "core" / "__pycache__" / "one.pyc").write_bytes(b"\0")
    assert build_of(tmp_path) == build_id(tmp_path) == before
    (tmp_path / "templates" / "page.html.j2").write_text("<b>\n")
    assert build_of(tmp_path) == build_id(tmp_path) != before
