# SPDX-License-Identifier: MIT
"""Faults of a program in MicroPython: its memory, its exceptions, its restarts."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from system.virtual import MICROPYTHON, Run, Stub, assert_nothing_is_lost, run

pytestmark = pytest.mark.long

CLICK = ("--press", "200000:300000")
SAMPLES = 380  # a second
LEAST = 16  # bytes that anything takes of the heap

Made = Callable[[str], Stub]


@pytest.fixture
def made(root: Path, f405: Path, micropython_image: Path, tmp_path: Path) -> Made:
    """The virtual pyboard with one of tests/micropython/mains."""

    def make(name: str) -> Stub:
        source = root / "tests" / "micropython" / "mains" / f"{name}.py"
        words = (sys.executable, "tools/micropython_build.py", source)
        subprocess.run(words, cwd=root, check=True)
        return Stub(MICROPYTHON, f405, micropython_image.with_name(name), tmp_path)

    return make


def taken(done: Run) -> list[int]:
    """Bytes of heap taken in each second of the stream, but for the first."""
    supplies = [status.fields["supply"] for status in done.named("status")]
    return [int(supply) - 1 for supply in supplies[2:] if isinstance(supply, int)]


def test_the_module_takes_no_memory_while_it_streams(made: Made) -> None:
    stub = made("memory")
    found = taken(run(stub, 6, *CLICK, *stub.raw_too))
    assert len(found) >= 3
    assert set(found) == {0}


def test_without_the_module_a_sample_takes_no_memory(made: Made) -> None:
    stub = made("memory_plain")
    found = taken(run(stub, 4.2, *CLICK))
    assert len(found) >= 2
    # The messages of a second take some, those of its samples none.
    assert max(found) < SAMPLES * LEAST / 4


def boots(done: Run) -> list[int]:
    counts = [hello.fields["boot_count"] for hello in done.named("hello")]
    return sorted({count for count in counts if isinstance(count, int)})


@pytest.mark.parametrize(
    ("name", "error"),
    [("raises", b"RuntimeError: planted"), ("interrupted", b"KeyboardInterrupt")],
)
def test_a_program_that_ends_is_told_and_starts_again_by_itself(
    made: Made, name: str, error: bytes
) -> None:
    done = run(made(name), 8)
    text = done.record.read_bytes()
    assert text.count(error) >= 2
    assert boots(done) == [1, 2, 3]
    assert done.summary["resets"] == 0
    # A listener receives every message of a start, the hello first.
    firsts = [m for m in done.messages if m.sequence == 0]
    assert [m.name for m in firsts] == ["hello"] * 3


def test_a_function_that_raises_is_told_and_the_stream_goes_on(made: Made) -> None:
    done = run(made("hook"), 6, *CLICK)
    failures = [m for m in done.named("event") if m.fields["event"] == "hook_failed"]
    assert [m.fields["detail"] for m in failures] == list(range(1, len(failures) + 1))
    assert len(failures) >= 3
    times = [pose.time_us for pose in done.named("pose")]
    assert times[-1] > 5_900_000
    assert_nothing_is_lost(done)


def test_a_battery_is_measured_and_a_low_one_told(made: Made) -> None:
    empty = {"kind": "battery", "at_us": 3_000_000, "mv": 3100}
    done = run(made("battery"), 20, "--battery", 3900, faults=[empty])
    told = [message.fields["battery"] for message in done.named("equipment")]
    assert 3850 < told[0] < 3950
    assert 3080 < told[-1] < 3150
    (low,) = [m for m in done.named("event") if m.fields["event"] == "battery_low"]
    assert 13_000_000 < low.time_us < 19_000_000
    assert done.named("equipment")[-1].fields["power"] == ("low",)


@pytest.mark.parametrize("name", ["log", "log_plain"])
def test_the_log_gets_what_the_wire_gets(made: Made, name: str) -> None:
    done = run(made(name), 4.5, *CLICK)
    assert_nothing_is_lost(done)
    assert len(done.named("raw" if name == "log_plain" else "pose")) > 200
    data = done.record.read_bytes()
    ends = {at + 1 for at, byte in enumerate(data) if byte == 0}
    told = [int(str(m.fields["supply"])) for m in done.named("status")[1:]]
    assert len(told) >= 3
    assert max(told) > 5000
    # Each is told of what was complete then: whole frames.
    assert set(told) <= ends
