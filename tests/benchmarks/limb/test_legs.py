# SPDX-License-Identifier: MIT
"""The figures of a leg: what they are measured on, and that the table has them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.limb import legs
from imud.body import chain, mounting, posture
from imud.body.tracks import Track
from imud.virtual import leg
from imud.virtual.leg_probes import RATE_HZ

SHORT = leg.Manner(walk_s=4.6, squats=2, raises=2, wobble_deg=0.0)


def test_true_attitudes_have_hardly_an_error_and_turned_ones_have_one():
    made = leg.made(1, SHORT)
    body = chain.read(leg.CHAIN, "leg")
    count = len(made.ankle[::10])
    times_s, sigma = np.arange(count) * 10 / RATE_HZ, np.full(count, 0.01)
    found = {
        name: Track(times_s, quat[::10], np.zeros((count, 3)), sigma, sigma)
        for name, quat in made.quats.items()
    }
    true = mounting.Mount(np.array([1.0, 0.0, 0.0, 0.0]), 0.01, 0.01, "true")
    mounts = dict.fromkeys(found, true)
    row = legs.score(made, posture.of(body, found, mounts))
    assert row["knee flexion"] < 1.0
    leant = np.array([np.cos(0.05), 0.0, 0.0, np.sin(0.05)])  # by 0.1 rad about z
    mounts["shank"] = replace(true, probe_from_segment=leant)
    worse = legs.score(made, posture.of(body, found, mounts))
    assert worse["knee flexion"] == pytest.approx(np.degrees(0.1), abs=1.0)


def test_probes_with_clocks_of_their_own_are_dated_alike():
    random = np.random.default_rng(1)
    for begin_s in (0.5, 0.503, 0.507):
        true = np.arange(begin_s, 10.0, 0.01)
        late = legs.dated(true, random) - true
        assert 1e-6 < np.ptp(late) < 5e-3
        assert np.abs(late).max() < 5e-3
