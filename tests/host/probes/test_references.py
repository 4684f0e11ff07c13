# SPDX-License-Identifier: MIT
"""Errors since an origin or a captured target: what they hold on to, when they are
void, and what they do not depend on.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imud import rotation
from imud.params.trusted import known_to
from imud.params.value import Params
from imud.probes.references import CAPTURES_MAX, References
from imud.published import SinceOrigin

ROOT = Path(__file__).resolve().parents[3]
VALUES = {"bias_counts": [0.0] * 3, "matrix": np.eye(3).tolist(), "method": "measured"}
FIELD = {"sigma_uT": 0.3, "norm_uT": 47.0, "dip_deg": 65.0}
KNOWN = (
    Params.decode(known_to(0.007, 0.3))
    .replaced("gyr", VALUES | {"sigma": 0.002})
    .replaced("mag", VALUES | FIELD)
    .encode()
)
LEVEL = (1.0, 0.0, 0.0, 0.0)


def turned(*vector_deg: float) -> tuple[float, ...]:
    return tuple(map(float, rotation.from_rotation_vector(np.deg2rad(vector_deg))))


class Told:
    """A probe's poses and events as its daemon describes them."""

    def __init__(self, hz: float = 100.0, params: bytes | None = KNOWN) -> None:
        self.references = References()
        self.references.tell(params)
        self.period_us = round(1e6 / hz)
        self.time_us = 100_000_000
        self.flags: tuple[str, ...] = ()
        self.sigmas: tuple[float | None, float | None] = 1.2, 0.4

    def pose(self, q: tuple[float, ...] = LEVEL, *flags: str) -> SinceOrigin | None:
        self.time_us += self.period_us
        heading, tilt = self.sigmas
        return self.references.on_pose(
            {
                "q": q,
                "t_device_us": self.time_us,
                "heading_sigma_deg": heading,
                "tilt_sigma_deg": tilt,
                "flags": (*self.flags, *flags),
            }
        )

    def poses(
        self, seconds: float, q: tuple[float, ...] = LEVEL, *flags: str
    ) -> SinceOrigin:
        found = None
        for _ in range(max(1, round(seconds * 1e6 / self.period_us))):
            found = self.pose(q, *flags)
        assert found is not None
        return found

    def captured(self) -> str:
        """The name of a target that is captured at another pose."""
        self.pose()
        name = self.references.capture()
        assert name is not None
        return name

    def event(self, name: str, detail: int = 0) -> None:
        self.references.on_event({"event": name, "detail": detail}, self.time_us)

    def tare(self, detail: int = 0) -> None:
        self.event("tared", detail)
        self.flags = () if detail == 2 else ("tared",)

    def swing(
        self, seconds: float, degrees: float, hz: float = 0.5, axis: int = 2
    ) -> Any:
        """About the vertical or another axis of the world, back and forth."""
        found = None
        for number in range(round(seconds * 1e6 / self.period_us)):
            at_s = number * self.period_us * 1e-6
            angle = degrees * math.sin(2.0 * math.pi * hz * at_s)
            found = self.pose(turned(*(angle * np.eye(3)[axis])))
        return found


def tared(hz: float = 100.0) -> Told:
    """With an origin."""
    told = Told(hz)
    told.pose()
    told.tare()
    return told


def heading_of(found: SinceOrigin | None) -> float:
    assert found.heading_sigma_deg is not None
    return found.heading_sigma_deg


def tilt_of(found: SinceOrigin | None) -> float:
    assert found.tilt_sigma_deg is not None
    return found.tilt_sigma_deg


def test_without_an_origin_there_is_nothing_to_state() -> None:
    told = Told()
    assert told.pose() is None
    told.tare()
    assert told.pose() is not None
    told.tare(2)
    assert told.pose() is None


def test_a_probe_that_lies_still_is_known_to_a_tenth_of_a_degree() -> None:
    told = tared()
    found = told.poses(1.0)
    assert found.age_s == pytest.approx(1.0, abs=0.02)
    assert 0.02 <= heading_of(found) < 0.05
    assert 0.02 <= tilt_of(found) < 0.07
    found = told.poses(119.0)
    assert found.age_s == pytest.approx(120.0, abs=0.02)
    assert 0.05 < heading_of(found) < 0.15
    assert found.void is None


def test_it_grows_with_what_was_turned_and_never_beyond_both_absolute_errors() -> None:
    told = tared()
    first = heading_of(told.swing(10.0, 5.0))
    second = heading_of(told.swing(30.0, 20.0))
    assert 0.15 < first < second
    far = heading_of(told.swing(120.0, 170.0, hz=1.0))
    assert second < far < 1.2 * math.sqrt(2.0)


def test_turns_about_a_level_axis_make_the_heading_less_sure_up_to_a_limit() -> None:
    told = tared()
    first = heading_of(told.swing(2.0, 5.0, axis=0))
    assert 0.1 < first < 0.3
    second = heading_of(told.swing(6.0, 5.0, axis=0))
    assert first < second
    assert heading_of(told.swing(6.0, 5.0, axis=0)) < 1.1 * second


