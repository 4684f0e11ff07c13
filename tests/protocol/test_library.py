# SPDX-License-Identifier: MIT
"""libimuprobe: the same vectors as the firmware's C, and its account of a port."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import native
from fakes import EXAMPLES
from imud.wire.frame import encode_frame
from imud.wire.messages import encode
from imud.wire.schema import FINGERPRINT
from protocol import wire
from protocol.wire import ROOT, SCHEMA, VECTORS, as_bytes_hex, fields_of, unhex

M0PLUS = ("-mcpu=cortex-m0plus", "-mthumb")
FROM_PROBES = [m["name"] for m in SCHEMA["message"] if m["direction"] == "probe"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("libimuprobe")
    program = ROOT / "protocol" / "generate.py"
    subprocess.run([sys.executable, program, "--library", made], check=True)
    return made


@pytest.fixture(scope="module")
def library(folder: Path) -> tuple[Any, Any]:
    return native.load([folder / "imuprobe.c"], [folder / "imuprobe.h"])


class Reader:
    def __init__(self, library: tuple[Any, Any]) -> None:
        self.ffi, self.lib = library
        self.c = self.ffi.new("struct imuprobe_reader *")
        self.message = self.ffi.new("struct imuprobe_message *")
        self.lib.imuprobe_begin(self.c)

    def feed(self, data: bytes) -> Iterator[int]:
        """What comes of each byte that ends something."""
        for byte in data:
            got = self.lib.imuprobe_read(self.c, byte, self.message)
            if got != self.lib.IMUPROBE_NOTHING:
                yield got

    def last(self, data: bytes) -> int:
        """What comes of a frame; 0: nothing."""
        return [0, *self.feed(data)][-1]

    @property
    def account(self) -> tuple[int, ...]:
        """Messages, lost, corrupt, late, restarts."""
        c = self.c
        return (c.messages, c.lost, c.corrupt, c.late, c.restarts)


def framed(name: str, number: int, **fields: object) -> bytes:
    return encode_frame(encode(name, EXAMPLES[name] | fields, number, 1000 * number))


@pytest.fixture
def reader(library: tuple[Any, Any]) -> Reader:
    """One that has heard the first hello of a probe."""
    reader = Reader(library)
    assert reader.last(framed("pose", 0)) == 0  # nobody knows its schema yet
    assert reader.last(framed("hello", 0, boot_count=7)) == 1
    return reader


@pytest.mark.parametrize(
    "vector",
    [v for v in VECTORS["good"] if v["message"] in FROM_PROBES and not v.get("grown")],
    ids=lambda vector: str(vector["name"]),
)
def test_a_message_is_the_vectors(reader: Reader, vector: dict[str, Any]) -> None:
    content = unhex(vector["content"])
    name, fields = vector["message"], vector["fields"]
    if name == "hello" and fields["schema_fingerprint"] != FINGERPRINT:
        assert reader.last(encode_frame(content)) == reader.lib.IMUPROBE_OTHER_SCHEMA
        assert reader.c.schema == fields["schema_fingerprint"]
        return
    reader.c.next = vector["sequence"]
    assert reader.last(encode_frame(content)) == reader.lib.IMUPROBE_MESSAGE
    header = reader.message.header
    found = (header.id, header.sequence, header.time_us)
    assert found == (wire.IDS[name], vector["sequence"], vector["time_us"])
    read = fields_of(name, getattr(reader.message, name))
    assert as_bytes_hex(read, fields) == fields


@pytest.mark.parametrize(
    "vector",
    [v for v in VECTORS["skew"] if v["message"] in FROM_PROBES],
    ids=lambda vector: str(vector["name"]),
)
def test_what_is_no_message_is_corrupt(reader: Reader, vector: dict[str, Any]) -> None:
    got = reader.last(encode_frame(unhex(vector["content"])))
    assert got == reader.lib.IMUPROBE_CORRUPT
    assert reader.account == (1, 0, 1, 0, 0)


def test_gaps_repetitions_and_restarts_are_counted(reader: Reader) -> None:
    lib = reader.lib
    for number, got in (
        (1, lib.IMUPROBE_MESSAGE),
        (4, lib.IMUPROBE_MESSAGE),
        (4, lib.IMUPROBE_LATE),
        (3, lib.IMUPROBE_LATE),
        (5, lib.IMUPROBE_MESSAGE),
    ):
        assert reader.last(framed("pose", number)) == got
    assert reader.account == (4, 2, 0, 2, 0)
    # Its first hello was lost.
    assert reader.last(framed("pose", 2)) == lib.IMUPROBE_LATE
    assert reader.last(framed("hello", 3, boot_count=8)) == lib.IMUPROBE_MESSAGE
    assert reader.last(framed("pose", 4)) == lib.IMUPROBE_MESSAGE
    assert reader.account == (6, 2, 0, 3, 1)


def test_one_damaged_number_is_not_believed_but_a_long_gap_is(reader: Reader) -> None:
    lib = reader.lib
    assert reader.last(framed("pose", 2**31)) == lib.IMUPROBE_CORRUPT
    assert reader.last(framed("pose", 1)) == lib.IMUPROBE_MESSAGE
    assert reader.last(framed("pose", 90_000)) == lib.IMUPROBE_CORRUPT
    assert reader.last(framed("pose", 90_001)) == lib.IMUPROBE_MESSAGE
    assert reader.account == (3, 89_999, 2, 0, 0)


def test_any_noise_leaves_a_reader_that_reads_on(reader: Reader) -> None:
    noise = random.Random(3)  # noqa: S311 - no secret
    good = b"".join(framed("pose", number) for number in range(1, 40))
    for _ in range(200):
        data = bytearray(good[: noise.randrange(len(good))])
        for _ in range(noise.randrange(8)):
            data[noise.randrange(len(data) or 1) : 0] = noise.randbytes(3)
        list(reader.feed(bytes(data) + noise.randbytes(noise.randrange(200))))
    list(reader.feed(b"\0" + framed("hello", 0, boot_count=9)))
    assert reader.last(framed("pose", 1)) == reader.lib.IMUPROBE_MESSAGE


def test_a_probe_understands_its_commands(reader: Reader) -> None:
    lib, size = reader.lib, reader.lib.IMUPROBE_COMMAND_MAX
    frame = reader.ffi.new("uint8_t[]", size)
    length = lib.imuprobe_command(
        reader.c, lib.IMUPROBE_COMMAND_START, -5, 2**31 - 1, frame
    )
    assert length <= size
    (content,) = wire.Decoder(FINGERPRINT & 0xFFFF).feed(bytes(frame)[:length])
    assert isinstance(content, bytes)
    result, _, fields = wire.decode_message("command", content)
    assert result == "ok"
    assert fields["token"] == reader.c.commands == 1
    assert fields["arguments"] == [-5, 2**31 - 1]


def test_the_example_starts_a_probe_and_prints_its_poses(folder: Path) -> None:
    examples = ROOT / "examples" / "libimuprobe"
    program = folder / "posix"
    words = ["gcc", "-std=gnu11", "-Wall", "-Wextra", "-Werror", f"-I{folder}"]
    words += [str(examples / "posix.c"), str(folder / "imuprobe.c"), "-o", str(program)]
    subprocess.run(words, check=True)
    ours, theirs = os.openpty()
    tty.setraw(theirs)  # before the first byte
    with subprocess.Popen(
        [program, os.ttyname(theirs)], stdout=subprocess.PIPE, text=True
    ) as example:
        assert example.stdout is not None
        os.write(ours, framed("hello", 0))
        assert example.stdout.readline().startswith("probe, firmware ")
        decoder = wire.Decoder(FINGERPRINT & 0xFFFF)
        found: list[bytes | str] = []
        while not found:
            found = decoder.feed(os.read(ours, 64))
        assert isinstance(found[0], bytes)
        _, _, command = wire.decode_message("command", found[0])
        os.write(ours, framed("pose", 3) + framed("hello", 4))
        pose, hello = example.stdout.readline(), example.stdout.readline()
        os.close(ours)
        os.close(theirs)
        assert example.wait() == 0
    assert command["command"] == 1
    assert pose.split()[:2] == ["0.003000", "s"]
    assert hello.endswith(": 3 messages, 2 lost, 0 corrupt\n")


def test_the_library_is_cxx_too_and_small(folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "reads.cpp"
    source.write_text('#include "imuprobe.h"\nstruct imuprobe_reader reader;\n')
    words = ["arm-none-eabi-g++", "-Wall", "-Werror", "-fsyntax-only"]
    subprocess.run([*words, f"-I{folder}", str(source)], check=True)
    for compiler, options, size, most in (
        ("avr", ("-mmcu=atmega2560", "-std=gnu11"), "avr-size", 3000),
        ("arm-none-eabi", M0PLUS, "arm-none-eabi-size", 2000),
    ):
        made = tmp_path / f"{compiler}.o"
        words = [f"{compiler}-gcc", *options, "-Os", "-c", str(folder / "imuprobe.c")]
        subprocess.run([*words, "-o", str(made)], check=True)
        told = subprocess.check_output([size, str(made)], text=True).splitlines()[1]
        assert int(told.split()[0]) <= most
