# SPDX-License-Identifier: MIT
"""The messages that a probe without the C module sends of a sample: the raw message,
the pose of a filter, or both, each at its rate.
"""

from . import wire
from .link import message
from .plain_fusion import Fusion


class Streams:
    """`filter`: of madgwick.py, or None. `settings` has the rates."""

    def __init__(self, link, settings, filter):
        self._link = link
        self._settings = settings
        self._fusion = Fusion(filter) if filter is not None else None
        self.is_on = False
        self.fields = wire.STREAM_RAW if filter is None else wire.STREAM_POSE
        self._pose = message(wire.POSE) if filter is not None else None
        self._phases = {wire.STREAM_RAW: 0, wire.STREAM_POSE: 0}
        self._rate_hz = 0

    @property
    def fused(self):
        return 0 if self._fusion is None else self._fusion.fused

    def begin(self, rate_hz, hello):
        """The sensor is ready, and described in the hello."""
        self._rate_hz = rate_hz
        if self._fusion is not None:
            self._fusion.begin(rate_hz, hello)

    def choose(self, fields):
        """Selects streams by flags of `stream`; False, and nothing changed, for poses
        without a filter."""
        most = wire.STREAM_RAW
        if self._fusion is not None:
            most |= wire.STREAM_POSE
        if not fields or fields & ~most:
            return False
        self.fields = fields
        return True

    def rates(self):
        """The rates of poses and raw messages, as they are sent."""
        poses, raws = self._settings.pose_rate, self._settings.rate
        if self._rate_hz:
            raws = min(raws, self._rate_hz)
        if self._fusion is not None:
            poses = min(poses, self._fusion.step_hz)
        return poses, raws

    def take(self, raw, stamp):
        """A sample. Returns Fusion.found_bias()."""
        fusion = self._fusion
        if self.is_on and self._is_due(
            wire.STREAM_RAW, self._settings.rate, self._rate_hz
        ):
            self._link.put(raw, len(wire.RAW), stamp)
        if fusion is None or not fusion.take(raw, stamp):
            return 0
        if self.is_on and self._is_due(
            wire.STREAM_POSE, self._settings.pose_rate, fusion.step_hz
        ):
            fusion.fill(self._pose)
            self._link.put(self._pose, len(wire.POSE), stamp)
        return fusion.found_bias()

    def _is_due(self, stream, rate, of_hz):
        """True `rate` times a second, evenly."""
        if not self.fields & stream:
            return False
        if rate >= of_hz:
            return True
        phase = self._phases[stream] + rate
        is_due = phase >= of_hz
        self._phases[stream] = phase - of_hz if is_due else phase
        return is_due
