# SPDX-License-Identifier: MIT
"""Which baud rate to listen at next, from what was heard. No I/O; time is an argument.

A rate proves right by a hello. A line on which nothing at all is heard is so at every
rate: a wrong one still makes bytes, of other bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from imud.probes.session import NOISE_BYTES

# A hello and a status come every second, so that much time is enough for one.
DWELL_S = 1.3

# A board that opening its port has reset says nothing while its bootloader waits, the
# Nano's old one for 2 s. And hellos that noise struck are to be outlasted.
QUIET_S = 3.0

# Bytes of the rate before are still on their way.
SETTLE_S = 0.05


@dataclass(frozen=True, slots=True)
class Sound:
    """What was heard at one rate."""

    bytes: int = 0
    frames: int = 0  # good ones
    shapely: int = 0  # of sound COBS but not of our CRC

    @classmethod
    def of(cls, counts: Mapping[str, Any]) -> Sound:
        """Of a session's counts."""
        shapely = counts["corrupt_kinds"].get("bad_crc", 0)
        return cls(counts["bytes"], counts["frames"], shapely)


class Step(Enum):
    STAY = 1
    NEXT = 2  # listen at Trial.rate, which is another one
    OVER = 3  # a round is over without a hello; the next one begins


class Trial:
    """One listening to a port, rate by rate, round by round."""

    def __init__(self, rates: Sequence[int], now_s: float) -> None:
        self.rates = tuple(rates)
        self._index = 0
        self._since_s = now_s
        self._first_s: float | None = None  # a byte came
        self._noise = 0
        self.noise = 0  # bytes of the round that is over, none of them a frame's

    @property
    def rate(self) -> int:
        return self.rates[self._index]

    def judge(self, sound: Sound, now_s: float) -> Step:
        """To be asked at bytes and, as time passes, about ten times a second."""
        if sound.bytes > 0 and self._first_s is None:
            self._first_s = now_s
        spent_s = now_s - self._since_s
        if self._first_s is None:
            # After noise at another rate: that was all of a burst, or the line's.
            is_in_vain = spent_s > (DWELL_S if self._noise else QUIET_S)
            return self._turn(sound, now_s) if is_in_vain else Step.STAY
        # Random bytes with zeros among them are hardly ever sound COBS: of 200,000 none
        # made such a frame. A probe of another schema makes nothing else but hellos.
        is_garbage = sound.bytes > NOISE_BYTES and sound.frames + sound.shapely == 0
        if is_garbage and spent_s > SETTLE_S:
            return self._turn(sound, now_s)
        if now_s - self._first_s > (QUIET_S if sound.frames else DWELL_S):
            return self._turn(sound, now_s)
        return Step.STAY

    def _turn(self, sound: Sound, now_s: float) -> Step:
        self._noise += sound.bytes
        self._since_s, self._first_s = now_s, None
        self._index += 1
        if self._index < len(self.rates) and self._noise:
            return Step.NEXT
        self._index = 0
        self.noise, self._noise = self._noise, 0
        return Step.OVER


class Memory:
    """The rates that proved right, by port and by probe."""

    def __init__(self) -> None:
        self._by_port: dict[str, int] = {}
        self._by_probe: dict[str, int] = {}

    def learn(self, ports: Iterable[str], probe_id: str, rate: int) -> None:
        """A port may have several names: of its device, of what is plugged in."""
        self._by_port.update(dict.fromkeys(ports, rate))
        # The last one learnt is the first to be tried.
        self._by_probe.pop(probe_id, None)
        self._by_probe[probe_id] = rate

    def order(
        self, ports: Iterable[str], missing: Iterable[str], rates: Iterable[int]
    ) -> tuple[int, ...]:
        """All that are worth a try: the port's, those of probes that are missing."""
        wanted = set(missing)
        own = [self._by_port[port] for port in ports if port in self._by_port]
        lost = [r for probe, r in reversed(self._by_probe.items()) if probe in wanted]
        return tuple(dict.fromkeys((*own, *lost, *rates)))
