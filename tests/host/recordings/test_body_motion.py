# SPDX-License-Identifier: MIT
"""BVH and C3D of a recorded body, read back: by a parser of our own, and by ezc3d."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from imud import rotation
from imud.body import angles, chain, posture, session
from imud.errors import FileError
from imud.recordings.body_export import WRITERS
from imud.rotation import FloatArray
from imud.virtual import leg

TREE = (
    leg.CHAIN
    + """
[segments.other]
parent = "thigh"
at = "side"
length_m = 0.3
"""
)
TREE = TREE.replace(
    'probe = "thigh"\n', 'probe = "thigh"\nmarks = {side = [0.1, 0, 0]}\n'
)
COUNT = 40
BODY = chain.read(TREE, "tree")
UPRIGHT = rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))


@cache
def made() -> session.BodyAnalysis:
    """A body in any attitudes."""
    random = np.random.default_rng(4)
    quats = {
        each.name: rotation.multiply(
            rotation.from_rotation_vector(
                np.cumsum(random.normal(0.0, 0.1, (COUNT, 3)), axis=0)
            ),
            UPRIGHT,
        )
        for each in BODY.segments
    }
    turns = {
        child.name: angles.joint_angles(
            quats[parent.name], quats[child.name], child.joint, BODY.side
        )
        for parent, child in BODY.joints()
    }
    times_s = np.arange(COUNT) / session.RATE_HZ
    found = posture.Posture(times_s, quats, turns, turns)
    return session.BodyAnalysis(found, {}, {}, {}, ())


def lost(name: str, first: int, last: int) -> session.BodyAnalysis:
    """The same, one segment missing in some rows."""
    quats = {key: each.copy() for key, each in made().posture.quats.items()}
    quats[name][first:last] = np.nan
    turns = {key: each.copy() for key, each in made().posture.angles.items()}
    turns[name][first:last] = np.nan
    return replace(made(), posture=replace(made().posture, quats=quats, angles=turns))


class Bvh:
    """A reader of BVH, after its description: joints in order, with parents, offsets,
    channels; frames.
    """

    def __init__(self, text: str) -> None:
        words = iter(text.split())
        self.names: list[str] = []
        self.parents: list[int] = []
        self.offsets: list[list[float]] = []
        self.channels: list[list[str]] = []
        above: list[int] = []
        for word in words:
            if word in ("ROOT", "JOINT", "End"):
                self.parents.append(above[-1] if above else -1)
                name = next(words)
                self.names.append(name if word != "End" else f"{name} {len(above)}")
                self.channels.append([])
            elif word == "{":
                above.append(len(self.names) - 1)
            elif word == "}":
                above.pop()
            elif word == "OFFSET":
                self.offsets.append([float(next(words)) for _ in range(3)])
            elif word == "CHANNELS":
                count = int(next(words))
                self.channels[-1] = [next(words) for _ in range(count)]
            elif word == "Time:":
                self.step_s = float(next(words))
                break
        width = sum(map(len, self.channels))
        self.frames = np.array([float(word) for word in words]).reshape(-1, width)

    def places(self, row: int) -> list[FloatArray]:
        """Where each joint is in a frame, cm, y up."""
        values = iter(self.frames[row].tolist())
        turns: list[FloatArray] = []
        found: list[FloatArray] = []
        for parent, offset, channels in zip(
            self.parents, self.offsets, self.channels, strict=True
        ):
            turn = turns[parent] if parent >= 0 else np.eye(3)
            place = found[parent] if parent >= 0 else np.zeros(3)
            place = place + turn @ np.array(offset)
            for channel in channels:
                value = next(values)
                axis = "XYZ".index(channel[0])
                if channel.endswith("position"):
                    place = place + np.eye(3)[axis] * value
                else:
                    turned = np.eye(3)[axis] * np.radians(value)
                    quat = rotation.from_rotation_vector(turned)
                    turn = turn @ rotation.to_matrix(quat)
            turns.append(turn)
            found.append(place)
        return found


def test_a_skeleton_of_bvh_goes_where_the_body_goes(tmp_path: Path):
    (file,) = WRITERS["bvh"](tmp_path, BODY, made())
    read = Bvh(file.read_text())
    assert read.step_s == pytest.approx(1.0 / session.RATE_HZ)
    assert len(read.frames) == COUNT
    truth = posture.places(BODY, made().posture.quats)
    for row in (0, 17, COUNT - 1):
        for name, place in zip(read.names, read.places(row), strict=True):
            if name.startswith("Site"):
                continue
            x, y, z = truth[f"{name}.start"][row]
            assert place == pytest.approx([100 * x, 100 * z, -100 * y], abs=0.01)
    ends = [p for n, p in zip(read.names, read.places(5), strict=True) if "Site" in n]
    x, y, z = truth["foot.end"][5]
    assert ends[0] == pytest.approx([100 * x, 100 * z, -100 * y], abs=0.01)


def test_only_a_stretch_without_gaps_becomes_bvh(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    (file,) = WRITERS["bvh"](tmp_path, BODY, lost("foot", 10, 13))
    assert len(Bvh(file.read_text()).frames) == COUNT - 13
    assert "only rows 13 to 39 of 40" in capsys.readouterr().err
    with pytest.raises(FileError, match="always missing"):
        WRITERS["bvh"](tmp_path, BODY, lost("foot", 0, COUNT))


def test_points_and_angles_of_c3d_are_read_back_by_ezc3d(tmp_path: Path):
    ezc3d = pytest.importorskip("ezc3d", reason="it has wheels for x86-64 alone")
    gone = lost("foot", 10, 13)
    (file,) = WRITERS["c3d"](tmp_path, BODY, gone)
    read = ezc3d.c3d(str(file))
    point = read["parameters"]["POINT"]
    labels = point["LABELS"]["value"]
    assert point["RATE"]["value"] == [session.RATE_HZ]
    assert point["ANGLES"]["value"] == ["shank_angles", "foot_angles", "other_angles"]
    points = read["data"]["points"]
    places = posture.places(BODY, gone.posture.quats)
    shank = points[:3, labels.index("shank.start")].T
    np.testing.assert_allclose(shank, 1000.0 * places["shank.start"], atol=0.01)
    knee = points[:3, labels.index("shank_angles")].T
    np.testing.assert_allclose(
        knee, np.degrees(gone.posture.angles["shank"]), atol=0.01
    )
    is_lost = np.isnan(points[0, labels.index("foot.toe")])
    assert np.flatnonzero(is_lost).tolist() == [10, 11, 12]
    with pytest.raises(FileExistsError):
        WRITERS["c3d"](tmp_path, BODY, made())


def test_without_ezc3d_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(FileError, match=r"pip install 'imu-probe\[c3d\]'"):
        WRITERS["c3d"](tmp_path, BODY, made())
    assert not list(tmp_path.iterdir())
