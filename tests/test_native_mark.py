# SPDX-License-Identifier: MIT
"""Which files of tests load the firmware's C, and which of them -m leaves out."""

from __future__ import annotations

from pathlib import Path

import pytest

import native_mark
from native_mark import is_left_out, loads_c

FILES = {
    "core/desk.py": "import native\nffi, lib = native.load()\n",
    "core/scene.py": "from core import desk\n",
    "test_a.py": "from core.scene import (\n    earth,\n)\n",
    "test_b.py": "from native import WARNINGS\n",
    "native.py": "def load(): ...\n",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(native_mark, "TESTS", tmp_path)
    (tmp_path / "core").mkdir()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_a_file_loads_c_itself_or_by_what_it_imports(folder: Path) -> None:
    names = ("core/desk.py", "core/scene.py", "test_a.py", "test_b.py")
    assert [loads_c(folder / name) for name in names] == [True, True, True, False]


@pytest.mark.parametrize(
    ("expression", "left_out"),
    [
        ("native", ["test_b.py"]),
        ("not native", ["test_a.py"]),
        ("native and (long or sampled)", ["test_b.py"]),
        ("not native and (long or sampled)", ["test_a.py"]),
        ("native or long", []),
        ("native and (long) or (sampled)", []),
        ("", []),
    ],
)
def test_a_file_is_left_out_only_if_all_its_tests_are(
    folder: Path, expression: str, left_out: list[str]
) -> None:
    names = ["test_a.py", "test_b.py"]
    assert [n for n in names if is_left_out(folder / n, expression)] == left_out
