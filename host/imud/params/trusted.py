# SPDX-License-Identifier: MIT
"""Params of calibrated sensors: values are used as they are, and the filter gets their
accuracy.
"""

from __future__ import annotations

import numpy as np

from imud.params.value import Params
from imud.rotation import FloatArray

IDENTITY = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
_VALUES = {"bias_counts": [0.0, 0.0, 0.0], "matrix": IDENTITY, "method": "measured"}


def known_to(
    sigma_m_s2: float,
    sigma_ut: float,
    gyr: float | None = None,
    temperature_c: float | None = None,
    **field: float,
) -> bytes:
    """Records with the one-sigma errors of an axis of accelerometer and
    magnetometer, and of the gyroscope's scale, a share; without it none.

    `temperature_c`: of the accelerometer's calibration. `field`: norm_uT and dip_deg of
    the place where the probe was calibrated.
    """
    of_gyr = {} if gyr is None else {"sigma": gyr}
    of_acc = {"sigma_m_s2": sigma_m_s2, "temperature_c": temperature_c}
    return (
        Params()
        .replaced("acc", _VALUES | of_acc)
        .replaced("gyr", _VALUES | of_gyr)
        .replaced("mag", _VALUES | {"sigma_uT": sigma_ut} | field)
        .encode()
    )


# As uncertain as a guided calibration leaves them, but for the gyroscope: the scales
# of recordings are wrong by percents.
CALIBRATED = known_to(0.007, 0.8)


def place_of(field_ut: FloatArray) -> dict[str, float]:
    """The norm and dip that known_to() takes, of a field: uT, east, north, up."""
    norm = float(np.linalg.norm(field_ut))
    return {
        "norm_uT": norm,
        "dip_deg": float(np.degrees(np.arcsin(-field_ut[2] / norm))),
    }
