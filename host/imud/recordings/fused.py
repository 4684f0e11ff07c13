# SPDX-License-Identifier: MIT
"""Poses of the raw samples in a log, by the firmware's own C: of what others recorded,
and of probes whose poses were not logged.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import msgspec
import numpy as np

from imud.config.settings import Config, ProbeSettings
from imud.log.parts import Damage
from imud.log.reader import METADATA_OF_PROBES, Logged, LogHead
from imud.probes.record import Stamp, describe
from imud.probes.references import References
from imud.probes.session import Event, ProbeFound, Received
from imud.recordings.decode import LogSessions, Tally
from imud.stages import COMPUTED, InjectMessage, LogLine
from imud.stages.fusion import FusionStage
from imud.wire import messages, raws
from imud.wire.messages import Message
from imud.wire.raws import Rows

# What cheap gyroscopes are off by where no rest has told, in deg/s.
UNKNOWN_DEG_S = 0.2
REST_S = 1.0

RUN, RUN_MIN = 256, 8  # messages that are taken at once
RAW = bytes([raws.ID])
POSE = bytes(c.id for c in messages.CODECS.values() if c.name == "pose")


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
        self._last: Received | None = None  # raw message

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
            self._last = event
        for result in self._stage.on_message(event):
            if isinstance(result, InjectMessage):
                yield self._computed(result.content, event)
            elif isinstance(result, LogLine) and result.is_warning:
                self.faults.append(result.text)

    def add_run(self, run: Sequence[Logged]) -> Iterator[Logged] | None:
        """What is computed with raw messages behind the first, which was added last, if
        they and poses between them continue it; None: they have to be added one by one.
        """
        last, contents = self._last, [each.data for each in run[1:]]
        samples = [each for each in run[1:] if each.data[0] == raws.ID]
        is_long = len(samples) >= RUN_MIN and self._stage.takes_runs
        if last is None or last.content is not run[0].data or not is_long:
            return None
        rows, heads = raws.rows_of([s.data for s in samples]), raws.heads_of(contents)
        account = last.probe.account
        if rows is None or not account.note_all(contents, heads, run[-1].t_ns):
            return None
        return self._of_run(samples, rows, last)

    def _of_run(
        self, run: Sequence[Logged], rows: Rows, last: Received
    ) -> Iterator[Logged]:
        self.has_field |= bool((rows["mag"] != raws.NULL).any())
        clock, times_us = last.probe.clock, rows["time_us"].tolist()
        for at, content in self._stage.on_run([each.data for each in run], rows):
            raw = run[at]
            device_us = clock.unroll(times_us[at], raw.t_ns)
            times = raw.t_sample_ns, None, raw.t_ns
            stamp = Stamp(0, 0, device_us, *times, boot=last.stamp.boot)
            of = Received(last.probe, last.message, raw.data, stamp, last.scales)
            yield self._computed(content, of)

    def _computed(self, content: bytes, event: Received) -> Logged:
        message = cast(Message, messages.decode(content))
        values = self._describe(message, event)
        if message.name == "pose":
            self._follow_rest(values, event)
        if (since := values.get("since_origin")) is not None:
            values["since_origin"] = msgspec.to_builtins(since)
        times = event.stamp.t_received_ns or 0, event.stamp.t_ns or 0
        return Logged(self._name, message.name, b"", *times, values=values)

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
        self._sessions = LogSessions(path, Tally())
        runs: defaultdict[str, list[Logged]] = defaultdict(list)
        for record in records:
            if not isinstance(record, Logged):
                for run in runs.values():
                    yield from self._end(run)
                yield from self._on(self._sessions.receive(record))
                yield record
                continue
            run, data = runs[record.probe], record.data
            is_frame, kind = record.topic == "frame", data[:1]
            is_running = kind == RAW or (kind == POSE and run)
            if is_frame and is_running and len(data) >= raws.SIZE:
                run.append(record)
                if len(run) == RUN:
                    yield from self._end(run)
            elif is_frame or record.topic in METADATA_OF_PROBES.values():
                yield from self._end(run)
                yield from self._on(self._sessions.receive(record))
            if record.topic not in COMPUTED:
                yield record
        for run in runs.values():
            yield from self._end(run)
        yield from self._on(self._sessions.close())
        for fused in self.probes.values():
            fused.end_rest(math.inf)

    def _end(self, run: list[Logged]) -> Iterator[Logged]:
        """Takes raw messages of one probe, and poses between them."""
        if not run:
            return
        yield from self._on(self._sessions.receive(run[0]))
        fused = self.probes.get(run[0].probe)
        computed = fused.add_run(run) if fused is not None else None
        if computed is not None:
            yield from computed
        else:
            for each in run[1:]:
                yield from self._on(self._sessions.receive(each))
        run.clear()

    def _on(self, events: Iterable[tuple[str, Iterable[Event]]]) -> Iterator[Logged]:
        for name, each in events:
            for event in each:
                if isinstance(event, ProbeFound | Received):
                    fused = self.probes.get(name)
                    if fused is None:
                        fused = FusedPoses(name, event.probe_id)
                        self.probes[name] = fused
                    if isinstance(event, ProbeFound):
                        fused.begin(event)
                    else:
                        yield from fused.add(event)
