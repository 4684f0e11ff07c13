# SPDX-License-Identifier: MIT
"""What `mip` installs is the whole package."""

from __future__ import annotations

import json
import re
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "firmware" / "micropython"


def test_package_json_lists_every_file_of_the_package() -> None:
    listed = json.loads((FOLDER / "package.json").read_text())["urls"]
    files = sorted(FOLDER.glob("probe/*.py"))
    names = [file.relative_to(FOLDER).as_posix() for file in files]
    assert listed == [[name, name] for name in names]


def test_its_version_is_that_of_the_project(root: Path) -> None:
    project = (root / "pyproject.toml").read_text()
    version = re.search(r'^version = "(.+)"', project, re.MULTILINE)
    assert version is not None
    package = json.loads((FOLDER / "package.json").read_text())
    assert package["version"] == version[1]


def test_the_guide_shows_the_main_that_runs_on_the_virtual_board(root: Path) -> None:
    guide = (root / "docs" / "micropython.md").read_text()
    shown = re.search(r"```python\n(   from machine.+?)```", guide, re.DOTALL)
    assert shown is not None
    lines = [line.removeprefix("   ").strip() for line in shown[1].splitlines()]
    runs = (FOLDER / "port" / "pyboard" / "main.py").read_text()
    own = {line.strip() for line in runs.splitlines()}
    only_shown = [line for line in lines if line and line not in own]
    # The virtual board has no file system.
    assert only_shown == [
        "from probe import LSM9DS0, Bus, FileStorage, run",
        'storage=FileStorage("probe.settings"),',
    ]
