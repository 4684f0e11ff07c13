# SPDX-License-Identifier: MIT
"""A body as it moves: its alignment, its angles, and what is missing."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache

import msgspec
import numpy as np
import pytest

from imud import rotation
from imud.body import chain, heading, live
from imud.body.live import LiveBody
from imud.body.state import BodyState
from imud.virtual import leg
from imud.virtual.leg_probes import RATE_HZ

UTC_S = 1.7e9
EVERY = 20  # records of the leg in a pose: 50 a second
STATE_HZ = 12.5
GUIDED_HZ = 4  # states a second that a test skips through
WALKED = leg.Manner(walk_s=9.0, squats=2, raises=2)
SIGMAS = math.radians(1.0), math.radians(20.0)


@cache
def made() -> leg.Leg:
    return leg.made(1, WALKED)


Sample = tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]


@cache
def samples() -> dict[str, list[Sample]]:
    """Attitude, rate and force of each probe's poses; their headings differ."""
    found = {}
    for turn, (name, motion) in enumerate(made().motions.items()):
        assert motion.quat is not None
        wrong = heading.about_up(np.array(math.radians(20.0 * turn)))
        quat = rotation.multiply(wrong, motion.quat)
        parts = [each[::EVERY].tolist() for each in (quat, motion.gyr, motion.acc)]
        found[name] = [
            (tuple(q), tuple(g), tuple(a)) for q, g, a in zip(*parts, strict=True)
        ]
    return found


