# SPDX-License-Identifier: MIT
"""`imud check`: which way the axes lie, the guide that asks for poses, the report."""

from __future__ import annotations

import datetime
import getpass
import json
import platform
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from check_bench import HELLO, G, evidence, raws, rows
from imud.calibration.poses import StaticPose
from imud.calibration.recording import Sample, Scale
from imud.check import report
from imud.check.axes import ASKED, TIMEOUT_S, PoseGuide
from imud.check.evidence import Posed
from imud.check.judge import judged
from imud.check.rows import RowVerdict
from imud.virtual import calibrating, checking, modules

GRAVITY = 9.80665

# By the poses of ASKED: where up is in the sensor, if an axis is mounted so.
MOUNTED = {
    "right": np.eye(3),
    "y is inverted": np.diag([1.0, -1.0, 1.0]),
    "x and y are swapped": np.array([[0, 1, 0], [1, 0, 0], [0, 0, 1.0]]),
    "x and z are swapped": np.array([[0, 0, 1], [0, 1, 0], [1.0, 0, 0]]),
    "turned": np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]),
}


def posed(matrix: np.ndarray[Any, Any]) -> list[Posed]:
    def force(pose: StaticPose) -> tuple[float, float, float]:
        x, y, z = (float(each) for each in matrix @ pose.up * GRAVITY)
        return x, y, z

    return [Posed(pose, force(pose)) for pose in ASKED]


@pytest.mark.parametrize(
    ("mounted", "words"),
    [
        ("y is inverted", "no mounting explains it"),
        ("x and y are swapped", "no mounting explains it"),
        ("x and z are swapped", "no mounting explains it"),
        ("turned", "turned in its housing"),
    ],
)
def test_an_axis_that_lies_otherwise_is_named(mounted: str, words: str) -> None:
    found = evidence()
    found.poses = posed(MOUNTED[mounted])
    row = rows(found)["axes"]
    assert row.verdict is RowVerdict.FAULT
    assert words in row.advice
    named = "x and y are swapped" if mounted == "turned" else mounted
    assert row.measured.startswith(named)


def test_axes_that_lie_right_are_good_and_missing_poses_are_not_judged() -> None:
    found = evidence()
    found.poses = posed(MOUNTED["right"])
    assert rows(found)["axes"].verdict is RowVerdict.GOOD
    found.poses[2] = replace(found.poses[2], acc_m_s2=None)
    row = rows(found)["axes"]
    assert (row.verdict, row.measured) == (
        RowVerdict.SKIPPED,
        "right in 2 of 3 poses",
    )


SCALE = Scale(GRAVITY / G, 1e-3, 0.15, 100.0)


def lie(
    guide: PoseGuide, up: tuple[int, int, int], seconds: float, from_us: int
) -> int:
    """Feeds a guide a probe that lies still; the time after that."""
    random = np.random.default_rng(3)
    for _ in range(round(seconds * SCALE.rate_hz)):
        noise = random.normal(0.0, 4.0, 3)
        x, y, z = (round(G * u + n) for u, n in zip(up, noise, strict=True))
        guide.feed(Sample(from_us, (x, y, z), (0, 1, 0)))
        from_us += 10_000
    return from_us


def test_a_guide_takes_a_pose_once_the_probe_lies_otherwise_than_before() -> None:
    guide = PoseGuide(SCALE, ASKED[1:])
    guide.start_from((0.0, 0.0, GRAVITY))
    now_us = lie(guide, (0, 0, 1), 5.0, 0)
    assert guide.found == []
    now_us = lie(guide, (0, -1, 0), 2.0, now_us)
    assert [each.pose for each in guide.found] == [ASKED[1]]
    lie(guide, (1, 0, 0), 2.0, now_us)
    assert guide.wanted is None
    force = guide.found[1].acc_m_s2
    assert force == pytest.approx((GRAVITY, 0.0, 0.0), abs=0.05)


def test_a_guide_gives_a_pose_up_after_its_time_or_when_it_is_skipped() -> None:
    guide = PoseGuide(SCALE, ASKED)
    guide.start_from((0.0, 0.0, GRAVITY))
    lie(guide, (0, 0, 1), TIMEOUT_S + 0.1, 0)
    assert [each.acc_m_s2 for each in guide.found] == [None]
    guide.skip()
    guide.skip()
    assert guide.wanted is None
    assert [each.acc_m_s2 for each in guide.found] == [None] * 3


def test_the_virtual_hand_does_what_the_guide_asks() -> None:
    guide, sampler = PoseGuide(calibrating.SCALE, ASKED[1:]), calibrating.Sampler()
    guide.start_from((0.0, 0.0, GRAVITY))
    for piece in checking.pieces(modules.calibrated(), 1, 200.0):
        for sample in sampler.samples(piece):
            if sample.t_us > 30e6:  # imud check measures meanwhile
                guide.feed(sample)
        if guide.wanted is None:
            break
    ups = [np.array(each.acc_m_s2) / GRAVITY for each in guide.found]
    assert ups[0] @ ASKED[1].up > 0.9
    assert ups[1] @ ASKED[2].up > 0.9
    first, second = list(checking.presses_us())[:2]
    assert second[0] - first[0] == 80_000_000


def test_a_report_has_all_rows_and_no_names() -> None:
    found = evidence(samples=raws(ppm=3.0))
    found.poses = posed(MOUNTED["right"])
    table = judged(found)
    document = report.as_object(found, table, datetime.date(2026, 11, 25))
    texts = json.dumps(document), report.as_markdown(json.loads(json.dumps(document)))
    for text in texts:
        assert all(row.name in text for row in table)
        assert str(HELLO["probe_id"]) not in text
        for name in (platform.node(), getpass.getuser(), "/dev/", "/home"):
            assert name not in text
    assert json.loads(texts[0])["self_test"]["factory"] == [93, 95, 96, 112, 112, 113]


def test_a_report_on_a_port_without_a_probe_says_so_instead_of_none() -> None:
    found = evidence(samples=raws(ppm=3.0))
    table = judged(found)
    found.hello = {}
    document = report.as_object(found, table, datetime.date(2026, 11, 25))
    text = report.as_markdown(document)
    assert "\nno hello was received; imud " in text
    assert "firmware None" not in text
