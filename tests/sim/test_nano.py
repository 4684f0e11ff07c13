# SPDX-License-Identifier: MIT
"""The virtual Nano as a program: its wire, files, faults and summary.

The firmware is tests/sim/desk.c; the real image has its own tests.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import struct
import subprocess
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import images
import native

ROOT = Path(__file__).resolve().parents[2]
NANO = ROOT / "build" / "sim" / "nano"
EEPROM, WILD, DEEP, ASLEEP, WORK, FLOOD, SAMPLES, TOO_MUCH = range(0xE0, 0xE8)
BOOT = b"R\x01\x00"  # power-on


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    images.emulators()
    image = tmp_path_factory.mktemp("desk") / "desk.elf"
    source = Path(__file__).with_name("desk.c")
    flags = ("-std=gnu11", "-mmcu=atmega328p", "-Os", *native.WARNINGS)
    subprocess.run(["avr-gcc", *flags, "-o", image, source], check=True)
    return image


def run(desk: Path, tmp_path: Path, *more: str, code: int = 0) -> tuple[bytes, Any]:
    """The bytes that left the UART, and the summary."""
    record, summary = tmp_path / "bytes", tmp_path / "summary.json"
    done = subprocess.run(
        [NANO, "--image", desk, "--record", record, "--summary", summary, *more],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == code, done.stderr
    return record.read_bytes(), json.loads(summary.read_text())


def faults(tmp_path: Path, *items: dict[str, Any]) -> str:
    path = tmp_path / "faults.json"
    path.write_text(json.dumps(items))
    return str(path)


# A run


def test_bytes_come_back_and_time_is_kept(desk: Path, tmp_path: Path) -> None:
    data, summary = run(
        desk, tmp_path, "--seconds", "0.5", "--send", "100000:48656c6c6f00"
    )
    assert data == BOOT + b"Hello\x00"
    assert summary["frames"] == 2
    assert summary["bytes"] == len(data)
    assert summary["seconds"] == pytest.approx(0.5, abs=1e-5)
    assert summary["motion_start_us"] == 100_000
    assert summary["crashed"] is False
    assert summary["resets"] == 0


def test_the_button_is_down_when_told(desk: Path, tmp_path: Path) -> None:
    data, _ = run(
        desk,
        tmp_path,
        *("--seconds", "1", "--press", "100000:200000", "--press", "300000:300050"),
        *("--send", "150000:31", "--send", "250000:32"),
    )
    assert data == BOOT + b"D1U2DU"


def test_marked_work_is_measured_to_the_cycle(desk: Path, tmp_path: Path) -> None:
    _, summary = run(
        desk, tmp_path, "--seconds", "0.2", "--send", f"1000:{WORK:x}{WORK:x}"
    )
    assert summary["samples"] == 2
    assert summary["cycles_mean"] == 1000
    assert summary["cycles_worst"] == 1000


def test_work_that_fits_is_never_late(desk: Path, tmp_path: Path) -> None:
    _, summary = run(desk, tmp_path, "--seconds", "1", "--send", f"200000:{SAMPLES:x}")
    assert summary["samples"] == 100
    assert summary["data_ready"] in (100, 101)
    assert summary["late"] == 0
    assert summary["cycles_mean"] == pytest.approx(40_000, abs=8)
    assert summary["sensor_complaint"] is None


def test_work_that_does_not_fit_is_late(desk: Path, tmp_path: Path) -> None:
    _, summary = run(desk, tmp_path, "--seconds", "2", "--send", f"200000:{TOO_MUCH:x}")
    assert summary["samples"] == 100
    # 5.5 ms of work and 0.5 ms of burst: of six edges in 30 ms five are served.
    assert summary["data_ready"] >= 115
    missed = summary["data_ready"] - summary["samples"]
    # Each edge without work counts, and so does the sample that ran over it.
    assert missed - 1 <= summary["late"] <= 2 * missed + 1


def test_the_deepest_stack_is_found(desk: Path, tmp_path: Path) -> None:
    _, shallow = run(desk, tmp_path, "--seconds", "0.1")
    _, deep = run(desk, tmp_path, "--seconds", "0.1", "--send", f"1000:{DEEP:x}")
    assert 0 < shallow["stack_max"] < 30
    assert 300 <= deep["stack_max"] <= 340


def test_a_crash_ends_the_run_with_its_place(desk: Path, tmp_path: Path) -> None:
    _, summary = run(
        desk, tmp_path, "--seconds", "9", "--send", f"1000:{WILD:x}", code=1
    )
    assert summary["crashed"] is True
    assert summary["seconds"] < 0.1
    assert 0 < summary["crash_pc"] < 2000
    assert 0x800 < summary["crash_sp"] <= 0x8FF


def test_sleep_with_interrupts_off_is_a_crash(desk: Path, tmp_path: Path) -> None:
    _, summary = run(
        desk, tmp_path, "--seconds", "9", "--send", f"1000:{ASLEEP:x}", code=1
    )
    assert summary["crashed"] is True


def test_runs_are_the_same_byte_for_byte(desk: Path, tmp_path: Path) -> None:
    more = ("--seconds", "2", "--send", f"1000:{FLOOD:x}", "--press", "50000:90000")
    assert run(desk, tmp_path, *more) == run(desk, tmp_path, *more)


# EEPROM and power


def test_eeprom_starts_erased_and_is_kept(desk: Path, tmp_path: Path) -> None:
    eeprom = tmp_path / "eeprom"
    run(desk, tmp_path, "--seconds", "0.05", "--eeprom", str(eeprom))
    assert eeprom.read_bytes() == b"\xff" * 1024
    more = ("--seconds", "0.1", "--eeprom", str(eeprom))
    _, summary = run(desk, tmp_path, *more, "--send", f"1000:{EEPROM:x}")
    assert eeprom.read_bytes()[6:14] == bytes.fromhex("ffffa0a1a2a3ffff")
    assert summary["eeprom_writes"] == 4
    run(desk, tmp_path, *more)
    assert eeprom.read_bytes()[6:14] == bytes.fromhex("ffffa0a1a2a3ffff")


@pytest.mark.parametrize("write", [1, 2, 3, 4])
def test_power_can_be_cut_at_each_write(desk: Path, tmp_path: Path, write: int) -> None:
    eeprom = tmp_path / "eeprom"
    cut = {"kind": "power_cut", "write": write, "after_us": 2600}
    _, summary = run(
        desk,
        tmp_path,
        *("--seconds", "1", "--eeprom", str(eeprom), "--send", f"1000:{EEPROM:x}"),
        *("--faults", faults(tmp_path, cut)),
    )
    cells = eeprom.read_bytes()[8:12]
    whole = bytes(range(0xA0, 0xA4))
    assert summary["power_cut"] is True
    assert summary["eeprom_writes"] == write
    assert cells[: write - 1] == whole[: write - 1]
    assert cells[write - 1] & whole[write - 1] == whole[write - 1]
    assert cells[write - 1] != whole[write - 1]
    assert cells[write:] == b"\xff" * (4 - write)


def test_resets_leave_their_cause(desk: Path, tmp_path: Path) -> None:
    data, summary = run(
        desk,
        tmp_path,
        *("--seconds", "0.3", "--faults"),
        faults(
            tmp_path,
            {"kind": "reset", "at_us": 100_000},
            {"kind": "brown_out", "at_us": 200_000},
        ),
    )
    assert data == BOOT + b"R\x02\x00R\x04\x00"
    assert summary["resets"] == 2


# The wire


@contextlib.contextmanager
def on_the_wire(
    desk: Path, tmp_path: Path, *more: str
) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    link = tmp_path / "wire"
    summary = tmp_path / "summary.json"
    process = subprocess.Popen(
        [NANO, "--image", desk, "--pty", link, "--summary", summary, *more],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        assert process.stderr.readline() == f"ready {link}\n"
        yield process, link
    finally:
        process.kill()
        process.communicate()


def open_wire(link: Path) -> int:
    wire = os.open(link, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(wire)
    return wire


def read_past(wire: int, mark: bytes) -> None:
    """Read up to a byte: the firmware's first words may or may not be heard."""
    while (byte := read(wire, 1)) != mark:
        assert byte, "nothing more comes"


