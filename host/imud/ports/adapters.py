# SPDX-License-Identifier: MIT
"""USB chips and boards of serial ports: the one table that code, the udev rule and
docs/connect.md are made from.

An id identifies a chip, not its use: a CH340 may be a probe's or a modem's. Only a
product's name that we give ourselves is ours alone.

Numbers: the drivers of Linux (drivers/usb/serial/ch341.c, ftdi_sio_ids.h, cp210x.c,
pl2303.h, drivers/usb/class/cdc-acm.c) and the boards' own descriptors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

# A board whose USB product begins so is a probe: nobody else's does.
PRODUCT = "imu-probe"


class Listed(Protocol):
    """The attributes of a port that is not open: of pyserial's ListPortInfo."""

    device: str
    hwid: str
    vid: int | None
    pid: int | None
    product: str | None
    serial_number: str | None
    location: str | None


@dataclass(frozen=True, slots=True)
class Adapter:
    """A chip or a board. `product` None: all of that vendor. `is_board`: a
    microcontroller's own USB or its maker's, so never a modem.
    """

    vendor: int
    product: int | None
    name: str
    is_board: bool = False

    @property
    def usb_id(self) -> str:
        product = "*" if self.product is None else f"{self.product:04x}"
        return f"{self.vendor:04x}:{product}"


ADAPTERS = (
    Adapter(0x1A86, 0x7523, "CH340"),
    Adapter(0x1A86, 0x7522, "CH340K"),
    Adapter(0x1A86, 0x5523, "CH341"),
    Adapter(0x1A86, 0x55D2, "CH342"),
    Adapter(0x1A86, 0x55D3, "CH343"),
    Adapter(0x1A86, 0x55D4, "CH9102"),
    Adapter(0x0403, 0x6001, "FT232R"),
    Adapter(0x0403, 0x6010, "FT2232"),
    Adapter(0x0403, 0x6011, "FT4232"),
    Adapter(0x0403, 0x6014, "FT232H"),
    Adapter(0x0403, 0x6015, "FT231X"),
    Adapter(0x10C4, 0xEA60, "CP2102"),
    Adapter(0x10C4, 0xEA70, "CP2105"),
    Adapter(0x10C4, 0xEA71, "CP2108"),
    Adapter(0x067B, 0x2303, "PL2303"),
    Adapter(0x067B, 0x23A3, "PL2303GC"),
    Adapter(0xF055, 0x9800, "MicroPython board", is_board=True),
    Adapter(0xF055, 0x9801, "MicroPython board", is_board=True),
    Adapter(0xF055, 0x9802, "MicroPython board", is_board=True),
    Adapter(0x0483, 0x374B, "ST-LINK of an STM32 board", is_board=True),
    Adapter(0x0483, 0x5740, "STM32's own USB"),
    Adapter(0x2E8A, None, "Raspberry Pi microcontroller", is_board=True),
    Adapter(0x303A, None, "Espressif microcontroller", is_board=True),
    Adapter(0x2341, None, "Arduino", is_board=True),
    Adapter(0x2A03, None, "Arduino", is_board=True),
    Adapter(0x239A, None, "Adafruit board", is_board=True),
    Adapter(0x1B4F, None, "SparkFun board", is_board=True),
    Adapter(0x16C0, 0x0483, "Teensy", is_board=True),
)


def adapter_of(port: Listed) -> Adapter | None:
    """None: it is not USB, or in no line of the table."""
    both = [a for a in ADAPTERS if a.vendor == port.vid]
    exact = (a for a in both if a.product == port.pid)
    return next(exact, next((a for a in both if a.product is None), None))


def kind_of(port: Listed) -> str:
    """In words: "CH340 (1a86:7523)", "Bluetooth", "not USB"."""
    if port.vid is None or port.pid is None:
        return "Bluetooth" if "rfcomm" in port.device else "not USB"
    adapter = adapter_of(port)
    name = adapter.name if adapter else port.product or "unknown chip"
    return f"{name} ({port.vid:04x}:{port.pid:04x})"


def is_ours_alone(port: Listed) -> bool:
    """Whether nobody else's device is like that one."""
    return (port.product or "").startswith(PRODUCT)


def table() -> str:
    """The table of docs/connect.md, in Markdown."""
    rows = ["| USB id | chip or board | left alone by ModemManager |", "|---|---|---|"]
    for a in ADAPTERS:
        when = "yes" if a.is_board else "once adopted"
        rows.append(f"| {a.usb_id} | {a.name} | {when} |")
    return "\n".join(rows)
