# SPDX-License-Identifier: MIT
"""Which baud rate to try next, from what was heard. No I/O; time is an argument, in s.

A hello proves a rate right. A silent line is silent at every rate: at a wrong one bytes
arrive too, with other bits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from imud.probes.session import NOISE_BYTES

# A hello and a status come every second, so this time is enough for one of them.
DWELL_S = 1.3

# Opening a port may reset a board, which is silent while its bootloader waits: 2 s with
# the Nano's old one. And a hello may be lost to noise.
QUIET_S = 3.0

# Bytes received at the rate before may still arrive.
SETTLE_S = 0.05


@dataclass(frozen=True, slots=True)
class Sound:
    """The bytes received at one rate."""

    bytes: int = 0
    frames: int = 0  # good ones
    well_formed: int = 0  # COBS is right, the CRC is not

    @classmethod
    def of(cls, counts: Mapping[str, Any]) -> Sound:
        """From `Session.counts`."""
        well_formed = counts["corrupt_kinds"].get("bad_crc", 0)
        return cls(counts["bytes"], counts["frames"], well_formed)


class TrialStep(Enum):
    STAY = 1
    NEXT = 2  # listen at Trial.rate, which is another one
    OVER = 3  # a round is over without a hello; the next one begins


class Trial:
    """The search for the rate of one port: all rates, again and again."""

    def __init__(self, rates: Sequence[int], now_s: float) -> None:
        self.rates = tuple(rates)
        self._index = 0
        self._since_s = now_s
        self._first_s: float | None = None  # of the first byte at this rate
        self._noise = 0
        self.noise = 0  # bytes of the last round, which had no hello

    @property
    def rate(self) -> int:
        return self.rates[self._index]

    def judge(self, sound: Sound, now_s: float) -> TrialStep:
        """The next step. Called when bytes have arrived, and about ten times a
        second."""
        if sound.bytes > 0 and self._first_s is None:
            self._first_s = now_s
        spent_s = now_s - self._since_s
        if self._first_s is None:
            # After noise at another rate, silence means that it was a short burst.
            is_in_vain = spent_s > (DWELL_S if self._noise else QUIET_S)
            return self._turn(sound, now_s) if is_in_vain else TrialStep.STAY
        # Random bytes with zeros among them are hardly ever valid COBS: of 200,000 none
        # were. A probe of another schema sends valid COBS; only hellos pass the CRC.
        is_garbage = sound.bytes > NOISE_BYTES and sound.frames + sound.well_formed == 0
        if is_garbage and spent_s > SETTLE_S:
            return self._turn(sound, now_s)
        if now_s - self._first_s > (QUIET_S if sound.frames else DWELL_S):
            return self._turn(sound, now_s)
        return TrialStep.STAY

    def _turn(self, sound: Sound, now_s: float) -> TrialStep:
        self._noise += sound.bytes
        self._since_s, self._first_s = now_s, None
        self._index += 1
        if self._index < len(self.rates) and self._noise:
            return TrialStep.NEXT
        self._index = 0
        self.noise, self._noise = self._noise, 0
        return TrialStep.OVER


class Memory:
    """Remembers the rates that were right, by port and by probe."""

    def __init__(self) -> None:
        self._by_port: dict[str, int] = {}
        self._by_probe: dict[str, int] = {}

    def learn(self, ports: Iterable[str], probe_id: str, rate: int) -> None:
        """`ports`: all names of one port, as its device and what is plugged in."""
        self._by_port.update(dict.fromkeys(ports, rate))
        # The last one learnt is the first to be tried.
        self._by_probe.pop(probe_id, None)
        self._by_probe[probe_id] = rate

    def order(
        self, ports: Iterable[str], missing: Iterable[str], rates: Iterable[int]
    ) -> tuple[int, ...]:
        """All rates to try: the port's own, those of missing probes, then `rates`."""
        wanted = set(missing)
        own = [self._by_port[port] for port in ports if port in self._by_port]
        lost = [r for probe, r in reversed(self._by_probe.items()) if probe in wanted]
        return tuple(dict.fromkeys((*own, *lost, *rates)))
