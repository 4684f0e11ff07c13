# SPDX-License-Identifier: MIT
"""Learns a probe's sensors from its normal use: collects raw samples, decides when a
fit is worth its time, and evaluates its result. No I/O, no thread, no clock.
"""

from __future__ import annotations

import datetime
import math
from collections import deque
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec
import numpy as np

from imud.calibration import rate_bias
from imud.calibration.affine import Affine, affine_of
from imud.calibration.faults import of_magnets
from imud.calibration.learned import motion
from imud.calibration.learned.motion import MotionFit, Priors
from imud.calibration.recording import (
    GAP_S,
    Gatherer,
    Sample,
    Scale,
    SensorRecording,
    is_clipped,
)
from imud.calibration.result import with_mag, with_sensor
from imud.calibration.score import TILT_TO_HEADING, stated_tilt_deg
from imud.calibration.stops import find_stops
from imud.errors import ParamsError
from imud.gravity import GRAVITY_M_S2
from imud.params.learned import METHOD, filter_can_continue
from imud.params.value import Calibration, Params
from imud.rotation import FloatArray

WINDOW_S = 60.0  # of the latest samples
LEAST_S = 20.0
# If all of them yield no usable fit, this many of the newest are tried: a magnet put on
# the probe changes its own field, so samples before and after it do not fit together; a
# room may have another field there.
PARTS_S = (30.0, 16.0)
EVERY_S, SELDOM_S, GROWTH = 3.0, 60.0, 1.15  # between two fits; without news
TURNED_RAD = math.pi  # since the last fit, at least: a probe at rest shows nothing new

# Limit of the heading's error, and how much smaller it must be than that of the active
# calibration.
HEADING_MAX_DEG = 7.0
BETTER = 0.9
# Beyond these it is no module of ours, or the motion was no motion of a hand.
AWAY_MAX = 0.15  # of an entry of a matrix
# Sigmas of its prior: more soft iron may be an uneven field, seen from few attitudes.
# All attitudes leave less than this part of the prior's sigma within half a minute.
SOFT_MAX = 2.5
SOFT_SURE = 0.15
UNEVEN = "its soft iron may be an uneven field; turn it every way in one place"
REST_MAX_RAD_S = math.radians(2.0)  # error of a bias that only motion shows
# Sigmas by which the own field differs from that of all samples where a magnet was put
# on: 15 and more with 30 uT; in uneven rooms 3 at most.
MAGNETISED = 5.0
ACC_BIAS_MAX_M_S2 = 0.8 * GRAVITY_M_S2


class RestRate(msgspec.Struct, frozen=True):
    """When the probe lay still, device time, and its rates then in nominal units."""

    t_us: float
    rate: tuple[float, float, float]  # rad/s


class Proposal(msgspec.Struct, frozen=True):
    """The learned params, to be activated."""

    params: Params
    tilt_deg: float  # one-sigma errors to expect
    heading_deg: float
    sigma_ut: float


class Work(msgspec.Struct, frozen=True):
    """A fit that is due: samples, and the last rest before them."""

    samples: tuple[Sample, ...]
    scale: Scale
    rest: RestRate | None
    base: bytes  # records before anything was learned
    records: bytes  # active


@dataclass(frozen=True, slots=True)
class Learned:
    """The result of a fit."""

    proposal: Proposal | None
    rest: RestRate | None
    since_us: int = 0  # device time; the samples before it do not fit
    refusal: str = ""  # why what fits is not proposed


@dataclass(slots=True)
class Learner:
    """The samples of one probe."""

    scale: Scale
    rest: RestRate | None = None
    base: bytes | None = None  # the params before anything was learned
    samples: deque[Sample] = field(default_factory=deque)
    _turned_rad: float = 0.0
    _due_us: int = 0
    _every_s: float = EVERY_S

    def add(self, sample: Sample) -> bool:
        """Takes the next sample; whether a fit is due. A loss or a clipped reading ends
        the integration.
        """
        samples = self.samples
        gap_us = sample.t_us - samples[-1].t_us if samples else 0
        if gap_us < 0 or gap_us > GAP_S * 1e6 or is_clipped(sample):
            samples.clear()
        samples.append(sample)
        while sample.t_us - samples[0].t_us > WINDOW_S * 1e6:
            samples.popleft()
        turned = max(map(abs, sample.gyr)) * self.scale.gyr_rad_s
        self._turned_rad += turned * min(max(gap_us, 0), GAP_S * 1e6) / 1e6
        is_enough = sample.t_us - samples[0].t_us > LEAST_S * 1e6
        return (
            is_enough and sample.t_us >= self._due_us and self._turned_rad > TURNED_RAD
        )

    def begin(self, records: bytes) -> Work:
        """The fit that is due, with these active params. An earlier result of learning
        is no prior: it comes from the same samples.
        """
        if self.base is None or not filter_can_continue(self.base, records):
            self.base = records
        self._turned_rad = 0.0
        self._due_us = self.samples[-1].t_us + round(self._every_s * 1e6)
        return Work(tuple(self.samples), self.scale, self.rest, self.base, records)

    def end(self, learned: Learned) -> None:
        """Takes the result; backs off without news."""
        self.rest = learned.rest or self.rest
        while self.samples and self.samples[0].t_us < learned.since_us:
            self.samples.popleft()
        has_news = learned.proposal is not None
        self._every_s = EVERY_S if has_news else min(GROWTH * self._every_s, SELDOM_S)


