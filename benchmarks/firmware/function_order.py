# SPDX-License-Identifier: MIT
"""Orders the functions of the Nano's image so that few calls are long.

A call or jump of two bytes reaches 4 KiB either way; the linker makes it so where it
can (-mrelax), else it takes four. From images, each with its linker's map beside it,
this finds an order with few long ones, by simulated annealing, and writes it into the
linker script as a list of sections. Images of several compilers are taken together, so
that none of them loses what another gains:

    PATH=COMPILER/bin:$PATH pio run -e nano     # for each, after rm -r .pio/build/nano
    cp .pio/build/nano/firmware.elf gcc5.elf; cp .pio/build/nano/firmware.map gcc5.map
    python benchmarks/firmware/function_order.py gcc5.elf gcc7.elf gcc14.elf --write

It begins with the order of the images. Run it again with other seeds, which find
orders that differ by some forty bytes, and on the image that it has led to: calls that
have become short shift the rest a little. What the list does not name lies behind it,
and a name that no longer exists does no harm.
"""

from __future__ import annotations

import argparse
import math
import random
import re
import subprocess
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.int64]

SCRIPT = Path(__file__).parents[2] / "firmware" / "avr" / "nano" / "atmega328p.ld"
BEGIN, END = "/* Order: begin */", "/* Order: end */"

# Bytes from the end of a call to its target; less than there are, because sizes shift.
REACH = 4080
LONG = 2  # bytes that a long call takes more
NEAR = 3900  # from here on a call is in danger of becoming long, which costs
DANGER = 0.3

SECTION = re.compile(
    r"^ (\.text\S*)\s+0x([0-9a-f]+)\s+0x([0-9a-f]+)\s+(\S+)$", re.MULTILINE
)
JUMP = re.compile(
    r"^\s*([0-9a-f]+):\t[0-9a-f ]+\t(?:r?call|r?jmp)\s(.*)$", re.MULTILINE
)
MEMBER = re.compile(r"lib\w+\.a\((\w+)\.o\)$")
# What compilers put before and behind a function's name.
BEFORE = r"^\.text\.(?:startup\.|unlikely\.|hot\.)?"
BEHIND = r"\.(?:isra|constprop|part|cold)(?:\.\d+)?"


@dataclass(frozen=True, slots=True)
class Image:
    """The functions of an image in their order, and its calls from one to another."""

    sizes: dict[str, int]
    calls: list[tuple[str, int, str, int]]  # function, offset in it, target, offset


def name_of(section: str, file: str) -> str:
    """A function, or `lib:` and the member of a library."""
    member = MEMBER.search(file)
    if member is not None:
        return f"lib:{member[1]}"
    return re.sub(f"(?:{BEHIND})+$", "", re.sub(BEFORE, "", section))


def pattern_of(name: str) -> str:
    """The linker script's line for a function."""
    if name.startswith("lib:"):
        return f"*lib*.a:{name[4:]}.o(.text .text.*)"
    if name == "main":
        return "*(.text.startup.main .text.main)"
    return f"*(.text.{name} .text.{name}.*)"


def parse(linked: str, disassembled: str) -> Image:
    """An image from its linker's map and its disassembly."""
    found = linked.partition("Linker script and memory map")[2]
    sizes: dict[str, int] = {}
    pieces: list[tuple[int, int, str, int]] = []  # start, end, name, offset in it
    rows = [
        (int(at, 16), int(size, 16), s, f) for s, at, size, f in SECTION.findall(found)
    ]
    for at, size, section, file in sorted(set(rows)):
        name = name_of(section, file)
        # The C library's start-up stays where it is, before all others.
        if size > 0 and section != ".text":
            pieces.append((at, at + size, name, sizes.get(name, 0)))
            sizes[name] = sizes.get(name, 0) + size
    starts = [piece[0] for piece in pieces]

    def place(address: int) -> tuple[str, int] | None:
        start, end, name, offset = pieces[max(bisect_right(starts, address) - 1, 0)]
        return (name, offset + address - start) if start <= address < end else None

    calls: list[tuple[str, int, str, int]] = []
    for at, operand in JUMP.findall(disassembled):
        absolute = re.search(r"0x([0-9a-f]+)", operand)
        relative = re.match(r"\.([+-]\d+)", operand)
        if absolute is not None:
            target = int(absolute[1], 16)
        elif relative is not None:
            target = int(at, 16) + 2 + int(relative[1])
        else:
            continue
        here, there = place(int(at, 16)), place(target)
        if here is not None and there is not None and here[0] != there[0]:
            calls.append((*here, *there))
    return Image(sizes, calls)


