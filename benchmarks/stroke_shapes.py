# SPDX-License-Identifier: MIT
"""Strokes whose path and turn are those of people who moved a sensor: BROAD's.

A shape is a stretch of a recording's optical truth between two minima of its speed. It
is scaled to a stroke's length and goes from rest to rest with least jerk along its own
course; its turn is kept. Everything is in the world's frame but for the heading, which
each stroke draws.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import scoring
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial import Chebyshev

from imud import rotation
from imud.rotation import FloatArray
from imud.virtual import motion
from imud.virtual.bodies import Body
from imud.virtual.curves import STEP, Curve, Turning
from imud.virtual.curves import shape as shaped
from imud.virtual.hand import Stance
from imud.virtual.motion import Motion, join
from imud.virtual.sensors import HAND_RATE_HZ, World
from imud.virtual.stroking import PAUSE_S, SETTLES_S, Plan

# Recordings in which the sensor is turned in place have no strokes.
TURNED_IN_PLACE = "_rotation"
# A stretch that counts as a stroke: its way in m, its time in s, its way over the
# path's length, the speed at its ends over the highest one, and the rms of what the
# polynomials leave over of it, m and rad.
LENGTH_M = (0.05, 0.4)
SECONDS = (0.25, 3.0)
STRAIGHT_MIN = 0.9
ENDS_MAX = 0.3
PATH_REST_M = 0.003
TURN_REST_RAD = 0.02
SMOOTH_S = 1.0 / 12.0  # of the speed whose minima count
DEGREE = 11
HALF_S = 1e-4  # of the differences that rates are found by

ZERO, ONE = np.zeros(1), np.ones(1)


@dataclass(frozen=True, slots=True)
class Shape:
    """A path, m, and the turn since its start, a rotation vector of the world, over
    0..1.
    """

    trial: str
    path: tuple[Chebyshev, ...]
    turn: tuple[Chebyshev, ...]

    @property
    def way_m(self) -> FloatArray:
        """From its start to its end."""
        return np.array([axis(1.0) - axis(0.0) for axis in self.path])

    @property
    def turn_deg(self) -> float:
        """The angle between its start and its end."""
        return float(np.degrees(np.linalg.norm([axis(1.0) for axis in self.turn])))


def smoothed(rows: FloatArray, count: int) -> FloatArray:
    """Each column's mean over windows of `count` rows; the ends are held."""
    padded = np.pad(rows, ((count // 2, count - 1 - count // 2), (0, 0)), mode="edge")
    return np.asarray(sliding_window_view(padded, count, axis=0).mean(axis=-1))


def shape_of(trial: str, place: FloatArray, quat: FloatArray) -> Shape | None:
    """The shape of a stretch of truth; none where it is not like a stroke."""
    way = place[-1] - place[0]
    length = float(np.linalg.norm(way))
    whole = float(np.sum(np.linalg.norm(np.diff(place[::8], axis=0), axis=1)))
    if not LENGTH_M[0] <= length <= LENGTH_M[1] or length < STRAIGHT_MIN * whole:
        return None
    turn = rotation.to_rotation_vector(
        rotation.multiply(quat, rotation.inverse(quat[0]))
    )
    # A turn of more than half a round leaps.
    if np.abs(np.diff(turn, axis=0)).max() > 1.0:
        return None
    u = np.linspace(0.0, 1.0, len(place))

    def fitted(rows: FloatArray) -> tuple[tuple[Chebyshev, ...], float]:
        fits = [Chebyshev.fit(u, axis, DEGREE, domain=[0, 1]) for axis in rows.T]
        rest = rows - np.stack([fit(u) for fit in fits], axis=1)
        return tuple(fits), float(np.sqrt(np.mean(np.sum(rest**2, axis=1))))

    path, path_rest = fitted(place - place[0])
    turned, turn_rest = fitted(turn)
    if path_rest > PATH_REST_M or turn_rest > TURN_REST_RAD:
        return None
    return Shape(trial, path, turned)


def shapes_of(trial: str, recorded: Motion) -> Iterator[Shape]:
    """The strokes of a recording with optical truth."""
    quat, place = recorded.quat, recorded.position
    if quat is None or place is None:
        return
    window = max(1, round(SMOOTH_S * recorded.rate_hz))
    speed = np.linalg.norm(np.gradient(smoothed(place, window), axis=0), axis=1)
    speed = smoothed(speed[:, None], window)[:, 0]
    near = round(0.5 * SECONDS[0] * recorded.rate_hz)
    least = sliding_window_view(np.pad(speed, near, mode="edge"), 2 * near + 1)
    for first, last in itertools.pairwise(np.flatnonzero(speed == least.min(axis=1))):
        seen = slice(first, last + 1)
        seconds = (last - first) / recorded.rate_hz
        is_seen = np.isfinite(quat[seen]).all() and np.isfinite(place[seen]).all()
        rests = max(speed[first], speed[last]) <= ENDS_MAX * speed[seen].max()
        if is_seen and rests and SECONDS[0] <= seconds <= SECONDS[1]:
            shape = shape_of(trial, place[seen], quat[seen])
            if shape is not None:
                yield shape


def are_here() -> bool:
    """Whether the recordings are on this machine."""
    return scoring.RECORDINGS.is_dir()


@cache
def shapes(half: int) -> tuple[Shape, ...]:
    """The shapes of every second recording, from the first or the second one on."""
    paths = sorted(scoring.RECORDINGS.glob("*.npz"))
    moved = [path for path in paths if TURNED_IN_PLACE not in path.stem]
    return tuple(
        shape
        for path in moved[half::2]
        for shape in shapes_of(path.stem, motion.load(path))
    )


def records(body: Body, *, is_stroke: bool) -> Motion:
    """What a sensor without errors measures at the origin of a body."""
    turning, place = body.turning, body.place
    down = rotation.inverse(turning.quat)
    count = len(turning.quat)
    return Motion(
        rate_hz=HAND_RATE_HZ,
        gyr=turning.rate,
        acc=body.specific_force(),
        mag=rotation.rotate(down, World().field_at(place.value)),
        quat=np.array(turning.quat),
        position=place.value,
        velocity=place.first,
        tip=place.value,
        movement=np.full(count, True),
        is_rest=np.full(count, not is_stroke),
        is_stroke=np.full(count, is_stroke),
        is_recorded=False,
    )


def still(stance: Stance, seconds: float) -> Motion:
    body = Body.still(stance.quat, round(seconds * HAND_RATE_HZ))
    there = Curve(body.place.value + stance.tip, body.place.first, body.place.second)
    return records(replace(body, place=there), is_stroke=False)


def stroke(
    shape: Shape, heading_rad: float, plan: Plan, start: Stance
) -> tuple[Motion, Stance]:
    """A stroke of this shape from a stance on, and the stance at its end."""
    scale = plan.length_m / float(np.linalg.norm(shape.way_m))
    heading = rotation.from_rotation_vector(np.array([0.0, 0.0, heading_rad]))

    def rows(curves: Sequence[Chebyshev], order: int, u: FloatArray) -> FloatArray:
        values = np.stack([axis.deriv(order)(u) for axis in curves], axis=-1)
        return rotation.rotate(heading, values)

    def place(u: FloatArray, first: FloatArray, second: FloatArray) -> Curve:
        along, bend = rows(shape.path, 1, u), rows(shape.path, 2, u)
        return Curve(
            start.tip + scale * (rows(shape.path, 0, u) - rows(shape.path, 0, ZERO)),
            scale * first * along,
            scale * (first**2 * bend + second * along),
        )

    def attitude(u: FloatArray) -> FloatArray:
        turn = rows(shape.turn, 0, u) - rows(shape.turn, 0, ZERO)
        return rotation.multiply(rotation.from_rotation_vector(turn), start.quat)

    t = np.arange(round(plan.seconds * HAND_RATE_HZ)) / HAND_RATE_HZ / plan.seconds
    course = shaped(STEP, t[:, None], plan.seconds)
    before, after = (
        attitude(STEP(np.clip(t + step / plan.seconds, 0.0, 1.0)))
        for step in (-HALF_S, HALF_S)
    )
    turned = rotation.multiply(rotation.inverse(before), after)
    rate = rotation.to_rotation_vector(turned) / (2.0 * HALF_S)
    turning = Turning(attitude(STEP(t)), rate, np.zeros_like(rate))
    body = Body(turning, place(course.value[:, 0], course.first, course.second))
    gone = scale * rotation.rotate(heading, shape.way_m)
    end = Stance(start.tip + gone, attitude(ONE)[0], 0.0, 0.0)
    return records(body, is_stroke=True), end


def chain(
    random: np.random.Generator,
    plan: Plan,
    quat: FloatArray,
    draw: Callable[[], tuple[Shape, float]],
) -> Motion:
    """A rest of this attitude, then a plan's strokes with a rest after each, the sensor
    at the tip. `draw` gives each stroke's shape and heading, rad.
    """
    stance = Stance(np.zeros(3), quat, 0.0, 0.0)
    pieces = [still(stance, SETTLES_S + 2.0 * PAUSE_S + random.uniform(0.0, 0.1))]
    for _ in range(plan.strokes):
        piece, stance = stroke(*draw(), plan, stance)
        pieces += [piece, still(stance, PAUSE_S + random.uniform(0.0, 0.1))]
    return join([*pieces, still(stance, 2.0 * PAUSE_S)])


def motion_of(plan: Plan, seed: int) -> Motion:
    """Strokes in the shapes of recordings: even seeds take those of one half of the
    recordings, odd ones those of the other.
    """
    random = np.random.default_rng([seed, 5])
    known = shapes(seed % 2)
    quat = rotation.from_heading_pitch_roll(
        random.uniform(-np.pi, np.pi),
        math.radians(random.uniform(30.0, 60.0)),
        math.radians(random.uniform(-30.0, 30.0)),
    )

    def draw() -> tuple[Shape, float]:
        return known[random.integers(len(known))], random.uniform(-np.pi, np.pi)

    return chain(random, plan, quat, draw)
