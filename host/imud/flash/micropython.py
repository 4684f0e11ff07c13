# SPDX-License-Identifier: MIT
"""Makes a board that runs MicroPython a probe, through its prompt on USB: copies the C
module for its processor, the package `probe` and a main.py with its pins.

The prompt is the raw REPL (MicroPython's documentation, "The MicroPython Interactive
Interpreter Mode"). Each request waits for the answer to the one before and is short, as
the board has a buffer of 256 bytes and no flow control.
"""

from __future__ import annotations

import ast
import base64
import hashlib
import time
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import msgspec

from imud import checkout, packaged
from imud.errors import FlashError
from imud.flash import OnProgress, firmware

BAUD = 115_200  # which USB does without
PROMPT_S, EACH_S = 2.0, 0.5  # some boards restart as their port is opened
ANSWER_S = 10.0  # a board that erases a block of its flash
PIECE = 150  # bytes of a file in a request
MAIN, MODULE = "main.py", "imuprobe.mpy"
PART = ".part"  # of the name of a file that is not whole
NEWEST = "https://micropython.org/download"

# MicroPython's "MicroPython .mpy files": the version in the low byte, the version of
# native code in two bits, then the processor. Each loads the code of a lesser one.
ABI = (6, 3)
ARCHES = {2: "x64", 4: "armv6m", 5: "armv6m", 6: "armv6m", 7: "armv7emsp"}
ARCHES |= {8: "armv7emsp", 11: "rv32imc"}
XTENSA = (9, 10)

# What of the package runs beside the module. The rest is for boards without it; a
# pyboard has no room for both.
PACKAGE = (
    *("__init__", "ak8963", "battery", "board", "bus", "log", "loop", "plain_settings"),
    *("relay", "sensors", "spi", "start", "storage", "udp", "wifi"),
)

# What ast.literal_eval raises, of any text.
_UNREADABLE = (ValueError, SyntaxError, TypeError, MemoryError, RecursionError)
_FACTS = (
    "import sys\ni=sys.implementation\n"
    "print((i._machine,i.version[:2],getattr(i,'_mpy',0)))"
)
_IMPORTS = "import os,hashlib\nimport binascii as b"
_DIGEST = (
    "def d(p):\n h=hashlib.sha256()\n try:\n  with open(p,'rb') as f:\n   while 1:\n"
    "    c=f.read(512)\n    if not c:break\n    h.update(c)\n"
    " except OSError:return\n return b.hexlify(h.digest()).decode()"
)


class NoPrompt(FlashError):
    """No answer from MicroPython's prompt."""


class PromptWire(Protocol):
    """A port, as pyserial has it."""

    def write(self, data: bytes, /) -> int | None: ...
    def read(self, size: int = 1, /) -> bytes: ...


