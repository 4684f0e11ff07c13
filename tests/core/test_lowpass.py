# SPDX-License-Identifier: MIT
"""The low-pass in 16 bits beside that in 32."""

from __future__ import annotations

import numpy as np
import pytest

from core.desk import ffi, lib

STEPS = 2**14  # of a row of 1


def outputs(inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Levels in 16 bits and in 32, both in steps of 16 bits."""
    short, axis = ffi.new("struct lowpass_short *"), ffi.new("int32_t[2]")
    gain = ffi.new("struct lowpass_gain *", lib.fuse_level_gain)
    found = []
    for count, value in enumerate(inputs.tolist(), 1):
        lib.lowpass_short_step(short, [value, 0, 0, 0, 0, -value], min(count, 255))
        lib.lowpass_axis_step(axis, axis + 1, gain, min(count, 255), value * 2**15)
        found.append((short.level[0], axis[0] / 2**15))
    return tuple(np.array(found).T)


@pytest.mark.parametrize("size", [200, STEPS, 24_576])
def test_16_bits_stay_within_20_steps_of_32(size: int) -> None:
    t = np.arange(4000) / 10
    random = np.random.default_rng(size)
    for inputs in (
        np.full(len(t), size),
        size * np.sign(np.sin(t / 3)),  # at the pace that it answers most to
        size * np.sin(2 * np.pi * 0.67 * t),
        size * random.uniform(-1, 1, len(t)),
        np.cumsum(random.normal(0, size / 50, len(t))).clip(-size, size),
    ):
        short, fine = outputs(np.rint(inputs).astype(int))
        assert np.abs(short - fine).max() <= 20


def test_it_passes_what_is_slow_and_stops_what_is_fast() -> None:
    t = np.arange(2000) / 10
    slow, _ = outputs(np.rint(10_000 * np.sin(t / 50)).astype(int))
    fast, _ = outputs(np.rint(10_000 * np.sin(2 * np.pi * t)).astype(int))
    assert np.abs(slow[500:]).max() > 9_000
    assert np.abs(fast[500:]).max() < 120
