# SPDX-License-Identifier: MIT
"""Which sensors a probe has by its hello, and what is wrong with them in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imud.probes.self_test import SelfTestOutcome, SensorVerdict

Hello = Mapping[str, Any]  # fields of a hello, or that object of a status

# Identities of InvenSense's family: Linux, drivers/iio/imu/inv_mpu6050/inv_mpu_iio.h;
# of ST's: the register headers of its drivers.
CHIPS = {
    0x11: "ICM-20600",
    0x12: "ICM-20602",
    0x68: "MPU-6050 or MPU-9150",
    0x69: "LSM6DS33 or LSM6DS3",
    0x6A: "LSM6DS3TR-C or LSM6DSL",
    0x6B: "ISM330DHCX",
    0x6C: "LSM6DSO or LSM6DSOX",
    0x70: "MPU-6500",
    0x71: "MPU-9250",
    0x73: "MPU-9255",
    0x74: "MPU-6515",
    0x78: "MPU-6880",
    0x98: "ICM-20689",
    0xAF: "ICM-20608",
    0xD1: "BMI160",
    0xEA: "ICM-20948",
}
# Sold for probes, and of no use in one: their registers are others'.
UNREADABLE = frozenset({0x68, 0x69, 0x6A, 0xD1, 0xEA})
NINE_AXES = frozenset({0x71, 0x73})  # with an AK8963 in the same package
MPU6500 = 0x70
LSM9DS0 = 0xD4  # of its gyroscope's half
LSM6DSOX = frozenset({0x6B, 0x6C})  # and its relatives
# What hello calls a sensor by its identity; another one is told beside it.
_USUAL = {
    "mpu9250": NINE_AXES,
    "mpu6500": {MPU6500},
    "lsm9ds0": {LSM9DS0},
    "lsm6dsox": {0x6C},
}

# The flag that poses get from the host.
SELF_TEST_FAILED = "self_test_failed"


@dataclass(frozen=True, slots=True)
class SensorFinding:
    """A sentence about the sensors of a probe; not a fault where nothing is known."""

    words: str
    is_fault: bool = True


_CURES = {
    "accelerometer": "don't trust tilt; replace the module",
    "gyroscope": "don't trust poses; replace the module",
    "magnetometer": (
        "don't trust heading; move the probe away from iron and magnets and restart "
        "it; if that does not help, replace the module"
    ),
}


def identity_words(identity: int) -> str:
    """An identity register, with the name of the chip if it is a known one."""
    name = CHIPS.get(identity)
    return f"0x{identity:02X} ({name})" if name else f"0x{identity:02X}"


def sensor_words(hello: Hello) -> str:
    """The sensor by its name, with its identity if that is not the usual one."""
    name, identity = str(hello["sensor"]), hello["who_am_i"][0]
    if identity == 0 or identity in _USUAL.get(name, ()):
        return name
    return f"{name}, answers {identity_words(identity)}"


def missing_magnetometer(hello: Hello) -> str:
    """Why there is no magnetometer; empty if there is one."""
    sensor, (identity, magnetic) = hello["sensor"], hello["who_am_i"]
    if sensor == "none":
        return "no sensor was found"
    # Drivers of others may leave out the identity.
    is_there = magnetic != 0 or identity == 0
    if sensor != "mpu6500" and is_there:
        return ""
    if sensor == "lsm6dsox":
        return (
            "no LIS3MDL answers beside this sensor (at 0x1C or 0x1E), or it measures "
            "nothing: no heading"
        )
    if sensor == "lsm9ds0" or identity in NINE_AXES:
        chip = CHIPS.get(identity, "LSM9DS0")
        return (
            f"the magnetometer of this {chip} does not answer: no heading; switch the "
            "power off and on; if that does not help, replace the module"
        )
    if identity in (0, MPU6500):
        return (
            "no magnetometer in this module (an MPU-6500 sold as an MPU-9250): "
            "no heading"
        )
    return (
        f"no magnetometer in this module (it answers {identity_words(identity)}; an "
        "MPU-9250 answers 0x71): no heading"
    )


def has_magnetometer(hello: Hello) -> bool:
    return not missing_magnetometer(hello)


def out_of_work(status: Mapping[str, Any]) -> str:
    """Why the sensor gives no samples, by the status of a probe; empty if it does."""
    sensors = status.get("sensors") or {}
    if sensors.get("is_working", True):
        return ""
    return str(next(iter(sensors["words"]), "its sensor was not found yet; try again"))


def findings_of(hello: Hello, verdicts: Sequence[SensorVerdict]) -> list[SensorFinding]:
    """Problems and unknowns of a probe's sensors."""
    if hello.get("sensor", "none") == "none":
        return []
    missing = missing_magnetometer(hello)
    found = [SensorFinding(missing)] if missing else []
    for verdict in verdicts:
        if verdict.outcome is SelfTestOutcome.FAILED:
            found.append(
                SensorFinding(
                    f"the {verdict.sensor} failed its self-test ({verdict.reason}): "
                    + _CURES[verdict.sensor]
                )
            )
    moved = " and ".join(v.sensor for v in verdicts if v.is_for_motion)
    if moved:
        words = (
            f"self-test of {moved} not judged: the probe moved; restart it while it "
            "lies still"
        )
        found.append(SensorFinding(words, is_fault=False))
    return found


def flags_of(verdicts: Sequence[SensorVerdict]) -> tuple[str, ...]:
    """The flags that poses get from the host."""
    has_failed = any(v.outcome is SelfTestOutcome.FAILED for v in verdicts)
    return (SELF_TEST_FAILED,) if has_failed else ()
