# SPDX-License-Identifier: MIT
"""Standard gravity: scales, calibrations and virtual motions count forces in it."""

GRAVITY_M_S2 = 9.80665
