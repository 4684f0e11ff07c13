# SPDX-License-Identifier: MIT
"""How wrong an axis of a calibrated sample is: noise, and what calibration left."""

from __future__ import annotations

import math

from imud.gravity import GRAVITY_M_S2
from imud.probes.chip import Chip, known_chip
from imud.probes.scales import Vector
from imud.wire.messages import Message, decode
from imud.wire.params import parts_of

# Error of a gyroscope's bias since its calibration, or the last rest: VQF,
# biasSigmaInit.
ZERO_SIGMA_DPS = 0.5
# Where the params state none the filter takes these: `fuse_params.h`.
LEVEL_SIGMA_G = 0.06
SCALE_SIGMA = 0.01
OWN_FIELD_SIGMA_UT = 21.0


class SampleError:
    """Variances of an axis by the chip of a hello and by the params in force. A board
    whose chip is not known has none: None.
    """

    def __init__(self, hello: bytes = b"", params: bytes | None = None) -> None:
        self.hello = hello
        self.params = params
        known = parts_of(params or b"")
        self._scale = _number(known.get("gyr", {}).get("sigma"), SCALE_SIGMA)
        self._chip, rate_hz = _of_hello(hello)
        self._zero_rad2_s2 = 0.0
        self.force_m2_s4: float | None = None
        self.field_ut2: float | None = None
        chip = self._chip
        if chip is None:
            return
        # An uncalibrated zero lies anywhere within its limits.
        zero_dps = ZERO_SIGMA_DPS if "gyr" in known else chip.gyr_offset_dps / 3**0.5
        # What calibration has measured, as white noise up to half the rate.
        share, noises = math.sqrt(rate_hz / 2.0), known.get("noise", {})
        usual = math.radians(chip.gyr_noise_dps)
        rate_noise = _number(noises.get("gyr"), usual / share) * share
        self._zero_rad2_s2 = math.radians(zero_dps) ** 2 + rate_noise**2
        level = LEVEL_SIGMA_G * GRAVITY_M_S2
        usual = chip.acc_noise_mg * GRAVITY_M_S2 / 1000.0
        noise = _number(noises.get("acc"), usual / share) * share
        self.force_m2_s4 = _number(known.get("acc", {}).get("sigma"), level) ** 2
        self.force_m2_s4 += noise**2
        own = _number(known.get("mag", {}).get("sigma"), OWN_FIELD_SIGMA_UT)
        self.field_ut2 = own**2 + chip.mag_noise_ut**2

    def rate_rad2_s2(self, rate_rad_s: Vector) -> float | None:
        """Grows with the rate: what its scale is wrong by turns and stretches it."""
        if self._chip is None:
            return None
        x, y, z = rate_rad_s
        return self._zero_rad2_s2 + self._scale**2 * (x * x + y * y + z * z)


def _of_hello(hello: bytes) -> tuple[Chip | None, float]:
    """The chip, and how many samples it makes a second."""
    message = decode(hello) if hello else None
    if not isinstance(message, Message):
        return None, 0.0
    return known_chip(message.fields), float(str(message.fields["sample_rate"]))


def _number(value: object, otherwise: float) -> float:
    return float(value) if isinstance(value, float) else otherwise
