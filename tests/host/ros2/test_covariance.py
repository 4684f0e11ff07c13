# SPDX-License-Identifier: MIT
"""The covariance of an orientation with an origin, and of samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from fakes import HELLO
from fakes.records import calibrated_records, calibration_record
from imud.calibration.noise import with_noise
from imud.params.value import Params
from imud.published import SinceOrigin
from imud.ros2 import cdr
from imud.ros2.covariance import FREE_RAD2, orientation_covariance
from imud.sinks.ros2 import RosTranslator
from imud.wire.messages import encode
from ros_values import RATE, pose, raw, sent_by


def covariance(since: SinceOrigin | None, **fields: Any) -> Any:
    pose = {
        "tilt_sigma_deg": 0.5,
        "heading_sigma_deg": 2.0,
        "flags": ("tared",),
        "since_origin": since,
    }
    return np.reshape(orientation_covariance(pose | fields), (3, 3))


def test_with_an_origin_it_is_the_error_since_then() -> None:
    found = covariance(SinceOrigin(0.12, 0.05, 60.0))
    assert np.allclose(found, np.diag(np.radians([0.05, 0.05, 0.12]) ** 2))
    assert covariance(SinceOrigin(None, 0.05, 60.0))[2, 2] == FREE_RAD2
    unknown = orientation_covariance(
        {
            "tilt_sigma_deg": None,
            "heading_sigma_deg": None,
            "flags": ("tared",),
            "since_origin": SinceOrigin(None, None, 60.0),
        }
    )
    assert unknown is cdr.ABSENT


def test_while_that_is_not_known_both_ends_count() -> None:
    both = 2.0 * np.diag(np.radians([0.5, 0.5, 2.0]) ** 2)
    for since in (SinceOrigin(None, None, 60.0, "gap"), None):
        assert np.allclose(covariance(since), both)
    assert covariance(None, heading_sigma_deg=100.0)[2, 2] == FREE_RAD2


@pytest.fixture
def translator() -> RosTranslator:
    return RosTranslator("tip", "imud", "world")


MG = 9.80665e-3
SPEED = math.hypot(*RATE)


def variance(matrix: Any) -> float:
    """Of an axis; all have the same, and nothing in common."""
    square = matrix.reshape(3, 3)
    assert np.array_equal(square, np.eye(3) * square[0, 0])
    return float(square[0, 0])


@pytest.mark.parametrize(
    ("sensor", "rate_dps", "force_mg", "white"),
    # PS-MPU-9250A-01, tables 1 and 2: at 92 and 94 Hz. ST states none. At last as a
    # calibration measured it, in the root of 100 Hz.
    [
        ("mpu9250", 0.1, 8.0, {}),
        ("mpu6500", 0.1, 8.0, {}),
        ("lsm9ds0", 0.2, 12.0, {}),
        ("lsm6dsox", 0.1, 5.0, {}),
        ("lsm6dsox", 0.03, 1.1, {"acc": 0.11 * MG, "gyr": math.radians(0.003)}),
    ],
)
def test_a_covariance_has_the_noise_of_the_chip_and_what_calibration_left(
    translator: RosTranslator,
    sensor: str,
    rate_dps: float,
    force_mg: float,
    white: dict[str, float | None],
) -> None:
    hello = encode("hello", HELLO | {"sensor": sensor, "sample_rate": 200}, 1, 0)
    params = with_noise(Params.decode(calibrated_records(1)), white).encode()
    sample = raw(params, hello, mag_uT=(20.0, -1.0, 45.0))
    topics = sent_by(translator, sample, pose())
    imu, mag = topics["/imud/tip/imu/data"][-1], topics["/imud/tip/imu/mag"][-1]
    assert variance(imu.linear_acceleration_covariance) == pytest.approx(
        (force_mg * MG) ** 2 + 0.025**2, rel=1e-3
    )
    # Its zero moves by half a degree a second, its scale is wrong by 0.0012.
    assert variance(imu.angular_velocity_covariance) == pytest.approx(
        math.radians(math.hypot(rate_dps, 0.5)) ** 2 + (0.0012 * SPEED) ** 2, rel=1e-4
    )
    assert variance(mag.magnetic_field_covariance) == pytest.approx(
        (1.5**2 + 0.8**2) * 1e-12
    )


def test_without_a_calibration_a_covariance_has_the_tolerances_of_the_chip(
    translator: RosTranslator,
) -> None:
    unsure = b"".join(calibration_record(t, [0] * 3, [0] * 9, 65535) for t in (1, 3))
    for params in (b"", None, unsure):
        sample = raw(params, mag_uT=(20.0, -1.0, 45.0))
        topics = sent_by(translator, sample, pose())
        imu, mag = topics["/imud/tip/imu/data"][-1], topics["/imud/tip/imu/mag"][-1]
        assert variance(imu.linear_acceleration_covariance) == pytest.approx(
            (8.0 * MG) ** 2 + (60.0 * MG) ** 2
        )
        # A zero evenly between -5 and 5 deg/s.
        of_zero = np.radians(np.linspace(-5.0, 5.0, 100_001)).var()
        assert variance(imu.angular_velocity_covariance) == pytest.approx(
            of_zero + math.radians(0.1) ** 2 + (0.01 * SPEED) ** 2, rel=1e-4
        )
        assert variance(mag.magnetic_field_covariance) == pytest.approx(
            (21.0**2 + 1.5**2) * 1e-12
        )


@pytest.mark.parametrize("hello", [b"", encode("hello", HELLO, 1, 0)[:20]])
def test_nothing_is_stated_of_a_chip_that_is_not_known(
    translator: RosTranslator, hello: bytes
) -> None:
    sample = raw(b"", hello, mag_uT=(20.0, -1.0, 45.0))
    topics = sent_by(translator, sample, pose())
    imu, mag = topics["/imud/tip/imu/data"][-1], topics["/imud/tip/imu/mag"][-1]
    assert imu.angular_velocity_covariance[0] == -1
    assert imu.linear_acceleration_covariance[0] == -1
    assert not mag.magnetic_field_covariance.any(), "unknown, as MagneticField.msg says"