def read(wire: int, length: int) -> bytes:
    data = b""
    while len(data) < length and select.select([wire], [], [], 20)[0]:
        data += os.read(wire, length - len(data))
    return data


def stop(process: subprocess.Popen[str], tmp_path: Path) -> Any:
    process.send_signal(signal.SIGTERM)
    assert process.wait(20) == 0
    return json.loads((tmp_path / "summary.json").read_text())


@pytest.mark.parametrize("pace", [[], ["--fast"]])
def test_bytes_go_both_ways_over_the_pty(
    desk: Path, tmp_path: Path, pace: list[str]
) -> None:
    with on_the_wire(desk, tmp_path, *pace) as (process, link):
        wire = open_wire(link)
        os.write(wire, b"?")
        read_past(wire, b"?")
        for start in range(0, 3000, 300):
            sent = bytes((start + i) % 224 for i in range(300))
            assert os.write(wire, sent) == 300
            assert read(wire, 300) == sent
        os.close(wire)
        summary = stop(process, tmp_path)
    assert summary["uart_overruns"] == 0
    assert summary["uart_dropped"] == 0
    assert not link.is_symlink()


def test_a_flood_faster_than_time_loses_nothing(desk: Path, tmp_path: Path) -> None:
    with on_the_wire(desk, tmp_path, "--fast") as (process, link):
        wire = open_wire(link)
        os.write(wire, b"?")
        read_past(wire, b"?")
        os.write(wire, bytes([FLOOD]))
        data = read(wire, 60_000)
        os.close(wire)
        summary = stop(process, tmp_path)
    assert data == bytes(i % 251 + 1 for i in range(60_000))
    assert summary["uart_dropped"] == 0


