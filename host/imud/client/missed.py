# SPDX-License-Identifier: MIT
"""Messages that a subscriber missed, from gaps in the sequence numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import itemgetter

import msgspec

from imud.net.access import is_id
from imud.published import Numbered


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


class Followed:
    """The series of a subscription, by probe and topic: a probe is followed under every
    name that it has. Of a subscription to a name only whoever has that is heard; what a
    probe published under another one is not missed.
    """

    def __init__(self, probe: str | None) -> None:
        """`probe`: the name or id that is subscribed to; None: all."""
        self._is_by_name = probe is not None and not is_id(probe)
        self._ids: dict[str, str] = {}  # by the latest names
        self._heard: dict[str, str] = {}  # by topic: whose messages come
        self._series: dict[tuple[str, str], Series] = {}

    def of(self, probe: str, probe_id: str, topic: str) -> Series:
        """The series of a message that has just arrived."""
        probe_id = self._ids[probe] = probe_id or probe
        series = self._series.setdefault((probe_id, topic), Series())
        if self._is_by_name and self._heard.get(topic) != probe_id:
            self._heard[topic] = probe_id
            series.last, series.told = None, 0
        return series

    def known(self, probe: str, topic: str) -> Series | None:
        """The series of a probe, by its name or id; None: nothing has arrived."""
        return self._series.get((self._ids.get(probe, probe), topic))

    def last(self, probe: str) -> dict[str, int | None]:
        """The last number of each topic of a probe."""
        wanted = self._ids.get(probe, probe)
        found = sorted(self._series.items(), key=itemgetter(0))
        return {topic: each.last for (of, topic), each in found if of == wanted}

    def missed(self, probe: str | None = None) -> Missed:
        """Messages missed so far, of one probe or of all."""
        wanted = None if probe is None else self._ids.get(probe, probe)
        return combined(
            {
                key: series.missed()
                for key, series in self._series.items()
                if wanted in (None, key[0])
            }
        )


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
