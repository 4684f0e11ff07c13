# SPDX-License-Identifier: MIT
"""The protocol of Virtual Motion Capture, which is OSC: the segments of bodies as bones
of Unity's humanoid, probes as trackers. Unity's axes: x right, y up, z ahead.
"""

from __future__ import annotations

import math
import time

import numpy as np

from imud.bridge.output import Output, Udp, library, shown
from imud.client import Body, Pose
from imud.client.published import Segment
from imud.config.settings import VmcSettings
from imud.rotation import Quat, inverse, multiply

# Unity's bones by the names of segments; those of a limb have its side in front.
TRUNK = {"pelvis": "Hips", "trunk": "Spine", "chest": "Chest", "head": "Head"}
LIMB = {"thigh": "UpperLeg", "shank": "LowerLeg", "foot": "Foot"}
LIMB |= {"upper_arm": "UpperArm", "forearm": "LowerArm", "hand": "Hand"}

# Of the body's stages, the state of calibration.
CALIBRATION = {"waiting": 1, "standing": 2, "moving": 2, "running": 3}

# world_from_segment of who stands: y up, z to the right, in a world of z up, y left.
STANDING = np.array([math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0])


class VmcOutput(Output):
    """Of a pose or a body at once what is known; once a second whether the tracking is
    good: all of the body, or a probe where there is none.
    """

    topics = ("pose", "status", "body")

    def __init__(self, settings: VmcSettings) -> None:
        self._messages = library("pythonosc.osc_message_builder", "osc")
        self._settings = settings
        self.rate_hz = settings.rate_hz
        self._udp = Udp("vmc", settings.to)
        self._calibration = CALIBRATION["running"]
        self._is_tracking = self._has_body = False

    def pose(self, pose: Pose) -> None:
        quat = shown(pose, relative_heading=self._settings.relative_heading).q
        if quat is not None:
            self._place("Tra", pose.probe, tracker_rotation(quat))
            self._is_tracking |= not self._has_body

    def body(self, body: Body) -> None:
        self._has_body = True
        self._calibration = CALIBRATION.get(body.stage, 0)
        bones = bones_of(body)
        for bone, rotation in bones.items():
            self._place("Bone", bone, rotation)
        self._is_tracking = bool(bones) and not body.missing

    def tick(self) -> None:
        tracking, self._is_tracking = self._is_tracking, False
        self._send("OK", 1, self._calibration, 0, int(tracking))
        self._send("T", time.monotonic())

    def _place(self, kind: str, name: str, rotation: Quat) -> None:
        w, x, y, z = rotation
        # The format has no message without a place; receivers have it from the model.
        self._send(f"{kind}/Pos", name, 0.0, 0.0, 0.0, x, y, z, w)

    def _send(self, end: str, *values: float | str) -> None:
        message = self._messages.OscMessageBuilder(f"/VMC/Ext/{end}")
        for value in values:
            message.add_arg(value)
        self._udp.send(message.build().dgram)

    def close(self) -> None:
        self._udp.close()


def tracker_rotation(quat: Quat) -> Quat:
    """From east, north, up: a mirrored axis turns the other way."""
    w, x, y, z = quat
    return w, -x, -z, -y


def bones_of(body: Body) -> dict[str, Quat]:
    """The rotation of each bone from that of its parent, as both are when the person
    stands. A missing segment has none, nor has what hangs from it.
    """
    segments = {each.name: each for each in body.segments}
    side = body.side.capitalize()
    found: dict[str, Quat] = {}
    for name, segment in segments.items():
        of_limb = LIMB.get(name.replace("-", "_"))  # the page has upper-arm
        bone = TRUNK.get(name) or (f"{side}{of_limb}" if of_limb else "")
        above = segments.get(segment.parent or "")
        if not bone or segment.q is None or (above and above.q is None):
            continue
        own = _from_standing(segment)
        if above is not None:
            own = multiply(inverse(_from_standing(above)), own)
        w, x, y, z = own.tolist()
        found[bone] = (w, y, -z, -x)  # from x ahead, y left, z up
    return found


def _from_standing(
    segment: Segment,
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return multiply(np.array(segment.q), inverse(STANDING))
