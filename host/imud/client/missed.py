# SPDX-License-Identifier: MIT
"""Messages that a subscriber missed, from gaps in the sequence numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec

from imud.client.published import Numbered


class Missed(msgspec.Struct, frozen=True):
    """Messages that this program did not get, by where they were lost."""

    wire: int = 0  # between probe and daemon, messages of any kind
    network: int = 0  # published, but not received here
    queue: int = 0  # received here, but not taken by this program in time
    unreadable: int = 0  # received here, but not a message of imud's
    daemon_restarts: int = 0  # `network` lacks what was published just before these

    @property
    def total(self) -> int:
        return self.wire + self.network + self.queue + self.unreadable


@dataclass(slots=True)
class Series:
    """Follows the numbers of one kind of message of one probe."""

    last: int | None = None
    told: int = 0  # the last number that its source says it has published
    source: str = ""
    wire: int = 0
    network: int = 0
    queue: int = 0
    unreadable: int = 0
    restarts: int = 0

    def count(self, message: Numbered, source: str) -> bool:
        """Counts what is missing before this message; False for a duplicate.

        `source` is the Zenoh session that published it.
        """
        last, self.source, source_before = self.last, source, self.source
        if last is None:
            self.last = message.number
            return True
        if source != source_before or (not source and message.number <= last):
            # Another daemon counts from 1: what it published before this is missing.
            self.restarts += 1
            last = self.told = 0
        if message.number <= last:
            return False
        self.network += message.number - last - 1
        self.wire += message.missing
        self.last = message.number
        return True

    def tell(self, number: int, source: str) -> None:
        """Takes the last number that `source` says it has published, after all that it
        published before saying so.
        """
        if source == self.source:
            self.told = number

    def missed(self) -> Missed:
        at_end = 0 if self.last is None else max(0, self.told - self.last)
        network = self.network + at_end
        return Missed(self.wire, network, self.queue, self.unreadable, self.restarts)


def combined(parts: Mapping[tuple[str, str], Missed]) -> Missed:
    """The sum over probes and topics, which are the keys."""
    # Each topic of a probe tells of losses on the same wire: take the highest count.
    wire: dict[str, int] = {}
    for (probe, _), part in parts.items():
        wire[probe] = max(wire.get(probe, 0), part.wire)
    return Missed(
        sum(wire.values()),
        sum(part.network for part in parts.values()),
        sum(part.queue for part in parts.values()),
        sum(part.unreadable for part in parts.values()),
        max((part.daemon_restarts for part in parts.values()), default=0),
    )
