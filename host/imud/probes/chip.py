# SPDX-License-Identifier: MIT
"""The specified accuracy of each kind of chip, at the settings of the firmware.

PS: InvenSense PS-MPU-9250A-01, revision 1.0, tables 1 and 2. DS: ST DocID024763,
revision 2, table 3. Both state no noise of the magnetometer, and DS none at all: there
the limits are several times what public recordings of such boards have at rest. DSO: ST
DocID032891, revision 1, table 3: limits are ten times its typical offsets.
"""

from __future__ import annotations

from dataclasses import dataclass


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


# By the hello's word. An MPU-6500 is the inertial die of an MPU-9250.
CHIPS = {
    "mpu9250": MPU9250,
    "mpu6500": MPU9250,
    "lsm9ds0": LSM9DS0,
    "lsm6dsox": LSM6DSOX,
}


def chip_of(sensor: str) -> Chip:
    """By the hello's word; of an unknown one the MPU-9250's."""
    return CHIPS.get(sensor, MPU9250)
