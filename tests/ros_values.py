# SPDX-License-Identifier: MIT
"""Values that the tests of ROS 2 share."""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_typestore

from fakes import HELLO
from imud.probes.record import Record
from imud.sinks.ros2 import RosTranslator
from imud.wire.messages import encode

JAZZY = get_typestore(Stores.ROS2_JAZZY)

T_NS = 1_795_237_912_345_678_901
Q = (0.9, 0.1, -0.2, 0.3)

RATE, FORCE, FIELD = (0.01, -0.02, 3.0), (-9.5, 0.125, 9.75), (2e-5, -1e-6, 4.5e-5)


def pose(**fields: Any) -> Record:
    values = {
        "type": "pose",
        "t_device_us": 1_000_000,
        "q": Q,
        "position_m": None,
        "tilt_sigma_deg": 0.5,
        "heading_sigma_deg": 2.0,
        "flags": (),
    } | fields
    return Record("tip", "pose", b"{}", b"", 1, T_NS, T_NS, values=values)


HELLO_BYTES = encode("hello", HELLO, 1, 0)


def raw(
    params: bytes | None = b"", hello: bytes = HELLO_BYTES, **fields: Any
) -> Record:
    values = {
        "type": "raw",
        "t_device_us": 1_000_000,
        "acc_m_s2": FORCE,
        "gyr_rad_s": RATE,
        "mag_uT": None,
    } | fields
    return Record(
        *("tip", "raw", b"{}", b"", 1, T_NS, T_NS),
        hello=hello,
        params=params,
        values=values,
    )


def sent_by(translator: RosTranslator, *records: Record) -> dict[str, list[Any]]:
    topics: dict[str, list[Any]] = {}
    for record in records:
        for topic, data in translator.translate(record):
            message = JAZZY.deserialize_cdr(data, topic.type.name)
            topics.setdefault(topic.name, []).append(message)
    return topics
