# SPDX-License-Identifier: MIT
"""The publishers of the daemon."""

from __future__ import annotations

import zenoh
import zenoh.ext

Publisher = zenoh.Publisher | zenoh.ext.AdvancedPublisher


def declare_publisher(session: zenoh.Session, key: str, history: int) -> Publisher:
    """A publisher of a topic, the last part of `key`. Late subscribers can get the last
    `history` poses.

    Without `express`: one batch for each message was measured to lose some.
    """
    topic = key.rpartition("/")[2]
    encoding = zenoh.Encoding.APPLICATION_JSON
    if topic == "frame":
        encoding = zenoh.Encoding.APPLICATION_OCTET_STREAM
    drop = zenoh.CongestionControl.DROP
    if topic == "pose" and history:
        return zenoh.ext.declare_advanced_publisher(
            session,
            key,
            encoding=encoding,
            congestion_control=drop,
            cache=zenoh.ext.CacheConfig(max_samples=history),
        )
    return session.declare_publisher(key, encoding=encoding, congestion_control=drop)
