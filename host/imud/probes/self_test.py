# SPDX-License-Identifier: MIT
"""The self-test of a probe's sensors: what they answered to their built-in stimulus,
and a verdict on each. No I/O.

A probe either judges itself (flags in its hello) or sends what was measured (message
`self_test`). Limits: InvenSense AN-MPU-9250A-03, 3.2 and 3.3, the gyroscope's response
by magnitude, as InvenSense's Motion Driver 6.12 takes it; AK8963 data sheet, 6.4.5 and
9.4.4, at 16 bits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import cast

from imud.wire.messages import Value

AXES = "xyz"
AK8963 = 0x48  # its WIA; without one there is no verdict on a magnetometer

ACC_PER_G = 16384  # counts at 2 g full scale
GYR_PER_DPS = 131  # counts at 250 deg/s full scale

FACTORY_COUNTS = 2620  # of code 1; each further code means 1 % more
ACC_WITHOUT_CODE_MG = (225.0, 675.0)
GYR_WITHOUT_CODE_DPS = 60.0
GYR_OFFSET_DPS = 20.0
MAG_X_Y, MAG_Z = (-200.0, 200.0), (-3200.0, -800.0)  # counts, adjusted

MOVED = "the probe moved"

# Between the measurements before and after the stimulus: more is motion. By the chip's
# noise at 10 Hz such a difference has 0.06 deg/s and 1.7 mg rms (PS 3.1, 3.2: 0.01
# deg/s and 300 ug per root of Hz).
MOVED_DPS = 2.5
MOVED_MG = 50.0

# The force at 2 g full scale and in operation, as a ratio. Offsets of 0.14 g (PS 3.2)
# may add to 1 g in one position and be subtracted in another: 0.75 to 1.33. A range
# register without effect gives 1/8 or 8.
SAME_FORCE = (0.5, 2.0)


class SelfTestOutcome(StrEnum):
    PASSED = "passed"
    FAILED = "failed"
    NOT_JUDGED = "not judged"


@dataclass(frozen=True, slots=True)
class Responses:
    """The measurements at boot, in counts: x, y, z of the accelerometer, then of the
    gyroscope. `factory`: codes of the same axes, 0 where there is none.
    """

    before: tuple[int, ...]
    stimulated: tuple[int, ...]
    after: tuple[int, ...]
    factory: tuple[int, ...]
    mag_response: tuple[int, ...]

    @classmethod
    def of(cls, fields: Mapping[str, Value]) -> Responses:
        """From the fields of a message `self_test`."""
        return cls(**{name: _integers(fields[name]) for name in cls.__slots__})

    def rise(self, axis: int) -> float:
        """The response of an axis, 0 to 5, to the stimulus, in counts."""
        rest = (self.before[axis] + self.after[axis]) / 2
        return self.stimulated[axis] - rest

    @property
    def has_moved(self) -> bool:
        """Whether the probe moved meanwhile. A response is then not to be trusted.

        A swing may have the same rate before and after: a rate that no gyroscope has at
        rest is motion, too.
        """
        changes = [abs(b - a) for a, b in zip(self.before, self.after, strict=True)]
        rates = [abs(rate) for rate in (*self.before[3:], *self.after[3:])]
        return (
            max(changes[:3]) > MOVED_MG / 1000 * ACC_PER_G
            or max(changes[3:]) > MOVED_DPS * GYR_PER_DPS
            or max(rates) > GYR_OFFSET_DPS * GYR_PER_DPS
        )

    @property
    def force_g(self) -> float:
        """Without the stimulus, measured at 2 g full scale."""
        return math.dist(self.before[:3], (0, 0, 0)) / ACC_PER_G


@dataclass(frozen=True, slots=True)
class Check:
    """One number of one axis and its limits; `high` is infinite where there is none."""

    axis: str
    what: str  # is measured: response, offset
    value: float
    low: float
    high: float
    unit: str

    @property
    def is_within(self) -> bool:
        return self.low <= self.value <= self.high

    @property
    def words(self) -> str:
        ends = f"{self.low:.0f} to {self.high:.0f}"
        if math.isinf(self.high):
            ends = f"at least {self.low:.0f}"
        value = f"{self.axis} {self.what} {self.value:.0f} {self.unit}"
        return f"{value}, expected {ends}"


@dataclass(frozen=True, slots=True)
class SensorVerdict:
    """On one sensor. `reason`: why it failed or was not judged."""

    sensor: str  # accelerometer, gyroscope, magnetometer
    outcome: SelfTestOutcome
    reason: str = ""
    checks: tuple[Check, ...] = ()  # empty: not measured, or judged by the probe

    @property
    def is_for_motion(self) -> bool:
        """Whether it was not judged because the probe moved."""
        return self.outcome is SelfTestOutcome.NOT_JUDGED and self.reason == MOVED

    @property
    def result(self) -> str:
        """The outcome, and the reason where there is one."""
        return f"{self.outcome}: {self.reason}" if self.reason else str(self.outcome)

    @property
    def words(self) -> str:
        return f"{self.sensor} {self.result}"


def judge(
    responses: Responses, who_am_i: tuple[int, ...], mag_adjust: tuple[int, ...]
) -> tuple[SensorVerdict, ...]:
    """A verdict on each sensor that there is; the last two are those of the hello."""
    acc = tuple(_acc_check(responses, axis) for axis in range(3))
    gyr = tuple(check for axis in range(3) for check in _gyr_checks(responses, axis))
    verdicts = [
        _verdict("accelerometer", acc, responses),
        _verdict("gyroscope", gyr, responses),
    ]
    if who_am_i[1] == AK8963:
        verdicts.append(_mag_verdict(responses, mag_adjust))
    return tuple(verdicts)


def verdicts_of(
    hello: Mapping[str, Value], responses: Responses | None
) -> tuple[SensorVerdict, ...]:
    """By the fields of a hello, and the responses that the same boot sent. Empty where
    the probe runs no self-test.
    """
    flags = hello.get("self_test")
    if not isinstance(flags, tuple) or not flags:
        return ()
    if "host_judges" not in flags:
        return _by_the_probe(frozenset(map(str, flags)))
    who_am_i, mag_adjust = _integers(hello["who_am_i"]), _integers(hello["mag_adjust"])
    if responses is not None:
        return judge(responses, who_am_i, mag_adjust)
    sensors = ["accelerometer", "gyroscope"]
    sensors += ["magnetometer"] if who_am_i[1] == AK8963 else []
    why = "its responses were not received"
    return tuple(
        SensorVerdict(sensor, SelfTestOutcome.NOT_JUDGED, why) for sensor in sensors
    )


def follows_range(responses: Responses, force_g: float) -> bool | None:
    """Whether the force at 2 g full scale agrees with the present one of a probe at
    rest, which is measured at another range; None: there is nothing to compare.
    """
    if force_g <= 0 or responses.has_moved:
        return None
    return SAME_FORCE[0] <= responses.force_g / force_g <= SAME_FORCE[1]


def adjusted(mag_response: tuple[int, ...], mag_adjust: tuple[int, ...]) -> list[float]:
    """By the factory's sensitivity adjustment (AK 8.3.11)."""
    return [
        value * ((adjust - 128) * 0.5 / 128 + 1)
        for value, adjust in zip(mag_response, mag_adjust, strict=True)
    ]


