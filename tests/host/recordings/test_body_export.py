# SPDX-License-Identifier: MIT
"""A recorded body as files: from motions and from logs, read back by readers of our
own that follow OpenSim's documents.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imud import cli, rotation
from imud.body import angles, chain, fused, level, session
from imud.body.hinge import AlignmentRefused
from imud.log.reader import Logged
from imud.recordings import body_tracks
from imud.virtual import leg
from imud.virtual import motion as motions
from imud.virtual.leg_probes import RATE_HZ
from imud.virtual.motion import Motion

LOOSE = leg.Manner(walk_s=9.0)
EVERY = 25  # records of the leg in one at 40 Hz


@cache
def made() -> leg.Leg:
    return leg.made(1, LOOSE)


def at_40_hz(motion: Motion) -> Motion:
    count = len(motion) // EVERY
    gyr, acc, mag = (
        each[: count * EVERY].reshape(count, EVERY, 3).mean(axis=1)
        for each in (motion.gyr, motion.acc, motion.mag)
    )
    return Motion(RATE_HZ / EVERY, gyr, acc, mag)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("leg")
    for name, motion in made().motions.items():
        at_40_hz(motion).save(folder / f"{name}.npz")
    (folder / "leg.toml").write_text(leg.CHAIN)
    return folder


def exported(folder: Path, to: str, out: Path, *more: str) -> int:
    motions = [f"{name}={folder / name}.npz" for name in leg.SEGMENTS]
    files = [*motions, "--body", str(folder / "leg.toml"), "--out", str(out)]
    return cli.main(["export", *files, "--to", to, *more])


def read_sto(path: Path) -> tuple[dict[str, str], list[str], list[list[str]]]:
    """Head, names and cells."""
    head, _, table = path.read_text().partition("endheader\n")
    keys = dict(each.split("=") for each in head.splitlines() if "=" in each)
    first, *rows = table.splitlines()
    return keys, first.split("\t"), [row.split("\t") for row in rows]


def test_motions_of_40_hz_become_joint_angles_of_opensim(
    recorded: Path, tmp_path: Path
):
    assert exported(recorded, "sto", tmp_path) == 0
    head, names, rows = read_sto(tmp_path / "right-leg-angles.sto")
    table = np.array(rows, float)
    assert (head["nRows"], head["nColumns"]) == (str(len(rows)), str(len(names)))
    assert head["inDegrees"] == "yes"
    times, bend = table[:, 0], table[:, names.index("shank_flexion")]
    # The mean of 25 records lies 12 ms after the first of them.
    at = np.rint((times + 0.012) * RATE_HZ).astype(int)
    walking = times > made().stages["walk"][0]
    off = bend - np.degrees(made().angles["shank"][at, 0])
    assert np.sqrt((off[walking] ** 2).mean()) < 4.0

    head, names, rows = read_sto(tmp_path / "right-leg-orientations.sto")
    assert names == ["time", "thigh_imu", "shank_imu", "foot_imu"]
    assert head["DataType"] == "Quaternion"
    quats = np.array([[cell.split(",") for cell in row[1:]] for row in rows], float)
    np.testing.assert_allclose(np.linalg.norm(quats, axis=2), 1.0, atol=1e-6)
    # Standing, every segment's y is OpenSim's y.
    y = rotation.rotate(quats[300], np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(y, [[0.0, 1.0, 0.0]] * 3, atol=0.05)
    # Thigh to shank is the angle that the other file has.
    joint, row = chain.JOINTS["knee"], 1000
    turn = rotation.multiply(rotation.inverse(quats[row, 0]), quats[row, 1])
    found = angles.joint_angles(rotation.IDENTITY, turn, joint, "right")
    assert np.degrees(found[0]) == pytest.approx(bend[row], abs=0.01)


def test_csv_has_errors_and_the_path_of_the_foot(recorded: Path, tmp_path: Path):
    assert exported(recorded, "csv", tmp_path) == 0
    with (tmp_path / "right-leg-body.csv").open() as file:
        rows = list(csv.DictReader(file))
    sigma = np.array([float(row["shank_flexion_sigma_deg"]) for row in rows])
    assert 0.5 < np.median(sigma) < 5.0
    ways = [float(row["foot_x_m"]) for row in rows if row["foot_x_m"]]
    walked = float(made().ankle[-1, 0] - made().ankle[0, 0])
    across = [float(row["foot_y_m"]) for row in rows if row["foot_y_m"]]
    assert np.hypot(ways[-1], across[-1]) == pytest.approx(walked, rel=0.05)
    assert exported(recorded, "csv", tmp_path) == 1  # nothing is overwritten


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a.npz", "--body", "leg.toml"], "add the name of its probe: PROBE=a.npz"),
        (["thigh=thigh.npz", "--body", "none.toml"], "can't read none.toml"),
        (["thigh=none.npz", "--body", "leg.toml"], "none.npz: No such file"),
        (["other=thigh.npz", "--body", "leg.toml"], "none of its probes has data"),
        (["thigh=thigh.npz", "--body", "leg.toml"], "give the facing direction"),
        (["thigh=thigh.npz", "--to", "sto"], "give one with --body"),
        (["a", "--to", "parquet", "--body", "leg.toml"], "csv, sto, bvh or c3d"),
        (["thigh=slow.npz", "--body", "leg.toml"], "20 samples a second are too few"),
    ],
)
def test_what_cannot_be_exported_is_told_on_one_line(
    arguments: list[str],
    words: str,
    recorded: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.chdir(recorded)
    slow = Motion(20.0, *np.zeros((3, 50, 3)))
    slow.save(recorded / "slow.npz")
    assert cli.main(["export", *arguments]) == 1
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1


def test_a_probe_that_is_not_there_is_told(recorded: Path):
    found = body_tracks.of_files(
        [f"{name}={recorded / name}.npz" for name in ("thigh", "shank")]
    )
    seen = session.of(chain.read(leg.CHAIN, "leg"), found)
    assert "foot: foot has no data" in seen.remarks
    assert np.isnan(seen.posture.quats["foot"]).all()
    assert "foot" not in seen.posture.angles


def test_who_never_stands_still_is_told(recorded: Path):
    found = {
        name: level.attitudes(each.gyr[500:600], each.acc[500:600], 40.0)
        for name, each in ((n, at_40_hz(m)) for n, m in made().motions.items())
    }
    assert recorded.is_dir()
    with pytest.raises(AlignmentRefused, match="no pose to align by"):
        session.of(chain.read(leg.CHAIN, "leg"), found)


def test_a_pose_without_a_compass_aligns_nothing(recorded: Path):
    motion = motions.load(recorded / "thigh.npz")[:200]
    times_s = np.arange(len(motion)) / motion.rate_hz
    none = np.zeros_like(motion.mag)
    body = chain.read(leg.CHAIN, "leg")
    with pytest.raises(AlignmentRefused, match="needs headings, and thigh has none"):
        still = {"thigh": fused.attitudes(times_s, motion.gyr, motion.acc, none)}
        still["shank"] = still["thigh"]
        session.of(body, still, 0.0)


def messages_of(name: str, bound_us: int | None = 500) -> list[Logged]:
    """A log's messages of one probe: poses and raw samples at 50 Hz."""
    motion = made().motions[name]
    found = []
    for index in range(0, len(motion), 20):
        head: Mapping[str, Any] = {
            "t_ns": round(1.7e18 + index * 1e6),
            "t_bound_us": bound_us,
        }
        pose = {
            "q": motion.quat[index].tolist(),
            "tilt_sigma_deg": 0.5,
            "heading_sigma_deg": None,
        }
        raw = {
            "gyr_rad_s": motion.gyr[index].tolist(),
            "acc_m_s2": motion.acc[index].tolist(),
        }
        for topic, rest in (("pose", pose), ("raw", raw)):
            data = json.dumps({**head, **rest}).encode()
            found.append(Logged(name, topic, data, 0))
    return found


