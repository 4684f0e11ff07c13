# SPDX-License-Identifier: MIT
"""The tip from a wobble in a dimple: where it is, how sure that is, what is refused."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from msgspec.structs import replace

from imud import rotation
from imud.calibration.faults import CalibrationFault
from imud.calibration.recording import Sample
from imud.calibration.tip import dimple
from imud.calibration.tip import guide as tip_guide
from imud.calibration.tip.guide import Dimpling
from imud.calibration.tip.score import INSIDE, trust_of
from imud.calibration.tip_found import TipFound
from imud.gravity import GRAVITY_M_S2
from imud.params.value import Params
from imud.virtual.calibrating import SCALE
from imud.virtual.dimpling import Wobble
from wobbled import CALIBRATED, TIP, exact, readings, wobbled

# It is held still for so long before the wobble.
BEFORE_S = Wobble().still_s + Wobble().pause_s


@pytest.fixture(autouse=True)
def _seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    # Fits take most of the time.
    monkeypatch.setattr(tip_guide, "FIT_S", 2.5)


def guided(samples: Sequence[Sample], params: Params = CALIBRATED) -> Dimpling:
    """A guide that has heard all samples, or is over."""
    guide = Dimpling(SCALE, params)
    for sample in samples:
        if guide.feed(sample) is not None:
            break
    return guide


@pytest.mark.parametrize("wobble", [Wobble(), Wobble(give=0.03), Wobble(slip_m=1e-3)])
def test_the_hand_moves_as_its_sensors_say(wobble: Wobble) -> None:
    motion = exact(wobble, 12.0)
    rate_hz = motion.rate_hz
    acceleration = (motion.velocity[2:] - motion.velocity[:-2]) * rate_hz / 2.0
    felt = rotation.rotate(motion.quat, motion.acc)[1:-1]
    assert np.abs(acceleration).max() > 1.0
    up = np.array([0.0, 0.0, GRAVITY_M_S2])
    # 4 ms of 10 Hz.
    assert np.abs(acceleration + up - felt).max() < 0.02
    turned = rotation.multiply(rotation.inverse(motion.quat[:-2]), motion.quat[2:])
    rate = rotation.to_rotation_vector(turned) * rate_hz / 2.0
    assert np.abs(rate - motion.gyr[1:-1]).max() < 1e-3


# No noise and no tremor.
CLEAN = Wobble(support=None)


def test_without_noise_the_tip_is_found_to_a_tenth_of_a_millimetre() -> None:
    force, rate, step_s = readings(exact(CLEAN, 20.0))
    begin = round((BEFORE_S - 1.0) / step_s)
    fit = dimple.fit(force[begin:], rate[begin:], step_s, trust_of(CALIBRATED))
    assert np.linalg.norm(fit.offset_m - TIP) < 1e-4
    assert fit.gravity_m_s2 == pytest.approx(GRAVITY_M_S2, abs=0.003)


def test_a_bias_of_the_gyroscope_a_scale_and_a_delay_are_found_with_it() -> None:
    force, rate, step_s = readings(exact(CLEAN, 24.0))
    begin = round((BEFORE_S - 1.0) / step_s)
    rate = 1.008 * rate + np.radians([0.5, -0.4, 0.3])
    force, rate = force[begin - 1 : -1], rate[begin:]  # 4 ms late
    fit = dimple.fit(force, rate, step_s)
    assert np.linalg.norm(fit.offset_m - TIP) < 5e-4


def test_too_few_blocks_say_nothing() -> None:
    assert dimple.fit(np.ones((300, 3)), np.zeros((300, 3)), 0.01) is None


def test_a_good_wobble_is_done_after_15_s_and_right() -> None:
    guide = Dimpling(SCALE, CALIBRATED)
    instructions = {guide.status().instruction}
    found = None
    for sample in wobbled(Wobble(), 26.0):
        found = guide.feed(sample)
        instructions.add(guide.instruction)
        if found is not None:
            break
    assert isinstance(found, TipFound)
    error_m = float(np.linalg.norm(found.offset_m - TIP))
    assert error_m < 0.001
    assert error_m < INSIDE * found.sigma_m < 0.0015
    assert found.seconds == pytest.approx(15.0, abs=3.0)
    status = guide.status()
    assert (status.phase, status.instruction, status.is_good) == ("done", "Done.", True)
    assert min(status.leans_deg) > 12.0
    assert len(instructions) == 3  # stand, wobble, done
    assert guide.feed(sample) is None  # it is over


WEAK = {
    "slips": (Wobble(slip_m=1e-3), "the tip slips"),
    "base_gives": (Wobble(give=0.04), "the base is soft"),
    "slow": (Wobble(hz=0.25), "faster"),
    "one_direction": (Wobble(directions=1, swing_deg=10.0), "two directions"),
    "small": (Wobble(swing_deg=6.0), "lean it further"),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", WEAK)
def test_a_weak_wobble_is_reported_and_refused_with_a_remedy(kind: str) -> None:
    wobble, words = WEAK[kind]
    guide = guided(wobbled(wobble, 27.0))
    assert guide.trouble.kind == kind
    assert words in (guide.status().trouble or "")
    refused = guide.end()
    assert isinstance(refused, CalibrationFault)
    assert refused.kind == kind
    assert guide.status().instruction == "Refused."


def test_it_is_refused_at_the_second_rest_of_a_tip_that_slips() -> None:
    slipping = wobbled(Wobble(slip_m=1e-3, wobble_s=8.0), 30.0)
    guide = guided(slipping)
    assert guide.phase == "refused"
    assert guide.trouble.kind == "slips"


def test_a_tip_that_slipped_may_be_held_still_and_wobbled_again() -> None:
    slipping = wobbled(Wobble(slip_m=1e-3, wobble_s=8.0), 17.0)
    late = slipping[-1].t_us
    held = wobbled(Wobble(), 27.0, seed=3)
    again = [replace(each, t_us=each.t_us + late) for each in held]
    guide = guided([*slipping, *again])
    assert guide.phase == "done"
    assert np.linalg.norm(guide.fit.offset_m - TIP) < 0.001


@pytest.mark.parametrize("wobble", [Wobble(), Wobble(slip_m=1e-3)])
def test_an_uncalibrated_probe_is_sent_to_be_calibrated(wobble: Wobble) -> None:
    # What its sensors leave over may look like a tip that slips.
    guide = guided(wobbled(wobble, 24.0), Params())
    refused = guide.end()
    assert isinstance(refused, CalibrationFault)
    assert "calibrate them first: imud calibrate" in str(refused)


def test_a_wobble_ended_early_is_too_short() -> None:
    refused = guided(wobbled(Wobble(), 26.0)[:1200]).end()
    assert isinstance(refused, CalibrationFault)
    assert refused.kind == "too_short"
    assert isinstance(Dimpling(SCALE, CALIBRATED).end(), CalibrationFault)


@pytest.mark.parametrize("kind", ["clipped", "gap"])
def test_clipped_or_lost_samples_restart_it(kind: str) -> None:
    samples = list(wobbled(Wobble(), 26.0)[:1500])
    if kind == "gap":
        del samples[1400:1430]
    else:
        samples[1450] = replace(samples[1450], is_clipped=True)
    guide = guided(samples)
    assert guide.phase == "stand"
    assert guide.trouble.kind == kind


def test_the_noise_of_readings_is_found_under_slow_motion() -> None:
    random = np.random.default_rng(4)
    slow = 3.0 * np.sin(np.arange(4000)[:, None] / 100.0 + np.arange(3))
    noise = dimple.noise_of(slow + 0.05 * random.standard_normal((4000, 3)))
    assert noise / dimple.RED == pytest.approx(0.05, rel=0.05)


def test_a_status_has_a_lean_for_each_direction() -> None:
    status = Dimpling(SCALE, CALIBRATED).status()
    assert len(status.leans_deg) == 8
    assert status.seconds == 0.0
    assert math.isclose(status.of_seconds, tip_guide.LEAST_S)
