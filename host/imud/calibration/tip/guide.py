# SPDX-License-Identifier: MIT
"""The guided search for the tip as a state machine: samples in; a status out, for a
terminal as for a page. It does no I/O and has no clock.

Stand the tip in a dimple, hold the probe still for a second, wobble it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import msgspec
import numpy as np

from imud.calibration.affine import Affine, affine_of
from imud.calibration.faults import CalibrationFault
from imud.calibration.recording import Gatherer, Sample, Scale
from imud.calibration.tip import dimple
from imud.calibration.tip.dimple import DimpleFit, Trust
from imud.calibration.tip.score import TipScore, score_of, trust_of, weakness
from imud.calibration.tip.swing import HELD_S, SECTORS, Swing, swing_of
from imud.calibration.tip_found import TipFound
from imud.params.value import Params
from imud.rotation import FloatArray

RATE_HZ = 190.0  # both boards come near to 200
LOOK_S = 0.1  # between two looks at whether it is held still
FIT_S = 1.0  # between two fits
LEAST_S, LONGEST_S = 15.0, 40.0  # of wobbling: when it is judged first and last
SURE_S = 10.0  # so long what may become better by itself is not told
TRIES = 2  # of a tip that slips or a base that gives

# Held still in a hand: spread of the rate, its mean (with an unknown bias) and the
# spread of the force.
STILL_RAD_S, TURNS_RAD_S, STILL_M_S2 = 0.04, 0.2, 0.35

WOBBLE = (
    "Wobble it about the tip: 20 degrees to each side, once a second, forwards and "
    "sideways, and twist it."
)

Phase = Literal["stand", "wobble", "done", "refused"]


class TipStatus(msgspec.Struct, frozen=True):
    """The status for a screen. None: not known yet."""

    phase: Phase
    instruction: str = msgspec.field(name="says")  # what to do now
    seconds: float  # of wobbling
    of_seconds: float
    is_still: bool
    score_m: float | None  # 95 % of errors are smaller
    is_good: bool
    leans_deg: tuple[float, ...]  # the farthest in each of 8 directions
    swing_deg: float | None
    hz: float | None
    trouble: str | None


@dataclass(slots=True)
class Dimpling:
    """One search for the tip of a probe with these params, from its raw samples.

    stand --- held still ---> wobble --- good, or LONGEST_S ---> done or refused
      ^                         |
      +--- clipped, or a gap ---+

    Held still again after a tip that slipped or a base that gave, a wobble restarts;
    after TRIES it is refused.
    """

    scale: Scale
    params: Params
    phase: Phase = "stand"
    fit: DimpleFit | None = None
    swing: Swing | None = None
    trouble: CalibrationFault | None = None
    _acc: Affine = field(init=False)
    _gyr: Affine = field(init=False)
    _trust: Trust = field(init=False)
    _gatherer: Gatherer = field(init=False)
    _looked: int = 0
    _begin: int = 0  # step from which the tip is in the dimple
    _is_still: bool = False
    _bias: FloatArray = field(default_factory=lambda: np.zeros(3))
    _fitted_s: float = 0.0
    _tries: int = 0

    def __post_init__(self) -> None:
        self._acc = affine_of(self.params.acc, self.scale.acc_m_s2)
        self._gyr = affine_of(self.params.gyr, self.scale.gyr_rad_s)
        self._trust = trust_of(self.params)
        self._gatherer = Gatherer(self.scale, RATE_HZ)

    @property
    def is_over(self) -> bool:
        """Whether it has found the tip or was refused."""
        return self.phase in ("done", "refused")

    @property
    def seconds(self) -> float:
        """How long it has been wobbled."""
        if self.phase == "stand":
            return 0.0
        steps = len(self._gatherer) - self._begin
        return max(0.0, steps * self._gatherer.step_s - HELD_S)

    def feed(self, sample: Sample) -> TipFound | CalibrationFault | None:
        """Takes a sample; returns the result once it is over."""
        if self.is_over:
            return None
        clipped = self._gatherer.clipped
        self._gatherer.add(sample)
        look = max(2, round(LOOK_S / self._gatherer.step_s))
        if self._gatherer.clipped > clipped and self.phase == "wobble":
            self._again(
                CalibrationFault(
                    "clipped", "a sensor was at the end of its range", "do not knock it"
                )
            )
        if len(self._gatherer) < self._looked + look:
            return None
        self._looked = len(self._gatherer)
        return self._look()

    def end(self) -> TipFound | CalibrationFault:
        """Evaluates the samples so far."""
        self._refit()
        return self._judged()

    def _look(self) -> TipFound | CalibrationFault | None:
        recording = self._gatherer.recording()
        held = round(HELD_S / recording.step_s)
        is_whole = recording.is_whole(self._begin, len(recording))
        if self.phase == "wobble" and not is_whole:
            self._again(
                CalibrationFault("gap", "samples are missing", "check with imud list")
            )
        rate = self._gyr.apply(recording.gyr[-held:])
        force = self._acc.apply(recording.acc[-held:])
        self._is_still = len(recording) >= held and bool(
            np.linalg.norm(rate.std(axis=0)) < STILL_RAD_S
            and np.linalg.norm(rate.mean(axis=0)) < TURNS_RAD_S
            and np.linalg.norm(force.std(axis=0)) < STILL_M_S2
        )
        if self._is_still and (self.phase == "stand" or self._is_spoilt()):
            return self._begin_at(len(recording) - held, rate.mean(axis=0))
        if self.phase == "stand" or self.seconds < self._fitted_s + FIT_S:
            return None
        return self._follow()

    def _begin_at(self, step: int, bias: FloatArray) -> CalibrationFault | None:
        """It is held still: from here on the tip is in the dimple."""
        self._tries += self.fit is not None
        if self._tries == TRIES and self.trouble is not None:
            self.phase = "refused"
            return self.trouble
        self.phase, self._begin, self._bias = "wobble", step, bias
        self.fit, self.swing, self._fitted_s = None, None, 0.0
        return None

    def _is_spoilt(self) -> bool:
        """Whether the samples so far can't become good: then a new rest restarts it."""
        return self.fit is None or (
            self.trouble is not None and self.trouble.kind in ("slips", "base_gives")
        )

    def _again(self, fault: CalibrationFault) -> None:
        self.phase, self.trouble, self.fit, self.swing = "stand", fault, None, None
        self._begin = len(self._gatherer)

    def _follow(self) -> TipFound | CalibrationFault | None:
        """Fits the samples so far, now and then."""
        self._fitted_s = self.seconds
        self._refit()
        if self.fit is None or self.swing is None:
            return None
        weak = weakness(self.fit, self.swing, self._trust)
        is_early = self.seconds < SURE_S
        self._tell(None if is_early and _is_unsure(weak) else weak)
        if weak is None and self.seconds >= LEAST_S:
            return self._judged()
        return self._judged() if self.seconds >= LONGEST_S else None

    def _tell(self, trouble: CalibrationFault | None) -> None:
        """Reports a fault once, not with each digit that changes."""
        kinds = [
            each.kind if each is not None else "" for each in (trouble, self.trouble)
        ]
        if kinds[0] != kinds[1]:
            self.trouble = trouble

    def _refit(self) -> None:
        recording = self._gatherer.recording()
        used = slice(self._begin, len(recording))
        force = self._acc.apply(recording.acc[used])
        rate = self._gyr.apply(recording.gyr[used]) - self._bias
        if self.phase == "wobble" and len(rate) > 1:
            self.fit = dimple.fit(force, rate, recording.step_s, self._trust, self.fit)
            self.swing = swing_of(force, rate, recording.step_s)

    def _judged(self) -> TipFound | CalibrationFault:
        weak = self._weakness()
        self.trouble = weak
        if weak is not None or self.fit is None:
            self.phase = "refused"
            return weak or CalibrationFault(
                "too_short", "there are too few samples", "start again"
            )
        self.phase = "done"
        sigma = score_of(self.fit, self._trust).sigma_m
        return TipFound("dimple", self.fit.offset_m, sigma, seconds=self.seconds)

    def _weakness(self) -> CalibrationFault | None:
        if self.fit is None or self.swing is None or self.seconds < SURE_S:
            return CalibrationFault(
                "too_short",
                f"{self.seconds:.0f} s of wobbling is too short",
                f"wobble it for {LEAST_S:.0f} s and keep the tip in its place",
            )
        return weakness(self.fit, self.swing, self._trust)

    @property
    def score(self) -> TipScore | None:
        """The expected error so far."""
        return score_of(self.fit, self._trust) if self.fit else None

    @property
    def instruction(self) -> str:
        """What to do."""
        if self.phase == "done":
            return "Done."
        if self.phase == "refused":
            return "Refused."
        if self.phase == "stand":
            return "Stand the tip in a dimple and hold the probe still."
        return WOBBLE

    def status(self) -> TipStatus:
        """The status for a screen."""
        score, swing = self.score, self.swing
        return TipStatus(
            self.phase,
            self.instruction,
            self.seconds,
            LEAST_S,
            self._is_still,
            score.score_m if score else None,
            score is not None and score.is_good and self.trouble is None,
            swing.leans_deg if swing else (0.0,) * SECTORS,
            swing.degrees if swing else None,
            swing.hz if swing else None,
            str(self.trouble) if self.trouble is not None else None,
        )


def _is_unsure(weak: CalibrationFault | None) -> bool:
    """Whether a few more seconds may be enough."""
    return weak is not None and weak.kind not in ("slips", "uncalibrated")
