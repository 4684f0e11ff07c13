# SPDX-License-Identifier: MIT
"""Strokes in the shapes of recorded motions: found, scaled, and true to their truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scoring
import stroke_shapes
import strokes
from stroke_shapes import Shape

import length
from imud import rotation
from imud.virtual.curves import STEP
from imud.virtual.motion import GRAVITY_M_S2, Motion
from imud.virtual.stroking import Plan, strokes_of

RATE_HZ = 285.714
TURN = np.array([0.3, -0.2, 0.5])  # rad


def recorded(way: object) -> Motion:
    """A rest, a motion along `way` (m) with a turn, and a rest."""
    u = np.clip(np.arange(-1.0, 2.0, 1.0 / RATE_HZ), 0.0, 1.0)
    step = STEP(u)[:, None]
    nothing = np.zeros((len(u), 3))
    # Optics see a resting body move a little: without that no instant is the slowest.
    seen = 1e-5 * np.random.default_rng(1).standard_normal((len(u), 3))
    return Motion(
        *(RATE_HZ, nothing, nothing, nothing),
        quat=rotation.from_rotation_vector(step * TURN),
        position=step * np.asarray(way) + seen,
    )


def shapes(motion: Motion) -> list[Shape]:
    return list(stroke_shapes.shapes_of("made up", motion))


def test_a_motion_between_two_rests_is_a_stroke_with_its_way_and_turn() -> None:
    (shape,) = shapes(recorded([0.2, 0.0, 0.1]))
    assert shape.way_m == pytest.approx([0.2, 0.0, 0.1], abs=0.003)
    assert shape.turn_deg == pytest.approx(np.degrees(np.linalg.norm(TURN)), abs=0.5)


@pytest.mark.parametrize("length_m", [0.04, 0.5])
def test_a_way_too_short_or_too_long_for_a_stroke_is_left_out(length_m: float) -> None:
    assert shapes(recorded([length_m, 0.0, 0.0])) == []


def test_a_motion_that_the_optics_lost_is_left_out() -> None:
    motion = recorded([0.2, 0.0, 0.1])
    assert motion.position is not None
    motion.position[len(motion) // 2] = np.nan
    assert shapes(motion) == []


def test_a_stroke_is_scaled_and_its_sensors_agree_with_its_truth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made_up = shapes(recorded([0.2, 0.0, 0.1]))
    monkeypatch.setattr(stroke_shapes, "shapes", [made_up, made_up].__getitem__)
    motion = stroke_shapes.motion_of(Plan(seconds=2.0, strokes=1), seed=1)[8000:]
    (stroke,) = strokes_of(motion)
    assert np.linalg.norm(stroke.way_m) == pytest.approx(0.1, abs=1e-6)
    assert motion.quat is not None
    assert motion.position is not None
    # Integrated by trapezoids, gyroscope and accelerometer lead to the truth.
    quat, dt = motion.quat[0], 1.0 / motion.rate_hz
    for rate in 0.5 * (motion.gyr[1:] + motion.gyr[:-1]):
        quat = rotation.multiply(quat, rotation.from_rotation_vector(rate * dt))
    left = rotation.multiply(rotation.inverse(quat), motion.quat[-1])
    assert np.linalg.norm(rotation.to_rotation_vector(left)) < 1e-5
    force = rotation.rotate(motion.quat, motion.acc) - [0.0, 0.0, GRAVITY_M_S2]
    speed = np.cumsum(0.5 * (force[1:] + force[:-1]), axis=0) * dt
    assert np.sum(speed, axis=0) * dt == pytest.approx(stroke.way_m, abs=1e-5)


def test_without_the_recordings_their_shapes_are_left_out_with_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(scoring, "RECORDINGS", tmp_path / "absent")
    options = ["--only", "BROAD", "--output", str(tmp_path / "strokes.json")]
    assert strokes.main(options) == 0
    assert "BROAD's shapes are left out" in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.usefixtures("shared_data")
def test_strokes_of_the_recordings_are_many_and_turn() -> None:
    for half in length.choose(everyday=(1,), long=(0, 1)):
        found = stroke_shapes.shapes(half)
        assert len(found) >= 20
        assert np.median([shape.turn_deg for shape in found]) > 10.0
