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
from imud.calibration.recording import (
    GAP_S,
    Gatherer,
    Sample,
    Scale,
    SensorRecording,
    is_clipped,
)
from imud.calibration.score import TILT_TO_HEADING, stated_tilt_deg
from imud.calibration.stops import find_stops
from imud.errors import ParamsError
from imud.gravity import GRAVITY_M_S2
from imud.params.learned import METHOD, filter_can_continue
from imud.params.value import SENSORS, Calibration, Params
from imud.refine.checks import HEADING_STEP_DEG, doubts_of, last_step_deg
from imud.refine.found import Found, found_by, taken
from imud.refine.known import priors_of
from imud.refine.model import NORTH, OWN, Priors, Recording
from imud.refine.reach import searched, settled
from imud.refine.window import Window
from imud.rotation import FloatArray

WINDOW_S = 60.0  # of the latest samples
LEAST_S = 20.0
EVERY_S, SELDOM_S, GROWTH = 4.0, 60.0, 1.15  # between two fits; without news
TURNED_RAD = math.pi  # since the last fit, at least: a probe at rest shows nothing new

# Limit of the heading's error, and how much smaller it must be than that of the active
# calibration.
HEADING_MAX_DEG = 7.0
BETTER = 0.9
# Beyond these it is no module of ours, or the motion was no motion of a hand.
AWAY_MAX = 0.15  # of an entry of a matrix
# Of the gyroscope's bias: what a rest shows, and what only motion shows at most.
REST_RAD_S, REST_MAX_RAD_S = math.radians(0.06), math.radians(2.0)
# Sigmas by which the own field moves where a magnet was put on or taken off.
MAGNETISED = 5.0
LEVEL_MIN_UT = 5.0  # of a field that shows a heading
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
    calibrated, gyr = _calibrated(recording, base, scale), base.gyr
    affine = affine_of(gyr, scale.gyr_rad_s)
    at, sigma = rest, REST_RAD_S
    if at is None:
        at, sigma = _rest_in_motion(calibrated, affine, begin_us)
        if sigma > REST_MAX_RAD_S:
            return Learned(None, None)
    rate = affine.apply(np.array(at.rate))
    priors = replace(known_of(base), bias=max(sigma, REST_RAD_S))
    window = fitted(calibrated, rate, priors)
    if window is None:
        return Learned(None, rest)
    found = found_by(window, calibrated.mag_early_s)
    if not _is_module(found) or not _is_better(found, before):
        return Learned(None, rest)
    made = {"temperature_c": recording.temperature_c}
    proposal = _proposal(found, base, before, scale, made)
    last = _magnetised_until(window, found)
    if proposal is None or last is None:
        return Learned(proposal, rest)
    since_us = begin_us + round((last + 1) * window.recording.node_s * 1e6)
    return Learned(_with_filter_reset(proposal, at, scale), rest, since_us)


def fitted(
    recording: SensorRecording, rest_rad_s: FloatArray, priors: Priors
) -> Window | None:
    """The window of a recording in motion; None if it does not determine its sensors.
    `rest_rad_s`: the gyroscope's bias at a rest.
    """
    if recording.seconds < LEAST_S or recording.breaks:
        return None
    samples = Recording(
        1.0 / recording.step_s, recording.gyr - rest_rad_s, recording.acc, recording.mag
    )
    try:
        with np.errstate(all="ignore"):  # what is not finite ends the search
            window = searched(samples, priors)
            if doubts_of(window):
                return None
            window = settled(window)
    except np.linalg.LinAlgError:
        return None
    is_found = last_step_deg(window)[2] < HEADING_STEP_DEG
    is_field = float(window.estimate.whole[NORTH][0]) > LEVEL_MIN_UT
    return window if is_found and is_field else None


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
    """The priors by the params, without what was learned."""
    for name in SENSORS:
        if sigma_of(params.calibration(name)) is None:
            params = params.without(name)
    return priors_of(params)


def _is_module(found: Found) -> bool:
    """Whether all three sensors are plausible for a module."""
    is_usual = float(np.abs(found.acc.bias).max()) < ACC_BIAS_MAX_M_S2
    sensors = (found.acc, found.gyr, found.mag)
    is_near = all(
        float(np.abs(each.matrix - np.eye(3)).max()) < AWAY_MAX for each in sensors
    )
    return is_usual and is_near and of_magnets(found.mag.bias, found.norm_ut) is None


def _magnetised_until(window: Window, found: Found) -> int | None:
    """The last interval before a magnet was put on or taken off; None: there was none.
    In an uneven room the own field stays.
    """
    own = window.estimate.states[:, OWN]
    moved_ut = np.linalg.norm(own - own[-1], axis=1)
    other = np.flatnonzero(moved_ut > MAGNETISED * found.own_sigma_ut)
    return int(other[-1]) if len(other) else None


def _is_better(found: Found, before: Params) -> bool:
    stated_deg = heading_of(before, found.north_ut)
    return found.heading_deg <= min(HEADING_MAX_DEG, BETTER * stated_deg)


def _proposal(
    found: Found, base: Params, before: Params, scale: Scale, made: dict[str, Any]
) -> Proposal | None:
    """The active params with the fit on top of those of `base`, for each sensor of
    which sigma_of() knows nothing; None: there is none.
    """
    made = made | {"day": datetime.datetime.now(datetime.UTC).date()}
    names = [name for name in SENSORS if sigma_of(before.calibration(name)) is None]
    # The filter knows the scales better, and continues to learn them: no sigma.
    cross = found.gyr.matrix - np.diag(np.diag(found.gyr.matrix)) + np.eye(3)
    kept = replace(found, gyr=Affine(cross, np.zeros(3)), gyr_sigma=None)
    params = taken(before, names, kept, base, scale, made)
    if params == before:
        return None
    return Proposal(params, found.tilt_deg, found.heading_deg, found.own_sigma_ut)


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