def test_logs_of_many_probes_are_joined_by_utc(monkeypatch: pytest.MonkeyPatch):
    logs = {f"{name}.mcap": messages_of(name) for name in leg.SEGMENTS}
    monkeypatch.setattr(body_tracks, "salvage", lambda path, _: logs[str(path)])
    found = body_tracks.of_files(list(logs))
    seen = session.of(chain.read(leg.CHAIN, "leg"), found)
    at = np.rint((seen.posture.times_s - 1.7e9) * RATE_HZ).astype(int)
    off = seen.posture.angles["shank"][:, 0] - made().angles["shank"][at, 0]
    assert np.degrees(np.sqrt(np.nanmean(off**2))) < 3.0
    assert len(seen.paths["foot"].strides) >= 6


def test_an_unknown_clock_is_reported(monkeypatch: pytest.MonkeyPatch):
    late = messages_of("shank", bound_us=None)
    monkeypatch.setattr(body_tracks, "salvage", lambda *_: late)
    assert cli.main(["export", "x.mcap", "--body", "none.toml"]) == 1
    with pytest.raises(Exception, match="shank: the clock is unknown"):
        body_tracks.of_files(["x.mcap"])


def test_more_samples_than_are_fused_are_averaged():
    motion = made().motions["shank"][:8000]
    times_s = np.arange(len(motion)) / RATE_HZ
    found = fused.attitudes(times_s, motion.gyr, motion.acc, motion.mag)
    assert len(found.times_s) == len(motion)
    assert motion.quat is not None
    up = np.array([0.0, 0.0, 1.0])
    seen, real = (
        rotation.rotate(rotation.inverse(each), up)
        for each in (found.quat, motion.quat)
    )
    off = np.degrees(np.arccos(np.clip((seen * real).sum(1), -1.0, 1.0)))
    assert np.sqrt((off[4000:] ** 2).mean()) < 1.0
    noise = np.random.default_rng(1).normal(0.0, 1.0, (5000, 3))
    fine, coarse = np.arange(5000) / 1000.0, np.arange(1000) / 200.0
    mean = fused.between(coarse, fine, noise)
    assert mean.std() == pytest.approx(1.0 / np.sqrt(5.0), rel=0.1)
