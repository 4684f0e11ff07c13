# SPDX-License-Identifier: MIT
"""The benchmark of the Pico: its figures of given runs."""

from __future__ import annotations

from types import SimpleNamespace as Made
from typing import Any

import numpy as np
import pytest

from benchmarks.firmware import pico


def capture(times_s: Any) -> Any:
    return Made(feed=Made(times_s=np.asarray(times_s)))


def test_times_are_compared_with_the_edges_of_the_run_with_the_wire() -> None:
    edges_s = 0.7012 + 0.005 * np.arange(1000)
    # Another start, and every other sample 20 us late.
    late_s = edges_s[3:] + 20e-6 * (np.arange(997) % 2)
    found = pico.times_of(capture(late_s), capture(edges_s))
    assert found["rms_us"] == pytest.approx(20.0 / np.sqrt(2.0), rel=0.01)
    assert found["99_us"] == pytest.approx(20.0)


def test_cycles_are_told_of_samples_that_a_pin_shows() -> None:
    twin = Made(compared=9, differed=0)
    names = ("late", "flash", "cycles_mean", "cycles_worst", "idle", "stack_max")
    for samples in (0, 5):
        summary = dict.fromkeys(names, 0.25) | {"samples": samples}
        run: Any = Made(summary=summary, lost=1, twin=lambda: twin)
        found = pico.told(run)
        assert found["awake"] == 0.75
        assert ("cycles_mean" in found) == (samples > 0)


def test_a_pose_that_differs_from_the_hosts_is_missed() -> None:
    names = ("usb", "uart", "polled", "micropython", "micropython polled")
    found: dict[str, Any] = {
        name: {"poses": 9, "different": int(name == "uart")} for name in names
    }
    report = pico.report_of(found)
    missed = [each.name for each in report.figures if each.verdict == "MISSED"]
    assert missed == ["uart: different poses"]
    assert [*report.tables[0].rows] == [
        ("poses compared with the host's", "9", "9", "9"),
        ("different ones", "0", "1", "0"),
    ]
