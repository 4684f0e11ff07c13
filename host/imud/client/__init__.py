# SPDX-License-Identifier: MIT
"""A daemon over the network, for programs: poses in, commands out."""

from imud.client.client import Client, Delivery
from imud.client.missed import Missed
from imud.client.published import Body, Pose, Published, Segment, Status, Topic
from imud.client.subscriber import Subscription, subscribe
from imud.published import Event, Mark, Raw, SinceOrigin
from imud.rotation import Angles

__all__ = [
    "Angles",
    "Body",
    "Client",
    "Delivery",
    "Event",
    "Mark",
    "Missed",
    "Pose",
    "Published",
    "Raw",
    "Segment",
    "SinceOrigin",
    "Status",
    "Subscription",
    "Topic",
    "subscribe",
]
