# SPDX-License-Identifier: MIT
"""The segments of a body, how they hang together, and which probe sits on each."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from imud.config.toml import called, line_of, mistakes, parse
from imud.endpoint import fitting
from imud.errors import ConfigError
from imud.rotation import FloatArray

Metres = Annotated[float, Meta(ge=0.0, le=3.0)]
Side = Literal["right", "left"]
JointName = Literal[
    "hip",
    "knee",
    "ankle",
    "shoulder",
    "elbow",
    "wrist",
    "ball",
    "hinge",
    "universal",
    "free",
]
THREE = ("flexion", "abduction", "rotation")


@dataclass(frozen=True, slots=True)
class Joint:
    """The properties of a joint.

    `flexion`: the sign of flexion as a turn of the child about z. `is_hinge`: it turns
    mainly about z. `bends`: the sign of flexion whenever it is far from straight; 0 if
    it bends both ways. `play_deg`: rms of its turns about the other two axes.

    `freedom`: how many axes it turns about, in any direction, which motion shows; 0: a
    joint of the body, whose segments stand upright. `angles`: their names.
    """

    flexion: float
    is_hinge: bool
    bends: float
    play_deg: float
    freedom: int = 0
    angles: tuple[str, ...] = THREE


JOINTS: dict[str, Joint] = {
    "hip": Joint(1.0, False, 0.0, 10.0),
    "knee": Joint(-1.0, True, 1.0, 4.0),
    "ankle": Joint(1.0, True, 0.0, 6.0),
    "shoulder": Joint(1.0, False, 0.0, 40.0),
    "elbow": Joint(1.0, True, 1.0, 20.0),
    "wrist": Joint(1.0, False, 0.0, 20.0),
    "ball": Joint(1.0, False, 0.0, 40.0),
    "hinge": Joint(1.0, False, 0.0, 2.0, 1, ("angle",)),
    "universal": Joint(1.0, False, 0.0, 3.0, 2, ("first", "second")),
    "free": Joint(1.0, False, 0.0, 90.0, 3),
}


NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


class _Segment(msgspec.Struct, forbid_unknown_fields=True):
    """A rigid part of the body."""

    length_m: Metres = 0.0
    probe: str | None = None
    parent: str | None = None
    joint: JointName = "ball"
    at: str | None = None
    contact: bool = False
    marks: dict[str, tuple[float, float, float]] = {}


class _File(msgspec.Struct, forbid_unknown_fields=True):
    """A file that describes a body."""

    segments: dict[str, _Segment]
    name: str = "body"
    side: Side = "right"


@dataclass(frozen=True, slots=True)
class Segment:
    """A rigid part of the body; `parent` None: the root.

    Marks are places in m in its frame, from the joint at its start; "end" lies
    `length_m` below. `at`: the mark of the parent where this segment begins.
    """

    name: str
    parent: str | None
    kind: JointName
    joint: Joint
    at: str
    probe: str | None
    is_contact: bool
    marks: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class Chain:
    """A tree of segments, parents before children."""

    name: str
    side: Side
    segments: tuple[Segment, ...]

    def __getitem__(self, name: str) -> Segment:
        return next(each for each in self.segments if each.name == name)

    def joints(self) -> Iterator[tuple[Segment, Segment]]:
        """Each parent with one of its children."""
        for child in self.segments:
            if child.parent is not None:
                yield self[child.parent], child


def read(text: str, source: str) -> Chain:
    """The chain in a TOML text; ConfigError with the first mistake, on one line.

    `source` names the file in the message.
    """
    try:
        table = parse(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{source} is not TOML: {error}") from error
    found = [(each.path, each.words) for each in mistakes(table, _File)]
    if not found and not table.get("segments"):
        found = [((), "it has no segments: add a section [segments.NAME] for each")]
    if not found:
        file = msgspec.convert(table, _File)
        found = [(("segments", *path), words) for path, words in _faults(file)]
        if not NAME.fullmatch(file.name):
            words = (
                "use only letters, digits, dots, - and _: the name is part of keys "
                f"and file names; try {fitting(file.name, '^A-Za-z0-9_.-', 'arm')}"
            )
            found.insert(0, (("name",), words))
    if found:
        path, words = found[0]
        line = line_of(text, path) if path else None
        place = f"{source}:{line}" if line is not None else source
        key = f"{called(path)}: " if path else ""
        raise ConfigError(f"{place}: {key}{words}")
    return _chain(file)


def _faults(file: _File) -> Iterator[tuple[tuple[str, ...], str]]:
    """Contradictions between valid values: where, and why."""
    segments = file.segments
    known = ", ".join(segments)
    wearers: dict[str, str] = {}
    for name, each in segments.items():
        if each.probe is not None:
            other = wearers.setdefault(each.probe, name)
            if other != name:
                yield (name, "probe"), f"{each.probe} is already on {other}"
        if each.parent is None:
            continue
        if each.parent not in segments:
            yield (name, "parent"), f"there is no segment {each.parent}, only {known}"
            continue
        marks = ("end", *segments[each.parent].marks)
        if each.at is not None and each.at not in marks:
            there = ", ".join(marks)
            yield (name, "at"), f"{each.parent} has no mark {each.at}, only {there}"
        way = [name]
        while way[-1] in segments and (above := segments[way[-1]].parent):
            way.append(above)
            if above == name:
                yield (name, "parent"), f"a cycle: {' > '.join(way)}"
                return
            if above in way[:-1]:
                break  # a cycle above, reported at its own members
    roots = [name for name, each in segments.items() if each.parent is None]
    if len(roots) > 1:
        first = roots[0]
        yield (roots[1],), f"it has no parent, like {first}; only one root is possible"
    if not any(each.probe for each in segments.values()):
        yield (next(iter(segments)),), "no segment has a probe"


def _chain(file: _File) -> Chain:
    waiting = dict(file.segments)
    placed: dict[str, Segment] = {}
    while waiting:
        for name, each in list(waiting.items()):
            if each.parent is not None and each.parent not in placed:
                continue
            marks = {"end": np.array([0.0, -each.length_m, 0.0])}
            marks |= {key: np.array(place) for key, place in each.marks.items()}
            placed[name] = Segment(
                name,
                each.parent,
                each.joint,
                JOINTS[each.joint],
                each.at or "end",
                each.probe,
                each.contact,
                marks,
            )
            del waiting[name]
    return Chain(file.name, file.side, tuple(placed.values()))
