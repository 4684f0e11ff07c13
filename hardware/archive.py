# SPDX-License-Identifier: MIT
"""The printed parts as one file for a release, with a sum of their sources.
`python -m hardware.archive --check FILE` fails if the sum differs from these sources.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path

NAME = "imu-probe-hardware.zip"
ORIGIN = "built-from.txt"
HERE = Path(__file__).resolve().parent
KINDS = ("*.py", "*.toml", "*.txt")


def origin() -> str:
    """The sum of all files that shape a part."""
    summed = hashlib.sha256()
    for path in sorted(path for kind in KINDS for path in HERE.glob(kind)):
        summed.update(path.name.encode() + b"\0" + path.read_bytes())
    return summed.hexdigest()


def write(path: Path, sources: Iterable[Path], made_of: str) -> None:
    """The same bytes for the same files, whenever that is. `made_of`: origin() before
    they were built.
    """
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        _add(file, ORIGIN, made_of.encode() + b"\n")
        for source in sources:
            _add(file, source.name, source.read_bytes())


def _add(file: zipfile.ZipFile, name: str, data: bytes) -> None:
    info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    file.writestr(info, data)


def is_current(path: Path) -> bool:
    """Whether it was built from these files; false for any other file."""
    try:
        with zipfile.ZipFile(path) as file:
            return file.read(ORIGIN) == origin().encode() + b"\n"
    except (zipfile.BadZipFile, KeyError):
        return False


def main() -> int:
    parser = argparse.ArgumentParser(prog="hardware.archive", description=__doc__)
    parser.add_argument("--check", metavar="FILE", type=Path, required=True)
    path = parser.parse_args().check
    if is_current(path):
        return 0
    sys.stderr.write(
        f"the parts in {path} were built from other files of hardware/; "
        "run make hardware, or remove them\n"
    )
    return 1


if __name__ == "__main__":
    sys.exit(main())
