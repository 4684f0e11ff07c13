# SPDX-License-Identifier: MIT
"""Free waves of the magnetometer, and the check of an old calibration."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from benchmarks.calibration.simulated import errors, recorded, samples
from imud.calibration.affine import Affine
from imud.calibration.algebra import units
from imud.calibration.faults import CalibrationFault
from imud.calibration.guided import verify, wave, whole
from imud.calibration.guided.result import result_of_fit, result_of_wave
from imud.calibration.guided.verify import Report, Verify
from imud.calibration.guided.wave import Wave, Waving
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.poses import TWELVE
from imud.calibration.recording import Sample
from imud.calibration.score import stated_tilt_deg
from imud.params.value import Params
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE, Manners
from imud.virtual.modules import shop
from imud.virtual.motions.module import Module

SAME = Affine(np.eye(3), np.zeros(3))


@cache
def module(seed: int = 1) -> Module:
    return shop(np.random.default_rng([seed, 79]), warm_degc=0.0)


@cache
def guided() -> ModuleFit:
    found = whole.fit(recorded(samples(module(), 2)))
    assert found is not None
    return found


@cache
def waved() -> tuple[Sample, ...]:
    """Half a minute in the air, without a stop."""
    ups = list(units(np.random.default_rng(3).standard_normal((21, 3))))
    manners = Manners(stop_s=0.02, move_s=1.5, is_held=True, swerve_rad=0.6)
    return tuple(samples(module(), 3, ups, manners))


def test_a_wave_finds_the_magnetometer_with_the_aid_of_the_others() -> None:
    acc = Affine(guided().acc.matrix, guided().acc.bias)
    gyr = Affine(guided().gyr.matrix, guided().gyr.bias)
    found = wave.fit(recorded(waved()), acc, gyr, 0.05)
    mag = Affine(found.mag.matrix, found.mag.bias)
    left = errors(module(), acc, mag)["heading"]
    assert left < 0.4
    assert 0.3 * left < found.heading_deg < 1.0
    alone = wave.fit(recorded(waved()), SAME, SAME, stated_tilt_deg(None))
    worse = errors(module(), SAME, Affine(alone.mag.matrix, alone.mag.bias))
    assert worse["heading"] > 2.0 * left
    assert alone.heading_deg > 2.0


def test_waving_ends_when_it_is_good() -> None:
    acc = Affine(guided().acc.matrix, guided().acc.bias)
    gyr = Affine(guided().gyr.matrix, guided().gyr.bias)
    waving = Waving(SCALE, acc, gyr, 0.05)
    assert "Wave it slowly" in waving.instruction
    found = next(filter(None, map(waving.feed, waved())))
    assert isinstance(found, Wave)
    assert 20.0 <= waving.seconds < 32.0
    assert "Heading error +-" in waving.instruction
    params = result_of_wave(found, SCALE, Params()).params
    assert params.acc is None
    assert params.mag.method == "wave"


def test_a_wave_that_only_rocks_is_refused() -> None:
    random = np.random.default_rng(5)
    ups = units(np.append(random.normal(0.0, 0.1, (21, 2)), np.ones((21, 1)), axis=1))
    manners = Manners(stop_s=0.02, move_s=1.5, is_held=True, swerve_rad=0.05)
    waving = Waving(SCALE, SAME, SAME, 2.0)
    for each in samples(module(), 5, list(ups), manners):
        waving.feed(each)
    refused = waving.end()
    assert isinstance(refused, CalibrationFault)
    assert refused.cure
    assert isinstance(Waving(SCALE, SAME, SAME, 2.0).end(), CalibrationFault)


def checked(of: Module, params: Params, ups: list[FloatArray]) -> Report | None:
    check = Verify(SCALE, params)
    for each in samples(of, 6, ups):
        if (report := check.feed(each)) is not None:
            return report
    return None


def test_an_old_calibration_is_verified_in_ten_seconds() -> None:
    params = result_of_fit(guided(), SCALE, Params()).params
    ups = [TWELVE[0].up, TWELVE[1].up, TWELVE[2].up]
    good = checked(module(), params, ups)
    assert good.is_good
    other = checked(module(2), params, ups)
    assert not other.is_good
    assert {each.sensor for each in other.findings if each.verdict == "bad"} >= {"acc"}
    none = checked(module(), Params(), ups)
    assert {each.verdict for each in none.findings} == {"not calibrated"}


def test_a_bent_gyroscope_and_a_magnet_are_seen() -> None:
    params = result_of_fit(guided(), SCALE, Params()).params
    ups = [TWELVE[0].up, TWELVE[1].up, TWELVE[2].up]
    bent = checked(replace(module(), gyr=1.05 * module().gyr), params, ups)
    assert [each.verdict for each in bent.findings] == ["good", "bad", "good"]
    own = module().mag_bias + np.array([5.0, 0.0, 0.0])
    magnet = checked(replace(module(), mag_bias=own), params, ups)
    assert [each.verdict for each in magnet.findings] == ["good", "good", "bad"]


def test_a_probe_that_is_not_turned_over_tells_nothing() -> None:
    params = result_of_fit(guided(), SCALE, Params()).params
    check = Verify(SCALE, params)
    assert check.instruction == "Lay it still."
    for each in samples(module(), 7, [TWELVE[0].up] * 4):
        assert check.feed(each) is None
    assert "turn it over" in check.instruction
    report = verify.report(
        recorded(samples(module(), 7, [TWELVE[0].up])), SCALE, params
    )
    assert {each.verdict for each in report.findings} == {"not seen"}