@dataclass
class Desk:
    """Feeds a body with what the virtual leg's probes say, 100 times a second."""

    body: LiveBody
    # From and to, s of the leg's time, in which a probe is silent.
    silent: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    late_s: Mapping[str, float] = field(default_factory=dict)
    wearers: Mapping[str, str] = field(default_factory=dict)  # probe: whose motion
    # By how much a filter has corrected its heading at each time, rad.
    corrected: Callable[[float], float] = lambda _: 0.0
    back_rad: float = 0.0  # by how much the heading of a silent probe differs then
    has_raw: bool = True
    bias_rad_s: float = 0.0  # of each axis of the gyroscope

    def states(
        self, until_s: float = math.inf, skipped_s: float = 0.0
    ) -> Iterator[tuple[float, BodyState]]:
        """The state at each moment, with the time of the leg that it shows; up to
        `skipped_s` only some.
        """
        for index in range(len(made().ankle) // EVERY):
            time_s = index * EVERY / RATE_HZ
            if time_s > until_s:
                return
            for name in leg.SEGMENTS:
                first, last = self.silent.get(name, (0.0, 0.0))
                late = round(self.late_s.get(name, 0.0) * RATE_HZ / EVERY)
                if index >= late and not first <= time_s < last:
                    self._say(name, index - late)
            rate_hz = GUIDED_HZ if time_s < skipped_s else STATE_HZ
            if index % round(RATE_HZ / EVERY / rate_hz) == 0:
                shown_s = time_s - live.DELAY_S
                yield shown_s, self.body.state(UTC_S + time_s)

    def _say(self, name: str, index: int) -> None:
        history = self.body.histories[name]
        quat, gyr, acc = samples()[self.wearers.get(name, name)][index]
        time_s = UTC_S + index * EVERY / RATE_HZ
        turn_rad = self.corrected(index * EVERY / RATE_HZ)
        if index * EVERY / RATE_HZ >= self.silent.get(name, (0.0, math.inf))[1]:
            turn_rad += self.back_rad
        turn = heading.about_up(np.array(turn_rad))
        w, x, y, z = rotation.multiply(turn, np.array(quat)).tolist()
        device_us = round(1e6 * (time_s - UTC_S))
        if turn_rad and self.back_rad:  # it has restarted
            device_us -= round(1e6 * self.silent[name][1])
        history.look(time_s, device_us, ())
        history.add_pose(time_s, (w, x, y, z), SIGMAS)
        if self.has_raw:
            p, q, r = (each + self.bias_rad_s for each in gyr)
            history.add_raw(time_s, (p, q, r), acc)
        history.bound_us = 700


def body() -> LiveBody:
    return LiveBody(chain.read(leg.CHAIN, "leg"))


@cache
def shown() -> list[tuple[float, BodyState]]:
    return list(Desk(body()).states())


def test_it_says_what_to_do_until_it_is_aligned():
    told = list(dict.fromkeys((s.stage, s.instruction) for _, s in shown()))
    assert told == [
        ("standing", live.STAND),
        ("moving", live.MOVE),
        ("running", None),
    ]
    assert all(s.joints[0].angles_deg is None for _, s in shown() if s.instruction)
    assert {s.remarks for _, s in shown()} == {()}
    assert [s.number for _, s in shown()] == [*range(1, len(shown()) + 1)]
    aligned_s = next(time_s for time_s, s in shown() if s.stage == "running")
    assert made().stages["rest"][0] < aligned_s < made().stages["walk"][0] + 1.0


def test_standing_and_bends_are_counted_while_it_is_aligned():
    stages = {name: [s for _, s in shown() if s.stage == name] for name in live.GUIDED}
    for name, of_s in live.GUIDED.items():
        last = stages[name][-1]
        assert (last.still_of_s, last.still_s) == (of_s, pytest.approx(of_s, abs=1.2))
    # Two squats, and the knee is raised twice. The foot also turns in between.
    knee, ankle = (each.bends for each in stages["moving"][-1].joints)
    assert knee == 4 <= ankle
    assert {s.still_s for s in stages["moving"] if not s.joints[0].bends} == {0.0}
    assert {s.still_s for _, s in shown() if s.stage == "running"} == {None}
    assert all(msgspec.json.encode(s) for _, s in shown())


def test_angles_are_those_of_the_leg_within_what_is_stated():
    off, sigmas = [], []
    for time_s, state in shown():
        knee = state.joints[0]
        if time_s > made().stages["walk"][0] + 1.0 and knee.angles_deg is not None:
            at = round(time_s * RATE_HZ)
            truth = math.degrees(made().angles["shank"][at, 0])
            off.append(knee.angles_deg["flexion"] - truth)
            sigmas.append(knee.sigmas_deg["flexion"])
    assert len(off) > 80
    assert np.sqrt(np.mean(np.square(off))) < 4.0
    assert (np.abs(off) < 1.96 * np.array(sigmas)).mean() > 0.85


def test_the_four_numbers_of_a_segment_never_jump_to_the_other_sign():
    """The attitude is the same, but who draws or differentiates them sees a jump."""
    last: dict[str, tuple[float, ...]] = {}
    begin_s = made().stages["walk"][0] + 2.0
    desk = Desk(body(), corrected=lambda time_s: math.tau * (time_s > begin_s))
    for _, state in desk.states(begin_s + 2.0):
        for segment in state.segments:
            if segment.q is not None:
                if segment.name in last:
                    assert np.dot(segment.q, last[segment.name]) > 0
                last[segment.name] = segment.q
    assert len(last) == 3


@pytest.mark.sampled(2)
@pytest.mark.parametrize("has_raw", [True, False])
def test_a_heading_that_is_corrected_is_no_motion(has_raw: bool):
    """A filter that learns the field turns its poses, ten times a second."""
    steps = np.random.default_rng(3).normal(0.0, math.radians(4.0), 600)
    steps[::2] -= steps[1::2].mean()
    turned = np.cumsum(steps - np.concatenate([[0.0], steps[:-1]]))
    desk = Desk(
        body(),
        corrected=lambda time_s: float(turned[int(10.0 * time_s)]),
        has_raw=has_raw,
        bias_rad_s=math.radians(2.0),
    )
    walk_s = made().stages["walk"][0]
    last = [state for _, state in desk.states(walk_s + 2.0, walk_s + 1.0)][-1]
    assert (last.stage, last.aligned) == ("running", "motion")


def test_joints_have_places_and_x_is_ahead():
    first = next(s for _, s in shown() if s.stage == "running")
    thigh, shank, foot = first.segments
    assert thigh.start_m == (0.0, 0.0, 0.0)
    assert shank.start_m == thigh.end_m == first.joints[0].at_m
    assert shank.start_m == pytest.approx((0.0, 0.0, -leg.THIGH_M), abs=0.05)
    assert foot.marks_m["toe"] is not None
    # It stands: the toe is ahead of the ankle, and to neither side.
    assert foot.start_m is not None
    away = np.subtract(foot.marks_m["toe"], foot.start_m)
    assert away == pytest.approx((leg.TOE_M, 0.0, -leg.ANKLE_M), abs=0.03)
    assert (first.t_bound_us, first.aligned) == (700, "motion")


def test_strides_of_the_foot_are_told():
    feet = [s.segments[2].contact for _, s in shown() if s.stage == "running"]
    strides = [foot.stride_m for foot in feet if foot is not None and foot.stride_m]
    assert {foot.is_down for foot in feet if foot is not None} == {False, True}
    told = np.array(sorted(set(strides)))
    # The first swing and the last are shorter.
    assert len(told) >= 4
    assert np.median(told) == pytest.approx(WALKED.stride_m, rel=0.04)


def test_a_lost_probe_is_missing_and_never_still():
    walk_s = made().stages["walk"][0] + 3.0
    desk = Desk(body(), silent={"shank": (walk_s, walk_s + 2.0)})
    presences = []
    for time_s, state in desk.states(walk_s + 2.6, skipped_s=walk_s - 0.3):
        if walk_s < time_s < walk_s + 1.95:
            shank, knee = state.segments[1], state.joints[0]
            assert shank.q is None
            assert shank.start_m is None
            assert state.segments[2].start_m is None  # it hangs on the shank
            assert knee.angles_deg is None
            assert state.missing == ("shank",)
            presences.append(shank.presence)
        if time_s > walk_s + 2.1:
            assert state.joints[0].angles_deg is not None
    assert list(dict.fromkeys(presences)) == ["late", "missing"]


@pytest.mark.parametrize(
    ("name", "away_s"), [("thigh", 4.3), ("shank", 4.3), ("thigh", 1.2), ("shank", 0.1)]
)
def test_a_probe_that_restarted_has_right_angles_at_once(name: str, away_s: float):
    begin_s = made().stages["walk"][0] + 2.0
    end_s = begin_s + away_s
    desk = Desk(body(), silent={name: (begin_s, end_s)}, back_rad=1.0)
    off, sigmas = [], []
    for time_s, state in desk.states(end_s + 2.0, skipped_s=end_s - 1.0):
        knee = state.joints[0]
        if time_s > end_s and knee.angles_deg is not None:
            truth = np.degrees(made().angles["shank"][round(time_s * RATE_HZ)])
            off.append(np.subtract([*knee.angles_deg.values()], truth))
            sigmas.append([*knee.sigmas_deg.values()])
    assert len(off) > 20
    assert (np.abs(off) < 1.96 * np.array(sigmas)).mean() > 0.85


def test_a_probe_that_comes_after_the_delay_is_late():
    walk_s = made().stages["walk"][0]
    desk = Desk(body(), late_s={"foot": live.DELAY_S + 0.05})
    *_, (_, last) = desk.states(walk_s + 1.0, skipped_s=walk_s + 1.0)
    assert last.stage == "running"
    assert (last.segments[2].presence, last.segments[2].q) == ("late", None)
    assert last.segments[1].q is not None


def test_an_unknown_clock_is_reported():
    found = body()
    for index in range(3):
        found.histories["thigh"].add_pose(UTC_S + index / 100, (1, 0, 0, 0), SIGMAS)
    found.histories["shank"].is_dated = False
    state = found.state(UTC_S + 0.1)
    assert state.instruction is not None
    assert "shank (shank)" in state.instruction
    assert "clock is unknown" in state.instruction
    assert state.segments[1].presence == "no clock"


def test_probes_that_were_swapped_are_found_by_their_motion():
    desk = Desk(body(), wearers={"thigh": "foot", "foot": "thigh"})
    told = [s.remarks for _, s in desk.states(skipped_s=math.inf) if s.remarks]
    assert any("are the two swapped?" in each for each in told[-1])


def test_who_has_said_nothing_is_waited_for():
    state = body().state(UTC_S)
    assert (state.stage, state.missing) == ("waiting", ("thigh", "shank", "foot"))
    assert state.instruction == (
        "waiting for thigh (thigh), shank (shank), foot (foot): no poses"
    )
