# SPDX-License-Identifier: MIT
"""The virtual STM32F405 as a program: options, summary, faults, the end of a run.

Its firmware is one of the bare programs in tests/sim/f405.
"""

from __future__ import annotations

import os
import select
import signal
import struct
import subprocess
import tty
from pathlib import Path

import pytest

import bare
from programs import ran

MEGABYTE = 1 << 20


def test_bytes_and_time_are_told(tmp_path: Path) -> None:
    output = bare.run("stack", tmp_path, "--seconds", "5")
    assert output.lines == {"done": [0]}
    assert output.summary["bytes"] == len(output.data) == 14
    assert output.summary["seconds"] < 0.01
    assert output.summary["motion_start_us"] == 100_000
    assert output.summary["resets"] == 0
    assert output.summary["firmware_complaint"] is None


def test_the_deepest_stack_and_the_sizes_are_found(tmp_path: Path) -> None:
    summary = bare.run("stack", tmp_path).summary
    assert 5000 <= summary["stack_max"] <= 5100
    assert 1000 <= summary["ram"] <= 2000  # 250 words and the vector table
    assert 500 < summary["flash"] < 2000


def test_runs_are_the_same_byte_for_byte(tmp_path: Path) -> None:
    more = ("--seconds", "2", "--seed", "7", "--send", "20000:48656c6c6f")
    more += tuple(bare.faults(tmp_path, {"kind": "brown_out", "at_us": 150_000}))
    first, second = (bare.run("usart", tmp_path, *more) for _ in range(2))
    assert first == second
    assert first.summary["resets"] == 1


def test_an_access_to_what_is_not_modelled_ends_the_run(tmp_path: Path) -> None:
    output = bare.run("unmodelled", tmp_path)
    assert output.lines == {"before": [1]}
    assert output.summary["crashed"] is True
    assert 0x08000000 < output.summary["crash_pc"] < 0x08001000
    assert "reads 0x40006404, which is not modelled" in output.errors


def test_marked_work_is_measured_to_the_cycle(tmp_path: Path) -> None:
    summary = bare.run("pins", tmp_path).summary
    # 100 loops of two instructions, the one before them, and the two stores.
    assert summary["samples"] == 5
    assert summary["cycles_mean"] == summary["cycles_worst"] == 203


# What survives power


def test_flash_is_kept_and_the_image_put_over_it(tmp_path: Path) -> None:
    flash = tmp_path / "flash"
    more = ("--eeprom", str(flash))
    assert bare.ended("settings", tmp_path, *more) == {"done": [4]}
    first = flash.read_bytes()
    assert len(first) == MEGABYTE
    words = struct.unpack_from("<5I", first, 0xC0000)
    assert words == (0x12340000, 0x12340001, 0x12340002, 0x12340003, 0xFFFFFFFF)
    lines = bare.ended("settings", tmp_path, *more)
    assert lines["word"] == [0x12340000 + i for i in range(4)]
    assert lines["done"] == [8]
    assert flash.read_bytes()[:0xC0000] == first[:0xC0000]


def settings_after_cut(folder: Path, write: int, after_us: int, *more: str) -> bytes:
    cut = {"kind": "power_cut", "write": write, "after_us": after_us}
    flash = folder / "flash"
    output = bare.run(
        "settings",
        folder,
        *("--eeprom", str(flash), *more, *bare.faults(folder, cut)),
        code=0,
    )
    assert output.summary["power_cut"] is True
    assert output.summary["eeprom_writes"] == write
    return flash.read_bytes()[0xC0000:0xE0000]


@pytest.mark.parametrize("write", [1, 2, 3, 4])
def test_a_word_that_power_left_is_torn(tmp_path: Path, write: int) -> None:
    sector = settings_after_cut(tmp_path, write, 9)
    words = struct.unpack_from("<4I", sector)
    torn, meant = words[write - 1], 0x12340000 + write - 1
    assert words[: write - 1] == tuple(0x12340000 + i for i in range(write - 1))
    assert torn & meant == meant  # some bits are still 1
    assert torn not in (meant, 0xFFFFFFFF)
    assert words[write:] == (0xFFFFFFFF,) * (4 - write)


