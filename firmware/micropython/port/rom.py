# SPDX-License-Identifier: MIT
"""Writes the C table of the modules that are inside an image: rom.h says its form."""

from __future__ import annotations

import sys
from pathlib import Path

COLUMNS = 20


def rows(data: bytes) -> str:
    lines = (data[at : at + COLUMNS] for at in range(0, len(data), COLUMNS))
    return "\n".join(f"    {','.join(map(str, line))}," for line in lines)


def table(files: dict[str, bytes]) -> str:
    """The C of these files, by their paths in the image."""
    parts = ["// SPDX-License-Identifier: MIT", '#include "pyboard/rom.h"', ""]
    for number, data in enumerate(files.values()):
        parts.append(f"static const uint8_t file_{number}[] = {{\n{rows(data)}\n}};")
    parts.append("const struct rom_file rom_files[] = {")
    for number, path in enumerate(files):
        parts.append(f'    {{"{path}", file_{number}, sizeof file_{number}}},')
    return "\n".join([*parts, "    {0},", "};", ""])


def main(folder: Path, target: Path) -> None:
    """All files of a folder, into a C file."""
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
    target.write_text(table(files))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
