# SPDX-License-Identifier: MIT
"""What two calibrations at two temperatures tell of an accelerometer's drift."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from imud.calibration.drift import DRIFT_MAX_M_S2_K, MG, drift_of
from imud.calibration.guided import whole
from imud.calibration.guided.result import result_of_fit
from imud.params.condition import DRIFT_M_S2_K
from imud.params.value import Calibration, Params
from imud.virtual.calibrating import SCALE
from imud.virtual.motions.module import Module

from .test_fit import UPS, module, recorded, samples

COUNT = 0.002  # m/s2
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def found_at(degc: float | None, bias_mg: tuple[float, float, float]) -> Calibration:
    x, y, z = (MG * each / COUNT for each in bias_mg)
    return Calibration(
        bias_counts=(x, y, z), matrix=IDENTITY, sigma=0.7 * MG, temperature_c=degc
    )


COLD = found_at(20.0, (10.0, -5.0, 30.0))


def learned_mg_k(after: Calibration, before: Calibration | None = COLD) -> float | None:
    drift = drift_of(before, after, COUNT)
    return None if drift is None else drift / MG


@pytest.mark.parametrize("apart_k", [30.0, -30.0])
def test_two_temperatures_tell_a_slope_and_how_sure_it_is(apart_k: float) -> None:
    calm = found_at(20.0 + apart_k, (16.0, -2.0, 24.0))
    slopes = math.sqrt((6.0**2 + 3.0**2 + 6.0**2) / 3.0) / 30.0
    unsure = math.hypot(0.7, 0.7, 2.0) / 30.0
    expected = pytest.approx(math.hypot(slopes, unsure), rel=0.02)
    assert learned_mg_k(calm) == expected
    wild = found_at(20.0 + apart_k, (55.0, -50.0, 75.0))
    assert learned_mg_k(wild) == pytest.approx(1.5, rel=0.02)


def test_one_temperature_tells_nothing() -> None:
    for degc in (20.0, 20.1):
        again = learned_mg_k(found_at(degc, (10.0, -5.0, 30.0)))
        assert again == pytest.approx(DRIFT_M_S2_K / MG, rel=0.002)
    assert learned_mg_k(COLD, None) is None
    moved = (30.0, 5.0, 30.0)  # by 20 mg: not by 0.1 K
    assert learned_mg_k(found_at(20.1, moved)) is None


def test_what_is_not_known_leaves_what_was() -> None:
    known = msgspec.structs.replace(COLD, drift_m_s2_k=0.3 * MG)
    for after in (
        found_at(None, (0.0, 0.0, 0.0)),
        msgspec.structs.replace(found_at(50.0, (0.0, 0.0, 0.0)), sigma=None),
        found_at(50.0, (400.0, 0.0, 0.0)),  # another module, or it was knocked
    ):
        assert learned_mg_k(after, known) == pytest.approx(0.3)


def test_a_third_calibration_keeps_what_two_have_told() -> None:
    known = msgspec.structs.replace(COLD, drift_m_s2_k=0.2 * MG)
    near = learned_mg_k(found_at(22.0, (10.3, -5.0, 30.0)), known)
    assert near == pytest.approx(0.2, rel=0.05)
    far = learned_mg_k(found_at(60.0, (70.0, -5.0, 30.0)), known)
    assert 0.6 < far < 60.0 / 40.0 / math.sqrt(3.0)


def test_a_third_calibration_may_contradict_what_two_have_told() -> None:
    known = msgspec.structs.replace(COLD, drift_m_s2_k=0.08 * MG)
    far = learned_mg_k(found_at(50.0, (22.0, -17.0, 42.0)), known)  # 0.4 mg/K
    assert far == pytest.approx(0.4, rel=0.05)


def test_no_drift_is_larger_than_the_wire_can_say() -> None:
    assert drift_of(COLD, found_at(30.0, (50.0, 35.0, 60.0)), COUNT) == DRIFT_MAX_M_S2_K


@pytest.mark.parametrize("slopes_mg_k", [(0.8, -1.4, 0.5), (0.1, 0.05, -0.1)])
def test_what_is_learned_holds_at_a_third_temperature(slopes_mg_k) -> None:
    """Of two guided calibrations 25 K apart, with their noise; at 30 K from the later
    one the accelerometer's error is inside what is stated of it.
    """
    slopes = np.array(slopes_mg_k) * MG
    params = Params()
    for degc in (20.0, 45.0):
        warm: Module = replace(
            module(3), acc_bias=module(3).acc_bias + slopes * (degc - 20.0)
        )
        fit = whole.fit(recorded(samples(warm, round(degc), UPS)))
        assert fit is not None
        fit = replace(fit, temperature_c=degc)
        params = result_of_fit(fit, SCALE, params).params
        if degc == 20.0:
            assert params.acc.drift_m_s2_k is None
    drift = params.acc.drift_m_s2_k
    rms = float(np.sqrt(np.mean(slopes**2)))
    assert rms * 0.9 < drift < rms + 0.1 * MG
