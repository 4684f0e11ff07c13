# SPDX-License-Identifier: MIT
"""Writes imud's man pages into a folder, for packages: imud.1, and imud-COMMAND.1 of
each command. Needs argparse-manpage (the group `test`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from argparse_manpage.manpage import Manpage

from imud.cli import build_parser
from imud.version import version

ROOT = Path(__file__).resolve().parent.parent


def parsers(
    parser: argparse.ArgumentParser, name: str = "imud"
) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Each command and what is below it, by the name of its page."""
    yield name, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, inner in action.choices.items():
                yield from parsers(inner, f"{name}-{word}")


def page_of(name: str, parser: argparse.ArgumentParser) -> str:
    parser.man_short_description = (parser.description or "").split(". ")[0]  # type: ignore[attr-defined]
    data = {"project_name": name, "version": version(), "manual_title": "imu-probe"}
    return str(Manpage(parser, _data=data))


def write(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, parser in parsers(build_parser()):
        (folder / f"{name}.1").write_text(page_of(name, parser), "utf-8")


def main(arguments: list[str]) -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", nargs="?", type=Path, default=ROOT / "build" / "man")
    folder = options.parse_args(arguments).folder
    write(folder)
    print(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
