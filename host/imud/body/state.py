# SPDX-License-Identifier: MIT
"""The messages of `imud body` on `imud/body/NAME/state`: docs/limb.md explains them.

Units are in the names. None: not known. Places and attitudes are in the body's world:
x level ahead, as the root faced when it was aligned; y to the left; z up; the origin
is the root's start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import msgspec
import numpy as np

from imud.body import posture
from imud.body.chain import Chain
from imud.body.posture import Posture
from imud.rotation import FloatArray

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

# The stage: waiting, standing, moving to align, or aligned (any motion).
Stage = Literal["waiting", "standing", "moving", "running"]
# `late`: its pose arrived after the delay. `no clock`: its UTC is unknown.
Presence = Literal["ok", "late", "missing", "no clock"]


class Contact(msgspec.Struct, frozen=True, kw_only=True):
    """How a segment with `contact` stands on the ground."""

    is_down: bool
    rests: int  # how often it has rested since the alignment
    stride_m: float | None  # level distance between the last two rests
    place_m: Vector | None  # of its last rest, from the first one; x, y, z as above
    place_sigma_m: Vector | None  # one-sigma errors of it, which grow


class SegmentState(msgspec.Struct, frozen=True, kw_only=True):
    """One segment. `q`: w, x, y, z, world_from_segment; None while it is missing."""

    name: str
    parent: str | None
    probe: str | None
    presence: Presence
    age_us: int | None  # from its last pose to now
    q: Quaternion | None
    start_m: Vector | None
    end_m: Vector | None
    marks_m: dict[str, Vector]
    contact: Contact | None


class JointState(msgspec.Struct, frozen=True, kw_only=True):
    """One joint, named after the child's segment; None while either is missing."""

    parent: str
    child: str
    kind: str  # knee, hinge, ...
    at_m: Vector | None
    bends: int  # counted since the person stood still to align
    angles_deg: dict[str, float] | None  # flexion, abduction, rotation, or fewer
    sigmas_deg: dict[str, float] | None


class BodyState(msgspec.Struct, frozen=True, kw_only=True):
    """A body at one moment."""

    type: Literal["body"] = "body"
    body: str
    side: str
    number: int  # counts from 1, without gaps
    t_ns: int  # UTC of the moment that it shows
    t_bound_us: int | None  # the probes' times are within this of the truth
    age_us: int  # from that moment to the publication
    stage: Stage
    instruction: str | None = msgspec.field(name="says")  # for the person
    still_s: float | None  # how long it stands still by now; None once it is aligned
    still_of_s: float | None  # and how long it should
    aligned: str | None  # by "motion" or "pose"
    missing: tuple[str, ...]  # segments whose probe is not `ok`
    remarks: tuple[str, ...]
    segments: tuple[SegmentState, ...]
    joints: tuple[JointState, ...]


def vector(values: FloatArray) -> Vector | None:
    """Three lengths in m, to 0.1 mm; None where they are not known."""
    if not np.isfinite(values).all():
        return None
    x, y, z = (round(each, 4) for each in values.tolist())
    return x, y, z


def place(values: FloatArray | None) -> Vector | None:
    """The first of places over time."""
    return None if values is None else vector(values[0])


def named(names: Sequence[str], rad: FloatArray) -> dict[str, float] | None:
    """Degrees by the names of a joint's angles; None where they are not known."""
    if not np.isfinite(rad).all():
        return None
    degrees = np.degrees(rad).tolist()
    return {name: round(each, 2) for name, each in zip(names, degrees, strict=True)}


def joints(
    chain: Chain, shown: Posture | None, bends: Mapping[str, int]
) -> tuple[JointState, ...]:
    """The joints of a posture at a moment; None before alignment. `bends`: by child."""
    states = []
    places = posture.places(chain, shown.quats) if shown is not None else {}
    for parent, child in chain.joints():
        angles = sigmas = None
        if shown is not None and child.name in shown.angles:
            angles = named(child.joint.angles, shown.angles[child.name][0])
            sigmas = named(child.joint.angles, shown.sigmas[child.name][0])
        states.append(
            JointState(
                parent=parent.name,
                child=child.name,
                kind=child.kind,
                at_m=place(places.get(f"{child.name}.start")),
                bends=bends.get(child.name, 0),
                angles_deg=angles,
                sigmas_deg=sigmas if angles is not None else None,
            )
        )
    return tuple(states)
