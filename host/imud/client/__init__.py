# SPDX-License-Identifier: MIT
"""A daemon over the network, for programs: poses in, commands out."""

from imud.client.client import Client, Heard
from imud.client.subscriber import (
    Event,
    Message,
    Missed,
    Pose,
    Raw,
    Status,
    Subscription,
    subscribe,
)

__all__ = [
    "Client",
    "Event",
    "Heard",
    "Message",
    "Missed",
    "Pose",
    "Raw",
    "Status",
    "Subscription",
    "subscribe",
]
