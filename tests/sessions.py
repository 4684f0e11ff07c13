# SPDX-License-Identifier: MIT
"""Contents of frames as a session passes them on."""

from __future__ import annotations

from collections.abc import Iterable

from imud.probes.session import Probe, Received, Session


def received(contents: Iterable[bytes]) -> list[Received]:
    """The events that a session emits."""
    probes: dict[str, Probe] = {}
    session = Session(lambda name: probes.setdefault(name, Probe(name)))
    return [
        event
        for content in contents
        for event in session.receive_content(content, None)
        if isinstance(event, Received)
    ]
