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
