# SPDX-License-Identifier: MIT
"""The 24 ways in which the axes of a module can lie along those of its housing."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import msgspec
import numpy as np

from imud.calibration.affine import Affine
from imud.calibration.algebra import closest_turn
from imud.calibration.recording import Counts, Sample
from imud.errors import ImudError
from imud.rotation import FloatArray

# Where an axis of a module may point in the housing.
SIDES = {
    "front": (1, 0, 0),
    "back": (-1, 0, 0),
    "left": (0, 1, 0),
    "right": (0, -1, 0),
    "top": (0, 0, 1),
    "bottom": (0, 0, -1),
}
NEAR = math.cos(math.radians(20.0))  # a turn this close to one of the 24 is that one


class MountError(ImudError):
    """There is no mounting of this name."""


class MountTold(msgspec.Struct, frozen=True):
    """How a module is mounted: a text for users, and the directions of its arrows."""

    words: str
    x: str
    y: str
    is_plain: bool


@dataclass(frozen=True, slots=True)
class ModuleMount:
    """One of the 24."""

    turn: FloatArray  # matrix of 0, 1 and -1 from the module's axes to the housing's
    is_assumed: bool = False  # assumed: neither found nor given

    @property
    def name(self) -> str:
        """Where the arrows x and y of the module point: "front,left" is as it is."""
        return ",".join(_side(self.turn[:, axis]) for axis in (0, 1))

    @property
    def is_plain(self) -> bool:
        return bool((self.turn == np.eye(3)).all())

    @property
    def words(self) -> str:
        """How the module is turned in its housing, as a line of a report."""
        if self.is_assumed:
            return (
                "the module's axes are assumed to be the housing's, as the poses were "
                "not the requested ones; find them with imud calibrate mount"
            )
        if self.is_plain:
            return "the module's axes are those of the housing"
        x, y, z = (_side(self.turn[:, axis]) for axis in range(3))
        lies = {"top": "lies flat", "bottom": "lies upside down"}.get(z, "stands")
        return (
            f"the module {lies}: its x arrow points to the {x}, its y arrow to the {y}"
        )

    def told(self) -> MountTold:
        """For a screen."""
        x, y = self.name.split(",")
        return MountTold(self.words, x, y, self.is_plain and not self.is_assumed)

    def sample(self, sample: Sample) -> Sample:
        """The readings that a module with the housing's axes would have had."""
        return Sample(
            sample.t_us,
            self._counts(sample.acc),
            self._counts(sample.gyr),
            None if sample.mag is None else self._counts(sample.mag),
            sample.temperature_c,
            sample.is_clipped,
        )

    def _counts(self, counts: Counts) -> Counts:
        x, y, z = (int(value) for value in self.turn @ counts)
        return x, y, z

    def of_turned(self, affine: Affine) -> Affine:
        """The calibration of readings that were turned, of one of the module's own."""
        return Affine(affine.matrix @ self.turn.T, self.turn @ affine.bias)


def _side(direction: FloatArray) -> str:
    return next(n for n, side in SIDES.items() if tuple(map(round, direction)) == side)


def _all() -> tuple[ModuleMount, ...]:
    found = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0.0:
                found.append(ModuleMount(turn))
    return tuple(found)


ALL = _all()
PLAIN = next(each for each in ALL if each.is_plain)
ASSUMED = ModuleMount(PLAIN.turn, is_assumed=True)


def named(name: str) -> ModuleMount:
    """MountError lists the possible names."""
    wanted = name.replace(" ", "").lower()
    for each in ALL:
        if each.name == wanted:
            return each
    raise MountError(
        f"{name!r} is not a mounting; give the directions of the module's x and y "
        f"arrows, such as back,left; each is one of {', '.join(SIDES)}"
    )


def of_matrix(matrix: FloatArray) -> ModuleMount | None:
    """The mounting that a calibration's matrix has; None if none is close."""
    if np.linalg.det(matrix) < 0.1:
        return None
    turn = closest_turn(matrix)
    best = max(ALL, key=lambda each: float((each.turn * turn).sum()))
    cosine = (float((best.turn * turn).sum()) - 1.0) / 2.0
    return best if cosine > NEAR else None
