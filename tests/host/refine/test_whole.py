# SPDX-License-Identifier: MIT
"""Poses of whole recordings: right within what they state, in one window or many."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from host.refine.made import FIELD, RATE_HZ, made, off_deg
from imud import rotation
from imud.refine import whole
from imud.refine.checks import doubts_of
from imud.refine.model import CALIBRATED, SHOP, Priors, Recording
from imud.refine.whole import Part, parts_of
from imud.rotation import FloatArray

BIAS = np.radians([1.0, -0.7, 0.4])
MAGNET = np.array([12.0, -7.0, 5.0])


def poses_of(recording: Recording, priors: Priors, **told: Any) -> list[Part]:
    return [part for part, _ in parts_of(recording, priors, **told)]


def joined(parts: list[Part], name: str) -> FloatArray:
    return np.concatenate([getattr(part, name) for part in parts])


def test_poses_are_right_within_what_they_state() -> None:
    recording, truth = made(bias=BIAS)
    done: list[float] = []
    parts = poses_of(recording, CALIBRATED, tell=done.append)
    off = off_deg(joined(parts, "quats"), truth)
    stated = np.hypot(joined(parts, "tilt_deg"), joined(parts, "heading_deg"))
    assert off.max() < 1.0
    assert (off < 2.0 * stated).mean() > 0.95
    assert joined(parts, "heading_deg").max() < 3.0
    assert joined(parts, "change_deg")[0] < 0.1
    assert done == sorted(done)
    assert done[-1] <= 1.0
    assert not any(part.doubts for part in parts)


def test_a_magnet_on_a_module_is_found() -> None:
    recording, truth = made(own=MAGNET)
    ((part, window),) = parts_of(recording, SHOP)
    assert off_deg(part.quats, truth).max() < 2.0
    assert window is not None
    found = window.estimate.states[-1, 12:15]
    assert found == pytest.approx(MAGNET, abs=1.0)


def test_who_walks_100_m_is_not_turned_by_it() -> None:
    recording, truth = made(80.0, walk_m=100.0)
    parts = poses_of(recording, CALIBRATED)
    off = off_deg(joined(parts, "quats"), truth)
    stated = np.hypot(joined(parts, "tilt_deg"), joined(parts, "heading_deg"))
    assert (off < 2.0 * stated).mean() > 0.95
    assert off.max() < 1.5


def test_windows_follow_each_other_without_a_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recording, truth = made(60.0, bias=BIAS)
    (one,) = poses_of(recording, CALIBRATED)
    monkeypatch.setattr(whole, "KEPT_S", 20.0)
    monkeypatch.setattr(whole, "AHEAD_S", 10.0)
    monkeypatch.setattr(whole, "FADE_S", 5.0)
    parts = poses_of(recording, CALIBRATED)
    assert len(parts) == 3
    quats = joined(parts, "quats")
    assert off_deg(quats, truth).max() < 1.0
    assert off_deg(quats, one.quats).max() < 0.7
    # From sample to sample they turn as one window does.
    for seam in (1000, 2000):
        about = slice(seam - 2, seam + 2)
        assert off_deg(quats[about], one.quats[about]).std() < 0.02
    assert (joined(parts, "heading_deg") > 0.0).all()


def test_a_delay_of_the_sensor_is_made_good() -> None:
    recording, truth = made()
    late = replace(recording, **{n: getattr(recording, n)[:-1] for n in ("gyr", "acc")})
    late = replace(late, mag=recording.mag[:-1])
    parts = poses_of(late, CALIBRATED, delay_s=1.0 / RATE_HZ)
    quats = joined(parts, "quats")
    assert off_deg(quats[:-1], truth[1:]).max() < 1.0


def test_a_bent_field_at_first_is_not_taken_for_north() -> None:
    recording, truth = made()
    mag = recording.mag.copy()
    bent = rotation.from_rotation_vector(np.radians([0.0, 0.0, 40.0]))
    mag[:200] = rotation.rotate(bent, mag[:200])  # where it lies first
    parts = poses_of(replace(recording, mag=mag), CALIBRATED)
    assert off_deg(joined(parts, "quats"), truth).max() < 8.0


def test_a_field_that_points_elsewhere_on_the_way_is_told() -> None:
    ((part, window),) = parts_of(made()[0], CALIBRATED)
    assert not part.doubts
    assert window is not None
    window.estimate.states[:, 9:12] = -5.0, 19.0, -43.0
    (doubt,) = doubts_of(window)
    assert "points 15 deg away from" in doubt.words


def spoilt(name: str) -> tuple[Recording, Priors]:
    """A recording on which an estimate can't be relied on, and why."""
    recording, _ = made()
    count = len(recording.gyr)
    at_s = np.arange(count) / RATE_HZ
    random = np.random.default_rng(5)
    if name == "did not see":  # another body's gyroscope
        return replace(recording, gyr=recording.gyr[:, ::-1].copy()), CALIBRATED
    if name == "no magnetometer reads a field":
        return replace(recording, mag=np.full((count, 3), np.nan)), CALIBRATED
    if name == "readings fit":  # a motor beside it
        noise = 60.0 * random.standard_normal((count, 3))
        return replace(recording, mag=recording.mag + noise), CALIBRATED
    if name == "calibration does not fit":  # iron beside a calibrated one
        longer, _ = made(120.0)
        return replace(longer, mag=longer.mag * [1.1, 1.0, 0.9]), CALIBRATED
    if name == "its headings before and after":  # the field turns amid it
        longer, truth = made(60.0)
        half = len(truth) // 2
        turn = rotation.from_rotation_vector(np.radians([0.0, 0.0, 40.0]))
        field = np.broadcast_to(rotation.rotate(turn, FIELD), (half, 3))
        mag = longer.mag.copy()
        is_read = np.isfinite(mag[half:, :1])
        bent = rotation.rotate(rotation.inverse(truth[half:]), field)
        mag[half:] = np.where(is_read, bent, np.nan)
        return replace(longer, mag=mag), CALIBRATED
    if name == "its tilts before and after":  # the accelerometer is knocked
        longer, _ = made(60.0)
        acc = longer.acc.copy()
        acc[len(acc) // 2 :, 0] += 4.0
        return replace(longer, acc=acc), CALIBRATED
    if name == "from what all else tells of them":  # the gyroscope is knocked
        longer, _ = made(60.0, still_s=(28.0, 32.0))
        gyr = longer.gyr.copy()
        gyr[len(gyr) // 3 :, 0] += np.radians(3.0)
        return replace(longer, gyr=gyr), CALIBRATED
    if name == "deg only":  # a module that is only carried
        still = 0.02 * np.sin(at_s)[:, None] * np.array([0.0, 0.0, 1.0])
        force = np.tile([0.0, 0.0, 9.81], (count, 1)) + 0.3 * np.sin(at_s)[:, None]
        field = np.tile([0.0, 20.0, -43.0], (count, 1))
        noise = 0.001 * random.standard_normal((count, 3))
        return Recording(RATE_HZ, still + noise, force + noise, field + noise), SHOP
    raise AssertionError(name)


@pytest.mark.parametrize(
    ("why", "is_of_all"),
    [
        ("did not see", True),
        ("no magnetometer reads a field", False),
        ("readings fit", False),
        ("calibration does not fit", False),
        ("its headings before and after", False),
        ("its tilts before and after", True),
        ("from what all else tells of them", True),
        ("deg only", False),
    ],
)
def test_what_can_not_be_relied_on_is_withheld(why: str, is_of_all: bool) -> None:
    parts = poses_of(*spoilt(why))
    assert any(why in doubt.words for part in parts for doubt in part.doubts)
    assert np.isnan(joined(parts, "heading_deg")).all()
    assert np.isnan(joined(parts, "tilt_deg")).all() == is_of_all


STUCK = "the gyroscope's x axis reads the same all the time"
NO_FIELD = "no magnetometer reads a field: its heading is to where it began"


@pytest.mark.parametrize(
    ("sensor", "axes", "value", "why", "is_of_all"),
    [
        ("mag", 3, 0.0, NO_FIELD, False),
        ("mag", 3, np.inf, NO_FIELD, False),
        ("mag", 3, 1e300, NO_FIELD, False),
        ("acc", 3, 0.0, "its readings determine no poses", True),
        ("acc", 3, np.nan, "the accelerometer reads 0.0 m/s2 only", True),
        ("gyr", 3, 1e300, "its readings determine no poses", True),
        ("gyr", 1, 0.0, STUCK, True),
    ],
)
def test_a_dead_sensor_is_told(
    sensor: str, axes: int, value: float, why: str, is_of_all: bool
) -> None:
    recording, _ = made(12.0)
    rows = getattr(recording, sensor).copy()
    rows[:, :axes] = value
    (part,) = poses_of(replace(recording, **{sensor: rows}), CALIBRATED)
    assert why in [doubt.words for doubt in part.doubts]
    assert np.isfinite(part.quats).all()
    assert np.isnan(part.heading_deg).all()
    assert np.isnan(part.tilt_deg).all() == is_of_all


def test_what_follows_a_window_without_an_estimate_is_estimated(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(whole, "KEPT_S", 12.0)
    monkeypatch.setattr(whole, "AHEAD_S", 1.0)
    recording, _ = made(36.0)
    acc = recording.acc.copy()
    acc[: round(13.0 * RATE_HZ)] = 0.0
    parts = poses_of(replace(recording, acc=acc), CALIBRATED)
    dead, *rest = parts
    assert np.isnan(dead.tilt_deg).all()
    assert np.isfinite(joined(rest, "tilt_deg")).any()
    assert np.isnan(joined(rest, "change_deg")).all()  # since when is not known
