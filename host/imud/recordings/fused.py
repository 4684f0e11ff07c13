# SPDX-License-Identifier: MIT
"""Poses of the raw samples in a log, by the firmware's own C: of what others recorded,
and of probes whose poses were not logged.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np

from imud.config.settings import Config, ProbeSettings
from imud.log.parts import Damage
from imud.log.reader import Logged, LogHead
from imud.probes.record import describe
from imud.probes.references import References
from imud.probes.session import ProbeFound, Received
from imud.recordings.decode import Tally, events_of_log
from imud.stages import COMPUTED, InjectMessage, LogLine
from imud.stages.fusion import FusionStage
from imud.wire import messages
from imud.wire.messages import Message

# What cheap gyroscopes are off by where no rest has told, in deg/s.
UNKNOWN_DEG_S = 0.2
REST_S = 1.0

_ENCODER = msgspec.json.Encoder()


class FusedPoses:
    """The poses and strokes of one probe, in the place of its own."""

    def __init__(self, name: str, probe_id: str) -> None:
        settings = ProbeSettings(fuse_on_host=True)
        self._name = name
        self._stage = FusionStage(Config(probes={probe_id: settings}))
        self._references = References()
        self._numbers: defaultdict[str, int] = defaultdict(int)
        self.faults: list[str] = []
        self.has_field = False
        self.rests: list[list[float]] = []  # mean rates in each, deg/s
        self._resting: list[tuple[float, ...]] = []
        self._resting_us = 0

    @property
    def count(self) -> int:
        return self._numbers["pose"]

    def begin(self, found: ProbeFound) -> None:
        self._stage.on_probe_found(found)

    def add(self, event: Received) -> Iterator[Logged]:
        """What is computed with that message."""
        if event.message.name == "event":
            self._describe(event.message, event)  # it may move the origin
        elif event.message.name == "raw":
            self.has_field |= event.message.fields["mag"] is not None
        for result in self._stage.on_message(event):
            if isinstance(result, InjectMessage):
                message = cast(Message, messages.decode(result.content))
                values = self._describe(message, event)
                if message.name == "pose":
                    self._follow_rest(values, event)
                stamp = event.stamp
                times = (stamp.t_received_ns or 0, stamp.t_ns or 0)
                yield Logged(
                    self._name, values["type"], _ENCODER.encode(values), *times
                )
            elif isinstance(result, LogLine) and result.is_warning:
                self.faults.append(result.text)

    def _describe(self, message: Message, event: Received) -> dict[str, Any]:
        stamp = event.stamp
        if message.name in COMPUTED:
            number = self._numbers[message.name]
            self._numbers[message.name] += 1
            stamp = msgspec.structs.replace(stamp, number=number, missing=0)
        return describe(
            message, event.content, self._name, stamp, event.scales, self._references
        )

    def _follow_rest(self, pose: dict[str, Any], event: Received) -> None:
        """Notes what the gyroscope tells at rest."""
        _, rate, _ = event.scales.measure(event.content)
        if "at_rest" in pose["flags"] and rate is not None:
            if not self._resting:
                self._resting_us = pose["t_device_us"]
            self._resting.append(rate)
            return
        self.end_rest(pose["t_device_us"])

    def end_rest(self, t_us: float) -> None:
        if self._resting and t_us - self._resting_us >= 1e6 * REST_S:
            self.rests.append([*np.degrees(np.mean(self._resting, axis=0))])
        self._resting = []

    def words(self) -> str:
        """What is to be known of them, on one line."""
        if self.faults:
            return self.faults[0]
        if not self.count:
            return "no raw samples, of which poses could be computed"
        text = f"{self.count} poses computed of its raw samples"
        return text if self.has_field else f"{text}; {self._drift()}"

    def _drift(self) -> str:
        why = "no magnetometer: its heading drifts by up to"
        if len(self.rests) < 2:
            return (
                f"{why} {60 * UNKNOWN_DEG_S:.0f} degrees a minute; more rests would "
                "tell better"
            )
        steps = np.linalg.norm(np.diff(self.rests, axis=0), axis=1)
        return (
            f"{why} {60 * max(steps):.1f} degrees a minute, as its gyroscope changed "
            f"between {len(self.rests)} rests"
        )


class FusedLog:
    """The messages of a log, with poses and strokes that are computed."""

    def __init__(self) -> None:
        self.probes: dict[str, FusedPoses] = {}

    def items(
        self, path: Path, records: Iterable[LogHead | Logged | Damage]
    ) -> Iterator[LogHead | Logged | Damage]:
        """FileError for a log of another schema."""
        passed: list[LogHead | Logged | Damage] = []

        def noted() -> Iterator[LogHead | Logged | Damage]:
            for record in records:
                if not isinstance(record, Logged) or record.topic not in COMPUTED:
                    passed.append(record)
                yield record

        for name, events in events_of_log(path, Tally(), noted()):
            yield from passed
            passed.clear()
            for event in events:
                if isinstance(event, ProbeFound | Received):
                    fused = self.probes.get(name)
                    if fused is None:
                        fused = FusedPoses(name, event.probe_id)
                        self.probes[name] = fused
                    if isinstance(event, ProbeFound):
                        fused.begin(event)
                    else:
                        yield from fused.add(event)
        yield from passed
        for fused in self.probes.values():
            fused.end_rest(math.inf)
