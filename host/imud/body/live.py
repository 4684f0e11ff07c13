# SPDX-License-Identifier: MIT
"""A body as it moves: poses of its probes come in, its states come out. Without I/O;
times are UTC in s.

A state shows the moment `delay_s` ago, by which each probe should have sent. A probe
that has not is late or missing, and so are its segment and the joints beside it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from imud import rotation
from imud.body import heading, mounting, posture, session, tracks, zero
from imud.body.chain import Chain, Segment
from imud.body.feet import Feet
from imud.body.following import Following
from imud.body.heading import HeadingFilter
from imud.body.hinge import AlignmentRefused
from imud.body.history import ProbeHistory
from imud.body.joints import JointModel
from imud.body.mounting import Mount
from imud.body.posture import Posture
from imud.body.session import Alignment
from imud.body.state import (
    BodyState,
    Presence,
    SegmentState,
    Stage,
    joints,
    place,
)
from imud.body.tracks import AWAY_S, GAP_S, Track
from imud.rotation import FloatArray, Quat

DELAY_S = 0.15
ALIGN_S = 180.0  # of poses that an alignment looks back on
RUN_S = 5.0  # and what is kept afterwards, to find swapped probes
SWAPPED_LOOKS = 4  # in a row that tell of swapped probes: a turn or a stop is one
RATE_HZ = 50.0  # of what alignment looks at
LOST_S = 1.0  # a probe that has been silent for longer is missing
# A zero that is not known is looked for again after ZERO_S, or that share of the time
# since the pose: each look goes through all of it.
LOST = "the zero angle stays unknown: restart imud body"
ZERO_S, ZERO_SHARE, ZERO_BEFORE_S = 3.0, 0.1, 0.1
GUIDE_S = 1.0  # between two looks at the motion
STAND_S, AGAIN_S = 3.0, 2.0
# How long the person should stand still, in the stages that align.
GUIDED = {"standing": STAND_S, "moving": AGAIN_S}

STAND = f"stand straight and still for {STAND_S:g} s"
MOVE = f"bend every joint four times, then stand still for {AGAIN_S:g} s"
# Gaps of single poses are nothing for an alignment.
GAP_ALIGN_S = 2.0 * GAP_S


class LiveBody:
    """One body.

    waiting --- poses ---> standing --- still ---> moving --- aligned ---> running
       ^                    |    ^                 |    |
       +-- a probe is away -+    +---- refused ----+    |
       +---------------- a probe is away ---------------+

    `facing_rad`: where the person faces while standing, counterclockwise from east, or
    None.
    """

    def __init__(
        self, chain: Chain, facing_rad: float | None = None, delay_s: float = DELAY_S
    ) -> None:
        self.chain = chain
        self._facing_rad = facing_rad
        self._delay_s = delay_s
        self.histories = {
            each.probe: ProbeHistory(ALIGN_S) for each in chain.segments if each.probe
        }
        self.stage: Stage = "waiting"
        self.instruction: str | None = None
        self._added: list[str] = []  # remarks since the alignment
        self._doubts = 0  # looks in a row at which probes seemed swapped
        self._begun_s = -math.inf  # of the poses that an alignment may use
        self._looked_s = -math.inf
        self._ahead_rad = 0.0  # heading of the body's x
        self._alignment: Alignment | None = None
        self._known: Mapping[str, JointModel] = {}
        self._zeroed_s = math.inf  # of the next look for zeros that were not known
        self._steps: dict[str, HeadingFilter] = {}
        self._feet = Feet(chain)
        self._following = Following(chain)
        self._followed_s = math.inf  # up to when
        self._sides: dict[str, Quat] = {}  # the last attitudes, for their signs
        self._number = 0

    def state(self, now_s: float) -> BodyState:
        """The state to publish. Call it with rising times, some dozens a second."""
        time_s = now_s - self._delay_s
        self._restart(time_s)
        presences = {s.name: self._presence(s, now_s) for s in self.chain.segments}
        if now_s - self._looked_s >= GUIDE_S:
            self._looked_s = now_s
            self._guide(presences, time_s)
        self._follow(time_s)
        shown = self._shown(time_s)
        self._number += 1
        of_s = GUIDED.get(self.stage)
        bounds = [h.bound_us for h in self.histories.values() if h.bound_us is not None]
        return BodyState(
            body=self.chain.name,
            side=self.chain.side,
            number=self._number,
            t_ns=round(time_s * 1e9),
            t_bound_us=max(bounds, default=None),
            age_us=round(self._delay_s * 1e6),
            stage=self.stage,
            instruction=self.instruction,
            still_s=None if of_s is None else round(self._following.still_s, 1),
            still_of_s=of_s,
            aligned=self._method(),
            missing=tuple(n for n, state in presences.items() if state != "ok"),
            remarks=(*self.remarks, *self._feet.remarks()),
            segments=self._segments(shown, presences, now_s),
            joints=joints(self.chain, shown, self._following.bends),
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on the alignment, and on the probes since then."""
        known = self._alignment.remarks if self._alignment is not None else ()
        return (*known, *self._added)

    def _presence(self, segment: Segment, now_s: float) -> Presence:
        history = self.histories.get(segment.probe or "")
        if history is None:
            return "missing"
        if not history.is_dated:
            return "no clock"
        last_s = history.last_s
        if last_s is None or now_s - last_s > LOST_S:
            return "missing"
        shown_s = now_s - self._delay_s
        if last_s < shown_s:
            return "late"
        return "ok" if history.has(shown_s) else "missing"

    # Alignment

    def _method(self) -> str | None:
        return next((each.method for each in self._mounts.values()), None)

    @property
    def _mounts(self) -> Mapping[str, Mount]:
        return self._alignment.mounts if self._alignment is not None else {}

    def _guide(self, presences: Mapping[str, Presence], time_s: float) -> None:
        """Follows the motion and sets the next instruction."""
        if self.stage == "running":
            self._check_order(time_s)
            if self._zeroed_s < math.inf and any(
                s.probe and self._is_away(s, time_s) for s in self.chain.segments
            ):
                # It may come back with another heading.
                self._end_zeros()
            if time_s >= self._zeroed_s and self._alignment is not None:
                self._zero(self._alignment, time_s)
            return
        away = [
            f"{s.name} ({s.probe})"
            for s in self.chain.segments
            if s.probe and (presences[s.name] == "no clock" or self._is_away(s, time_s))
        ]
        if away:
            undated = any(state == "no clock" for state in presences.values())
            why = "its clock is unknown" if undated else "no poses"
            self.stage = "waiting"
            self.instruction = f"waiting for {', '.join(away)}: {why}"
            self._begun_s = time_s
            return
        if self.stage == "waiting":
            self.stage, self.instruction = "standing", STAND
        found = self._since(self._begun_s, time_s)
        if not found:
            return
        try:
            spans = session.standing(found)
        except AlignmentRefused:
            return
        stood = [each for each in spans if each[1] - each[0] >= STAND_S - 0.1]
        if not stood:
            return
        begin_s, end_s = stood[0]
        if self.stage == "standing":
            # Earlier motion is no part of an alignment.
            self._begun_s = begin_s
            self.stage, self.instruction = "moving", MOVE
            self._following.begin()
        if any(each[0] > end_s + session.MOTION_S for each in spans):
            self._align(found, time_s)

    def _follow(self, time_s: float) -> None:
        """Shows the person how far the motion that aligns is."""
        if self.stage not in GUIDED:
            self._followed_s = math.inf
            return
        if self._followed_s == math.inf:
            self._followed_s = time_s
            self._following.still_s = 0.0
        count = int((time_s - self._followed_s) * RATE_HZ)
        if count < 2:
            return
        times_s = self._followed_s + np.arange(1, count + 1) / RATE_HZ
        self._followed_s = float(times_s[-1])
        self._following.add(self._tracks(times_s))

    def _restart(self, time_s: float) -> None:
        """Begins again what rests on the heading of a probe that has another now."""
        for segment in self.chain.segments:
            history = self.histories.get(segment.probe or "")
            if history is None or time_s < history.turned_s:
                continue
            history.turned_s = math.inf
            for parent, child in self.chain.joints():
                if segment in (parent, child):
                    self._steps.pop(child.name, None)
            if self.stage in ("standing", "moving"):
                self.stage, self._begun_s = "standing", time_s
                self._following.still_s = 0.0
                words = f"the probe of {segment.name} restarted or got another origin"
                self.instruction = f"{words}. Start again: {STAND}"
            elif self._zeroed_s < math.inf:
                self._end_zeros()

    def _is_away(self, segment: Segment, time_s: float) -> bool:
        """Whether it has been silent for too long for an alignment or a zero."""
        last_s = self.histories[segment.probe or ""].last_s
        return last_s is None or time_s - last_s > AWAY_S

    def _since(self, begin_s: float, end_s: float) -> dict[str, Track]:
        """Tracks at RATE_HZ by segment; empty if there is too little."""
        starts = [h.poses[0][0] for h in self.histories.values() if h.poses]
        begin_s = max([begin_s, *starts])
        times_s = begin_s + np.arange(int((end_s - begin_s) * RATE_HZ)) / RATE_HZ
        if len(times_s) < RATE_HZ * session.STILL_S:
            return {}
        return self._tracks(times_s)

    def _tracks(self, times_s: FloatArray) -> dict[str, Track]:
        """By segment; empty where a probe has none."""
        found = {}
        for segment in self.chain.segments:
            if segment.probe:
                track = self.histories[segment.probe].track(times_s, GAP_ALIGN_S)
                if track is None:
                    return {}
                found[segment.name] = track
        return found

    def _align(self, found: Mapping[str, Track], time_s: float) -> None:
        try:
            done = session.aligned(self.chain, found, self._facing_rad)
        except AlignmentRefused as refused:
            self.stage = "standing"
            self.instruction = f"{refused}. Start again: {STAND}"
            self._begun_s = time_s
            self._following.still_s = 0.0
            return
        self.stage, self.instruction = "running", None
        root = self.chain.segments[0].name
        if root in found:
            quat = zero.mean(found[root], session.standing(found)[0])
            stood = rotation.multiply(quat, done.mounts[root].probe_from_segment)
            x, y, _ = rotation.rotate(stood, np.array([1.0, 0.0, 0.0])).tolist()
            self._ahead_rad = math.atan2(y, x)
        self._take(done, time_s)

    def _take(self, done: Alignment, time_s: float) -> None:
        """An alignment, or one with better zeros."""
        self._alignment = done
        # Forces at a joint's centre need samples before and after: not live.
        self._known = {n: replace(each, arms=None) for n, each in done.known.items()}
        since_s = time_s - done.pose[0]
        if zero.is_open(self.chain, done.mounts) and since_s < ALIGN_S:
            self._zeroed_s = time_s + max(ZERO_S, ZERO_SHARE * since_s)
        else:
            self._end_zeros()

    def _end_zeros(self) -> None:
        """Ends the search for zeros; those that are unknown stay so."""
        self._zeroed_s = math.inf
        if self._alignment is not None and self._alignment.on_zeros:
            self._added.append(LOST)
        for history in self.histories.values():
            history.kept_s = RUN_S

    def _zero(self, begun: Alignment, time_s: float) -> None:
        """Checks whether motion has shown the unknown zeros."""
        found = self._since(begun.pose[0] - ZERO_BEFORE_S, time_s)
        done = begun
        if found and next(iter(found.values())).times_s[0] <= begun.pose[0]:
            done = session.zeroed(self.chain, begun, found, self._facing_rad)
        self._take(done, time_s)

    def _check_order(self, time_s: float) -> None:
        """Detects swapped probes by their motion in walking."""
        if self._method() != "motion" or any("swapped" in r for r in self.remarks):
            return
        found = self._since(time_s - RUN_S, time_s)
        if not mounting.is_walking(found):
            self._doubts = 0
            return
        try:
            mounting.check_order(self.chain, found)
        except AlignmentRefused as refused:
            self._doubts += 1
            if self._doubts == SWAPPED_LOOKS:
                self._added.append(str(refused))
        else:
            self._doubts = 0

    # What is published

    def _shown(self, time_s: float) -> Posture | None:
        """The posture at a moment, in the body's world; None before alignment."""
        if self.stage != "running":
            return None
        times_s = np.array([time_s])
        seen = {}
        for segment in self.chain.segments:
            history = self.histories.get(segment.probe or "")
            track = history.track(times_s) if history is not None else None
            seen[segment.name] = track or tracks.nothing(times_s)
        found = posture.of(self.chain, seen, self._mounts, self._known, self._steps)
        back = heading.about_up(-self._ahead_rad)
        for name, quat in found.quats.items():
            found.quats[name] = rotation.multiply(back, quat)
        histories = {
            each.name: self.histories[each.probe]
            for each in self.chain.segments
            if each.probe in self.histories
        }
        self._feet.update(time_s, found.quats, seen, self._mounts, histories)
        return found

    def _segments(
        self, shown: Posture | None, presences: Mapping[str, Presence], now_s: float
    ) -> tuple[SegmentState, ...]:
        places = posture.places(self.chain, shown.quats) if shown is not None else {}
        states = []
        for segment in self.chain.segments:
            name = segment.name
            history = self.histories.get(segment.probe or "")
            last_s = history.last_s if history is not None else None
            quat = shown.quats[name][0] if shown is not None else np.full(4, np.nan)
            is_there = bool(np.isfinite(quat).all())
            w, x, y, z = (round(each, 5) for each in quat.tolist())
            if is_there:
                w, x, y, z = self._sides[name] = rotation.beside(
                    (w, x, y, z), self._sides.get(name)
                )
            marks = {
                mark: there
                for mark in segment.marks
                if (there := place(places.get(f"{name}.{mark}"))) is not None
            }
            states.append(
                SegmentState(
                    name=name,
                    parent=segment.parent,
                    probe=segment.probe,
                    presence=presences[name],
                    age_us=None
                    if last_s is None
                    else max(0, round((now_s - last_s) * 1e6)),
                    q=(w, x, y, z) if is_there else None,
                    start_m=place(places.get(f"{name}.start")) if is_there else None,
                    end_m=marks.pop("end", None),
                    marks_m=marks,
                    contact=self._feet.state(name) if is_there else None,
                )
            )
        return tuple(states)
