# SPDX-License-Identifier: MIT
"""Each term of the errors since a moment, by the numbers of docs/pose.md, and what of
two attitudes goes into them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from imud import rotation
from imud.params.trusted import known_to
from imud.params.value import Params
from imud.probes.references import References
from imud.probes.relative_error import (
    Quality,
    Quat,
    Turned,
    Unevenness,
    capped,
    heading_variance,
    quality_of,
    tilt_variance,
)

QUALITY = Quality(0.01, 0.0, 4.0, 0.5, 0.1)
NOTHING: dict[str, Any] = {
    **{"age_s": 0.0, "on_s": 1e6, "about_up": 0.0, "about_any": 0.0},
    **{"net_up": 0.0, "half_sine": 0.0, "quality": QUALITY, "unsure": 0.0},
    "uneven": 0.0,
}
FLOOR = 0.0004


@pytest.mark.parametrize(
    ("change", "adds"),
    [
        ({"age_s": 100.0}, 0.006),
        # A half and two thirds of the way to what it is when warm.
        (
            {"age_s": 30.0 * math.log(1.5), "on_s": 30.0 * math.log(3.0)},
            6e-5 * 30.0 * math.log(1.5) + 0.3 / 36.0,
        ),
        ({"about_up": 10.0}, 0.035),
        ({"about_any": 45.0}, 0.036),
        ({"about_any": 600.0}, 0.048),
        ({"net_up": 50.0}, 1.0),
        # After 20 s times the logarithm of 4 three quarters are there.
        (
            {"age_s": 20.0 * math.log(4.0), "half_sine": 0.5},
            6e-5 * 20.0 * math.log(4.0) + 2.0 * 1.5**2,
        ),
        ({"about_any": 45.0, "unsure": 4.0}, 0.036 + 0.1),
        ({"about_any": 180.0, "unsure": 4.0}, 0.048 + 0.2),
        # After 10 s times the logarithm of 2 half of it is there.
        (
            {"age_s": 10.0 * math.log(2.0), "about_any": 10.0, "uneven": 1.2},
            6e-5 * 10.0 * math.log(2.0) + 0.008 + 3.0 * 0.5 * 0.5,
        ),
        ({"age_s": 0.0, "about_any": 0.0, "uneven": 5.0}, 0.0),
        (
            {
                "age_s": 5.0 * math.log(2.0),
                "quality": Quality(0.01, 0.2, 4.0, 0.5, 0.1),
            },
            6e-5 * 5.0 * math.log(2.0) + 0.02,
        ),
    ],
)
def test_each_term_of_the_headings_error(change: dict[str, Any], adds: float) -> None:
    assert heading_variance(**NOTHING) == pytest.approx(FLOOR)
    found = heading_variance(**NOTHING | change)
    assert found == pytest.approx(FLOOR + adds, rel=1e-9)


def test_each_term_of_the_tilts_error() -> None:
    known = 0.38**2 + 0.1
    assert tilt_variance(0.0, 0.0, 0.0, QUALITY) == pytest.approx(FLOOR)
    assert tilt_variance(known + 1.0, 0.0, 0.0, QUALITY) == pytest.approx(FLOOR + 0.17)
    assert tilt_variance(0.0, known + 2.0, 0.0, QUALITY) == pytest.approx(FLOOR + 0.34)
    assert tilt_variance(0.0, 0.0, 0.5, QUALITY) == pytest.approx(FLOOR + 5.0)


def test_no_error_exceeds_that_of_two_which_have_nothing_in_common() -> None:
    assert capped(4.0, 4.0) == pytest.approx(math.sqrt(2.0))
    assert capped(1e12, 4.0) == pytest.approx(2.0)
    assert capped(1e-6, 4.0) == pytest.approx(1e-3)


def pose_of(q: Quat, time_s: float) -> dict[str, Any]:
    known = {"heading_sigma_deg": 90.0, "tilt_sigma_deg": 40.0, "flags": ()}
    return {"q": q, "t_device_us": round(time_s * 1e6)} | known


def known_well() -> References:
    references = References()
    references.quality = QUALITY
    return references


def captured(references: References) -> str:
    name = references.capture()
    assert name is not None
    return name


def about(axis: tuple[float, ...], degrees: float) -> Quat:
    unit = np.array(axis) / np.linalg.norm(axis)
    w, x, y, z = rotation.from_rotation_vector(np.deg2rad(degrees) * unit).tolist()
    return w, x, y, z


@pytest.mark.parametrize("degrees", [30.0, 100.0, 179.0])
def test_the_angle_between_both_attitudes_counts_whatever_they_are(
    degrees: float,
) -> None:
    start = about((0.3, -0.5, 0.8), 77.0)
    turn = about((0.9, 0.2, -0.4), degrees)
    w, x, y, z = rotation.multiply(np.array(turn), np.array(start)).tolist()
    references = known_well()
    references.on_pose(pose_of(start, 100.0))
    name = captured(references)
    references.on_pose(pose_of((w, x, y, z), 100.1))
    found = references.since_capture(name)
    half_sine = 2.0 * math.sin(math.radians(degrees / 2.0))
    variance = tilt_variance(1600.0, 1600.0, half_sine, QUALITY)
    assert found.tilt_sigma_deg == pytest.approx(capped(variance, 3200.0), abs=6e-4)


def test_what_was_turned_before_a_moment_does_not_count() -> None:
    """Out by 60 degrees and half of it back, by a probe that is still warming."""
    references = known_well()
    time_s = 5.0
    references.on_pose(pose_of(about((0, 0, 1), 0.0), time_s))
    early = captured(references)  # from here on it is followed
    late = ""
    for step in range(91):
        time_s += 0.1
        angle = 1.0 * (step if step <= 60 else 120 - step)
        references.on_pose(pose_of(about((0, 0, 1), angle), time_s))
        if step == 60:
            late = captured(references)
    half_sine = 2.0 * math.sin(math.radians(15.0))
    for name, age_s, turned, net in ((early, 9.1, 90.0, 30.0), (late, 3.0, 30.0, 30.0)):
        found = references.since_capture(name)
        wanted = {"age_s": age_s, "on_s": time_s, "about_up": turned}
        wanted |= {"about_any": turned, "net_up": net, "half_sine": half_sine}
        expected = heading_variance(**NOTHING | wanted)
        assert found.age_s == pytest.approx(age_s)
        sigma = capped(expected, 16200.0)
        assert found.heading_sigma_deg == pytest.approx(sigma, abs=1e-3)


def test_the_origin_is_the_attitude_that_it_was_set_at() -> None:
    """Poses are relative to it: at the event the probe was not turned."""
    references = known_well()
    references.on_event({"event": "tared", "detail": 0}, 100_000_000)
    pose = pose_of(about((0.6, 0.0, 0.8), 40.0), 100.1) | {"flags": ("tared",)}
    found = references.on_pose(pose)
    half_sine = 2.0 * math.sin(math.radians(20.0))
    variance = tilt_variance(1600.0, 1600.0, half_sine, QUALITY)
    assert found.tilt_sigma_deg == pytest.approx(capped(variance, 3200.0), abs=6e-4)
    assert found.age_s == pytest.approx(0.1)


def test_a_pause_may_hide_turns_in_either_direction() -> None:
    """Missing poses also add to the net turn."""
    turning = Turned()
    turning.add(about((0, 0, 1), 0.0), about((0, 0, 1), 10.0), 1_000_000)
    assert turning.net_up == pytest.approx(10.0)
    assert turning.unheard == turning.about_up == turning.about_any == 180.0
    references = known_well()
    references.on_pose(pose_of(about((0, 0, 1), 0.0), 100.0))
    name = captured(references)
    references.on_pose(pose_of(about((0, 0, 1), 10.0), 101.0))
    again = captured(references)
    after = references.since_capture(again)
    assert after.heading_sigma_deg == pytest.approx(0.02, abs=1e-3)
    found = references.since_capture(name)
    wanted = {"age_s": 1.0, "on_s": 101.0, "about_up": 180.0, "about_any": 180.0}
    wanted |= {"net_up": 190.0, "half_sine": 2.0 * math.sin(math.radians(5.0))}
    expected = heading_variance(**NOTHING | wanted)
    assert found.heading_sigma_deg == pytest.approx(capped(expected, 16200.0), abs=2e-3)


@pytest.mark.parametrize("restarts", [False, True])
def test_the_least_sigma_so_far_is_the_best_that_was_known(*, restarts: bool) -> None:
    """A restarted filter has forgotten it."""
    references = known_well()

    known = Unevenness()

    def poses(sigma: float, first_s: float, degrees: float) -> None:
        for step in range(11):
            angle = degrees * step / 10.0
            known.add(sigma, round(1e6 * (first_s + 0.1 * step)))
            pose = pose_of(about((0, 0, 1), angle), first_s + 0.1 * step)
            references.on_pose(pose | {"heading_sigma_deg": sigma})

    poses(1.0, 100.0, 0.0)
    if restarts:
        references.on_event({"event": "restarted", "detail": 0}, 101_000_000)
        known = Unevenness()
    poses(3.0, 102.0, 0.0)
    name = captured(references)
    poses(4.0, 103.1, 150.0)
    found = references.since_capture(name)
    least = 3.0 if restarts else 1.0
    wanted = {"age_s": 1.1, "on_s": 104.1, "about_up": 150.0, "about_any": 150.0}
    wanted |= {"net_up": 150.0, "half_sine": 2.0 * math.sin(math.radians(75.0))}
    wanted |= {"unsure": 9.0 + 16.0 - 2.0 * least * least, "uneven": known.mean}
    expected = heading_variance(**NOTHING | wanted)
    assert found.heading_sigma_deg == pytest.approx(capped(expected, 25.0), abs=2e-3)


@pytest.mark.parametrize("axis", [(0.9, 0.2, -0.4), (-0.3, 0.7, 0.6), (0.5, -0.8, 0.1)])
def test_a_turn_is_split_by_its_axis_in_the_world(axis: tuple[float, ...]) -> None:
    start = about((0.3, -0.5, 0.8), 77.0)
    turn = about(axis, 25.0)
    w, x, y, z = rotation.multiply(np.array(turn), np.array(start)).tolist()
    turning = Turned()
    turning.add(start, (w, x, y, z), 50_000)
    up = 25.0 * axis[2] / math.hypot(*axis)
    assert turning.about_any == pytest.approx(25.0)
    assert turning.net_up == pytest.approx(up)
    assert turning.about_up == pytest.approx(abs(up))


def test_params_tell_how_good_the_sensors_are() -> None:
    plain = {"bias_counts": [0.0] * 3, "matrix": np.eye(3).tolist()}
    plain["method"] = "measured"
    field = {"sigma_uT": 0.5, "norm_uT": 50.0, "dip_deg": 60.0}
    known = Params.decode(known_to(0.0981, 0.5)).replaced("mag", plain | field)
    known = known.replaced("gyr", plain | {"sigma": 0.002})
    found = quality_of(known.encode())
    acc_rad = 0.0981 / 9.80665
    assert found.acc_deg == pytest.approx(math.degrees(acc_rad), rel=1e-2)
    assert found.level2_deg2 == pytest.approx(
        2.0 * math.degrees(acc_rad) ** 2, rel=2e-2
    )
    assert found.mag_deg == pytest.approx(math.degrees(0.5 / 25.0), rel=1e-2)
    unknown = quality_of(None)
    assert unknown == quality_of(b"") == Quality()
    assert unknown.gyr_share > found.gyr_share == pytest.approx(0.002)
    assert unknown.acc_deg == pytest.approx(math.degrees(0.06))
    assert unknown.level2_deg2 == pytest.approx(math.degrees(0.06) ** 2)
    assert unknown.mag_deg == pytest.approx(math.degrees(21.0 / 15.0))


def test_a_room_shows_in_the_mean_of_a_minute_of_what_is_above_the_least() -> None:
    found = Unevenness()
    assert (found.least, found.mean) == (None, 0.0)
    for step in range(1, 601):
        found.add(1.0, 100_000 * step)
    assert (found.least, found.mean) == (1.0, 0.0)
    for step in range(601, 1201):  # a minute of a sigma that is twice as large
        found.add(2.0, 100_000 * step)
    assert found.mean == pytest.approx(3.0 * (1.0 - math.exp(-1.0)), rel=1e-2)
    before = found.mean
    found.add(None, 100_000 * 1201)  # withheld: nothing is learned of the room
    assert found.mean == before
    found.add(0.6, 100_000 * 1202)  # no settling
    assert 0.98 * before < found.mean < before
    found.add(0.4, 100_000 * 1203)
    assert (found.least, found.mean) == (0.4, 0.0)


def test_a_pause_counts_as_a_second_and_a_sigma_without_bound_as_one_with() -> None:
    found = Unevenness()
    for step in range(1, 10):
        found.add(1.0, 100_000 * step)
    before = found.mean
    # A pause counts as a second, and a sigma without bound as one with.
    found.add(1e6, 100_000 * 9999)
    assert found.mean - before == pytest.approx((10.0 - before) / 60.0)