def _acc_check(responses: Responses, axis: int) -> Check:
    rise_mg = responses.rise(axis) / ACC_PER_G * 1000
    code = responses.factory[axis]
    if code == 0:
        return Check(AXES[axis], "response", abs(rise_mg), *ACC_WITHOUT_CODE_MG, "mg")
    trim_mg = _factory_counts(code) / ACC_PER_G * 1000
    return Check(AXES[axis], "response", rise_mg, trim_mg / 2, trim_mg * 1.5, "mg")


def _gyr_checks(responses: Responses, axis: int) -> tuple[Check, Check]:
    rise_dps = abs(responses.rise(3 + axis)) / GYR_PER_DPS
    code = responses.factory[3 + axis]
    least_dps = _factory_counts(code) / GYR_PER_DPS / 2
    if code == 0:
        least_dps = GYR_WITHOUT_CODE_DPS
    offset_dps = responses.before[3 + axis] / GYR_PER_DPS
    limit = GYR_OFFSET_DPS
    return (
        Check(AXES[axis], "response", rise_dps, least_dps, math.inf, "deg/s"),
        Check(AXES[axis], "offset", offset_dps, -limit, limit, "deg/s"),
    )


def _factory_counts(code: int) -> float:
    return FACTORY_COUNTS * math.pow(1.01, code - 1)


def _verdict(
    sensor: str, checks: tuple[Check, ...], responses: Responses
) -> SensorVerdict:
    wrong = [check.words for check in checks if not check.is_within]
    if not wrong:
        return SensorVerdict(sensor, SelfTestOutcome.PASSED, checks=checks)
    if responses.has_moved:
        return SensorVerdict(sensor, SelfTestOutcome.NOT_JUDGED, MOVED, checks)
    return SensorVerdict(sensor, SelfTestOutcome.FAILED, "; ".join(wrong), checks)


def _mag_verdict(responses: Responses, mag_adjust: tuple[int, ...]) -> SensorVerdict:
    if not any(responses.mag_response):
        why = "it did not measure the field of its own coil"
        return SensorVerdict("magnetometer", SelfTestOutcome.FAILED, why)
    limits = (MAG_X_Y, MAG_X_Y, MAG_Z)
    checks = tuple(
        Check(axis, "response", value, low, high, "counts")
        for axis, value, (low, high) in zip(
            AXES, adjusted(responses.mag_response, mag_adjust), limits, strict=True
        )
    )
    wrong = "; ".join(check.words for check in checks if not check.is_within)
    outcome = SelfTestOutcome.FAILED if wrong else SelfTestOutcome.PASSED
    return SensorVerdict("magnetometer", outcome, wrong, checks)


def _by_the_probe(flags: frozenset[str]) -> tuple[SensorVerdict, ...]:
    """A sensor that has neither flag failed while the probe moved; a magnetometer
    without one has no self-test.
    """
    verdicts = []
    for sensor, short in (
        ("accelerometer", "acc"),
        ("gyroscope", "gyr"),
        ("magnetometer", "mag"),
    ):
        if f"{short}_failed" in flags:
            why = "by the probe's own self-test"
            verdicts.append(SensorVerdict(sensor, SelfTestOutcome.FAILED, why))
        elif f"{short}_passed" in flags:
            verdicts.append(SensorVerdict(sensor, SelfTestOutcome.PASSED))
        elif short != "mag":
            verdicts.append(SensorVerdict(sensor, SelfTestOutcome.NOT_JUDGED, MOVED))
    return tuple(verdicts)


def _integers(value: Value) -> tuple[int, ...]:
    return cast(tuple[int, ...], value)
