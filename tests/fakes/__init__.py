# SPDX-License-Identifier: MIT
"""A probe made of Python, a port made of a pty, and a daemon of its own process."""

from fakes.daemon import (
    DaemonProcess,
    assert_honest,
    free_address,
    free_endpoint,
    status_of,
)
from fakes.forked import Forked
from fakes.messages import COMMAND, EQUIPMENT, EXAMPLES, HELLO, POSE
from fakes.port import PATIENCE_S, SOON_S, Port
from fakes.probe import FakeProbe
from fakes.stopwatch import Stopwatch

__all__ = [
    "COMMAND",
    "EQUIPMENT",
    "EXAMPLES",
    "HELLO",
    "PATIENCE_S",
    "POSE",
    "SOON_S",
    "DaemonProcess",
    "FakeProbe",
    "Forked",
    "Port",
    "Stopwatch",
    "assert_honest",
    "free_address",
    "free_endpoint",
    "status_of",
]
