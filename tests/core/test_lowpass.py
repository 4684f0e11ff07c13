# SPDX-License-Identifier: MIT
"""The low-pass in 16 bits against the one in 32."""

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


def test_three_axes_are_three_filters_and_nothing_beside_them_is_touched() -> None:
    random = np.random.default_rng(5)
    gain = ffi.new("struct lowpass_gain *", lib.fuse_level_gain)
    room = ffi.new("struct lowpass[2]")  # the second lies behind the first
    vectors = ffi.new("struct vector[2]")
    vectors[1].axis[0] = 10**6  # behind the input
    levels, bands = ffi.new("int32_t[3]"), ffi.new("int32_t[3]")
    behind = bytes(ffi.buffer(room + 1, ffi.sizeof("struct lowpass")))
    for count in range(1, 300):
        inputs = random.integers(-(2**29), 2**29, 3).tolist()
        for axis, value in enumerate(inputs):
            vectors[0].axis[axis] = value
            lib.lowpass_axis_step(
                levels + axis, bands + axis, gain, min(count, 255), value
            )
        lib.lowpass_step(room, gain, vectors, min(count, 255))
        assert list(room[0].level.axis) == list(levels)
        assert list(room[0].band.axis) == list(bands)
    assert bytes(ffi.buffer(room + 1, ffi.sizeof("struct lowpass"))) == behind


def test_short_filters_are_one_for_each_input_and_no_more() -> None:
    random = np.random.default_rng(6)
    size = ffi.sizeof("struct lowpass_short")
    together = ffi.new("struct lowpass_short[2]")
    alone = [ffi.new("struct lowpass_short *") for _ in range(lib.LOWPASS_SHORTS)]
    inputs = ffi.new("int16_t[]", lib.LOWPASS_SHORTS + 2)
    inputs[lib.LOWPASS_SHORTS] = 12_345  # behind the input
    for count in range(1, 300):
        values = random.integers(-20_000, 20_000, lib.LOWPASS_SHORTS).tolist()
        inputs[0 : lib.LOWPASS_SHORTS] = values
        lib.lowpass_short_step(together, inputs, min(count, 255))
        for at, (one, value) in enumerate(zip(alone, values, strict=True)):
            own = [0] * lib.LOWPASS_SHORTS
            own[at] = value
            lib.lowpass_short_step(one, own, min(count, 255))
            assert together[0].level[at] == one.level[at]
            assert together[0].band[at] == one.band[at]
    assert bytes(ffi.buffer(together + 1, size)) == bytes(size)