def test_what_nobody_hears_is_gone_and_counted(desk: Path, tmp_path: Path) -> None:
    with on_the_wire(desk, tmp_path, "--fast") as (process, link):
        for _ in range(2):
            wire = open_wire(link)
            os.write(wire, b"?")
            read_past(wire, b"?")
            os.write(wire, bytes([FLOOD]))
            assert read(wire, 1)  # the flood has begun
            os.close(wire)
            wire = open_wire(link)
            read_past(wire, b"\x00")  # it is over
            os.close(wire)
        summary = stop(process, tmp_path)
    assert summary["uart_unheard"] > 0
    assert summary["bytes"] == len(BOOT) + 2 * (1 + 60_001)


def test_a_writer_that_closes_at_once_is_heard(desk: Path, tmp_path: Path) -> None:
    with on_the_wire(desk, tmp_path) as (process, link):
        link.write_bytes(bytes([EEPROM]) + b"!")
        wire = open_wire(link)
        read_past(wire, b"!")  # comes back once the EEPROM is written, after 14 ms
        os.close(wire)
        summary = stop(process, tmp_path)
    assert summary["eeprom_writes"] == 4


def test_a_stale_link_is_replaced_and_a_file_of_others_is_kept(
    desk: Path, tmp_path: Path
) -> None:
    link = tmp_path / "wire"
    link.symlink_to("/nowhere")
    with on_the_wire(desk, tmp_path) as (process, _):
        assert str(link.readlink()).startswith("/dev/pts/")
        link.unlink()
        link.write_text("somebody else's")
        stop(process, tmp_path)
    assert link.read_text() == "somebody else's"


# Mistakes


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "--image is missing"),
        (["--image"], "value is missing"),
        (["--image", "x", "--pty", "a", "--record", "b"], "exclude each other"),
        (["--image", "/nowhere"], "is no image"),
        (["--image", "/bin/true"], "is no image"),
        (["--image", "{desk}", "--press", "5:5"], "START_US:END_US"),
        (["--image", "{desk}", "--send", "5:123"], "TIME_US:HEXBYTES"),
        (["--image", "{desk}", "--seconds", "soon"], "takes a number"),
        (["--image", "{desk}", "--motion", "/dev/null"], "is no motion stream"),
        (["--image", "{desk}", "--eeprom", "{desk}"], "is no EEPROM"),
        (["--image", "{desk}", "--wings", "2"], "is no option"),
        (["--self-test", "--fast"], "does not go with"),
    ],
)
def test_a_mistake_is_told_in_a_line(
    desk: Path, arguments: list[str], says: str
) -> None:
    given = [argument.format(desk=desk) for argument in arguments]
    done = subprocess.run(
        [NANO, *given], capture_output=True, text=True, check=False, timeout=20
    )
    assert done.returncode == 2
    assert done.stderr.startswith("nano: ")
    assert says in done.stderr.splitlines()[0]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{}", "list in brackets"),
        ('[{"at_us": 5}]', "has no kind"),
        ('[{"kind": "rain"}]', "no such kind of fault: rain"),
        ('[{"kind": "nack", "color": 5}]', "no such key: color"),
        ('[{"kind": "nack", "at_us": -5}]', "at_us is no whole number"),
        ('[{"kind": "nack", "byte": 300}]', "byte is above 255"),
        ('[{"kind": "nack"}', "comma or bracket"),
        ('[{"kind": "nack"} {"kind": "nack"}]', "comma or bracket"),
    ],
)
def test_a_mistake_in_the_faults_is_named(
    desk: Path, tmp_path: Path, text: str, says: str
) -> None:
    path = tmp_path / "faults.json"
    path.write_text(text)
    done = subprocess.run(
        [NANO, "--image", desk, "--faults", path],
        capture_output=True,
        text=True,
        check=False,
        timeout=20,
    )
    assert done.returncode == 2
    assert says in done.stderr