def learned_of(work: Work) -> Learned:
    """The calibration of all three sensors, if it is good and better than the active
    params.
    """
    begin_us, scale = work.samples[0].t_us, work.scale
    recording = Gatherer.of(scale, work.samples).recording()
    rest = _rest_of(recording, begin_us) or work.rest
    try:
        base, before = Params.decode(work.base), Params.decode(work.records)
        base.check()
        before.check()
    except ParamsError:
        return Learned(None, rest)
    calibrated, known = _calibrated(recording, base, scale), known_of(base)
    gyr, at = affine_of(base.gyr, scale.gyr_rad_s), rest
    if at is None:
        at, sigma = _rest_in_motion(calibrated, gyr, begin_us)
        if sigma > REST_MAX_RAD_S:
            return Learned(None, None)
        known = replace(known, rest_rad_s=max(sigma, known.rest_rad_s))
    rate = gyr.apply(np.array(at.rate))
    rest_step = (at.t_us - begin_us) / 1e6 / recording.step_s
    made = {"temperature_c": recording.temperature_c, "method": METHOD}
    whole: MotionFit | None = None
    refusal = ""
    for start in _starts(calibrated):
        found = motion.fit(calibrated.since(start), rate, rest_step - start, known)
        if found is not None and not _is_module(found):
            # Shorter parts are not reliable: their priors alone would make them look
            # good.
            return Learned(None, rest)
        if start == 0:
            whole = found
        if found is not None and not _is_even(found):
            refusal = UNEVEN
            continue
        if found is None or not _is_sound(found) or not _is_better(found, before):
            continue
        proposal = _proposal(found, base, before, scale, made)
        if start == 0 or proposal is None or not _is_magnetised(found, whole, proposal):
            return Learned(proposal, rest)
        since_us = begin_us + round(start * recording.step_s * 1e6)
        return Learned(_with_filter_reset(proposal, at, scale), rest, since_us)
    return Learned(None, rest, refusal=refusal)


def _rest_of(recording: SensorRecording, begin_us: int) -> RestRate | None:
    """The mean over all stops."""
    stops = find_stops(recording)
    if not stops:
        return None
    rates = np.concatenate([recording.gyr[stop.start : stop.end] for stop in stops])
    x, y, z = (float(value) for value in rates.mean(axis=0))
    middle = float(np.mean([stop.middle for stop in stops]))
    return RestRate(begin_us + middle * recording.step_s * 1e6, (x, y, z))


def _rest_in_motion(
    calibrated: SensorRecording, gyr: Affine, begin_us: int
) -> tuple[RestRate, float]:
    """The rates at rest, of a recording that never rested, and their one-sigma error,
    rad/s. `gyr`: what it was calibrated with.
    """
    rate, sigma = rate_bias.of_motion(calibrated.gyr, calibrated.acc, calibrated.step_s)
    x, y, z = map(float, np.linalg.solve(gyr.matrix, rate) + gyr.bias)
    return RestRate(begin_us + 5e5 * calibrated.seconds, (x, y, z)), sigma


def _starts(recording: SensorRecording) -> list[int]:
    """The starts of the parts to fit: all of it, then shorter parts."""
    steps = [len(recording) - round(part / recording.step_s) for part in PARTS_S]
    return [0, *(start for start in steps if start > 0)]


def _calibrated(
    recording: SensorRecording, params: Params, scale: Scale
) -> SensorRecording:
    """As the filter has it."""
    return replace(
        recording,
        acc=affine_of(params.acc, scale.acc_m_s2).apply(recording.acc),
        gyr=affine_of(params.gyr, scale.gyr_rad_s).apply(recording.gyr),
        mag=affine_of(params.mag, scale.mag_ut).apply(recording.mag),
    )


def sigma_of(calibration: Calibration | None) -> float | None:
    """The error that a calibration states. None where it states none, or was learned
    itself, mostly from the same samples: then it is the initial guess, but no prior.
    """
    if calibration is None or calibration.method == METHOD:
        return None
    return calibration.sigma


