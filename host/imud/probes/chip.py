# SPDX-License-Identifier: MIT
"""The inertial dies by their identities, and the specified accuracy of each kind of
chip at the settings of the firmware.

PS: InvenSense PS-MPU-9250A-01, revision 1.0, tables 1 and 2. DS: ST DocID024763,
revision 2, table 3. Both state no noise of the magnetometer, and DS none at all: there
the limits are several times what public recordings of such boards have at rest. DSO: ST
DocID032891, revision 1, table 3: limits are ten times its typical offsets. ISM, DSV: as
others quote the data sheets of the ISM330DHCX and the LSM6DSV, which were not at hand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True, slots=True)
class Chip:
    """Limits of a kind of sensor, of each axis; noise is that of single samples."""

    name: str
    source: str
    rate_share: float  # of the sample rate, both ways
    gyr_noise_dps: float  # rms in the bandwidth that the firmware sets
    acc_noise_mg: float
    mag_noise_ut: float
    gyr_offset_dps: float
    acc_offset_mg: tuple[float, float, float]
    acc_scale: float


MPU9250 = Chip(
    name="MPU-9250",
    source="PS-MPU-9250A-01",
    rate_share=0.02,  # PS 4.15: the gyroscope's oscillator 1 %; a resonator 0.5 %
    gyr_noise_dps=0.1,  # at 92 Hz
    acc_noise_mg=8.0,  # at 94 Hz
    mag_noise_ut=1.5,
    gyr_offset_dps=5.0,  # at 25 degC
    acc_offset_mg=(60.0, 60.0, 80.0),
    acc_scale=0.03,
)
LSM9DS0 = Chip(
    name="LSM9DS0",
    source="DocID024763",
    rate_share=0.1,
    gyr_noise_dps=0.2,
    acc_noise_mg=12.0,
    mag_noise_ut=1.5,
    gyr_offset_dps=25.0,  # at 2000 deg/s
    acc_offset_mg=(60.0, 60.0, 60.0),
    acc_scale=0.04,
)
LSM6DSOX = Chip(
    name="LSM6DSOX",
    source="DocID032891",
    rate_share=0.1,  # the document states none
    gyr_noise_dps=0.1,  # 3.8 mdps/rtHz, at 66.8 Hz
    acc_noise_mg=5.0,  # 0.16 mg/rtHz, at 104 Hz
    mag_noise_ut=1.5,
    gyr_offset_dps=5.0,
    acc_offset_mg=(200.0, 200.0, 200.0),
    acc_scale=0.05,
)

ISM330DHCX = replace(
    LSM6DSOX,
    name="ISM330DHCX",
    source="its data sheet, as quoted",
    gyr_noise_dps=0.12,  # ISM: 5 mdps/rtHz, at 66.8 Hz
    acc_noise_mg=3.0,  # ISM: 0.06 mg/rtHz, at 104 Hz; of a relative 0.12 at 16 g
)

LSM6DSV16X = replace(
    LSM6DSOX,
    name="LSM6DSV16X",
    source="its data sheet, as quoted",
    acc_noise_mg=3.0,  # DSV: 0.06 mg/rtHz, at 100 Hz; at 16 g it may be more
)

# By the hello's word. An MPU-6500 is the inertial die of an MPU-9250.
CHIPS = {
    "mpu9250": MPU9250,
    "mpu6500": MPU9250,
    "lsm9ds0": LSM9DS0,
    "lsm6dsox": LSM6DSOX,
    "lsm6dsv16x": LSM6DSV16X,
}


@dataclass(frozen=True, slots=True)
class Die:
    """`sensor`: the hello's word for what a driver makes of it; empty: none reads it.
    `chip`: its accuracy, where it is not that of the word. `is_untried`: nobody has run
    its driver with one, nor was a data sheet at hand.
    """

    name: str
    sensor: str = ""
    chip: Chip | None = None
    is_untried: bool = False


# By WHO_AM_I. Of InvenSense's family: Linux, drivers/iio/imu/inv_mpu6050/inv_mpu_iio.h;
# of ST's: the register headers of its drivers. An LSM9DS0's is its gyroscope's half.
DIES = {
    0x11: Die("ICM-20600"),
    0x12: Die("ICM-20602"),
    0x68: Die("MPU-6050 or MPU-9150"),
    0x69: Die("LSM6DS33 or LSM6DS3"),
    0x6A: Die("LSM6DS3TR-C or LSM6DSL"),
    0x6B: Die("ISM330DHCX", "lsm6dsox", ISM330DHCX),
    0x6C: Die("LSM6DSO or LSM6DSOX", "lsm6dsox"),
    0x70: Die("MPU-6500", "mpu6500"),
    0x71: Die("MPU-9250", "mpu9250"),
    0x73: Die("MPU-9255", "mpu9250"),
    0x74: Die("MPU-6515"),
    0x78: Die("MPU-6880"),
    0x98: Die("ICM-20689"),
    0xAF: Die("ICM-20608"),
    0xD1: Die("BMI160"),
    0xD4: Die("LSM9DS0", "lsm9ds0"),
    0xEA: Die("ICM-20948"),
}


# Those that answer as another one above does, by the hello's word.
NAMESAKES = {
    0x70: Die("LSM6DSV16X or LSM6DSV", "lsm6dsv16x", is_untried=True),
}


def die_of(identity: int, sensor: str) -> Die | None:
    """The die of an identity, with the hello's word for it if there is one."""
    namesake = NAMESAKES.get(identity)
    if namesake is not None and namesake.sensor == sensor:
        return namesake
    return DIES.get(identity)


def known_chip(hello: Mapping[str, Any]) -> Chip | None:
    """By who answered, or else by the hello's word; None: no known one."""
    sensor, (identity, *_) = str(hello.get("sensor")), hello.get("who_am_i") or (0,)
    die = die_of(identity, sensor)
    of_die = die.chip if die is not None and die.sensor == sensor else None
    return of_die or CHIPS.get(sensor)


def chip_of(hello: Mapping[str, Any]) -> Chip:
    """The same; of an unknown one the MPU-9250."""
    return known_chip(hello) or MPU9250
