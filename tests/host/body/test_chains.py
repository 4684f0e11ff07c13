# SPDX-License-Identifier: MIT
"""Made chains with joints about any axes, from files of 40 Hz to joint angles."""

from __future__ import annotations

import csv
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.limb import chains, made_chain
from benchmarks.limb.made_chain import Made
from imud import cli, rotation
from imud.body import angles, chain, session
from imud.body.hinge import AlignmentRefused
from imud.body.tracks import Track
from imud.log.reader import Logged
from imud.recordings import body_tracks
from imud.rotation import FloatArray
from imud.virtual.motion import CSV_COLUMNS, Motion

JOINTS = ("free", "hinge", "universal", "hinge")
SECONDS = 20.0


@cache
def made() -> Made:
    return made_chain.made(11, JOINTS, SECONDS)


@cache
def tracks_of() -> dict[str, Track]:
    return {name: chains.track_of(each) for name, each in made().motions.items()}


def write_csv(path: Path, motion: Motion) -> None:
    times_s = np.arange(len(motion)) / motion.rate_hz
    names = ["t_s", *(name for group in CSV_COLUMNS.values() for name in group)]
    table = np.column_stack([times_s, motion.gyr, motion.acc, motion.mag])
    rows = (",".join(f"{value:.6f}" for value in row) for row in table)
    path.write_text("\n".join([",".join(names), *rows]) + "\n")


def turned(name: str, parent: str) -> FloatArray:
    """How the joint is turned against its pose: rotation vectors of the parent, rad."""
    turn = rotation.multiply(rotation.inverse(made().quats[parent]), made().quats[name])
    return rotation.to_rotation_vector(
        rotation.multiply(turn, rotation.inverse(turn[0]))
    )


@pytest.mark.nightly
def test_files_of_40_hz_become_angles_of_joints_about_any_axes(tmp_path: Path):
    files = []
    for name, motion in made().motions.items():
        write_csv(tmp_path / f"{name}.csv", motion)
        files.append(f"{name}={tmp_path / name}.csv")
    (tmp_path / "five.toml").write_text(made().toml)
    body = ["--body", str(tmp_path / "five.toml"), "--out", str(tmp_path)]
    assert cli.main(["export", *files, *body, "--to", "csv"]) == 0
    with (tmp_path / "five-body.csv").open() as file:
        rows = list(csv.DictReader(file))
    times_s = np.array([float(row["t_s"]) for row in rows])
    moving = times_s > made_chain.STILL_S + 2.0
    for parent, name in (("two", "three"), ("four", "five")):
        found = np.array([float(row[f"{name}_angle_deg"]) for row in rows])
        sigma = np.array([float(row[f"{name}_angle_sigma_deg"]) for row in rows])
        turns = turned(name, parent)
        axis = np.linalg.eigh(turns.T @ turns)[1][:, -1]
        truth = np.degrees(np.interp(times_s, made().times_s, turns @ axis))
        # Which end of an axis is positive is for imud to say.
        truth *= np.sign(truth[moving] @ found[moving])
        off = (found - truth)[moving]
        assert np.sqrt((off**2).mean()) < 3.0
        assert np.abs(truth[moving]).max() > 30.0
        assert (np.abs(off) < 1.96 * sigma[moving]).mean() > 0.85
    assert {"two_flexion_deg", "four_first_deg", "four_second_deg"} < rows[0].keys()
    # Where all joints are at 0, all segments have one attitude.
    at = round(made_chain.STILL_S * session.RATE_HZ) - 60
    quats = [[float(rows[at][f"{n}_q{p}"]) for p in "wxyz"] for n in made_chain.NAMES]
    same = np.abs(np.array(quats) @ np.array(quats).T)
    assert np.degrees(2.0 * np.arccos(np.minimum(same, 1.0))).max() < 3.0


def test_samples_that_no_probe_fused_are_fused_here(monkeypatch: pytest.MonkeyPatch):
    motion = made().motions["one"]
    logged = []
    for index in range(len(motion)):
        values = {
            "t_ns": round(1.7e18 + index * 25e6),
            "t_bound_us": 500,
            "gyr_rad_s": motion.gyr[index].tolist(),
            "acc_m_s2": motion.acc[index].tolist(),
            "mag_uT": motion.mag[index].tolist() if index % 2 else None,
        }
        logged.append(Logged("one", "raw", json.dumps(values).encode(), 0))
    monkeypatch.setattr(body_tracks, "salvage", lambda *_: logged)
    found = body_tracks.of_files(["one.mcap"])["one"]
    other = tracks_of()["one"]
    np.testing.assert_allclose(found.times_s - 1.7e9, other.times_s, atol=1e-5)
    # Half of the field's readings are interpolated.
    turn = rotation.multiply(rotation.inverse(found.quat), other.quat)
    off_deg = np.degrees(np.linalg.norm(rotation.to_rotation_vector(turn), axis=1))
    assert np.median(off_deg[200:]) < 1.0


def test_a_joint_that_is_freer_than_the_file_says_is_told():
    text = made().toml.replace('"free"', '"hinge"')
    tracks = tracks_of()
    with pytest.raises(AlignmentRefused, match="one and two: no hinge fits"):
        session.of(chain.read(text, "five"), tracks)
    still = {name: each.between(0.0, 5.0) for name, each in tracks.items()}
    with pytest.raises(AlignmentRefused, match="three"):
        session.of(chain.read(made().toml, "five"), still)


def test_who_never_rests_begins_with_angles_of_0():
    tracks = {name: each.between(6.5, 18.0) for name, each in tracks_of().items()}
    text = made().toml.replace('"universal"', '"free"')
    found = session.of(chain.read(text, "five"), tracks)
    assert any("it never rests" in each for each in found.remarks)
    begin = np.degrees(found.posture.angles["three"][:5])
    assert np.abs(begin).max() < 30.0


@pytest.mark.parametrize("between_deg", [90.0, 70.0])
def test_angles_about_two_axes_are_those_that_made_the_turn(between_deg: float):
    random = np.random.default_rng(5)
    first = np.array([0.6, 0.0, 0.8])
    across = np.array([0.8, 0.0, -0.6])
    between = np.radians(between_deg)
    second = np.cos(between) * first + np.sin(between) * across
    given = random.uniform(-1.3, 1.3, (50, 2))
    turn = rotation.multiply(
        rotation.from_rotation_vector(given[:, :1] * first),
        rotation.from_rotation_vector(given[:, 1:] * second),
    )
    found = angles.universal_angles(turn, first, second)
    np.testing.assert_allclose(found, given, atol=1e-9)
    alone = rotation.from_rotation_vector(given[:, :1] * first)
    np.testing.assert_allclose(angles.hinge_angle(alone, first), given[:, :1])
