# SPDX-License-Identifier: MIT
"""Attitudes by integrated rates, from one node to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.refine.model import BIAS, GYR, Estimate, Recording
from imud.rotation import FloatArray


@dataclass(frozen=True, slots=True)
class Course:
    """Attitudes, world_from_body, and the rates that led to them."""

    nodes: FloatArray  # (k + 1, 4)
    ends: FloatArray  # (n, 4): at the end of each sample
    middles: FloatArray  # (n, 4): amid what it averages
    biases: FloatArray  # (n, 3), rad/s
    rates: FloatArray  # (n, 3), rad/s, without errors

    def late(self, samples: float) -> FloatArray:
        """The attitudes so many samples before the ends."""
        at = np.clip(np.arange(len(self.ends)) - samples, 0.0, len(self.ends) - 1.001)
        before = at.astype(int)
        share = (at - before)[:, None]
        first, second = self.ends[before], self.ends[before + 1]
        sign = np.sign((first * second).sum(axis=1, keepdims=True))
        mixed = (1.0 - share) * first + share * sign * second
        return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))


def course_of(recording: Recording, estimate: Estimate, earth: FloatArray) -> Course:
    """`earth`: its rotation in the world, rad/s."""
    count, each, node_s = recording.count, recording.each, recording.node_s
    biases, rates = rates_of(recording, estimate)
    inner, middle = within(rates, recording)
    outer = estimate.unseen - earth * node_s
    left = products(rotation.from_rotation_vector(outer), is_left=True)
    right = products(inner[:, -1], is_left=False)
    nodes = rotation.multiply(rotation.multiply(left, estimate.first), right)
    nodes /= np.linalg.norm(nodes, axis=1, keepdims=True)

    def at(share: FloatArray, turned: FloatArray) -> FloatArray:
        partly = rotation.from_rotation_vector(outer[:, None] * share[:, None])
        whole = rotation.multiply(partly, rotation.multiply(nodes[:-1, None], turned))
        return whole.reshape(count * each, 4)

    share = (np.arange(each) + 1.0) / each
    return Course(
        nodes, at(share, inner), at(share - 0.5 / each, middle), biases, rates
    )


def rates_of(recording: Recording, estimate: Estimate) -> tuple[FloatArray, FloatArray]:
    """The biases at each sample, and the rates without errors."""
    share = ((np.arange(recording.each) + 0.5) / recording.each)[None, :, None]
    before, after = estimate.states[:-1, None, BIAS], estimate.states[1:, None, BIAS]
    biases = (before * (1.0 - share) + after * share).reshape(-1, 3)
    return biases, (recording.gyr - biases) @ estimate.matrix(GYR).T


def within(rates: FloatArray, recording: Recording) -> tuple[FloatArray, FloatArray]:
    """Turns since the node before to the end and to the middle of each sample, each of
    shape (intervals, samples in each, 4).
    """
    turns = recording.by_node(rates * recording.step_s)
    steps = rotation.from_rotation_vector(turns)
    halves = rotation.from_rotation_vector(0.5 * turns)
    ends, middles = np.empty_like(steps), np.empty_like(steps)
    turned = np.tile(rotation.IDENTITY, (len(steps), 1))
    for index in range(recording.each):
        middles[:, index] = rotation.multiply(turned, halves[:, index])
        turned = rotation.multiply(turned, steps[:, index])
        ends[:, index] = turned
    return ends, middles


def products(steps: FloatArray, *, is_left: bool) -> FloatArray:
    """Of all steps before each node, (k + 1, 4): later ones to the left or right."""
    found = np.concatenate([rotation.IDENTITY[None], steps])
    reach = 1
    while reach < len(found):  # after each round an entry spans `2 reach` steps
        earlier, later = found[:-reach], found[reach:]
        pair = (later, earlier) if is_left else (earlier, later)
        found[reach:] = rotation.multiply(*pair)
        reach *= 2
    return found
