# SPDX-License-Identifier: MIT
"""A virtual probe whose clock is wrong, through the daemon: when its samples were.

The daemon's clock is the emulator's time: where a busy machine holds up the emulator,
both stand still together. benchmarks/host/faults.py shows the figures of each run.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from fakes import PATIENCE_S, DaemonProcess
from imud.client import Client
from length import choose
from system.live import LiveProbe, hear, take
from system.test_chain import drained
from system.virtual import BOARDS, Stub

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

PPM, DRIFT_PPM_S = 200.0, 1.0
LINKS = {
    "a wire": (),
    "16 ms batches and bursts of 100 ms": ("--batch-ms", 16, "--burst-ms", 100),
}

# UTC less the emulator's time.
UTC_NS = 1_700_000_000 * 10**9

# A daemon whose clocks are the file of the emulator's --now. They have to be so before
# anything else of imud is loaded.
FOLLOWER = f"""
import mmap, sys, time
from pathlib import Path
from imud.probes import timeline

with Path(sys.argv.pop(1)).open("rb") as file:
    now = memoryview(mmap.mmap(file.fileno(), 8, prot=mmap.PROT_READ)).cast("q")
timeline.host_ns = lambda: now[0]
time.time_ns = lambda: now[0] + {UTC_NS}

from imud.cli import program

sys.argv[0] = "imud"
program()
"""


def figures(error_us: Array, bound_us: Array, later: Flags) -> dict[str, float]:
    """Errors and bounds after 10 s, and of all poses those whose bound holds."""
    off_us, bounded = np.abs(error_us), np.isfinite(bound_us)
    p50, p99 = np.percentile(off_us[later], [50, 99])
    return {
        "error_median_us": p50,
        "error_p99_us": p99,
        "error_max_us": off_us[later].max(),
        "bound_median_us": float(np.median(bound_us[later])),
        "bound_max_us": bound_us[later].max(),
        "bound_holds": float(np.mean(off_us[bounded] <= bound_us[bounded])),
    }


@dataclass
class Run:
    """A daemon's records of a probe for some seconds, and the emulator's truth."""

    poses: list[dict[str, Any]]
    status: dict[str, Any]
    summary: dict[str, Any]


def run(stub: Stub, link: tuple[object, ...]) -> Run:
    clock_error = ("--clock-ppm", PPM, "--clock-drift", DRIFT_PPM_S)
    now = stub.folder / "now"
    press = ("--press", "300000:500000")
    probe = LiveProbe(stub, "--now", now, *press, *link, *clock_error)
    script = stub.folder / "follower.py"
    script.write_text(FOLLOWER)
    program = (str(script), str(now))
    with DaemonProcess(probe.port, directory=stub.folder, program=program) as daemon:
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:
            client.wait_for(seconds=PATIENCE_S)
            poses = hear(client, "pose")
            got = take(poses, POSES)
            got += list(drained(poses))
            (status,) = client.statuses()
        summary = probe.end()
        daemon.stop()
    return Run(got, status, summary)


POSES = choose(everyday=1500, long=2000)  # 100 a second

# Each board and each link; `make test-long` has them in all pairs.
PAIRS = [*zip(("nano", "f405"), LINKS, strict=True)]
ALL_PAIRS = [*itertools.product(BOARDS, LINKS)]


@pytest.mark.sampled(2)
@pytest.mark.long
@pytest.mark.parametrize(
    ("stub", "link"), choose(everyday=PAIRS, long=ALL_PAIRS), indirect=["stub"]
)
def test_samples_are_timed_to_a_millisecond(
    stub: Stub, link: str, record_property: Callable[[str, object], None]
) -> None:
    done = run(stub, LINKS[link])
    got, summary, status = done.poses, done.summary, done.status
    device_ns = np.array([1000.0 * pose["t_device_us"] for pose in got])
    run_ns = summary["clock_start_ns"] + device_ns
    fast_ppm = PPM + DRIFT_PPM_S / 2 * run_ns * 1e-9
    begin_ns = UTC_NS + summary["power_ns"]
    true_ns = run_ns - run_ns * fast_ppm * 1e-6
    error_us = np.array([p["t_ns"] - begin_ns for p in got]) / 1e3 - true_ns / 1e3
    later = device_ns - device_ns[0] > 10e9
    bound_us = np.array([pose["t_bound_us"] or np.inf for pose in got])
    for name, value in figures(error_us, bound_us, later).items():
        record_property(name, float(value))
    assert np.abs(error_us[later]).max() < 1000.0
    assert np.mean(np.abs(error_us) <= bound_us) > 0.99
    assert bound_us[later].max() < 6000.0
    assert np.all(np.diff([pose["t_ns"] for pose in got]) > 0)
    clock = status["clock"]
    assert clock["exchanges"] > POSES // 100
    assert clock["restarts"] == 0
    assert clock["skew_ppm"] == pytest.approx(PPM + POSES / 100 * DRIFT_PPM_S, abs=100)
