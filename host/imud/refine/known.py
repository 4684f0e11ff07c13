# SPDX-License-Identifier: MIT
"""What params tell of a module beforehand."""

from __future__ import annotations

from dataclasses import replace

from imud.gravity import GRAVITY_M_S2
from imud.params.value import Params
from imud.refine.model import CALIBRATED, SHOP, Priors

FIELD_UT = 50.0  # of a place, where the params do not have it


def priors_of(params: Params) -> Priors:
    """Of the sensors that the params calibrate, by the errors that they state; else of
    a module from a shop.
    """
    found = SHOP
    acc, gyr, mag = params.acc, params.gyr, params.mag
    if acc is not None and acc.sigma is not None:
        share = acc.sigma / GRAVITY_M_S2
        found = replace(found, acc_bias=acc.sigma, acc_scale=share, acc_cross=share)
    if gyr is not None:
        found = replace(found, bias=CALIBRATED.bias)
        if gyr.sigma is not None:
            found = replace(found, gyr_scale=gyr.sigma, gyr_cross=gyr.sigma)
    if mag is not None and mag.sigma is not None:
        share = mag.sigma / (mag.norm_ut or FIELD_UT)
        found = replace(found, own=mag.sigma, soft=share, mag_cross=share)
    return found
