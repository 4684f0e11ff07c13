# SPDX-License-Identifier: MIT
"""Assigns each address of an image to a part of the firmware.

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

# The file of the innermost function that is listed here decides.
FILES = {
    "sampling.c": "sampling",
    "twi.c": "sampling",
    "i2c.c": "sampling",
    "bus_recovery.c": "sampling",
    "clock.c": "clock",
    "handlers.S": "interrupts",
    "uart.c": "uart",
    "wire.c": "uart",
    "usb_descriptors.c": "uart",
    "radio.c": "radio",
    "rn41.c": "radio",
    "spi.c": "card",
    "sdcard.c": "card",
    "logbook.c": "card",
    "logbook_file.c": "card",
    "logbook_state.c": "card",
    "logbook_write.c": "card",
    "mpu9250.c": "sensor",
    "mpu9250_setup.c": "sensor",
    "lsm9ds0.c": "sensor",
    "lsm9ds0_setup.c": "sensor",
    "adafruit_4517.c": "sensor",
    "chip_pair.c": "sensor",
    "joined.c": "sensor",
    "lis3mdl.c": "sensor",
    "lsm6dsox.c": "sensor",
    "part.c": "sensor",
    "calibrate.c": "calibrate",
    "pose.c": "pose",
    "pose_place.c": "strokes",
    "stroke.c": "strokes",
    "stroke_way.c": "strokes",
    "fuse_stroke.c": "strokes",
    "fuse_own.c": "filter",
    "fuse_doubt.c": CALLER,
    "attitude.c": "filter",
    "paper_filter.c": "filter",
    "complementary.c": "filter",
    "mahony.c": "filter",
    "madgwick.c": "filter",
    "dcm_pi.c": "filter",
    "messages.c": "messages",
    "frame.c": "messages",
    "settings.c": "settings",
    "memory.c": "settings",
    "bank.c": "settings",
    "crc32.c": "settings",
    "params.c": "params",
    "store.c": "params",
    "probe_params.c": "params",
    "probe_filter.c": "params",
    "own_field.c": "params",
    "eeprom.c": "settings",
    "journal.c": "settings",
    "flash.c": "settings",
    "probe.c": "probe",
    "probe_state.c": "probe",
    "probe_stream.c": "probe",
    "send.c": "probe",
    "outlet.c": "probe",
    "commands.c": "probe",
    "acquisition.c": "probe",
    "polled.c": "probe",
    "button.c": "probe",
    "main.c": "probe",
    "board.c": "board",
    "chip.c": "board",
    "equipment.c": "board",
    "identity.c": "board",
    "adc.c": "board",
    "power.c": "board",
    "battery.c": "board",
    "reset.c": "board",
    "start.S": "board",
    "start.c": "board",
    "fixed.c": CALLER,
    "fixed_trig.c": CALLER,
    "fixed_mul.S": CALLER,
    "fixed_mul.c": CALLER,
    "string.c": CALLER,
    "vector.c": CALLER,
    "quat.c": CALLER,
    "kalman.c": CALLER,
    "lowpass.c": CALLER,
}
# The main filter in more detail: its files by these functions and by its stages. Their
# other functions count for their callers.
FILTER_FILES = {
    "fuse.c",
    "fuse_level.c",
    "fuse_gyro.c",
    "fuse_field.c",
    "fuse_heading.c",
}
FILTER_STAGE = "fuse_stage_"
FILTER_FUNCTIONS = {
    "fuse_step": "fuse.step",
    "fuse_take": "fuse.step",
    "fuse_work": "fuse.step",
    "fuse_orientation": "fuse.orientation",
    "fuse_quality": "fuse.quality",
    "integrate": "fuse.integrate",
    "fuse_look_for_rest": "fuse.rest",
    "add_to_means": "fuse.means",
}

# Of the ATmega328P: data sheet, table 12-6, the vectors that the firmware uses. The
# handlers of the STM32F405 have names of their own.
HANDLERS = {
    "__vector_1": "INT0",
    "__vector_14": "TIMER0_COMPA",
    "__vector_13": "TIMER1_OVF",
    "__vector_18": "USART_RX",
    "__vector_19": "USART_UDRE",
    "__vector_24": "TWI",
}


# The machine in the ELF header, and the prefix of its tools.
TOOLS = {40: "arm-none-eabi-", 83: "avr-"}

# Functions of handlers.S beside the handlers. The linker keeps no lines of assembly.
HANDLED = ("board_time_us", "clock_us", "sampling_begin")


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
    if place.file in FILTER_FILES:
        if place.function.startswith(FILTER_STAGE):
            return "fuse." + place.function.removeprefix(FILTER_STAGE)
        return FILTER_FUNCTIONS.get(place.function, CALLER)
    if place.function.startswith("__vector_") or place.function in HANDLED:
        return FILES["handlers.S"]
    if place.file.endswith((".h", ".o")):
        return CALLER  # inlined; or assembly, of which the linker keeps no lines
    return FILES.get(place.file, REST if place.file else CALLER)


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
    if all(item.part in (CALLER, REST, FILES["handlers.S"]) for item in found):
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
            name = Path(line.rpartition(":")[0]).name
            chains[-1].append(Place(function, name.removeprefix("??")))
            function = ""
    return chains


def _homes(tools: str, image: Path) -> dict[str, str]:
    """The source file of each C function."""
    found = {}
    for line in _output(f"{tools}nm", "-l", image).splitlines():
        symbol, _, place = line.partition("\t")
        found[symbol.split()[-1]] = Path(place.rpartition(":")[0]).name
    return found
