# SPDX-License-Identifier: MIT
"""What is normal, by the kind of chip, with the sources.

PS: InvenSense PS-MPU-9250A-01, revision 1.0, tables 1 and 2. DS: ST DocID024763,
revision 2, table 3. Both state no noise of the magnetometer, and DS none at all: there
the limits are several times what public recordings of such boards have at rest.
"""

from __future__ import annotations

from dataclasses import dataclass

# Processor clocks against the host's, ppm. A Nano has a ceramic resonator (Murata
# CSTCE16M0V53, 0.5 % at 25 degC); beyond a percent and a half the UART fails.
CRYSTAL_PPM = 100.0
RESONATOR_PPM = 5_000.0
CLOCK_FAULT_PPM = 15_000.0

# Of the samples' age when the host has read them: 16 ms is an FTDI's timer as shipped.
AGE_GOOD_MS = 12.0
AGE_FAULT_MS = 200.0

JITTER_GOOD = 0.02  # of a period, rms
JITTER_FAULT = 0.2

# A die is some degrees warmer than the room; beyond the last two no part is specified.
WARM_DEGC = (5.0, 60.0)
SPECIFIED_DEGC = (-40.0, 85.0)

SLOPE_MG = 35.0  # of a table that is off level by two degrees

# Millivolts that are normal, and what is a fault, by board. The Nano measures its own
# against a reference of 10 % (data sheet of the ATmega328P, 28.8), and 16 MHz need
# 3.78 V (28.3).
SUPPLY_MV = {"nano": (4_300, 5_500, 3_780), "f405": (3_000, 3_600, 2_400)}

# The Earth's field is 22 to 67 uT strong. A module's own field adds 15 to 45 uT or is
# subtracted; a magnet beside it does worse.
EARTH_UT = (20.0, 70.0)
OWN_UT = 45.0


@dataclass(frozen=True, slots=True)
class Chip:
    """Limits of the kind of sensor that a probe has."""

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


def chip_of(sensor: str) -> Chip:
    """By the hello's word."""
    return LSM9DS0 if sensor == "lsm9ds0" else MPU9250
