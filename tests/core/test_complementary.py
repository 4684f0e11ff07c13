# SPDX-License-Identifier: MIT
"""The thesis' noise and complementary filters against its equations in doubles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, FIELD, FORCE, ONE, RATE, Array, G
from core.doubles import BIAS_DEG_S, UPSIDE_DOWN, WILD_S, rms, unit, wild
from core.scenes import Attitude, Scene, at_rest, scene, tumble
from core.test_fuse import STARTS
from imud import rotation

pytestmark = pytest.mark.sampled(4)

# Table I: NP, NPS, NPL, with what a count is.
FORCE_NOISE = (200 * G / 16384, 150 * G / 16384, 0.025)
FIELD_NOISE = (3 * 0.6, 3 * 0.6, 0.025)
RATE_NOISE = 30 / 131  # deg/s


def filtered(value: float, before: float, noise: tuple[float, float, float]) -> float:
    """The noise filter of section 6, as its lines are printed."""
    np_, nps, npl = noise
    if value < before - np_ or value > before + np_:
        return value
    if value < before - nps or value > before + nps:
        return (value + before) / 2
    return (1 - npl) * before + npl * value


def doubles(
    felt: Scene, biases: dict[int, tuple[float, float, float]], alpha: float = 0.9
) -> Array:
    """Equations 7.1 to 7.8, in degrees as the thesis has them."""
    rows = felt.measurements()
    out = np.zeros((len(felt), 4))
    roll = pitch = yaw = 0.0
    force: list[float] = []
    field: list[float] = []
    bias = np.zeros(3)
    for i, row in enumerate(rows):
        bias = np.array(biases.get(i, bias))
        measured = (row["acc_m_s2_q21"] / FORCE).tolist()
        is_first = not force
        force = [
            filtered(new, old, FORCE_NOISE)
            for new, old in zip(measured, force or measured, strict=True)
        ]
        ax, ay, az = force
        a_roll = math.degrees(math.atan2(ay, math.hypot(ax, az)))
        a_pitch = math.degrees(math.atan2(-ax, math.hypot(ay, az)))
        rate = row["gyr_rad_s_q25"] / RATE / DEGREE - bias
        rate = np.where(np.abs(rate) > RATE_NOISE, rate, 0.0)
        if is_first:
            roll, pitch = a_roll, a_pitch
        else:
            seconds = felt.interval_us[i] / 1e6
            roll = alpha * (rate[0] * seconds + roll) + (1 - alpha) * a_roll
            pitch = alpha * (rate[1] * seconds + pitch) + (1 - alpha) * a_pitch
        if row["has_mag"]:
            reading = (row["mag_ut_q18"] / FIELD).tolist()
            field = [
                filtered(new, old, FIELD_NOISE)
                for new, old in zip(reading, field or reading, strict=True)
            ]
            mx, my, mz = unit(np.array(field))
            r, p = math.radians(roll), math.radians(pitch)
            magx = mz * math.sin(r) - my * math.cos(r)
            magy = (
                mx * math.cos(p)
                + my * math.sin(p) * math.sin(r)
                + mz * math.sin(p) * math.cos(r)
            )
            yaw = math.degrees(math.atan2(magx, magy))
        angles = math.radians(yaw + 90), math.radians(pitch), math.radians(roll)
        out[i] = rotation.from_heading_pitch_roll(*angles)
    return out


def apart(felt: Scene, alpha: float = 0.9) -> tuple[Array, Array]:
    told = 3 * felt.rate_hz
    fixed = Attitude("complementary", felt.rate_hz)
    before, _ = fixed.feel(felt[:told])
    fixed.set_bias(BIAS_DEG_S)
    after, _ = fixed.feel(felt[told:])
    found = np.concatenate([before, after])
    return desk.apart_deg(found, doubles(felt, {told: BIAS_DEG_S}, alpha)), found


@pytest.mark.long
@pytest.mark.parametrize(
    ("rate_hz", "start", "dip_deg", "sway_m_s2"),
    [
        (200, rotation.IDENTITY, 66, 1.0),
        (200, rotation.IDENTITY, 66, 0.05),
        (200, UPSIDE_DOWN, 85, 1.0),
        (100, UPSIDE_DOWN, 66, 1.0),
        (380, rotation.IDENTITY, 66, 1.0),
    ],
)
def test_fixed_point_is_within_0_002_degrees_of_doubles(
    rate_hz, start, dip_deg, sway_m_s2
):
    felt = wild(rate_hz, WILD_S, 5, start=start, dip_deg=dip_deg, sway_m_s2=sway_m_s2)
    away, found = apart(felt)
    assert rms(away) < 0.002
    assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-8


@pytest.mark.nightly
def test_the_comparison_would_see_another_alpha():
    away, _ = apart(wild(200, 15, 5), alpha=0.905)
    assert rms(away) > 0.05


@pytest.mark.parametrize("start", STARTS, ids=lambda q: str(np.round(q, 2)))
def test_every_start_but_those_upside_down_is_known_at_once(start):
    felt = scene(at_rest(5, 200, start), 200, seed=1)
    found, _ = Attitude("complementary").feel(felt)
    tilt = desk.tilt_deg(found, felt.quat)
    if rotation.rotate(rotation.inverse(start), np.array([0, 0, 1.0]))[2] < -0.5:
        # Equation 7.2 gives a roll within a quarter turn.
        assert tilt[200:].min() > 170
    else:
        assert tilt.max() < 3
        assert desk.apart_deg(found, felt.quat)[200:].max() < 8


def test_roll_is_not_quite_a_roll_where_there_is_pitch_as_well():
    felt = scene(
        at_rest(1, quat=rotation.from_heading_pitch_roll(0, 0.3, 0.4)), 200, noise=0
    )
    found, _ = Attitude("complementary").feel(felt)
    assert desk.tilt_deg(found, felt.quat) == pytest.approx(1.03, abs=0.01)


def test_a_gentle_turn_of_the_heading_is_told_by_the_field_alone():
    quat = rotation.from_rotation_vector(
        np.linspace(0, 1, 2000)[:, None] * np.array([0, 0, 2.5])
    )
    felt = scene(quat, 200, noise=0)
    felt.gyr[:] = 0
    found, _ = Attitude("complementary").feel(felt)
    # The low-pass holds a change below 1.8 uT back: 5 degrees of the 20 uT that lie.
    assert desk.heading_deg(found, felt.quat)[1:].max() < 6


def held(change_counts: float, lsb: float, scale: float, name: str) -> Array:
    """The filter's state after a first value of nothing and a second one."""
    felt = scene(at_rest(0.02), 200, noise=0)
    felt.has_mag[:] = True
    for rows in (felt.acc, felt.mag):
        rows[:] = (0.0, 0.0, 1.0)
        rows[1:, 0] = change_counts * lsb
    probe = Attitude("complementary")
    probe.run(felt.measurements()[:2], felt.interval_us[:2])
    return np.array(getattr(probe.c.complementary, name).x / scale / lsb)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(
    ("counts", "share"), [(149, 0.025), (151, 0.5), (199, 0.5), (201, 1.0)]
)
def test_a_force_passes_wholly_half_or_hardly_by_table_1(counts, share, sign):
    found = held(sign * counts, G / 16384, FORCE, "force_m_s2_q21")
    assert found == pytest.approx(sign * counts * share, abs=0.01)


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("counts", "share"), [(2.99, 0.025), (3.01, 1.0)])
def test_a_field_passes_wholly_or_hardly_by_table_1(counts, share, sign):
    found = held(sign * counts, 0.6, FIELD, "field_ut_q18")
    assert found == pytest.approx(sign * counts * share, abs=0.01)