@pytest.mark.parametrize("hz", [10.0, 25.0, 50.0, 100.0, 200.0, 760.0])
def test_it_does_not_depend_on_the_rate_of_the_poses(hz: float) -> None:
    told = tared(hz)
    found = heading_of(told.swing(20.0, 10.0))
    assert found == pytest.approx(heading_of(tared().swing(20.0, 10.0)), rel=0.03)


def test_a_lost_pose_changes_little_and_a_pause_counts_as_turned() -> None:
    found = {}
    for lost_s in (0.0, 0.1, 0.2, 0.5, 1.4, 2.0):
        told = tared(20.0)
        told.swing(4.0, 10.0)
        told.time_us += round(lost_s * 1e6)
        found[lost_s] = told.swing(4.0, 10.0)
    assert heading_of(found[0.1]) == pytest.approx(heading_of(found[0.0]), rel=0.03)
    assert heading_of(found[0.2]) < heading_of(found[0.5]) < heading_of(found[1.4])
    assert heading_of(found[0.5]) > 1.2 * heading_of(found[0.0])
    assert found[2.0].void == "pause"
    assert found[2.0].heading_sigma_deg is None


@pytest.mark.parametrize("at", ["then", "now"])
def test_an_unknown_error_at_either_end_is_unknown(at: str) -> None:
    told = Told()
    told.pose()
    known = told.sigmas
    for sigmas in ((None, 0.4), (None, None)):
        told.sigmas = sigmas if at == "then" else known
        told.tare()
        told.pose()
        told.sigmas = sigmas if at == "now" else known
        found = told.pose()
        assert found.heading_sigma_deg is None
        assert (found.tilt_sigma_deg is None) == (sigmas[1] is None)
        assert found.void is None


def test_a_heading_that_was_lost_meanwhile_has_nothing_in_common_with_the_first() -> (
    None
):
    told = tared()
    told.poses(2.0)
    told.sigmas = None, 0.4
    told.pose()
    told.sigmas = 1.2, 0.4
    assert heading_of(told.pose()) == pytest.approx(1.2 * math.sqrt(2.0), abs=0.002)


def test_an_origin_of_the_heading_leaves_the_tilt_as_it_is() -> None:
    told = Told()
    told.pose(turned(0.0, 20.0, 0.0))
    told.tare(1)
    found = told.poses(2.0, turned(0.0, 20.0, 0.0))
    assert found.tilt_sigma_deg == 0.4
    assert heading_of(found) < 0.06


@pytest.mark.parametrize("flags", [("starting",), ("gap",)])
def test_a_lost_attitude_voids_the_origin_until_the_next(flags: tuple[str]) -> None:
    told = tared()
    name = told.captured()
    told.poses(1.0)
    told.pose(LEVEL, *flags)
    found = told.poses(0.5)
    assert (found.heading_sigma_deg, found.tilt_sigma_deg) == (None, None)
    assert found.void == flags[0]
    assert found.age_s is not None
    captured = told.references.since_capture(name)
    assert captured == SinceOrigin(None, None, None, flags[0])
    told.tare()
    assert told.poses(0.5).void is None


def test_samples_that_are_missing_at_rest_hide_no_motion() -> None:
    told = tared()
    told.pose(LEVEL, "gap", "at_rest")
    assert told.poses(0.1).void is None


def test_a_restart_leaves_nothing_to_relate_to() -> None:
    told = tared()
    name = told.captured()
    told.event("restarted", 1)
    assert told.poses(0.1).void == "restarted"
    told.references.follow(1, KNOWN)
    told.flags = ()
    assert told.pose() is None
    captured = told.references.since_capture(name)
    assert captured.void == "restarted"


def test_other_params_end_it_even_if_their_event_was_lost() -> None:
    told = tared()
    told.pose()
    told.references.tell(None)  # known to be others, not which
    told.references.tell(KNOWN)
    assert told.poses(0.1).void is None
    told.references.tell(known_to(0.02, 0.5))
    assert told.poses(0.1).void == "params_changed"


def test_an_origin_from_before_the_daemon_is_not_known() -> None:
    told = Told()
    told.flags = ("tared",)
    found = told.poses(1.0)
    assert found == SinceOrigin(None, None, None, "unheard")
    told.tare()
    assert told.poses(1.0).void is None


def test_a_capture_is_related_to_its_own_moment_and_ends_with_the_origin() -> None:
    told = Told()
    first = told.captured()
    told.swing(20.0, 30.0)
    second = told.references.capture()
    told.pose(turned(0.0, 0.0, 0.01))
    assert second is not None
    errors = [told.references.since_capture(name) for name in (first, second)]
    assert heading_of(errors[0]) > 4.0 * heading_of(errors[1])
    told.tare()
    told.pose()
    captured = told.references.since_capture(second)
    assert captured.void == "origin_changed"
    assert told.references.since_capture("other") is None


def test_so_many_captures_are_kept_and_no_more() -> None:
    told = Told()
    assert told.references.capture() is None
    told.pose()
    names = [told.references.capture() for _ in range(CAPTURES_MAX + 1)]
    found = [told.references.since_capture(name or "") for name in names]
    assert [one is None for one in found] == [True] + CAPTURES_MAX * [False]
