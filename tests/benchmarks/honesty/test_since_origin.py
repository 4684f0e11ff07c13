# SPDX-License-Identifier: MIT
"""The benchmark of errors since an origin: what it takes for true, and its shares."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.engines import Estimate
from benchmarks.honesty import since_origin
from benchmarks.honesty.since_origin import known_params, pairs_of, stated
from imud import rotation
from imud.probes.relative_error import quality_of
from imud.virtual.motion import Motion


def test_each_origin_is_compared_with_the_times_after_it() -> None:
    """A heading that drifts by 0.01 deg/s from a world that is 5 degrees off."""
    times_s = np.arange(0.0, 45.0, 0.1)
    drift = np.stack([0 * times_s, 0 * times_s, 5.0 + 0.01 * times_s], axis=1)
    sigma = np.full(len(times_s), 1.2)
    found = Estimate(
        times_s, rotation.from_rotation_vector(np.deg2rad(drift)), sigma / 3, sigma
    )
    still = np.zeros((4600, 3))
    truth = Motion(100.0, still, still, still, np.tile([1.0, 0, 0, 0], (4600, 1)))
    pairs = [*pairs_of(found, truth, known_params(), step_s=2.0)]
    assert {pair.after_s for pair in pairs} == {1.0, 10.0}
    for pair in pairs:
        assert pair.heading == pytest.approx(0.01 * pair.after_s, rel=0.02)
        assert pair.heading_sigma < 0.1


def test_shares_count_only_what_is_stated() -> None:
    found = stated([0.1, 0.3, 9.0], [0.1, 0.1, None])
    assert (found.count, found.withheld) == (3, pytest.approx(1 / 3))
    assert found.inside == 0.5
    assert found.sigma == pytest.approx(0.1)
    assert found.true == pytest.approx(np.sqrt(0.05))


def test_the_params_tell_what_the_motions_draw() -> None:
    quality = quality_of(known_params())
    assert quality.gyr_share == pytest.approx(0.002)
    assert quality.mag_deg == pytest.approx(np.degrees(0.3 / 20.0), rel=1e-3)


def test_a_short_run_states_errors_that_hold(tmp_path: Path) -> None:
    output = tmp_path / "found.json"
    words = f"--seeds 1 --groups aim --jobs 1 --output {output}"
    since_origin.main(arguments=words.split())
    rows = json.loads(output.read_text("utf-8"))["tables"]["lines"]["rows"]
    assert [after for _, after, *_ in rows] == [1.0, 10.0, 30.0, 60.0, 120.0]
    for _, _, sigma, _, inside, *_ in rows:
        assert inside > 90.0
        assert sigma < 0.8


def test_errors_outside_what_is_stated_are_missed() -> None:
    good = since_origin.Paired(100, 0.0, 0.1, 0.1, 0.96)
    bad = since_origin.Paired(100, 0.0, 0.1, 0.3, 0.92)
    lines = [
        since_origin.Line("still", 120.0, good, good),
        since_origin.Line("aim", 30.0, good, bad),
    ]
    *_, inside = since_origin.figures(lines)
    assert (inside.value, inside.verdict) == (92.0, "MISSED")
