# SPDX-License-Identifier: MIT
"""Assigns each address of an image to a part of the firmware: the folder of its source.

Uses the debug information, which tells what was inlined where. Shared arithmetic counts
for the part that calls it.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

CALLER = "-"
REST = "rest"
INTERRUPTS = "interrupts"
# Folders of firmware/ and of firmware/core; main.c is in firmware itself.
FOLDERS = {
    *("avr", "mega", "nano", "stm32", "rp2040", "generic", "firmware"),
    *("drivers", "fusion", "params", "probe", "storage", "wire"),
}
ARITHMETIC = "math"

# Functions of handlers.S beside the handlers. The linker keeps no lines of assembly.
HANDLED = ("board_time_us", "clock_us", "sampling_begin")
# The machine in the ELF header, and the prefix of its tools.
TOOLS = {40: "arm-none-eabi-", 83: "avr-"}


class NoParts(Exception):
    """An image has no debug information to tell its parts by."""


class Place(NamedTuple):
    """A function, and the source file of an instruction in it."""

    function: str
    file: str


class Range(NamedTuple):
    """Addresses of one part, without the end."""

    start: int
    end: int
    part: str


def part_of(chain: Sequence[Place], home: str) -> str:
    """The part of an instruction: that of the innermost place of its chain with a part.

    `home` is the file of the outermost function; "" without debug information, as in
    the compiler's own arithmetic.
    """
    for place in (*chain, Place(chain[-1].function, home)):
        part = _part(place)
        if part != CALLER:
            return part
    return CALLER


def _part(place: Place) -> str:
    if place.function.startswith("__vector_") or place.function in HANDLED:
        return INTERRUPTS
    # A header's function is inlined; assembly has an object for its file, or none.
    if not place.file.endswith(".c"):
        return CALLER
    folder = Path(place.file).parent.name
    if folder == ARITHMETIC:
        return CALLER
    return folder if folder in FOLDERS else REST


def read(image: Path) -> list[Range]:
    """The parts of an image in ascending addresses; raises NoParts."""
    tools = _tools(image)
    start, end = _text(tools, image)
    addresses = range(start, end, 2)
    homes = _homes(tools, image)
    found: list[Range] = []
    for address, chain in zip(addresses, _chains(tools, image, addresses), strict=True):
        part = part_of(chain, homes.get(chain[-1].function, ""))
        if found and found[-1].part == part:
            found[-1] = found[-1]._replace(end=address + 2)
        else:
            found.append(Range(address, address + 2, part))
    if all(item.part in (CALLER, REST, INTERRUPTS) for item in found):
        raise NoParts(f"{image} was built without debug information")
    return found


def write(image: Path, path: Path) -> None:
    """Write an image's parts in the format that the emulators' `--parts` reads."""
    lines = (f"{r.start:x} {r.end:x} {r.part}\n" for r in read(image))
    path.write_text("".join(lines))


def _output(*command: str | Path, given: str = "") -> str:
    return subprocess.run(
        command, input=given, capture_output=True, text=True, check=True
    ).stdout


def _tools(image: Path) -> str:
    header = image.read_bytes()[:20]
    machine = int.from_bytes(header[18:20], "little")
    if header[:4] != b"\x7fELF" or machine not in TOOLS:
        raise NoParts(f"{image} is not an image of a board")
    return TOOLS[machine]


def _text(tools: str, image: Path) -> tuple[int, int]:
    """The addresses of the code."""
    for line in _output(f"{tools}size", "-A", "-d", image).splitlines():
        words = line.split()
        if words[:1] == [".text"]:
            return int(words[2]), int(words[2]) + int(words[1])
    raise NoParts(f"{image} has no code")


def _chains(tools: str, image: Path, addresses: Iterable[int]) -> list[list[Place]]:
    """For each address the functions that it is inlined into, innermost first."""
    given = "".join(f"{address:x}\n" for address in addresses)
    output = _output(f"{tools}addr2line", "-a", "-i", "-f", "-e", image, given=given)
    chains: list[list[Place]] = []
    function = ""
    for line in output.splitlines():
        if line.startswith("0x"):
            chains.append([])
        elif not function:
            function = line
        else:
            chains[-1].append(Place(function, line.rpartition(":")[0]))
            function = ""
    return chains


def _homes(tools: str, image: Path) -> dict[str, str]:
    """The source file of each C function."""
    found = {}
    for line in _output(f"{tools}nm", "-l", image).splitlines():
        symbol, _, place = line.partition("\t")
        found[symbol.split()[-1]] = place.rpartition(":")[0]
    return found
