# SPDX-License-Identifier: MIT
"""Images are written into the virtual Nano by the bootloaders that Nanos have."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import serial

import bootloaders
from bootloaders import ATMEGABOOT, OPTIBOOT_4
from fakes import PATIENCE_S
from imud.errors import FlashError
from imud.flash import nano
from imud.flash.stk500 import BootWire
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, decode
from system.live import LiveProbe
from system.virtual import NANO, Stub

EVERY = pytest.mark.parametrize("bootloader", [OPTIBOOT_4, ATMEGABOOT])


class Cut(Exception):
    """The cable was pulled."""


@pytest.fixture
def stub(nano: Path, image: Path, tmp_path: Path) -> Stub:
    return Stub(NANO, nano, image, tmp_path)


def bytes_of(image: Path) -> dict[int, int]:
    """Of an ELF file, as they lie in flash."""
    binary = image.parent / "firmware.flash"
    subprocess.run(["avr-objcopy", "-O", "binary", image, binary], check=True)
    return dict(enumerate(binary.read_bytes()))


@contextlib.contextmanager
def live(stub: Stub, bootloader: str) -> Iterator[LiveProbe]:
    options = bootloaders.options(bootloader)
    probe = LiveProbe(stub, "--reset-on-open", *options)
    try:
        yield probe
    finally:
        probe.end()


def opening(
    probe: LiveProbe, on_write: Callable[[bytes], None] = lambda _: None
) -> nano.Reset:
    """Opens the port, which resets the board."""

    @contextlib.contextmanager
    def opened(baud: int) -> Iterator[BootWire]:
        with serial.Serial(str(probe.port), baud, timeout=0.02) as port:
            write = port.write

            def watched(data: bytes) -> int | None:
                on_write(data)
                return write(data)

            port.write = watched  # type: ignore[method-assign]
            yield port

    return opened


def hello_of(probe: LiveProbe) -> Message:
    decoder = FrameDecoder()
    with serial.Serial(str(probe.port), 500_000, timeout=PATIENCE_S) as port:
        while True:
            for content in decoder.feed(port.read(64)):
                message = decode(content)
                if isinstance(message, Message) and message.name == "hello":
                    return message


@EVERY
def test_an_image_is_written_read_back_and_runs(stub: Stub, bootloader: str) -> None:
    image = bytes_of(stub.image)
    seen: list[tuple[int, int]] = []
    with live(stub, bootloader) as probe:
        with nano.reached(opening(probe)) as (found, begins_at):
            assert begins_at == {OPTIBOOT_4: 0x7E00, ATMEGABOOT: 0x7800}[bootloader]
            assert nano.check_chip(found) == "ATmega328P"
            pages = nano.write(found, begins_at, image, lambda *at: seen.append(at))
            found.leave()
        assert pages == -(-len(image) // nano.PAGE)
        assert seen[-1] == (len(seen), len(seen))
        assert hello_of(probe).fields["board"] == "nano"


@EVERY
def test_a_cut_leaves_the_bootloader_and_the_next_try_works(
    stub: Stub, bootloader: str
) -> None:
    image = bytes_of(stub.image)
    writes = 0

    def cut(_: bytes) -> None:
        nonlocal writes
        writes += 1
        if writes == 150:
            raise Cut

    with live(stub, bootloader) as probe:
        with pytest.raises(Cut), nano.reached(opening(probe, cut)) as (found, at):
            nano.write(found, at, image)
        with nano.reached(opening(probe)) as (found, at):
            assert found.read(0, 4)[:2] == b"\x0c\x94"  # it leads to the bootloader
            nano.write(found, at, image)
            found.leave()
        assert hello_of(probe).fields["board"] == "nano"


def test_where_no_bootloader_is_one_is_missed_in_words(stub: Stub) -> None:
    with (
        live(stub, bootloaders.NONE) as probe,
        pytest.raises(FlashError, match="at 115200 or 57600 baud; is it an Arduino"),
        nano.reached(opening(probe)),
    ):
        pass
