# SPDX-License-Identifier: MIT
"""The virtual boards, and where their images and emulators are found."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from imud import checkout, packaged
from imud.errors import FileError


@dataclass(frozen=True, slots=True)
class OtherSensor:
    """A sensor that a virtual board can have instead of its usual one."""

    name: str  # as its emulator calls it
    what: str
    sample_rate_hz: int
    image: Path | None = None  # of its own; None: the board's finds it by itself


@dataclass(frozen=True, slots=True)
class VirtualBoard:
    """A virtual board, and where the builds leave its image and its emulator."""

    name: str
    title: str
    what: str
    sample_rate_hz: int  # of its sensor; it can send as many messages a second
    memory: str  # the kind that keeps its settings without power
    image: Path  # relative to the project's folder
    simulator: Path
    packaged: str  # the image in imu-probe-firmware; empty: it is not there
    image_variable: str  # of the environment, with another path
    simulator_variable: str
    files: tuple[str, ...]  # options of its emulator that take a file
    has_battery: bool
    wires: tuple[str, ...] = ()  # of several ports, the one that the host has
    has_ready_wire: bool = False  # that can be left out
    others: tuple[OtherSensor, ...] = ()
    sensor: str = ""  # the one of `others` that it has; empty: its usual one

    def with_sensor(self, name: str) -> VirtualBoard:
        """The same board with the sensor of that name, one of `others`."""
        other = next(each for each in self.others if each.name == name)
        found = replace(self, sensor=name, sample_rate_hz=other.sample_rate_hz)
        return replace(found, image=other.image, packaged="") if other.image else found

    def find_image(self, given: Path | None = None) -> Path:
        """The image to run; FileError if there is none."""
        package = (packaged.FIRMWARE, self.packaged)
        return find(given, self.image_variable, self.image, *package)

    def find_simulator(self, given: Path | None = None) -> Path:
        """The emulator; FileError if there is none."""
        package = (packaged.SIM, self.simulator.name)
        return find(given, self.simulator_variable, self.simulator, *package)


PAIRS = (
    OtherSensor("lsm6dsox", "an LSM6DSOX with a LIS3MDL (Adafruit 4517)", 208),
    OtherSensor("ism330dhcx", "an ISM330DHCX with a LIS3MDL", 208),
)
DSV = OtherSensor("lsm6dsv16x", "an LSM6DSV16X with a LIS3MDL", 200)
PAIRED = Path(".pio/build/nano_lsm6dsox/firmware.elf")

NANO = VirtualBoard(
    name="nano",
    title="Nano",
    what="an Arduino Nano with an MPU-9250",
    sample_rate_hz=200,
    memory="EEPROM",
    image=Path(".pio/build/nano/firmware.elf"),
    simulator=Path("build/sim/nano"),
    packaged="nano-fuse.elf",
    image_variable="IMUD_IMAGE",
    simulator_variable="IMUD_SIM",
    files=("faults", "eeprom", "summary", "profile"),
    has_battery=False,
    others=tuple(replace(each, image=PAIRED) for each in PAIRS),
)
MEGA = replace(
    NANO,  # its emulator looks at the image
    name="mega",
    title="Mega",
    what="an Arduino Mega 2560 with an MPU-9250",
    image=Path(".pio/build/mega/firmware.elf"),
    packaged="mega.elf",
    image_variable="IMUD_IMAGE_MEGA",
    has_ready_wire=True,
    others=(),
)
F405 = VirtualBoard(
    name="f405",
    title="F405",
    what="an STM32F405 (pyboard) with an LSM9DS0",
    sample_rate_hz=380,
    memory="flash",
    image=Path(".pio/build/stm32f405/firmware.elf"),
    simulator=Path("build/sim/f405"),
    packaged="f405.elf",
    image_variable="IMUD_IMAGE_F405",
    simulator_variable="IMUD_SIM_F405",
    files=("faults", "eeprom", "summary", "profile", "card", "radio"),
    has_battery=True,
)
PICO = VirtualBoard(
    name="pico",
    title="Pico",
    what="a Raspberry Pi Pico with an MPU-9250",
    sample_rate_hz=200,
    memory="flash",
    image=Path("build/pico/pico.elf"),
    simulator=Path("build/sim/pico/pico"),
    packaged="",
    image_variable="IMUD_IMAGE_PICO",
    simulator_variable="IMUD_SIM_PICO",
    files=("faults", "eeprom", "summary"),
    has_battery=False,
    wires=("usb", "uart"),
    has_ready_wire=True,
    others=(*PAIRS, DSV),
)
BOARDS = {board.name: board for board in (NANO, F405, PICO, MEGA)}


def find(
    given: Path | None, variable: str, built: Path, package: str, name: str
) -> Path:
    """Finds a file: as given, by the environment, as a build left it, or of that name
    in a package.

    `built` is relative to the project's folder; an image there is brought up to date.
    Raises FileError if there is none.
    """
    named = given or (Path(text) if (text := os.environ.get(variable)) else None)
    if named is not None:
        if named.is_file():
            return named
        raise FileError(f"{named} does not exist; run `make firmware sim`")
    here = Path.cwd()
    # A virtual environment lies in the project's folder.
    for folder in (here, *here.parents, Path(sys.prefix).parent):
        if (folder / built).is_file():
            checkout.refresh_image(folder / built)
            return folder / built
    installed = packaged.folder_of(package)
    if installed is not None and (installed / name).is_file():
        return installed / name
    if checkout.is_checkout() or not name:
        raise FileError(f"{built} is not built yet; run `{_builder_of(built)}`")
    raise FileError(
        f"{built.name} is not installed; pip install 'imu-probe[sim]', or give its path"
    )


def _builder_of(built: Path) -> str:
    """The command that makes this file."""
    if built.parts[0] == ".pio":
        return f"pio run -e {built.parent.name}"
    if built.parts[:2] == ("build", "pico"):
        return "make firmware BOARD=pico"
    return "make firmware sim"
