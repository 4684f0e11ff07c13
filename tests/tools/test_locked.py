# SPDX-License-Identifier: MIT
"""requirements.lock: what we install of others, by version and hash."""

from __future__ import annotations

import re
import tomllib
from typing import Any

import locked
import pytest
from packaging.requirements import Requirement

from imud import checkout

PROJECT: dict[str, Any] = tomllib.loads((checkout.ROOT / "pyproject.toml").read_text())
LOCKED = locked.read(locked.LOCK.read_text())
HASH = re.compile(r"--hash=sha256:[0-9a-f]{64}")

SMALL = """\
# This file was made
one==1.0 \\
    --hash=sha256:aa
    # via imu-probe (pyproject.toml:test)
two==2.0 ; python_full_version < '3.12' \\
    --hash=sha256:bb
    # via one
two==2.1 ; python_full_version >= '3.12' \\
    --hash=sha256:cc
    # via one
three==3.0 \\
    --hash=sha256:dd
    # via
    #   imu-probe (pyproject.toml)
    #   two
four==4.0 \\
    --hash=sha256:ee
    # via imu-probe (pyproject.toml)
"""


def demanded() -> list[str]:
    extras = PROJECT["project"]["optional-dependencies"]
    groups = PROJECT["dependency-groups"]
    return [
        *PROJECT["project"]["dependencies"],
        *(each for name, rows in extras.items() if name != "sim" for each in rows),
        *(each for rows in groups.values() for each in rows),
    ]


def test_what_is_wanted_comes_with_what_it_needs_and_with_nothing_else() -> None:
    lines = locked.lines_for(["One>=0.5"], locked.read(SMALL))
    assert lines == [
        "one==1.0 \\",
        "    --hash=sha256:aa",
        "two==2.0 ; python_full_version < '3.12' \\",
        "    --hash=sha256:bb",
        "two==2.1 ; python_full_version >= '3.12' \\",
        "    --hash=sha256:cc",
        "three==3.0 \\",
        "    --hash=sha256:dd",
    ]


def test_what_is_not_locked_is_refused() -> None:
    with pytest.raises(ValueError, match="lacks five: run make lock"):
        locked.lines_for(["five>=1"], locked.read(SMALL))


@pytest.mark.parametrize("requirement", demanded())
def test_each_requirement_is_locked_inside_its_range(requirement: str) -> None:
    """A range that was changed without `make lock` fails here."""
    wanted = Requirement(requirement)
    rows = [each for each in LOCKED if each.name == locked.canonical(wanted.name)]
    assert rows
    for row in rows:
        version = row.lines[0].split("==")[1].split()[0]
        assert version in wanted.specifier


def test_each_file_has_a_hash_and_no_line_says_where_it_came_from() -> None:
    assert all(HASH.search(line) for row in LOCKED for line in row.lines[1:])
    assert all(len(row.lines) > 1 for row in LOCKED)
    assert "://" not in locked.LOCK.read_text()
