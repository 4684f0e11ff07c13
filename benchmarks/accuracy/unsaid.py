# SPDX-License-Identifier: MIT
"""Recordings whose refined poses are wrong without a word: none may be.

Stretches of simulated motions of all groups, begun at rest and amid the motion, with
three kinds of modules: calibrated as they say, worse than they say, and as shops sell
them. Seeds of 1000 and more, which nothing was tuned on.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.accuracy.afterwards import DELAY_S
from benchmarks.accuracy.compared import grouped
from benchmarks.accuracy.groups import KNOWN
from benchmarks.common import scoring
from benchmarks.common.feed import MPU9250, sampled
from benchmarks.harness import Figure, Report, Table
from imud import rotation
from imud.params.trusted import known_to, place_of
from imud.params.value import Params
from imud.refine.known import priors_of
from imud.refine.model import Recording
from imud.refine.whole import parts_of
from imud.rotation import FloatArray
from imud.virtual.modules import shop
from imud.virtual.motion import Motion
from imud.virtual.motions.groups import GROUPS, Recipe, exact
from imud.virtual.motions.module import MODULES
from imud.virtual.motions.ride import RATE_HZ
from imud.virtual.motions.room import ROOMS

AS_SAID, WORSE, SHOP = "as its params say", "worse than they say", "of a shop"
FIRST_SEED = 1000
SECONDS = (30.0, 60.0)
WHOLE = ("walking",)  # all of it: 100 m and more
# Wrong: beyond so many stated sigmas and so many degrees, for so long in all.
SIGMAS, WRONG_DEG, WRONG_S = 4.0, 5.0, 1.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of one recording: for how long which errors were wrong; the largest stated ones
    in sigmas, and what was withheld.
    """

    group: str
    module: str
    seed: int
    from_rest: bool
    wrong: tuple[str, ...]
    worst_deg: tuple[float, float, float]  # stated tilt, heading, change of heading
    all_withheld: bool
    heading_withheld: bool
    doubts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Task:
    group: str
    module: str
    seed: int

    def made(self) -> tuple[Motion, Motion, bytes, bool]:
        """The exact motion, as it is felt, its params, and whether it begins at rest.
        North is where the field points at its beginning.
        """
        recipe = Recipe(self.group, self.seed)
        random = np.random.default_rng([self.seed, len(self.group)])
        ride = GROUPS[self.group].ride(random)
        room = ROOMS[recipe.room](random, ride)
        motion = exact(ride, room)
        seconds = random.uniform(*SECONDS)
        from_rest = bool(random.integers(2)) or self.group in WHOLE
        first = 0 if from_rest else round(RATE_HZ * (ride.rest_s + 2.0))
        last = len(motion) if self.group in WHOLE else first + round(RATE_HZ * seconds)
        motion = motion[first:last]
        at = ride.body.place.value[first : first + 1]
        east, north, _ = room.field_at(at, ride.t[first : first + 1])[0].tolist()
        up = np.array([0.0, 0.0, math.atan2(east, north)])
        turn = rotation.from_rotation_vector(up)
        assert motion.quat is not None
        motion.quat[:] = rotation.multiply(turn, motion.quat)
        said = recipe.module
        module = MODULES[said](random)
        if self.module == SHOP:
            return motion, shop(random).measures(motion, random), b"", from_rest
        if self.module == WORSE:
            module = MODULES["large"](random)
            said = "small"
        params = known_to(*KNOWN[said], **place_of(room.field_ut))
        return motion, module.measures(motion, random), params, from_rest


def measure(task: Task) -> Outcome:
    motion, felt, params, from_rest = task.made()
    feed = sampled(felt, MPU9250, params)
    samples = feed.samples
    recording = Recording(samples.rate_hz, samples.gyr, samples.acc, samples.mag)
    priors = priors_of(Params.decode(params))
    parts = [part for part, _ in parts_of(recording, priors, DELAY_S)]

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(part, name) for part in parts])

    quats = joined("quats")
    off = scoring.errors_at(feed.times_s[: len(quats)], quats, motion)
    turned = np.degrees(np.angle(np.exp(1j * np.radians(off.turned))))
    change = np.abs((turned - turned[0] + 180.0) % 360.0 - 180.0)
    wrong, worst = [], []
    for name, error in (
        ("tilt", off.inclination),
        ("heading", np.abs(turned)),
        ("change", change),
    ):
        sigma = joined(f"{name}_deg")
        is_wrong = (error > SIGMAS * sigma) & (error > WRONG_DEG)
        worst.append(float(np.max(error, where=np.isfinite(sigma), initial=0.0)))
        if is_wrong.sum() > WRONG_S * samples.rate_hz:
            wrong.append(name)
    doubts = {doubt.words: doubt.is_of_all for part in parts for doubt in part.doubts}
    return Outcome(
        *(task.group, task.module, task.seed, from_rest, tuple(wrong)),
        (worst[0], worst[1], worst[2]),
        any(doubts.values()),
        bool(doubts),
        tuple(doubts),
    )


COLUMNS = {
    **{"group": "", "module": "", "recordings": "d", "all withheld, %": ".0f"},
    **{"heading withheld, %": ".0f", "largest tilt, heading, change, deg": ""},
    "wrong without a word": "d",
}


def row(outcomes: Sequence[Outcome]) -> list[Any]:
    worst = np.max([each.worst_deg for each in outcomes], axis=0)
    return [
        *(outcomes[0].group, outcomes[0].module, len(outcomes)),
        100.0 * float(np.mean([each.all_withheld for each in outcomes])),
        100.0 * float(np.mean([each.heading_withheld for each in outcomes])),
        ", ".join(f"{each:.1f}" for each in worst),
        sum(bool(each.wrong) for each in outcomes),
    ]


def tasks(args: argparse.Namespace) -> Iterator[Task]:
    for seed in harness.seeds_of(args, FIRST_SEED):
        for group in args.groups:
            for module in (AS_SAID, WORSE, SHOP):
                yield Task(group, module, seed)


def measured(args: argparse.Namespace) -> Report:
    """What `--kept` holds is not measured again."""
    found = {Task(o.group, o.module, o.seed): o for o in kept(args.kept)}
    wanted = [*tasks(args)]
    missing = [task for task in wanted if task not in found]
    for outcome in harness.each(measure, missing, args.jobs, "recordings"):
        found[Task(outcome.group, outcome.module, outcome.seed)] = outcome
        if args.kept is not None:
            with args.kept.open("a") as file:
                file.write(json.dumps(asdict(outcome)) + "\n")
    outcomes = [found[task] for task in wanted]
    groups = grouped(outcomes, lambda each: f"{each.group}, {each.module}")
    wrong = [each for each in outcomes if each.wrong]
    names = ", ".join(f"{each.group} {each.seed}" for each in wrong)
    return Report(
        [Table("groups", COLUMNS, [row(each) for each in groups.values()])],
        [
            Figure("recordings", len(outcomes), (2000, math.inf), (2000, math.inf)),
            Figure("wrong without a word", len(wrong), (0, 0), (0, 0), names),
        ],
    )


def kept(path: Path | None) -> Iterator[Outcome]:
    if path is None or not path.exists():
        return
    for line in path.read_text().splitlines():
        known = json.loads(line)
        for name in ("wrong", "worst_deg", "doubts"):
            known[name] = tuple(known[name])
        yield Outcome(**known)


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--kept", metavar="FILE", type=Path, help="of what was measured, to go on from"
    )


main = partial(
    harness.run,
    *("unsaid", __doc__, measured),
    harness.options(seeds=61, groups=GROUPS, jobs=1, more=more),
)
