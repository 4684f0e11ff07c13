# SPDX-License-Identifier: MIT
"""Quaternions of exports never jump: each row is on the side of the last one."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

from fakes import FakeProbe
from imud import cli, rotation
from imud.body import chain, posture, session
from imud.probes.record import Record, Stamp, record_of
from imud.probes.scales import UNKNOWN
from imud.recordings.body_export import WRITERS
from imud.rotation import FloatArray
from imud.virtual import leg
from imud.wire.messages import Message, decode
from log_files import BEGIN_NS, PERIOD_NS, write

COUNT = 120
BODY = chain.read(leg.CHAIN, "leg")


def turning(count: int) -> FloatArray:
    """Two turns about up, with w at least 0 in every row, as many programs do."""
    angle = np.linspace(0.0, 4.0 * math.pi, count)
    quat = rotation.from_rotation_vector(angle[:, None] * [0.0, 0.0, 1.0])
    return np.where(quat[:, :1] < 0.0, -quat, quat)


def poses(turns: FloatArray, boot_ns: int = BEGIN_NS) -> list[Record]:
    probe = FakeProbe()
    made = []
    for number, q in enumerate(turns.tolist()):
        content = probe.content("pose", q=tuple(q))
        message = decode(content)
        assert isinstance(message, Message)
        t_ns = boot_ns + number * PERIOD_NS
        stamp = Stamp(
            *(number + 1, 0, number * 5000, t_ns, 1000, t_ns),
            whose=("lab-3", None if number % 2 else 412),
        )
        made.append(record_of(message, content, "left", stamp, UNKNOWN))
    return made


def jumps(quat: FloatArray) -> int:
    known = quat[np.isfinite(quat[:, 0])]
    return int((np.sum(known[1:] * known[:-1], axis=1) < 0.0).sum())


def same(quat: FloatArray, other: FloatArray) -> None:
    """Either sign is the same attitude."""
    np.testing.assert_allclose(np.abs(np.sum(quat * other, axis=1)), 1.0, atol=1e-6)


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_poses_are_on_one_side_until_the_probe_restarts(
    tmp_path: Path, to: str
) -> None:
    turns = turning(COUNT)
    assert jumps(turns) == 2
    # The second boot begins on the other side of where the first one ended.
    other = -turns[::-1]
    path = write(tmp_path, poses(turns), poses(other, BEGIN_NS + 10**12))
    assert cli.main(["export", str(path), "--to", to]) == 0
    file = tmp_path / f"{path.stem}-left-pose.{to}"
    if to == "csv":
        with file.open() as text:
            rows = list(csv.DictReader(text))
    else:
        rows = parquet.read_table(file).to_pylist()
    quat = np.array([[float(row[f"q_{n}"]) for n in "wxyz"] for row in rows])
    same(quat, np.concatenate([turns, other]))
    assert "-0.0" not in {str(row["q_x"]) for row in rows}
    assert (jumps(quat[:COUNT]), jumps(quat[COUNT:])) == (0, 0)
    np.testing.assert_allclose(quat[COUNT], other[0], atol=1e-6)
    assert [row["utc_host"] for row in rows] == ["lab-3"] * (2 * COUNT)
    bounds = [row["utc_bound_us"] for row in rows[:2]]
    assert bounds == (["412", ""] if to == "csv" else [412, None])


def body() -> session.BodyAnalysis:
    quats = {each.name: turning(COUNT) for each in BODY.segments}
    quats["shank"][50:60] = np.nan  # while its sign changes
    turns = {child.name: np.zeros((COUNT, 3)) for _, child in BODY.joints()}
    found = posture.Posture(np.arange(COUNT) / session.RATE_HZ, quats, turns, turns)
    return session.BodyAnalysis(found, {}, {}, {}, ())


def test_segments_are_on_one_side_over_gaps(tmp_path: Path) -> None:
    made = body()
    (_, sto) = WRITERS["sto"](tmp_path, BODY, made)
    _, _, table = sto.read_text().partition("endheader\n")
    lines = [line.split("\t")[1:] for line in table.splitlines()[1:]]
    cells = np.array([[cell.split(",") for cell in line] for line in lines], float)
    (file,) = WRITERS["csv"](tmp_path, BODY, made)
    with file.open() as text:
        rows = list(csv.DictReader(text))
    for index, segment in enumerate(BODY.segments):
        wanted = made.posture.quats[segment.name]
        assert jumps(wanted) > 0
        names = [f"{segment.name}_q{n}" for n in "wxyz"]
        flat = np.array([[float(row[n] or "nan") for n in names] for row in rows])
        for quat in (flat, cells[:, index]):
            assert jumps(quat) == 0
            np.testing.assert_array_equal(np.isnan(quat), np.isnan(wanted))
        is_there = np.isfinite(wanted[:, 0])
        same(flat[is_there], wanted[is_there])
