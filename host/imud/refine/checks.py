# SPDX-License-Identifier: MIT
"""What a covariance does not notice: signs that an estimate is wrong, each with the
limit from which on it is withheld.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.refine.model import FIELD, MAG, OWN, PLACE, SPEED, TURN, Recording
from imud.refine.reach import off_by, unseen_of
from imud.refine.window import Window
from imud.rotation import FloatArray

FORCE_LEAST_M_S2 = 3.0
TILT_STEP_DEG, HEADING_STEP_DEG = 0.05, 0.2  # rms, of the last round
UNSEEN_DEG = 0.06  # deg/sqrt(s): turning that the gyroscope did not see
SPEED_M_S, PLACE_M = 60.0, 10_000.0  # rms
BELIEVED = 0.5  # share of the magnetometer's readings
FAR_SIGMAS = 3.0  # of a reading that is not believed, and of a prior
# Sigmas between estimates by the first and by the second half, where they meet. Noise
# stands for much in the model: 99 % of sound recordings are within 1.4 and 0.6.
TILTS_APART, HEADINGS_APART = 1.8, 1.2
RESTS_OFF = 3.0  # sigmas: sound recordings have 1.7 and less
# Of modules that are not calibrated, whose errors are not all in the model: sound ones
# have up to 1.7 and 8.
RAW_HEADINGS_APART, RAW_RESTS_OFF = 2.0, 9.0
VARIED_DEG = 60.0  # from the first attitude, where the magnetometer is not calibrated
OWN_KNOWN_UT = 1.0
ELSEWHERE_DEG = 5.0  # between the fields at the first rest and on the way


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why an estimate is withheld."""

    words: str
    is_of_all: bool = False  # tilt, too, not the heading alone
    is_of_changes: bool = False  # of the heading


def doubts_of(window: Window) -> tuple[Doubt, ...]:
    """All that there are; empty: the estimate can be used."""
    return (*_of_all(window), *_of_heading(window))


def _of_all(window: Window) -> Iterator[Doubt]:
    yield from doubts_of_readings(window.recording)
    step = last_step_deg(window)[:2].max()
    if step > TILT_STEP_DEG:
        yield Doubt(f"the search has not ended: its last step is {step:.2f} deg", True)
    unseen = math.degrees(unseen_of(window))
    if unseen > UNSEEN_DEG:
        yield Doubt(
            f"it turned by {unseen:.2f} deg/sqrt(s) that the gyroscope did not see",
            True,
        )
    is_raw = window.priors.own > OWN_KNOWN_UT
    apart, sigma = window.halves_apart()
    tilt, heading = math.hypot(*apart[:2]), abs(apart[2])
    words = "before and after its middle differ by"
    if tilt > TILTS_APART * math.hypot(*sigma[:2]):
        yield Doubt(f"its tilts {words} {math.degrees(tilt):.0f} deg", True)
    most = (RAW_HEADINGS_APART if is_raw else HEADINGS_APART) * float(sigma[2])
    if heading > most and window.recording.has_mag.any():
        angle = f"{math.degrees(heading):.0f} deg"
        yield Doubt(f"its headings {words} {angle}", is_of_changes=True)
    off = window.rests_off()
    if off > (RAW_RESTS_OFF if is_raw else RESTS_OFF):
        words = f"a rest's rates are {off:.0f} sigmas from what all else tells of them"
        yield Doubt(words, True)
    states = window.estimate.states
    speed, place = (
        math.sqrt((states[:, of] ** 2).sum(axis=1).mean()) for of in (SPEED, PLACE)
    )
    if speed > SPEED_M_S or place > PLACE_M:
        yield Doubt(f"it would have moved at {speed:.0f} m/s, {place:.0f} m far", True)


def _of_heading(window: Window) -> Iterator[Doubt]:
    recording, priors = window.recording, window.priors
    if not recording.has_mag.any():
        yield Doubt("no magnetometer reads a field: its heading is to where it began")
        return
    step = last_step_deg(window)[2]
    if step > HEADING_STEP_DEG:
        yield Doubt(f"its heading is not told: the last step is {step:.2f} deg")
    believed = believed_share(window)
    if believed < BELIEVED:
        yield Doubt(f"{believed:.0%} of the magnetometer's readings fit")
    if (away := elsewhere_deg(window)) > ELSEWHERE_DEG:
        yield Doubt(
            f"the field where it lay first points {away:.0f} deg away from that of "
            "its way"
        )
    own = float(np.abs(window.estimate.states[0, OWN]).max())
    if priors.own < OWN_KNOWN_UT:
        if math.hypot(off_by(window, MAG), own / priors.own) > FAR_SIGMAS:
            yield Doubt(
                "the magnetometer's calibration does not fit, or the field where it "
                "lay first is not that of the place",
                is_of_changes=True,
            )
    elif (varied := varied_deg(window)) < VARIED_DEG:
        yield Doubt(
            f"the magnetometer is not calibrated, and turned by {varied:.0f} deg only"
        )


def doubts_of_readings(recording: Recording) -> Iterator[Doubt]:
    """What is wrong with a sensor, whatever the estimate."""
    force = float(np.median(np.linalg.norm(recording.acc, axis=1)))
    if force < FORCE_LEAST_M_S2:
        yield Doubt(f"the accelerometer reads {force:.1f} m/s2 only", True)
    mag = recording.mag[recording.has_mag]
    for name, rows, is_of_all in (
        ("gyroscope", recording.gyr, True),
        ("accelerometer", recording.acc, True),
        ("magnetometer", mag, False),
    ):
        is_stuck = np.ptp(rows, axis=0) == 0.0 if len(rows) else np.zeros(3, bool)
        if is_stuck.any():
            axis = "xyz"[int(np.argmax(is_stuck))]
            words = f"the {name}'s {axis} axis reads the same all the time"
            yield Doubt(words, is_of_all)


def last_step_deg(window: Window) -> FloatArray:
    """The last round's, rms, about east, north and up."""
    steps = window.solution.step[:, TURN]
    return np.asarray(np.degrees(np.sqrt((steps**2).mean(axis=0))))


def believed_share(window: Window) -> float:
    """Of the intervals with readings of the field, those near what was expected."""
    rows = window.intervals(slice(0, window.recording.count)).field()
    has = rows.weight > 0.0
    off2 = (rows.away[has] ** 2).sum(axis=1) / window.priors.mag_noise**2
    return float((off2 < FAR_SIGMAS**2).mean()) if has.any() else 0.0


def elsewhere_deg(window: Window) -> float:
    """Between north, where the field points at the first rest, and where it points on
    the average.
    """
    east, north, _ = window.estimate.states[:, FIELD].mean(axis=0).tolist()
    return abs(math.degrees(math.atan2(east, north)))


def varied_deg(window: Window) -> float:
    """How far it has turned from where it began, about any axis."""
    nodes = window.course.nodes
    turns = rotation.multiply(nodes, rotation.inverse(nodes[:1]))
    return math.degrees(2.0 * math.acos(min(1.0, float(np.abs(turns[:, 0]).min()))))
