# SPDX-License-Identifier: MIT
"""The limits of each image, its figures beside them, and its cycles by part."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from benchmarks.common.boards import F405, MEGA, NANO
from benchmarks.firmware import filters, parts


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of an image; sizes in bytes."""

    cycles: int  # a sample
    flash: int
    variables: int  # bytes of RAM
    stack: int
    both: int


LIMITS = {
    "nano": Limits(
        int(0.9 * NANO.clock_hz / NANO.chip.rate_hz),
        # On old Nanos the bootloader takes 2 kB of the flash.
        flash=filters.FLASH_BYTES - 2048,
        variables=filters.RAM_BYTES,
        stack=filters.RAM_BYTES,
        # 256 bytes are a reserve for stack that no run has needed.
        both=1792,
    ),
    # The bootloader takes 8 kB of the flash. A sample's work ends before the next one.
    "mega": Limits(
        int(MEGA.clock_hz / MEGA.chip.rate_hz),
        flash=(256 - 8) * 1024,
        variables=8 * 1024,
        stack=8 * 1024,
        both=8 * 1024 - 256,
    ),
    # Half of the time, because an instruction may take more than a cycle. Data sheet,
    # "Memory mapping"; the last two sectors of flash are for settings, and the stack is
    # in 8 KiB of its own (firmware/stm32/stm32f405.ld).
    "f405": Limits(
        int(0.5 * F405.clock_hz / F405.chip.rate_hz),
        flash=(1024 - 256) * 1024,
        variables=128 * 1024,
        stack=8 * 1024,
        both=(128 + 8) * 1024,
    ),
}


class SumsDiffer(Exception):
    """The parts of a profile do not add up to its total."""


@dataclass(frozen=True, slots=True)
class Line:
    """A figure and its limit, if it has one."""

    name: str
    value: float
    unit: str
    limit: float | None = None

    @property
    def is_kept(self) -> bool:
        return self.limit is None or self.value <= self.limit

    def __str__(self) -> str:
        limit = "" if self.limit is None else f"of {self.limit:g}"
        mark = "" if self.is_kept else "  <-- too much"
        return f"{self.name:34}{self.value:>10g} {self.unit:8}{limit:>10}{mark}"


@dataclass(frozen=True, slots=True)
class Part:
    """Cycles a sample in one part of the firmware."""

    name: str
    mean: float
    worst: int
    in_worst: int  # in the slowest sample
    outside: float  # mean, before a sample's work begins or after it has ended


def figures(
    summary: dict[str, Any], lost: int, poses_hz: float, name: str = NANO.name
) -> list[Line]:
    """The table of an image, from the emulator's summary."""
    limits = LIMITS[name]
    return [
        Line("cycles a sample, worst", summary["cycles_worst"], "", limits.cycles),
        Line("cycles a sample, mean", summary["cycles_mean"], "", limits.cycles),
        Line("asleep", round(100.0 * summary["idle"], 1), "%"),
        Line("samples late", summary["late"], "", 0),
        Line("samples or messages lost", lost, "", 0),
        Line("samples", summary["samples"], ""),
        Line("poses a second", round(poses_hz, 1), ""),
        Line("flash", summary["flash"], "bytes", limits.flash),
        Line("RAM: variables", summary["ram"], "bytes", limits.variables),
        Line("RAM: deepest stack", summary["stack_max"], "bytes", limits.stack),
        Line("RAM: both", summary["ram"] + summary["stack_max"], "bytes", limits.both),
    ]


def by_part(profile: dict[str, Any]) -> list[Part]:
    """The parts, largest mean first, and their total; SumsDiffer if it is another."""
    count = profile["samples"]
    total = profile["total"]
    tallies = profile["parts"]
    for kind in ("cycles", "outside", "in_worst"):
        whole = sum(tally[kind] for tally in tallies.values())
        if whole != total[kind]:
            raise SumsDiffer(f"{kind}: parts {whole}, total {total[kind]}")
    found = [
        Part(
            name=name,
            mean=round(tally["cycles"] / count, 1),
            worst=tally["worst"],
            in_worst=tally["in_worst"],
            outside=round(tally["outside"] / count, 1),
        )
        for name, tally in {**tallies, "all": total}.items()
    ]
    return sorted(found, key=lambda part: (part.name == "all", -part.mean))


def print_parts(found: Iterable[Part], interrupts: dict[str, Any], count: int) -> None:
    print("\ncycles a sample             mean     worst  in worst sample   outside")
    for part in found:
        print(
            f"{part.name:20}{part.mean:>12.0f}{part.worst:>10}{part.in_worst:>17}"
            f"{part.outside:>10.0f}"
        )
    print("\ninterrupt              a sample      mean     worst cycles")
    for name, handler in interrupts.items():
        mean = handler["cycles"] / handler["calls"]
        print(
            f"{parts.HANDLERS.get(name, name):20}{handler['calls'] / count:>12.2f}"
            f"{mean:>10.1f}{handler['worst']:>10}"
        )
