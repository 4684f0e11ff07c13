# SPDX-License-Identifier: MIT
"""The inputs worth keeping of each fuzz target, an archive a target: packs, unpacks.

python tests/fuzz/corpus.py {pack,unpack} TARGET FOLDER
"""

from __future__ import annotations

import argparse
import hashlib
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
TARGETS = ("pose", "wire")


def archive(target: str) -> Path:
    return HERE / f"corpus_{target}.zip"


def unpack(target: str, folder: Path) -> list[Path]:
    """The inputs as files, in the order of their names."""
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(archive(target)) as packed:
        packed.extractall(folder)
        return [folder / name for name in packed.namelist()]


def pack(target: str, folder: Path) -> None:
    """The same inputs make the same bytes: names are digests, there are no dates, and
    nothing is compressed, which git does.
    """
    contents = {path.read_bytes() for path in folder.iterdir()}
    named = sorted((hashlib.sha256(data).hexdigest()[:16], data) for data in contents)
    with zipfile.ZipFile(archive(target), "w") as packed:
        for name, data in named:
            packed.writestr(zipfile.ZipInfo(name), data)


def main() -> None:
    parser = argparse.ArgumentParser(prog="tests/fuzz/corpus.py", description=__doc__)
    parser.add_argument("what", choices=("pack", "unpack"))
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("folder", type=Path)
    args = parser.parse_args()
    (pack if args.what == "pack" else unpack)(args.target, args.folder)


if __name__ == "__main__":
    main()
