# SPDX-License-Identifier: MIT
"""Limits for all boards, with the sources; of the chips: `probes/chip.py`."""

from __future__ import annotations

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

# Normal millivolts, and the limit of a fault, by board. The Nano measures its own
# against a reference of 10 % (data sheet of the ATmega328P, 28.8), and 16 MHz need
# 3.78 V (28.3). A Mega needs 4.5 V (data sheet of the ATmega2560, "Speed Grades"),
# which may read a tenth less. The Pico measures its regulator's input, which may be 1.8
# to 5.5 V (data sheet of the Pico, 4.5).
SUPPLY_MV = {
    "nano": (4_300, 5_500, 3_780),
    "mega": (4_500, 5_500, 4_050),
    "f405": (3_000, 3_600, 2_400),
    "pico": (2_300, 5_500, 1_800),
}

# The Earth's field is 22 to 67 uT strong. A module's own field adds 15 to 45 uT or is
# subtracted; a magnet beside it does worse.
EARTH_UT = (20.0, 70.0)
OWN_UT = 45.0
