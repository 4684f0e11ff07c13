# SPDX-License-Identifier: MIT
"""The scales of a probe's counts, from its hello and its params."""

from __future__ import annotations

import contextlib

from imud import _core
from imud.wire.params import digest_of, is_mag_off

Vector = tuple[float, float, float]

# Acceleration in m/s2, rate in rad/s, field in uT. None: not known.
Measured = tuple[Vector | None, Vector | None, Vector | None]


class Scales:
    """Calibrates raw messages as the probe itself does, with its own C."""

    __slots__ = ("_calibrator", "_has_mag", "digest", "hello", "params")

    def __init__(self, hello: bytes = b"", params: bytes | None = None) -> None:
        self.hello = hello  # content; empty: not known
        self.params = params  # records in force; None: not known
        # Digest of the params that measure() applies. None: there are none.
        self.digest: int | None = None
        self._has_mag = not is_mag_off(params)
        self._calibrator: _core.Calibrator | None = None
        if hello and params is not None:
            # Refused: a hello without a sensor, or records of a later firmware.
            with contextlib.suppress(ValueError):
                self._calibrator = _core.Calibrator(hello, params)
                self.digest = digest_of(params)

    def measure(self, raw: bytes) -> Measured:
        """The content of a raw message in SI units."""
        if self._calibrator is None:
            return None, None, None
        acc, gyr, mag = self._calibrator.apply(raw)
        return acc, gyr, mag if self._has_mag else None

    @property
    def gyr_delay_s(self) -> float:
        """Of the gyroscope's low-pass; 0: not known."""
        return 1e-6 * self._calibrator.gyr_delay_us() if self._calibrator else 0.0


UNKNOWN = Scales()