def read(elf: Path) -> Image:
    shown = subprocess.run(
        ["avr-objdump", "-d", elf], capture_output=True, text=True, check=True
    )
    return parse(elf.with_suffix(".map").read_text(encoding="utf-8"), shown.stdout)


class Costs:
    """The cost of an order for an image."""

    def __init__(self, image: Image, names: Sequence[str]) -> None:
        index = {name: place for place, name in enumerate(names)}
        self.sizes = np.array([image.sizes.get(name, 0) for name in names])
        calls = image.calls
        self.callers = np.array([index[call[0]] for call in calls], int)
        self.callees = np.array([index[call[2]] for call in calls], int)
        self.offsets = np.array([call[3] - call[1] - 2 for call in calls], int)

    def distances(self, order: Numbers) -> Numbers:
        starts = np.empty(len(order), int)
        sizes = self.sizes[order]
        starts[order] = np.cumsum(sizes) - sizes
        away: Numbers = starts[self.callees] - starts[self.callers] + self.offsets
        return np.asarray(np.abs(away))

    def long(self, order: Numbers) -> int:
        """Calls that do not reach."""
        return int(np.count_nonzero(self.distances(order) > REACH))

    def cost(self, order: Numbers) -> float:
        """Bytes, and a little for what is near the end of its reach or far beyond."""
        far = self.distances(order)
        danger = np.clip(far - NEAR, 0, NEAR).sum() / NEAR
        return LONG * float(np.count_nonzero(far > REACH)) + DANGER * float(danger)


def names_of(images: Iterable[Image]) -> list[str]:
    """The functions of all images, in the order of the first."""
    return [*dict.fromkeys(name for image in images for name in image.sizes)]


def anneal(
    images: Sequence[Image], names: Sequence[str], turns: int, seed: int = 1
) -> list[str]:
    """A better order: runs of functions are moved, and sometimes turned round."""
    chance = random.Random(seed)  # noqa: S311  no secret
    costs = [Costs(image, names) for image in images]
    order = np.arange(len(names))
    now = sum(each.cost(order) for each in costs)
    best, least = order, now
    hot, cold = 6.0 * len(images), 0.15 * len(images)
    for turn in range(turns):
        heat = hot * (cold / hot) ** (turn / turns)
        start = chance.randrange(len(names))
        length = 1 if chance.random() < 0.6 else chance.randrange(1, 12)
        run = order[start : start + length]
        rest = np.concatenate((order[:start], order[start + length :]))
        to = chance.randrange(len(rest) + 1)
        if chance.random() < 0.1:
            run = run[::-1]
        tried = np.concatenate((rest[:to], run, rest[to:]))
        cost = sum(each.cost(tried) for each in costs)
        if cost <= now or chance.random() < math.exp((now - cost) / heat):
            order, now = tried, cost
            if now < least:
                best, least = order, now
    return [names[int(place)] for place in best]


def with_list(script: str, names: Sequence[str]) -> str:
    """The linker script with another list between its two comments."""
    before, begin, rest = script.partition(BEGIN)
    _, end, behind = rest.partition(END)
    indent = " " * 8
    lines = "".join(f"{indent}{pattern_of(name)}\n" for name in names)
    return f"{before}{begin}\n{lines}{indent}{end}{behind}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("images", nargs="+", type=Path, metavar="IMAGE.elf")
    parser.add_argument("--turns", type=int, default=400_000, help="%(default)s")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="into the linker script")
    args = parser.parse_args()
    images = [read(path) for path in args.images]
    names = names_of(images)
    order = anneal(images, names, args.turns, args.seed)
    if args.write:
        script = SCRIPT.read_text(encoding="utf-8")
        SCRIPT.write_text(with_list(script, order), encoding="utf-8")
    new = np.array([names.index(name) for name in order])
    for path, image in zip(args.images, images, strict=True):
        costs = Costs(image, names)
        before = costs.long(np.arange(len(names)))
        print(f"{path}: {before} long calls before, {costs.long(new)} after")


if __name__ == "__main__":
    main()
