# SPDX-License-Identifier: MIT
"""`imud calibrate learned --from FILE`: what free motion in a file tells of a module,
by the estimate of all of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from imud.calibration.affine import affine_of
from imud.calibration.recording import Gatherer, Sample, Scale, SensorRecording
from imud.calibration.result import CalibrationResult
from imud.calibration.score import HEADING_MAX_DEG
from imud.cli.calibrate_refusal import CalibrationRefused, today
from imud.cli.calibrate_source import CalibratedProbe
from imud.params.condition import TITLES
from imud.params.value import SENSORS, Params
from imud.progress import Progress
from imud.refine.found import Found, found_by, proposed
from imud.refine.known import priors_of
from imud.refine.model import Recording
from imud.refine.reach import settled
from imud.refine.whole import parts_of
from imud.refine.window import Window

LEAST_S = 20.0
CURES = {
    "acc": "turn it slowly until each side was up",
    "gyr": "turn it about each of its axes, with rests between",
    "mag": "turn it every way, away from iron",
}


def of_samples(
    subject: CalibratedProbe, samples: Sequence[Sample]
) -> CalibrationResult:
    """CalibrationRefused if they tell of no sensor."""
    before, scale = subject.params, subject.scale
    recording = Gatherer.of(scale, samples).recording()
    if recording.seconds < LEAST_S:
        raise CalibrationRefused(
            f"refused: {recording.seconds:.0f} s of samples without a pause are too "
            f"few; record {LEAST_S:.0f} s and more, while you turn the probe every way"
        )
    window = settled(_searched(recording, scale, before))
    found = found_by(window, recording.mag_early_s)
    made = {"day": today(), "temperature_c": recording.temperature_c}
    params = proposed(found, window.priors, before, scale, made)
    names = tuple(name for name in SENSORS if params.plain(name) != before.plain(name))
    missing = tuple(_missing(found, names))
    if not names:
        raise CalibrationRefused(f"refused: nothing better than before; {missing[0]}")
    return CalibrationResult(
        params,
        names,
        seconds=recording.seconds,
        temperature_c=recording.temperature_c,
        tilt_deg=found.tilt_deg if "acc" in names else None,
        heading_deg=found.heading_deg if "mag" in names else None,
        level_ut=found.north_ut,
        missing=missing,
    )


def _missing(found: Found, names: Sequence[str]) -> Iterator[str]:
    """What it may not be used for, and what would help."""
    for name in SENSORS:
        if name not in names:
            yield f"{TITLES[name]}: left as it is; {CURES[name]}"
    if "mag" in names and found.heading_deg > HEADING_MAX_DEG:
        yield (
            f"a heading better than {HEADING_MAX_DEG:g} degrees: turn it for longer, "
            "away from iron, or calibrate it with imud calibrate"
        )


def _searched(recording: SensorRecording, scale: Scale, params: Params) -> Window:
    """The last window of all, which knows what was before it."""
    is_bad = np.zeros(len(recording), bool)
    is_bad[[at for at in recording.breaks if at < len(recording)]] = True
    readings = Recording(
        1.0 / recording.step_s,
        affine_of(params.gyr, scale.gyr_rad_s).apply(recording.gyr),
        affine_of(params.acc, scale.acc_m_s2).apply(recording.acc),
        affine_of(params.mag, scale.mag_ut).apply(recording.mag),
        is_bad,
    )
    last: list[Window] = []
    bar = Progress("estimating", 1)
    try:
        for part, window in parts_of(readings, priors_of(params), tell=bar.update):
            if part.doubts or window is None:
                raise CalibrationRefused(f"refused: {part.doubts[0].words}")
            last = [window]
    finally:
        bar.end()
    return last[0]