class Board(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A row of boards.toml."""

    name: str
    arch: str
    has_wifi: bool
    tried: str
    pins: dict[str, int | str]

    @property
    def main(self) -> str:
        """Its main.py."""
        words = ", ".join(f"{name}={pin!r}" for name, pin in self.pins.items())
        about = f'"""A probe on a board "{self.name}", by imud flash."""\n\n'
        return f"{about}from probe.start import start\n\nstart({words})\n"


def boards() -> tuple[Board, ...]:
    raw = tomllib.loads(Path(__file__).with_name("boards.toml").read_text("utf-8"))
    return tuple(msgspec.convert(raw["boards"], list[Board]))


class Prompt:
    """MicroPython's prompt on an open port."""

    def __init__(self, wire: PromptWire) -> None:
        self._wire = wire
        until_s = time.monotonic() + PROMPT_S
        while True:
            wire.write(b"\r\x03\x03\r\x01")
            if self._until(b"raw REPL; CTRL-B to exit\r\n>", EACH_S)[1]:
                return
            if time.monotonic() < until_s:
                continue
            raise NoPrompt(
                "no prompt of MicroPython: if the board runs a probe, hold its button "
                "down while you plug it in; if it has no MicroPython, get it from "
                f"{NEWEST}"
            )

    def ask(self, code: str, takes_s: float = 0.0) -> str:
        """Runs some lines, and returns what they print. FlashError with the board's
        last line if they fail.
        """
        seconds = ANSWER_S + takes_s
        self._wire.write(code.encode() + b"\x04")
        heard, is_whole = self._until(b"\x04>", seconds)
        if not is_whole:
            raise FlashError(f"the board did not answer for {seconds:g} s; try again")
        text = heard.partition(b"OK")[2].removesuffix(b"\x04>").decode(errors="replace")
        out, _, fault = text.partition("\x04")
        if fault:
            said = fault.strip().rpartition("\n")[2]
            if said.startswith("OSError") and "28" in said:  # ENOSPC
                said = "its file system is full; remove files that it does not need"
            raise FlashError(f"the board refused: {said}")
        return out.strip()

    def value(self, code: str, kind: Any, takes_s: float = 0.0) -> Any:
        """What some lines print, as a value of Python of that kind."""
        text = self.ask(code, takes_s)
        try:
            return msgspec.convert(ast.literal_eval(text), kind)
        except (*_UNREADABLE, msgspec.ValidationError) as error:
            raise FlashError(f"the board answered {text[:60]!r}; try again") from error

    def _until(self, end: bytes, seconds: float) -> tuple[bytes, bool]:
        """What is heard up to that end, and whether it came."""
        heard = b""
        until_s = time.monotonic() + seconds
        while not heard.endswith(end) and time.monotonic() < until_s:
            heard += self._wire.read(1)
        return heard, heard.endswith(end)

    def restart(self) -> None:
        """Ends the prompt, and starts main.py as after power-on."""
        self._wire.write(b"\x02\x04")

    def board(self, *, needs_wifi: bool = False) -> Board:
        """The board's row; FlashError with what to do if there is nothing for it."""
        facts = self.value(_FACTS, tuple[str, tuple[int, int], int])
        machine, version, mpy = facts
        abi, number = (mpy & 0xFF, mpy >> 8 & 3), mpy >> 10 & 15
        said = f"MicroPython {version[0]}.{version[1]} on {machine}"
        if abi != ABI:
            what = "too old: get 1.25 or newer from " + NEWEST
            if abi > ABI:
                what = "newer than this imud: update imu-probe and imu-probe-firmware"
            raise FlashError(f"{said} is {what}")
        if number not in ARCHES:
            what = "its processor"
            if number in XTENSA:
                what = "an Xtensa; it can send raw samples: docs/micropython.md"
            raise FlashError(f"{said}: there is no module for {what}")
        name = machine.partition(" with ")[0]
        for board in boards():
            if board.name.replace(" ", "") == name.replace(" ", ""):
                if needs_wifi and not board.has_wifi:
                    raise FlashError(f"{said} has no Wi-Fi; leave --wifi out")
                return msgspec.structs.replace(board, arch=ARCHES[number])
        known = ", ".join(board.name for board in boards())
        raise FlashError(
            f"{said}: its pins are unknown, only those of {known}; write its main.py "
            "by hand: docs/micropython.md"
        )

    def digests(self, names: Mapping[str, object]) -> dict[str, str | None]:
        """The SHA-256 of each file of these names that the board has."""
        self.ask(_IMPORTS)
        self.ask(_DIGEST)
        return {n: self.value(f"print(repr(d({n!r})))", str | None) for n in names}

    def put(self, files: Mapping[str, bytes], on_progress: OnProgress) -> int:
        """Copies the files that differ, and reads them back; returns their number. Each
        replaces an older one only when it is whole.
        """
        had = self.digests(files)
        new = {name: raw for name, raw in files.items() if had[name] != sha256(raw)}
        done, total = 0, sum(map(len, new.values()))
        for name, raw in new.items():
            if folder := name.rpartition("/")[0]:
                self.ask(f"try:\n os.mkdir({folder!r})\nexcept OSError:pass")
            part = name + PART
            self.ask(f"f=open({part!r},'wb')")
            for at in range(0, len(raw), PIECE):
                piece = base64.b64encode(raw[at : at + PIECE]).decode()
                self.ask(f"f.write(b.a2b_base64({piece!r}))")
                done += len(raw[at : at + PIECE])
                on_progress(done, total)
            self.ask("f.close()")
            if self.digests({part: raw})[part] != sha256(raw):
                raise FlashError(f"{name} reads back wrong; try again")
            self.remove(name)  # FAT renames to no name that is taken
            self.ask(f"os.rename({part!r},{name!r})")
        return len(new)

    def remove(self, name: str) -> None:
        self.ask(f"import os\ntry:\n os.remove({name!r})\nexcept OSError:pass")


def files_for(board: Board, schema: str) -> dict[str, bytes]:
    """What a board gets, by the names there. FlashError if a file is missing, was
    modified, or is not of that schema, which is this imud's.
    """
    module = f"imuprobe-{board.arch}.mpy"
    package = [f"probe/{name}.py" for name in PACKAGE]
    if checkout.is_checkout():
        built = checkout.ROOT / "build" / "mpy"
        source = checkout.ROOT / "firmware" / "micropython"
        found = {MODULE: _read(built, module, schema)}
        found |= {name: (source / name).read_bytes() for name in package}
    else:
        folder = packaged.folder_of(packaged.FIRMWARE)
        if folder is None:
            raise FlashError("no firmware is installed: pip install imu-probe-firmware")
        firmware.is_signed(folder)
        found = {MODULE: _read(folder, module, schema)}
        found |= {name: _read(folder, name, schema) for name in package}
    return found | {MAIN: board.main.encode()}


def _read(folder: Path, name: str, schema: str) -> bytes:
    rows = [row for row in firmware.listed(folder) if row.file == name]
    hint = "make firmware BOARD=mpy" if checkout.is_checkout() else "get both again"
    try:
        raw = (folder / name).read_bytes()
    except OSError as error:
        raise FlashError(f"can't read {folder / name}: {hint}") from error
    if not rows:
        raise FlashError(f"{folder / firmware.MANIFEST} has no {name}: {hint}")
    if rows[0].sha256 != sha256(raw):
        raise FlashError(
            f"{folder / name} was modified: its SHA-256 is not in "
            f"{firmware.MANIFEST}; {hint}"
        )
    if rows[0].schema != schema:
        raise FlashError(
            f"{folder / name} has schema {rows[0].schema}, but this imud {schema}: "
            "install the imu-probe-firmware of its version"
        )
    return raw


def sha256(raw: bytes) -> str:
    return hashlib.sha256(raw).hexdigest()
