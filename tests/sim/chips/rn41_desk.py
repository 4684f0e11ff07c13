# SPDX-License-Identifier: MIT
"""The model of the RN-41 with a UART, a host and the time, for its tests."""

from __future__ import annotations

from typing import Any

import native

MS = 1_000_000
SECOND = 1000 * MS
FACTORY = 115_200
UP = 1.0  # s from power-up until the module is ready
LINK = 3.0  # s from power-up until a host has connected

ffi, lib = native.load()


class Radio:
    """A module with a UART and a host, and the time."""

    def __init__(self, settings: str = "", **config: int) -> None:
        self.config = ffi.new("struct rn41_chip_config *")
        self.config[0] = lib.rn41_chip_defaults()
        for name, value in config.items():
            setattr(self.config, name, value)
        self.chip = ffi.gc(lib.rn41_chip_new(self.config), lib.rn41_chip_free)
        if settings:
            assert lib.rn41_chip_load(self.chip, settings.encode())
        self.now = 0
        self.baud = FACTORY
        self.output = b""
        self.heard = b""
        self.rates: set[int] = set()

    def until(self, seconds: float) -> None:
        self.now = max(self.now, round(seconds * SECOND))
        lib.rn41_chip_advance(self.chip, self.now)
        self.collect()

    def wait(self, seconds: float) -> None:
        self.until(self.now / SECOND + seconds)

    def collect(self) -> None:
        byte, baud = ffi.new("uint8_t *"), ffi.new("uint32_t *")
        while lib.rn41_chip_take(self.chip, byte, baud):
            self.output += bytes([byte[0]])
            self.rates.add(baud[0])
        while lib.rn41_chip_host_read(self.chip, byte):
            self.heard += bytes([byte[0]])

    def send(self, data: bytes) -> None:
        """Send bytes without pauses, at this UART's own rate."""
        for byte in data:
            self.now += 10 * SECOND // self.baud
            lib.rn41_chip_receive(self.chip, self.now, byte, self.baud)
            self.collect()

    def ask(self, line: str, seconds: float = 0.2) -> str:
        self.output = b""
        self.send(line.encode() + b"\r")
        self.wait(seconds)
        return self.output.decode()

    def command(self, at: float = UP + 0.1) -> None:
        """Enter command mode."""
        self.until(at)
        self.send(b"$$$")
        self.wait(0.2)
        assert self.output.endswith(b"CMD\r\n")

    def host(self, data: bytes) -> None:
        for byte in data:
            lib.rn41_chip_host_write(self.chip, self.now, byte)
        self.collect()

    def fault(self, kind: str, at: float, seconds: float = 0.0) -> None:
        fault = ffi.new("struct rn41_chip_fault *")
        fault.kind = getattr(lib, f"RN41_CHIP_{kind}")
        fault.from_ns = round(at * SECOND)
        fault.for_ns = round(seconds * SECOND)
        assert lib.rn41_chip_add_fault(self.chip, fault)

    def reset_pulse(self, ms: float) -> None:
        lib.rn41_chip_set_reset(self.chip, self.now, True)
        self.wait(ms / 1000)
        lib.rn41_chip_set_reset(self.chip, self.now, False)

    def cts(self, is_high: bool) -> None:
        lib.rn41_chip_set_cts(self.chip, self.now, is_high)
        self.collect()

    @property
    def rts(self) -> int:
        return int(lib.rn41_chip_rts(self.chip))

    @property
    def pio2(self) -> int:
        return int(lib.rn41_chip_pio2(self.chip))

    @property
    def counters(self) -> Any:
        return lib.rn41_chip_counters(self.chip)

    def complaint(self) -> str | None:
        text = lib.rn41_chip_complaint(self.chip)
        return None if text == ffi.NULL else ffi.string(text).decode()

    def settings(self) -> str:
        text = ffi.new("char[]", lib.RN41_CHIP_TEXT)
        lib.rn41_chip_save(self.chip, text)
        return str(ffi.string(text).decode())


def settings(**changes: str) -> str:
    """The text of a settings file: the factory's settings with some changed."""
    lines = dict(line.split("=", 1) for line in Radio().settings().splitlines())
    return "".join(f"{k}={v}\n" for k, v in (lines | changes).items())


def linked(text: str = "", **config: int) -> Radio:
    radio = Radio(text, **config)
    radio.until(LINK + 0.1)
    assert radio.pio2 == 1
    return radio
