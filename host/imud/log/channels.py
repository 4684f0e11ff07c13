# SPDX-License-Identifier: MIT
"""The JSON of a record for other tools, from a log and live: its topics, and the object
of each. `schemas.py` has the schema of each topic.
"""

from __future__ import annotations

import msgspec

from imud.probes.mark import MARKS
from imud.probes.record import Record

POSE_IN_FRAME = "pose_in_frame"  # a pose as Foxglove draws it
WORLD = "world"  # the frame of poses whose position is known

_ENCODER = msgspec.json.Encoder()


def topics_of(record: Record, *, has_foxglove: bool = True) -> tuple[str, ...]:
    """The topics of a record: its own, and for a pose that of Foxglove."""
    if not record.payload or record.topic == MARKS:
        return ()
    if has_foxglove and record.topic == "pose" and record.values:
        return record.topic, POSE_IN_FRAME
    return (record.topic,)


def payload_on(record: Record, topic: str) -> bytes:
    """The object of a record on one of its topics, as JSON."""
    return pose_in_frame(record) if topic == POSE_IN_FRAME else record.payload


def pose_in_frame(record: Record) -> bytes:
    """A pose as foxglove.PoseInFrame, which can't leave out its position. While that is
    not known, the pose is in a frame that has the probe as its origin.
    """
    sec, nsec = divmod(record.t_ns, 10**9)
    w, x, y, z = record.values["q"]
    place = record.values["position_m"]
    px, py, pz = place or (0.0, 0.0, 0.0)
    return _ENCODER.encode(
        {
            "timestamp": {"sec": sec, "nsec": nsec},
            "frame_id": f"{record.probe}_level" if place is None else WORLD,
            "pose": {
                "position": {"x": px, "y": py, "z": pz},
                "orientation": {"x": x, "y": y, "z": z, "w": w},
            },
        }
    )