# Motion


ffi, lib = native.load(
    extra_sources=["sim/motion.c"],
    extra_headers=["sim/chips/mpu9250.h", "sim/motion.h"],
    core=False,
)


def stream(rate_hz: float, count: int, records: list[list[float]]) -> bytes:
    head = b"IMUMOT1\x00" + struct.pack("<dQQ", rate_hz, count, 0)
    return head + b"".join(struct.pack("<9f", *record) for record in records)


@pytest.fixture
def ramp(tmp_path: Path) -> Iterator[Any]:
    """100 Hz; axis a of record i is i * (a + 1), with a corner at record 50."""
    records = [
        [min(i, 100 - i) * (axis + 1.0) for axis in range(9)] for i in range(101)
    ]
    path = tmp_path / "motion"
    path.write_bytes(stream(100.0, 0, records))
    motion = ffi.new("struct motion *")
    assert lib.motion_open(motion, str(path).encode()) == ffi.NULL
    yield motion
    lib.motion_close(motion)


def mean(motion: Any, quantity: int, start_ms: float, end_ms: float) -> list[float]:
    out = ffi.new("double[3]")
    lib.motion_mean(motion, quantity, round(start_ms * 1e6), round(end_ms * 1e6), out)
    return list(out)


def test_before_its_start_a_motion_stands(ramp: Any) -> None:
    assert mean(ramp, 0, 0, 500) == [0, 0, 0]
    lib.motion_begin(ramp, 1_000_000_000)
    assert mean(ramp, 0, 900, 1000) == [0, 0, 0]


def test_means_over_a_motion_are_exact(ramp: Any) -> None:
    lib.motion_begin(ramp, 0)
    assert mean(ramp, 0, 100, 100) == pytest.approx([10, 20, 30])
    assert mean(ramp, 1, 103, 103) == pytest.approx([41.2, 51.5, 61.8])
    assert mean(ramp, 0, 101, 117)[0] == pytest.approx(10.9)
    # Over the corner at 500 ms: two triangles.
    assert mean(ramp, 0, 497, 506)[0] == pytest.approx(50 - (9 + 36) / 2 / 9 / 10)
    assert mean(ramp, 0, -30, 10)[0] == pytest.approx(0.5 / 4)


def test_after_its_end_a_motion_stands(ramp: Any) -> None:
    lib.motion_begin(ramp, 0)
    assert not lib.motion_is_over(ramp, 999_000_000)
    assert lib.motion_is_over(ramp, 1_000_000_000)
    assert mean(ramp, 2, 1000, 5000) == pytest.approx([0, 0, 0])


def test_a_run_ends_with_its_motion(desk: Path, tmp_path: Path) -> None:
    path = tmp_path / "motion"
    path.write_bytes(stream(50.0, 26, [[0, 0, 0, 0, 0, 9.81, 0, 20, -40]] * 40))
    _, summary = run(desk, tmp_path, "--motion", str(path))
    # 100 ms, 25 intervals of 20 ms, and 20 ms for the last bytes to leave.
    assert summary["seconds"] == pytest.approx(0.62, abs=0.0011)
    _, summary = run(desk, tmp_path, "--motion", str(path), "--seconds", "1.5")
    assert summary["seconds"] == pytest.approx(1.5, abs=1e-5)


def test_a_motion_can_come_through_a_pipe(desk: Path, tmp_path: Path) -> None:
    records = stream(50.0, 0, [[0.0] * 9] * 26)
    summary = tmp_path / "summary.json"
    subprocess.run(
        [NANO, "--image", desk, "--motion", "-", "--summary", summary],
        input=records,
        capture_output=True,
        check=True,
        timeout=20,
    )
    seconds = json.loads(summary.read_text())["seconds"]
    assert seconds == pytest.approx(0.62, abs=0.0011)
