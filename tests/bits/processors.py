# SPDX-License-Identifier: MIT
"""The core on each processor: main.c over firmware/core, built as the board's image is,
takes the messages of a log in an emulator and gives the poses back.
"""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import sys
import tty
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import images
from imud import _core
from imud.wire import messages
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, Value
from imud.wire.params import ParamsParts

ROOT = Path(__file__).resolve().parent.parent.parent
FIRMWARE = ROOT / "firmware"


@dataclass(frozen=True, slots=True)
class Processor:
    """How a program for it is made and run."""

    environment: str  # of platformio.ini: whose flags
    compiler: tuple[str, ...]
    folder: str  # of firmware/
    portable: bool  # fixed_mul.c, where no assembler stands for it
    simulator: str
    room: int  # bytes for what was received and not yet taken


ARM = ("arm-none-eabi-gcc", "-mthumb", "-mcpu=cortex-m4", "-nostdlib")
ARM_LINK = ("-T", str(FIRMWARE / "stm32" / "stm32f405.ld"), "-Wl,--fatal-warnings")
PROCESSORS = {
    "atmega328p": Processor(
        "nano",
        ("avr-gcc", "-mmcu=atmega328p", "-DF_CPU=16000000L"),
        *("avr", False, "nano", 64),
    ),
    "atmega2560": Processor(
        "mega",
        ("avr-gcc", "-mmcu=atmega2560", "-DF_CPU=16000000L"),
        *("avr", False, "nano", 64),
    ),
    "cortex_m4": Processor(
        "stm32f405",
        (*ARM, *ARM_LINK, "-DF_CPU=168000000L"),
        *("stm32", True, "f405", 1000),
    ),
    "cortex_m4_fpu": Processor(
        "stm32f405_fpu",
        (*ARM, *ARM_LINK, "-DF_CPU=168000000L"),
        *("stm32", True, "f405", 1000),
    ),
}


@functools.cache
def flags(environment: str) -> tuple[str, ...]:
    """The compiler's flags in platformio.ini."""
    shown = subprocess.run(
        [Path(sys.executable).parent / "pio", "project", "config", "--json-output"],
        cwd=ROOT,
        env=os.environ | {"PLATFORMIO_SETTING_ENABLE_TELEMETRY": "no"},
        capture_output=True,
        check=True,
    )
    options = dict(dict(json.loads(shown.stdout))[f"env:{environment}"])
    found = options["build_flags"]
    words = found.split() if isinstance(found, str) else " ".join(found).split()
    assert "-std=gnu11" in words
    return tuple(words)


def command(processor: Processor) -> tuple[str | Path, ...]:
    """The compiler and its flags, as for the board's image."""
    own = flags(processor.environment)
    return (
        *(*processor.compiler, *own, "-Werror", "-Wvla", "-Wl,--gc-sections"),
        *("-I", FIRMWARE),
    )


def build(processor: Processor) -> Path:
    core = sorted((FIRMWARE / "core").rglob("*.c"))
    folder = FIRMWARE / processor.folder
    # A Nano's sensor is one of two.
    own = [*({*folder.glob("*.[cS]")} - {folder / "chip_pair.c"})]
    own += (FIRMWARE / "generic").glob("*.c")
    sources = [file for file in core if processor.portable or file.stem != "fixed_mul"]
    return images.program(
        *command(processor),
        # Recordings of every sensor; that of a Nano has no lag of its own. No board.
        *("-UPOSE_WITHOUT_MAG_LAG", "-UPORTS_FIXED"),
        *(ROOT / "tests" / "bits" / "main.c", *sources, *sorted(own)),
    )


def computed(name: str, contents: Sequence[bytes], folder: Path) -> list[bytes]:
    """The poses that a processor gives for the samples of a log."""
    if name == "host":
        return list(replayed(contents))
    processor = PROCESSORS[name]
    link, summary = folder / f"{name}.wire", folder / f"{name}.json"
    simulator = ROOT / "build" / "sim" / processor.simulator
    words: list[str | Path] = [simulator, "--image", build(processor)]
    words += ["--pty", link, "--fast", "--summary", summary]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr.readline().startswith("ready")
            poses = exchanged(link, contents, processor.room)
            process.send_signal(signal.SIGTERM)
            errors = process.stderr.read()
            assert process.wait() == 0, errors
        finally:
            process.kill()
    found = json.loads(summary.read_text())
    assert found["resets"] == 0
    assert found["firmware_complaint"] is None
    return poses


def exchanged(link: Path, contents: Sequence[bytes], room: int) -> list[bytes]:
    """Sends the frames, no more at once than the receiver has room for, and returns
    what is answered.
    """
    wire = os.open(link, os.O_RDWR | os.O_NOCTTY)
    decoder = FrameDecoder()
    poses: list[bytes] = []
    waiting: deque[int] = deque()  # bytes of each frame without an answer

    def receive() -> None:
        answers = os.read(wire, 4096)
        assert answers, f"{len(waiting)} frames are not answered"
        poses.extend(decoder.feed(answers))
        for _ in range(answers.count(0)):
            waiting.popleft()

    try:
        tty.setraw(wire)
        assert os.read(wire, 1)
        os.write(wire, b"\0")
        while (heard := os.read(wire, 1)) != b"\0":
            assert heard
        for content in contents:
            frame = encode_frame(content)
            while waiting and sum(waiting) + len(frame) > room:
                receive()
            os.write(wire, frame)
            waiting.append(len(frame))
        while waiting:
            receive()
    finally:
        os.close(wire)
    return poses


def has_sensor(content: bytes) -> bool:
    message = messages.decode(content)
    return message.name == "hello" and bool(message.fields["sample_rate"])


def replayed(contents: Sequence[bytes]) -> Iterator[bytes]:
    """The same, by the host's build of the same C."""
    replay: _core.Replay | None = None
    parts = ParamsParts()
    for content in contents:
        message = messages.decode(content)
        assert isinstance(message, Message)
        if message.name == "params":
            parts.add_part(message)
        elif replay is None and has_sensor(content):
            digest = message.fields["params_digest"]
            replay = _core.Replay(content, whole(parts, digest))
        if replay is None:
            continue
        if message.name == "raw":
            replay.step(content)
        elif message.name == "pose":
            yield replay.pose(message.sequence, message.time_us)
        elif message.fields.get("event") == "params_changed":
            replay.params(whole(parts, message.fields["detail"]))
        elif message.fields.get("event") in ("tared", "restarted"):
            change = {"tared": replay.origin, "restarted": replay.restart}
            detail = message.fields["detail"]
            assert isinstance(detail, int)
            change[str(message.fields["event"])](detail)


def whole(parts: ParamsParts, digest: Value) -> bytes:
    """The records of that digest, which was told."""
    assert isinstance(digest, int)
    records = parts.get(digest & 0xFFFFFFFF)
    assert records is not None
    return records
