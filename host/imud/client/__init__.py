# SPDX-License-Identifier: MIT
"""A daemon over the network, for programs: poses in, commands out."""

from imud.client.client import Client, Delivery
from imud.client.missed import Missed
from imud.client.published import Pose, Published, Status, Topic
from imud.client.subscriber import Subscription, subscribe
from imud.published import Event, Raw, SinceOrigin
from imud.rotation import Angles

__all__ = [
    "Angles",
    "Client",
    "Delivery",
    "Event",
    "Missed",
    "Pose",
    "Published",
    "Raw",
    "SinceOrigin",
    "Status",
    "Subscription",
    "Topic",
    "subscribe",
]
