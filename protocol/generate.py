# SPDX-License-Identifier: MIT
"""Makes C, Python, MicroPython and the tables of PROTOCOL.md from schema.toml, and the
types of what is published, the table of commands and others in docs/pose.md, and the
hashes of ROS 2's types.

`python protocol/generate.py` writes the files that are stale; with `--check` it writes
nothing, but names them and exits with 1.
"""

from __future__ import annotations

import argparse
import difflib
import sys
from pathlib import Path

from generator import (
    c_code,
    commands,
    library,
    micropython_code,
    page_code,
    published,
    python_code,
    ros2,
    tables,
)
from generator.checker import load
from generator.schema import Schema, SchemaError

ROOT = Path(__file__).resolve().parent.parent
SCHEMA = ROOT / "protocol" / "schema.toml"
C_HEADER = Path("firmware/core/wire/messages.h")
C_SOURCE = Path("firmware/core/wire/messages.c")
C_RECORDS = Path("firmware/core/params/records.h")
PYTHON = Path("host/imud/wire/schema.py")
MICROPYTHON = Path("firmware/micropython/probe/wire.py")
DOCUMENT = Path("protocol/PROTOCOL.md")
PUBLISHED = Path("protocol/published.toml")
TYPES = Path("host/imud/published.py")
ROS2 = Path("host/imud/ros2/hashes.py")
SCRIPT = Path("host/imud/web/site/published.js")
WIRE_SCRIPT = Path("host/imud/web/site/usb/wire.js")
POSE = Path("docs/pose.md")
KEPT = Path("host/imud/wire/schemas")  # every schema that a probe or a log may have

DIFF_LINES = 20  # shown of a stale file


def outputs(schema: Schema) -> dict[Path, str]:
    """The text of each generated file, by its path below the project's root."""
    document = (ROOT / DOCUMENT).read_text("utf-8")
    pose = (ROOT / POSE).read_text("utf-8")
    structs = published.load(ROOT / PUBLISHED, schema)
    return {
        C_HEADER: c_code.header(schema),
        C_SOURCE: c_code.source(schema),
        C_RECORDS: c_code.records_header(schema),
        PYTHON: python_code.module(schema),
        KEPT / f"{schema.fingerprint:08x}.txt": schema.canonical,
        MICROPYTHON: micropython_code.module(schema),
        DOCUMENT: tables.document(schema, document),
        TYPES: published.python(structs),
        ROS2: ros2.module(),
        SCRIPT: published.script(structs),
        WIRE_SCRIPT: page_code.module(schema, structs),
        POSE: commands.document(published.document(structs, pose)),
    }


def stale(path: Path, text: str) -> list[str]:
    """A message and a diff if the file does not hold the text; else nothing."""
    file = ROOT / path
    found = file.read_text("utf-8") if file.exists() else ""
    if found == text:
        return []
    diff = difflib.unified_diff(
        found.splitlines(),
        text.splitlines(),
        str(path),
        f"{path} generated",
        lineterm="",
    )
    return [
        f"{path} is stale; run python protocol/generate.py",
        *list(diff)[:DIFF_LINES],
    ]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description="Makes C, Python and tables from protocol/schema.toml."
    )
    parser.add_argument(
        "--check", action="store_true", help="write nothing; exit 1 if a file is stale"
    )
    parser.add_argument(
        "--canonical",
        action="store_true",
        help="print the text whose digest is the fingerprint",
    )
    parser.add_argument(
        "--library",
        dest="folder",
        metavar="DIR",
        type=Path,
        help="write libimuprobe there, and stop",
    )
    asked = parser.parse_args(arguments)
    try:
        schema = load(SCHEMA)
        if asked.canonical:
            sys.stdout.write(schema.canonical)
            return 0
        if asked.folder is not None:
            asked.folder.mkdir(parents=True, exist_ok=True)
            for name, text in library.files(schema).items():
                (asked.folder / name).write_text(text, "utf-8")
            return 0
        files = outputs(schema)
    except (SchemaError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    reports = {path: stale(path, text) for path, text in files.items()}
    if asked.check:
        lines = [line for report in reports.values() for line in report]
        sys.stdout.write("".join(f"{line}\n" for line in lines))
        return 1 if lines else 0
    for path, report in reports.items():
        if (
            report
        ):  # files that are up to date keep their times, so that nothing is rebuilt
            (ROOT / path).write_text(files[path], "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
