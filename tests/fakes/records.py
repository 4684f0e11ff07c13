# SPDX-License-Identifier: MIT
"""Params as a probe has them: records, and the messages that tell them."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from fakes.probe import FakeProbe
from imud.wire.params import PART, digest_of

ONE = 16384  # 1 of a matrix
ROW_MAX = 27852  # the most that the magnitudes of its row may sum up to
BIAS_MAX = 16384 * 16384

# Tag, and the bytes behind bias and matrix: sigma, residual, temperature, day, method;
# for the magnetometer norm, dip, lag, and the field to the north and up besides.
KINDS = {1: "<HHhHB", 2: "<HHhHB", 3: "<HHhHBHhhhh"}
SIGMAS = {1: 250, 2: 120, 3: 80}  # 0.025 m/s2, 0.0012, 0.8 uT


def record(tag: int, content: bytes) -> bytes:
    return bytes((tag, len(content))) + content


def calibration_record(
    tag: int,
    bias: list[int],
    matrix: list[int],
    sigma: int | None = None,
    temperature: int = 2345,
    field: tuple[int, int] = (78, -176),
) -> bytes:
    """The record of one sensor; numbers as on the wire."""
    kind = KINDS[tag]
    rest = [SIGMAS[tag] if sigma is None else sigma, 30, temperature, 9800, 2]
    rest += [4820, 6610, 0, *field]
    return record(
        tag,
        struct.pack("<3i9h", *bias, *matrix)
        + struct.pack(kind, *rest[: len(kind) - 1]),
    )


def calibrated_records(seed: int) -> bytes:
    """Three sensors with the errors of ordinary modules."""
    random = np.random.default_rng(seed)
    records = b""
    for tag in KINDS:
        error = random.uniform(-0.03, 0.03, (3, 3)) + np.eye(3)
        bias = random.uniform(-60, 60, 3) * ONE
        records += calibration_record(
            tag,
            [int(value) for value in bias],
            [int(value) for value in (error * ONE).ravel()],
        )
    return records


def any_records(seed: int) -> bytes:
    """Three sensors with anything that the firmware takes, up to its bounds."""
    random = np.random.default_rng(seed)
    records = b""
    for tag in KINDS:
        matrix: list[int] = []
        for _ in range(3):
            shares = (
                random.dirichlet((1.0, 1.0, 1.0)) * random.uniform(0.2, 1) * ROW_MAX
            )
            signs = random.choice((-1, 1), 3)
            matrix += [int(value) for value in np.floor(shares) * signs]
        limit = random.choice((0, 100 * ONE, BIAS_MAX))
        bias = [
            int(value) for value in random.integers(-limit, limit, 3, endpoint=True)
        ]
        records += calibration_record(tag, bias, matrix)
    return records


def parts_of(
    probe: FakeProbe, records: bytes, make: Callable[..., Any] | None = None
) -> Iterator[Any]:
    """The messages that tell these records, as frames or as `make` makes them."""
    say = make or probe.say
    for at in range(0, len(records), PART):
        fields: dict[str, Any] = {
            "set_digest": digest_of(records),
            "set_length": len(records),
            "part_offset": at,
            "part": records[at : at + PART].ljust(PART, b"\0"),
        }
        yield say("params", **fields)
