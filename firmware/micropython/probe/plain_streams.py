# SPDX-License-Identifier: MIT
"""The raw messages that a probe without the C module sends, at their rate."""

from . import wire


class Streams:
    """`settings` has the rate."""

    def __init__(self, link, settings):
        self._link = link
        self._settings = settings
        self.is_on = False
        self.fields = wire.STREAM_RAW
        self._phase = 0
        self.rate_hz = 0  # of the sensor, once it is ready

    def rate(self):
        """Raw messages a second, as they are sent."""
        return min(self._settings.rate, self.rate_hz or self._settings.rate)

    def take(self, raw, stamp):
        """A sample: sent `rate` times a second, evenly."""
        if not self.is_on:
            return
        phase = self._phase + self._settings.rate
        is_due = phase >= self.rate_hz
        self._phase = phase % self.rate_hz if is_due else phase
        if is_due:
            self._link.put(raw, len(wire.RAW), stamp)
