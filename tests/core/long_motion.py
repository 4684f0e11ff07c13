# SPDX-License-Identifier: MIT
"""Hours of motion, minute by minute: a hand, falls, magnets, turns and shakes beyond
the range, and the samples that a sensor makes of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from core import desk
from core.desk import DEGREE, G, ffi, lib
from core.scenes import ACC_NOISE, GYR_NOISE, MAG_NOISE, SAMPLE, earth, tumble
from imud import rotation

RATE_HZ = 200
BLOCK_S = 60
PER_BLOCK = BLOCK_S * RATE_HZ
START_US = 2**32 - 30_000_000  # the clock wraps in the first block, and 10 times more

# Rates are means over the sample period, so 2.5 ms of delay need no lead.
MPU9250 = desk.identity_of(gyr_delay_us=2500)
LSB = {"gyr": 1065264e-9, "acc": 4788403e-9, "mag": 150000e-6}
# A calibration as a module needs it: offsets in counts, a matrix near 1.
OFFSETS = {"gyr": (0, 0, 0), "acc": (90, -60, 120), "mag": (-150, 220, 80)}
MATRIX = {
    "gyr": np.array([[1.004, 0, 0.002], [0, 0.997, 0], [-0.003, 0, 1.001]]),
    "acc": np.array([[0.995, 0.004, 0], [0, 1.006, 0], [0.002, 0, 0.991]]),
    "mag": np.array([[1.03, 0.02, -0.01], [0.02, 0.96, 0.03], [-0.01, 0.03, 1.05]]),
}


@dataclass
class Block:
    """A minute of motion: attitudes, one more than samples, and what disturbs."""

    quat: desk.Array
    sway: desk.Array = field(default_factory=lambda: np.zeros((PER_BLOCK, 3)))
    extra_acc: desk.Array = field(default_factory=lambda: np.zeros((PER_BLOCK, 3)))
    extra_field: desk.Array = field(default_factory=lambda: np.zeros((PER_BLOCK, 3)))
    falls: desk.Array = field(default_factory=lambda: np.zeros(PER_BLOCK, bool))
    has_mag: desk.Array = field(default_factory=lambda: np.ones(PER_BLOCK, bool))


T = np.arange(PER_BLOCK + 1)[:, None] / RATE_HZ


def eased(begin_s: float, end_s: float) -> desk.Array:
    """0 before, 1 after, of least jerk between."""
    u = np.clip((T - begin_s) / (end_s - begin_s), 0, 1)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def to(start: desk.Array, goal: desk.Array, begin_s: float, end_s: float) -> desk.Array:
    """Turned from one attitude to another."""
    way = rotation.to_rotation_vector(rotation.multiply(rotation.inverse(start), goal))
    return rotation.multiply(
        start, rotation.from_rotation_vector(eased(begin_s, end_s) * way)
    )


def any_attitude(random: np.random.Generator) -> desk.Array:
    return desk.unit_rows(random, 1, 4)[0]


def hand(
    random: np.random.Generator,
    start: desk.Array,
    begin_s: float = 2,
    end_s: float = 58,
) -> Block:
    """Held in a hand that moves: turns of up to some 200 deg/s, sway of 1 m/s2."""
    window = eased(begin_s, begin_s + 2) - eased(end_s - 2, end_s)
    frequency = random.uniform(0.15, 0.8, (3, 1, 3))
    phase = random.uniform(0, 2 * np.pi, (3, 1, 3))
    swing = np.sin(2 * np.pi * frequency * T + phase).sum(axis=0)
    quat = rotation.multiply(
        start, rotation.from_rotation_vector(0.35 * window * swing)
    )
    shake = np.sin(2 * np.pi * random.uniform(0.8, 2.5, 3) * T[1:])
    return Block(quat, sway=window[1:] * shake)


def rest(random: np.random.Generator, start: desk.Array) -> Block:
    """Laid down on another side."""
    return Block(to(start, any_attitude(random), 3, 5))


def fast(random: np.random.Generator, start: desk.Array) -> Block:
    """Turns of up to 2000 deg/s."""
    return Block(
        tumble(50, RATE_HZ, int(random.integers(2**31)), start)[
            np.minimum(np.arange(PER_BLOCK + 1), 50 * RATE_HZ - 1)
        ]
    )


def fall(random: np.random.Generator, start: desk.Array) -> Block:
    """Thrown and caught, six times, tumbling."""
    block = Block(np.tile(start, (PER_BLOCK + 1, 1)))
    for begin_s in range(5, 50, 8):
        lasts = random.uniform(0.3, 1.5)
        spin = desk.unit_rows(random, 1, 3)[0] * random.uniform(1, 6) * lasts
        turn = rotation.from_rotation_vector(eased(begin_s, begin_s + lasts) * spin)
        block.quat = rotation.multiply(block.quat, turn)
        block.falls |= (T[1:, 0] > begin_s) & (T[1:, 0] <= begin_s + lasts)
    return block


def upside_down(random: np.random.Generator, start: desk.Array) -> Block:
    """Worked with overhead."""
    block = hand(random, start, 5, 58)
    over = rotation.multiply(
        rotation.from_heading_pitch_roll(float(random.uniform(-3, 3)), 0, 0),
        np.array([0.0, 1.0, 0.0, 0.0]),
    )
    moved = rotation.multiply(rotation.inverse(start), block.quat)
    block.quat = rotation.multiply(to(start, over, 1, 4), moved)
    return block


def gimbal_lock(random: np.random.Generator, start: desk.Array) -> Block:
    """x straight up or down, less a thousandth, and turned about it."""
    steep = rotation.from_heading_pitch_roll(
        float(random.uniform(-3, 3)), float(random.choice([-1, 1])) * np.pi / 2, 0
    )
    lean = 1e-3 * np.sin(2 * np.pi * 0.3 * T) * np.array([0.0, 1.0, 0.5])
    spin = 4 * np.sin(2 * np.pi * 0.1 * T) * np.array([1.0, 0.0, 0.0])
    window = eased(5, 7) - eased(56, 58)
    held = to(start, steep, 1, 4)
    turned = rotation.multiply(held, rotation.from_rotation_vector(window * lean))
    return Block(
        rotation.multiply(turned, rotation.from_rotation_vector(window * spin))
    )


def magnet(random: np.random.Generator, start: desk.Array) -> Block:
    """A magnet of up to 80 uT comes by twice."""
    block = hand(random, start)
    for begin_s in (8, 32):
        lasts = random.uniform(4, 15)
        near = np.sin(np.pi * np.clip((T[1:] - begin_s) / lasts, 0, 1))
        strong = random.uniform(15, 80) * desk.unit_rows(random, 1, 3)[0]
        block.extra_field += near * strong
    return block


def gone(random: np.random.Generator, start: desk.Array) -> Block:
    """No reading of the magnetometer for most of the minute."""
    block = hand(random, start)
    block.has_mag = (T[1:, 0] < 5) | (T[1:, 0] > random.uniform(30, 55))
    return block


def gone_for_long(random: np.random.Generator, start: desk.Array) -> Block:
    block = hand(random, start)
    block.has_mag[:] = False
    return block


def clipping(random: np.random.Generator, start: desk.Array) -> Block:
    """A spin faster than the range, a shake and an impact beyond it."""
    spin = desk.unit_rows(random, 1, 3)[0] * random.uniform(40, 60) * 8 / 15
    turn = rotation.from_rotation_vector(eased(5, 6) * spin)
    block = Block(rotation.multiply(start, turn))
    t = T[1:]
    shake = np.where(np.sin(2 * np.pi * 20 * (t - 8)) >= 0, 30 * G, -30 * G)
    block.extra_acc += np.where((t > 8) & (t < 9), shake, 0)
    block.extra_acc += np.where((t > 12) & (t < 12.02), 30 * G, 0) * np.array(
        [1, -1, 1]
    )
    return block


KINDS = [
    *(hand, rest, fast, fall, hand, upside_down, gimbal_lock, magnet, gone),
    *(clipping, hand, rest),
]
LONG_GONE = range(40, 45)  # of each hour


def minutes(count: int) -> Iterator[tuple[int, Block]]:
    quat = rotation.IDENTITY
    for index in range(count):
        random = np.random.default_rng([7, index])
        kind = KINDS[index % len(KINDS)]
        if index % 60 in LONG_GONE:
            kind = gone_for_long
        if index == 0:  # at rest, for the start-up calibration
            block = Block(np.tile(quat, (PER_BLOCK + 1, 1)))
        else:
            block = kind(random, quat)
        quat = block.quat[-1] / np.linalg.norm(block.quat[-1])
        yield index, block


def calibration() -> Any:
    out = ffi.new("struct calibration *")
    for name in LSB:
        part = getattr(out, name)
        part.bias = [offset * 2**14 for offset in OFFSETS[name]]
        part.matrix = np.round(MATRIX[name] * 2**14).astype(int).tolist()
    assert lib.calibration_is_valid(out)
    return out


def counts(name: str, rows: desk.Array) -> desk.Array:
    """What a sensor of this calibration reads, held at the ends of its range."""
    matrix = np.round(MATRIX[name] * 2**14) / 2**14
    read = rows / LSB[name] @ np.linalg.inv(matrix).T + OFFSETS[name]
    return np.clip(np.round(read), -(2**15), 2**15 - 1)


def felt(index: int, block: Block) -> desk.Array:
    """The samples of a minute: means of rates, noise, a bias that wanders."""
    random = np.random.default_rng([8, index])
    quat = block.quat[1:]
    back = rotation.inverse(quat)
    turn = rotation.multiply(rotation.inverse(block.quat[:-1]), quat)
    gyr = rotation.to_rotation_vector(turn) * RATE_HZ
    seconds = index * BLOCK_S + T[1:]
    # 0.3 deg/s in three hours, each axis in its own time.
    gyr += 0.3 * DEGREE * np.sin(2 * np.pi * seconds / 10_800 + np.array([0, 2, 4]))
    force = block.sway + np.array([0, 0, G])
    acc = rotation.rotate(back, np.where(block.falls[:, None], 0, force))
    acc += block.extra_acc
    mag = rotation.rotate(back, earth() + block.extra_field)
    # A reading is 12.5 ms behind; at both ends of a minute nothing moves.
    row = np.arange(PER_BLOCK)
    mag = (mag[np.maximum(row - 2, 0)] + mag[np.maximum(row - 3, 0)]) / 2
    out = np.zeros(PER_BLOCK, SAMPLE)
    for name, rows, noise in (
        ("gyr", gyr, GYR_NOISE),
        ("acc", acc, ACC_NOISE),
        ("mag", mag, MAG_NOISE),
    ):
        rows += noise * random.standard_normal(rows.shape)
        out[name] = counts(name, rows)
        if name != "mag":
            out[f"{name}_clipped"] = (np.abs(out[name].astype(int)) >= 32767).any(1)
    number = index * PER_BLOCK + np.arange(PER_BLOCK, dtype=np.int64)
    out["time_us"] = (START_US + number * (1_000_000 // RATE_HZ)) % 2**32
    out["has_mag"] = block.has_mag & (number % 2 == 1)
    return out
