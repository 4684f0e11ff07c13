# SPDX-License-Identifier: MIT
"""Which sensors a probe has by its hello, and what is wrong with them in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imud.probes.chip import DIES, NAMESAKES, die_of
from imud.probes.self_test import SelfTestOutcome, SensorVerdict
from imud.wire.params import is_mag_off

Hello = Mapping[str, Any]  # fields of a hello, or that object of a status

# Sold for probes, and of no use in one: their registers are others'.
UNREADABLE = frozenset({0x68, 0x69, 0x6A, 0xD1, 0xEA})
MPU6500 = 0x70
# With an AK8963 in the same package.
NINE_AXES = frozenset(who for who, die in DIES.items() if die.sensor == "mpu9250")

# Pairs of an inertial chip and a LIS3MDL.
PAIRS = ("lsm6dsox", "lsm6dsv16x")

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


def identity_words(identity: int, sensor: str = "") -> str:
    """An identity register, with the name of the chip if it is a known one; `sensor`:
    the hello's word, if there is one.
    """
    named = [die_of(identity, sensor)] if sensor else []
    named = named or [dies.get(identity) for dies in (DIES, NAMESAKES)]
    names = " or ".join(die.name for die in named if die)
    return f"0x{identity:02X} ({names})" if names else f"0x{identity:02X}"


def sensor_words(hello: Hello) -> str:
    """The sensor by its name, with its identity if that is not the usual one."""
    name, identity = str(hello["sensor"]), hello["who_am_i"][0]
    die = die_of(identity, name)
    if identity == 0 or (die and die.sensor == name and die.chip is None):
        return f"{name} (untried)" if die and die.is_untried else name
    return f"{name}, answers {identity_words(identity, name)}"


def missing_magnetometer(hello: Hello, params: bytes | None = None) -> str:
    """Why there is no magnetometer; empty if there is one. `params`: its records, by
    which it may be switched off.
    """
    if is_mag_off(params):
        return "the magnetometer is switched off: no heading"
    sensor, (identity, magnetic) = hello["sensor"], hello["who_am_i"]
    if sensor == "none":
        return "no sensor was found"
    # Drivers of others may leave out the identity.
    is_there = magnetic != 0 or identity == 0
    if sensor != "mpu6500" and is_there:
        return ""
    if sensor in PAIRS:
        return (
            "no LIS3MDL answers beside this sensor (at 0x1C or 0x1E), or it measures "
            "nothing: no heading"
        )
    if sensor == "lsm9ds0" or identity in NINE_AXES:
        chip = DIES[identity].name if identity in NINE_AXES else "LSM9DS0"
        return (
            f"the magnetometer of this {chip} does not answer: no heading; switch the "
            "power off and on; if that does not help, replace the module"
        )
    if identity in (0, MPU6500):
        return (
            "no magnetometer in this module (an MPU-6500 sold as an MPU-9250): "
            "no heading"
        )
    answers = identity_words(identity, sensor)
    return (
        f"no magnetometer in this module (it answers {answers}; an MPU-9250 answers "
        "0x71): no heading"
    )


def has_magnetometer(hello: Hello, params: bytes | None = None) -> bool:
    return not missing_magnetometer(hello, params)


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
    die = die_of(hello["who_am_i"][0], str(hello["sensor"]))
    if die is not None and die.is_untried:
        words = (
            f"{die.name}: untried, nobody has run this firmware with it; please send "
            "the report of imud check"
        )
        found.append(SensorFinding(words, is_fault=False))
    return found


def flags_of(verdicts: Sequence[SensorVerdict]) -> tuple[str, ...]:
    """The flags that poses get from the host."""
    has_failed = any(v.outcome is SelfTestOutcome.FAILED for v in verdicts)
    return (SELF_TEST_FAILED,) if has_failed else ()
