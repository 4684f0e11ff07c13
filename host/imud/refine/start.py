# SPDX-License-Identifier: MIT
"""A first estimate: the bias that rests show, levelled, north by the field."""

from __future__ import annotations

import math

import numpy as np

from imud import rotation
from imud.calibration.algebra import onto
from imud.refine.model import (
    BIAS,
    FIELD,
    NORTH,
    OWN,
    BoolArray,
    Estimate,
    Priors,
    Recording,
)
from imud.refine.rests import smooth
from imud.refine.strapdown import course_of, rates_of, within
from imud.rotation import FloatArray

EARTH_RAD_S = 7.292e-5
LEVELLING_S, TURNING_S = 3.0, 5.0
REST_LEAST_S = 0.5  # in all
BIAS_S = (2.0, 20.0)  # of means: of what rests show, and of it over time
UP = np.array([0.0, 0.0, 1.0])
NO_ROTATION = np.zeros(3)
# Readings that are used, and the weight of the own field's prior beside them.
EVERY, ROOM_UT = 7, 3.0
OWN_WEIGHT = 0.01


def started(
    recording: Recording, priors: Priors, is_rest: BoolArray
) -> tuple[Estimate, FloatArray]:
    """The estimate, and the earth's rotation in the world, rad/s."""
    estimate = Estimate.begun(recording.count)
    has_rest = is_rest.sum() * recording.node_s > REST_LEAST_S
    if has_rest:
        bias = _bias_at_rests(recording, is_rest)
        estimate.states[:, BIAS] = np.concatenate([bias, bias[-1:]])
    first = recording.acc[: round(recording.rate_hz)].mean(axis=0)
    estimate.first = rotation.from_matrix(onto(first / np.linalg.norm(first), UP))
    is_turned = not has_rest and priors.own < ROOM_UT
    level(recording, estimate, is_turned=is_turned)
    if not recording.has_mag.any():
        return estimate, NO_ROTATION
    _turn_north(recording, estimate, priors)
    north, up = estimate.whole[NORTH]
    latitude = math.atan2(-up, 2.0 * north)  # of a dipole's field
    along = np.array([0.0, math.cos(latitude), math.sin(latitude)])
    return estimate, EARTH_RAD_S * along


def _bias_at_rests(recording: Recording, is_rest: BoolArray) -> FloatArray:
    """The rates at rests, between and beyond them, smooth over time."""
    rates = recording.by_node(recording.gyr).mean(axis=1)
    at = np.flatnonzero(is_rest)
    short, long = (round(seconds / recording.node_s) for seconds in BIAS_S)
    known = smooth(rates[at], short)
    time = np.arange(recording.count)
    course = np.stack([np.interp(time, at, known[:, i]) for i in range(3)], axis=1)
    return smooth(course, long)


def level(recording: Recording, estimate: Estimate, *, is_turned: bool) -> None:
    """Turns each node by what the mean force tells; `is_turned`: and the field,
    where no rest tells the bias.
    """
    _, rates = rates_of(recording, estimate)
    ends, middles = within(rates, recording)
    forces = rotation.rotate(middles, recording.by_node(recording.acc)).mean(axis=1)
    fields = None
    if is_turned:
        read = recording.by_node(np.nan_to_num(recording.mag))
        reads = recording.by_node(recording.has_mag).sum(axis=1)[:, None]
        fields = rotation.rotate(ends, read).sum(axis=1) / np.maximum(reads, 1)
        fields[reads[:, 0] == 0] = np.nan
    attitude, north = estimate.first, None
    share = recording.node_s / LEVELLING_S
    for node in range(recording.count):
        force = rotation.rotate(attitude, forces[node])
        x, y, z = force.tolist()
        size = math.sqrt(x * x + y * y + z * z) or 1.0
        turn = np.array([share * y / size, -share * x / size, 0.0])
        if fields is not None and math.isfinite(fields[node, 0]):
            east, ahead, _ = rotation.rotate(attitude, fields[node]).tolist()
            now = math.atan2(east, ahead)
            north = now if north is None else north
            away = (now - north + math.pi) % (2.0 * math.pi) - math.pi
            turn[2] = recording.node_s / TURNING_S * away
        estimate.unseen[node] = turn
        step = rotation.from_rotation_vector(turn)
        attitude = rotation.multiply(rotation.multiply(step, attitude), ends[node, -1])


def _turn_north(recording: Recording, estimate: Estimate, priors: Priors) -> None:
    """Field of the place and own field by least squares; north is where it points."""
    course = course_of(recording, estimate, NO_ROTATION)
    used = np.flatnonzero(recording.has_mag[: len(course.ends)])[::EVERY]
    turns = rotation.to_matrix(course.ends[used])
    read = rotation.rotate(course.ends[used], recording.mag[used])
    slopes = np.concatenate([np.broadcast_to(np.eye(3), turns.shape), turns], axis=2)
    matrix = np.einsum("nij,nik->jk", slopes, slopes)
    matrix[3:, 3:] += np.eye(3) * OWN_WEIGHT * len(used) * (ROOM_UT / priors.own) ** 2
    found = np.linalg.solve(matrix, np.einsum("nij,ni->j", slopes, read))
    yaw = math.atan2(found[0], found[1])
    turn = rotation.from_rotation_vector(yaw * UP)
    estimate.first = rotation.multiply(turn, estimate.first)
    estimate.unseen = rotation.rotate(turn, estimate.unseen)
    field = rotation.rotate(turn, found[:3])
    estimate.states[:, FIELD], estimate.states[:, OWN] = field, found[3:]
    estimate.whole[NORTH] = field[1:]
