# SPDX-License-Identifier: MIT
"""Which version and which files of each package of others we install: requirements.lock
has them with their SHA-256, for every system and every Python from 3.11 on.

Imported by the system's Python before any package is there. Run, it rewrites the file:
the newest versions that pyproject.toml's ranges allow.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "requirements.lock"
UV = "uv>=0.9,<1"  # resolves for all systems at once, which pip does not
# Set by the nightly run, which looks at what is newest: is it still good?
UNLOCKED = "UNLOCKED"

# What it has of a package: "name==version ; marker \", hashes, and who needs it.
_BEFORE_EACH = re.compile(r"^(?=[a-z0-9][a-z0-9.-]*==)", re.MULTILINE)
_NEEDED_BY = re.compile(r"^    #(?: via)?  *(.+)$")
_OURS = "imu-probe (pyproject.toml"


class Locked(NamedTuple):
    name: str
    lines: tuple[str, ...]
    needed_by: tuple[str, ...]
    """Names of packages that need it; our own pyproject.toml is not among them."""


def canonical(name: str) -> str:
    """A package's name as the index has it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def name_of(requirement: str) -> str:
    found = re.match(r"[A-Za-z0-9._-]+", requirement)
    if found is None:
        raise ValueError(f"{requirement!r} names no package")
    return canonical(found[0])


def read(text: str) -> list[Locked]:
    """One for each package and marker."""
    _, *packages = _BEFORE_EACH.split(text)
    return [_locked(package.splitlines()) for package in packages]


def _locked(lines: list[str]) -> Locked:
    name = lines[0].partition("==")[0]
    needed_by = [found[1] for line in lines if (found := _NEEDED_BY.match(line))]
    return Locked(
        name,
        tuple(line for line in lines if not line.lstrip().startswith("#")),
        tuple(name for name in needed_by if not name.startswith(_OURS)),
    )


def lines_for(wanted: Iterable[str], packages: list[Locked]) -> list[str]:
    """Lines for `pip install --require-hashes -r`: of what is wanted, and of all that
    this needs, which pip then wants with a hash, too.

    ValueError: something is wanted that is not locked.
    """
    names = {name_of(each) for each in wanted}
    if missing := names - {each.name for each in packages}:
        raise ValueError(
            f"{LOCK.name} lacks {', '.join(sorted(missing))}: run make lock"
        )
    while more := {
        each.name
        for each in packages
        if each.name not in names and names.intersection(each.needed_by)
    }:
        names |= more
    return [line for each in packages if each.name in names for line in each.lines]


def is_used() -> bool:
    return not os.environ.get(UNLOCKED)


def write(project: dict[str, Any]) -> None:
    """Rewrites the file. CalledProcessError: said by uv, on stderr."""
    # The extra "sim" is ours.
    extras = project["project"]["optional-dependencies"].keys() - {"sim"}
    words = [word for name in sorted(extras) for word in ("--extra", name)]
    words += [
        word for name in project["dependency-groups"] for word in ("--group", name)
    ]
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        subprocess.run([sys.executable, "-m", "venv", str(room)], check=True)
        pip = (str(room / "bin" / "pip"), "install", "--quiet", UV)
        subprocess.run(pip, check=True)
        subprocess.run(
            [
                *(str(room / "bin" / "uv"), "pip", "compile", "pyproject.toml"),
                *("--quiet", "--universal", "--python-version", "3.11", "--upgrade"),
                *("--generate-hashes", "--custom-compile-command", "make lock"),
                *("--output-file", str(LOCK), *words),
            ],
            cwd=ROOT,
            check=True,
        )


if __name__ == "__main__":
    import tomllib

    write(tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8")))