def test_an_erase_that_power_left_is_half_done(tmp_path: Path) -> None:
    # The firmware erases a sector of zeros, which takes a second.
    (tmp_path / "flash").write_bytes(bytes(MEGABYTE))
    press = ("--press", "0:3000000")
    sector = settings_after_cut(tmp_path, 1, 500_000, *press)
    ones = sum(byte.bit_count() for byte in sector)
    assert 0.49 < ones / (8 * len(sector)) < 0.51
    assert 0.05 < sum(byte == 0 for byte in sector) * 256 / len(sector) < 20


def test_a_reset_leaves_its_cause(tmp_path: Path) -> None:
    faults = bare.faults(
        tmp_path,
        {"kind": "reset", "at_us": 400_000},
        {"kind": "brown_out", "at_us": 800_000},
    )
    lines = bare.run("reset", tmp_path, "--seconds", "0.9", *faults, code=0).lines
    # Power-on, software, watchdog, pin. Brown-out, which loses RAM; software again.
    assert lines["cause"] == [0x0E, 0x14, 0x24, 0x04, 0x06, 0x14]
    assert lines["count"] == [1, 2, 3, 4, 1, 2]
    assert lines["cleared"] == [0] * 6
    # The watchdog is fed after 60 ms and resets 100 ms later.
    assert 155_000 < lines["us"][0] < max(lines["us"][:8]) < 160_000


# The wire


def test_bytes_go_both_ways_over_the_pty(tmp_path: Path) -> None:
    link, summary = tmp_path / "wire", tmp_path / "summary.json"
    process = subprocess.Popen(
        [
            *(bare.emulator(), "--image", bare.image("echo"), "--fast"),
            *("--pty", link, "--summary", summary),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr.readline() == f"ready {link}\n"
        wire = os.open(link, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(wire)
        for start in range(0, 2000, 200):
            sent = bytes((start + i) % 256 for i in range(200))
            assert os.write(wire, sent) == 200
            assert read(wire, 200) == sent
        os.close(wire)
        process.send_signal(signal.SIGTERM)
        assert process.wait() == 0
    finally:
        process.kill()
        process.communicate()


def read(wire: int, length: int) -> bytes:
    data = b""
    while len(data) < length and select.select([wire], [], [], 20)[0]:
        data += os.read(wire, length - len(data))
    return data


# Mistakes


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "--image is missing"),
        (["--image", "x", "--pty", "a", "--record", "b"], "exclude each other"),
        (["--image", "/nowhere"], "is no image of an STM32F405"),
        (["--image", "/bin/true"], "is no image of an STM32F405"),
        (["--image", "{image}", "--eeprom", "{image}"], "is no flash of 1048576"),
        (["--image", "{image}", "--self-test", "2"], "is no option"),
        (["--image", "{image}", "--crystal", "3.9"], "takes megahertz, 4 to 26"),
        (["--image", "{image}", "--crystal", "12 MHz"], "takes megahertz, 4 to 26"),
        (["--image", "{image}", "--hsi", "nan"], "takes megahertz, 14.5 to 17"),
        (["--image", "{image}", "--faults", "{faults}"], "die is neither 1 nor 2"),
    ],
)
def test_a_mistake_is_told_in_a_line(
    tmp_path: Path, arguments: list[str], expected: str
) -> None:
    image = bare.image("stack")
    path = tmp_path / "faults.json"
    path.write_text('[{"kind": "nack", "die": 3}]')
    given = [text.format(image=image, faults=path) for text in arguments]
    done = ran(bare.emulator(), *given)
    assert done.returncode == 2
    assert done.stderr.startswith("f405: ")
    assert expected in done.stderr.splitlines()[0]


@pytest.mark.parametrize("kind", ["crystal", "glitch"])
def test_a_nano_has_no_such_faults(tmp_path: Path, kind: str) -> None:
    bare.emulator()
    nano = bare.ROOT / "build" / "sim" / "nano"
    faults = bare.faults(tmp_path, {"kind": kind})
    done = ran(nano, "--image", "x", *faults)
    assert done.returncode == 2
    assert f"no such kind of fault: {kind}" in done.stderr