@pytest.mark.parametrize(("deg_s", "is_heard"), [(0.228, False), (0.230, True)])
def test_a_rate_is_heard_above_30_counts(deg_s, is_heard):
    felt = scene(at_rest(1), 200, noise=0)
    felt.gyr[:, 0] = deg_s * DEGREE
    found, _ = Attitude("complementary").feel(felt)
    # 0.9 / (1 - 0.9) samples of it are left in the roll.
    roll = 9 * deg_s / 200 if is_heard else 0
    assert desk.tilt_deg(found, felt.quat)[-1] == pytest.approx(roll, abs=1e-4)


def test_the_fastest_roll_at_the_longest_interval_stays_in_its_format():
    felt = scene(tumble(2, 200, 1), 200)
    felt.gyr[:] = 38 * (1 - 1e-9)
    felt.acc[:] = (0, G, 0)
    probe = Attitude("complementary")
    probe.set_bias((-4 / DEGREE, -4 / DEGREE, 0))
    intervals = np.full(len(felt), 2**32 - 1, np.uint32)
    found, _ = probe.run(felt.measurements(), intervals)
    assert probe.c.complementary.roll_rad / RATE == pytest.approx(
        9 * 42 * 0.05 + np.pi / 2, abs=0.01
    )
    assert np.abs(desk.norms(found) / ONE - 1).max() < 1e-8
