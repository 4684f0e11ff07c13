# SPDX-License-Identifier: MIT
"""Params of sensors that somebody has calibrated: values are taken as they are, and the
filter is told how good they are.
"""

from __future__ import annotations

from imud.params.value import Params

IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
_VALUES = {"bias_counts": [0.0, 0.0, 0.0], "matrix": IDENTITY, "method": "measured"}


def known_to(
    sigma_m_s2: float, sigma_ut: float, gyr: float | None = None, **field: float
) -> bytes:
    """Records that tell the one-sigma errors of an axis of accelerometer and
    magnetometer, and of the gyroscope's scale, a share; without it none.

    `field`: norm_uT and dip_deg of the place where the probe was calibrated.
    """
    of_gyr = {} if gyr is None else {"sigma": gyr}
    return (
        Params()
        .replaced("acc", _VALUES | {"sigma_m_s2": sigma_m_s2})
        .replaced("gyr", _VALUES | of_gyr)
        .replaced("mag", _VALUES | {"sigma_uT": sigma_ut} | field)
        .encode()
    )


# As uncertain as a guided calibration leaves them, but for the gyroscope: the scales
# of recordings are wrong by percents.
CALIBRATED = known_to(0.007, 0.05)