def known_of(params: Params) -> Priors:
    """The prior by the active params."""
    known = Priors()
    acc, gyr, mag = sigma_of(params.acc), sigma_of(params.gyr), sigma_of(params.mag)
    if acc is not None:
        known = replace(known, acc_m_s2=acc, acc_scale=acc / GRAVITY_M_S2)
    if gyr is not None:
        known = replace(known, gyr_scale=gyr, gyr_cross=gyr)
    if mag is not None and params.mag is not None:
        share = mag / (params.mag.norm_ut or 50.0)
        known = replace(known, mag_ut=mag, mag_soft=share, mag_turn_rad=share)
    return known


def _is_module(found: MotionFit) -> bool:
    """Whether accelerometer and gyroscope are plausible for a module."""
    is_usual = float(np.abs(found.acc.bias).max()) < ACC_BIAS_MAX_M_S2
    return is_usual and _is_near(found.acc.matrix) and _is_near(found.gyr.matrix)


def _is_sound(found: MotionFit) -> bool:
    """Whether the magnetometer is, too: a magnet that was put on spoils it until the
    readings from before are left out.
    """
    return _is_near(found.mag.matrix) and of_magnets(found.mag) is None


def _is_even(found: MotionFit) -> bool:
    """Whether what looks like soft iron is that of a module."""
    most = float(np.abs(motion.soft_of(found.mag.matrix)).max())
    prior = Priors().mag_soft
    return most < SOFT_MAX * prior or found.soft_sigma < SOFT_SURE * prior


def _is_magnetised(
    found: MotionFit, whole: MotionFit | None, proposal: Proposal
) -> bool:
    """Whether a magnet was put on within the recording: then the own field of its
    newest part, `found`, is not that of all of it, beyond the error that its
    proposal states. In an uneven room both agree.
    """
    if whole is None or not _is_sound(whole):
        return True
    moved_ut = float(np.linalg.norm(found.mag.bias - whole.mag.bias))
    return moved_ut > MAGNETISED * proposal.sigma_ut


def _is_near(matrix: FloatArray) -> bool:
    return float(np.abs(matrix - np.eye(3)).max()) < AWAY_MAX


def _is_better(found: MotionFit, before: Params) -> bool:
    stated_deg = heading_of(before, found.mag.level_ut)
    return found.heading_deg <= min(HEADING_MAX_DEG, BETTER * stated_deg)


def _proposal(
    found: MotionFit, base: Params, before: Params, scale: Scale, made: dict[str, Any]
) -> Proposal | None:
    """The active params with the fit on top of those of `base`, for each sensor of
    which sigma_of() knows nothing; None: there is none.
    """
    made = made | {"day": datetime.datetime.now(datetime.UTC).date()}
    params = before
    if sigma_of(before.acc) is None:
        sigma = math.radians(found.tilt_deg) * GRAVITY_M_S2 / math.sqrt(2.0)
        stated = {"sigma_m_s2": sigma, "residual_m_s2": found.acc.residual_m_s2}
        own = Affine(found.acc.matrix, found.acc.bias)
        whole = own.after(affine_of(base.acc, scale.acc_m_s2))
        params = with_sensor(params, "acc", whole, scale, made | stated)
    if sigma_of(before.gyr) is None:
        # The filter knows the scales better, and continues to learn them: no sigma.
        cross = found.gyr.matrix - np.diag(np.diag(found.gyr.matrix)) + np.eye(3)
        own = Affine(cross, np.zeros(3))
        whole = own.after(affine_of(base.gyr, scale.gyr_rad_s))
        params = with_sensor(params, "gyr", whole, scale, made)
    if sigma_of(before.mag) is None:
        own = Affine(found.mag.matrix, found.mag.bias)
        whole = own.after(affine_of(base.mag, scale.mag_ut))
        mag = replace(found.mag, matrix=whole.matrix, bias=whole.bias)
        params = with_mag(params, mag, found.field_deg, np.eye(3), scale, made)
    if params == before:
        return None
    params.check()
    sigma_ut = math.radians(found.field_deg) * found.mag.level_ut
    return Proposal(params, found.tilt_deg, found.heading_deg, sigma_ut)


def _with_filter_reset(found: Proposal, rest: RestRate, scale: Scale) -> Proposal:
    """The same with the gyroscope's bias, if it was learned, too. With another bias a
    filter restarts (filter_can_continue), which it should: the samples that do not fit
    have taught it a wrong north and a wrong own field. With the bias it does so in
    motion.
    """
    gyr = found.params.plain("gyr")
    if gyr is None or gyr["method"] != METHOD:
        return found
    bias = [rate / scale.gyr_rad_s for rate in rest.rate]
    params = found.params.replaced("gyr", gyr | {"bias_counts": bias})
    return msgspec.structs.replace(found, params=params)


def heading_of(params: Params, level_ut: float) -> float:
    """The heading's error stated by the active params, degrees."""
    if params.mag is None or params.mag.sigma is None:
        return math.inf
    own = math.degrees(params.mag.sigma / level_ut)
    return math.hypot(TILT_TO_HEADING * stated_tilt_deg(params.acc), own)
