# SPDX-License-Identifier: MIT
"""The Lab Streaming Layer: a stream of poses for each probe, at the times of their
samples in LSL's clock, and one of markers: button, marks, state.
"""

from __future__ import annotations

import math
import time
from typing import Any

from imud.bridge.output import ABSENT, Output, library, shown
from imud.client import Event, Mark, Pose, Status
from imud.config.settings import LslSettings
from imud.machine.utc import sync_of_host

# Label, unit and type as XDF has them.
CHANNELS = (
    *((f"q_{axis}", "quaternion", f"Orientation{axis.upper()}") for axis in "wxyz"),
    *((name, "degrees", "Euler") for name in ("yaw", "pitch", "roll")),
    *((f"{name}_sigma", "degrees", "Error") for name in ("tilt", "heading")),
    *((f"tip_{axis}", "meters", f"Position{axis.upper()}") for axis in "xyz"),
    ("time_bound", "microseconds", "Error"),
)
PRESSES = {"button_pressed", "button_released"}
BUFFER_S = 60  # for an inlet that does not read
NONE3 = (None, None, None)


class Clock:
    """From UTC to LSL's clock, which steps of UTC don't touch."""

    def __init__(self, lsl: Any) -> None:
        self._lsl = lsl
        self._host = sync_of_host()

    def look(self) -> None:
        """Once a second: how well this machine knows UTC."""
        self._host = sync_of_host()

    def at(self, t_ns: int) -> tuple[float, float]:
        """The time in LSL's clock, and its bound in us."""
        before = self._lsl.local_clock()
        utc_ns = time.time_ns()
        half = (self._lsl.local_clock() - before) / 2
        return before + half + (t_ns - utc_ns) / 1e9, half * 1e6

    def bound_us(self, pose: Pose, own_us: float) -> float:
        """Of a sample: the probe's clock, then those of two hosts. NaN: not known."""
        if pose.t_bound_us is None:
            return math.nan
        between: float = 0.0
        if pose.utc_host != self._host.host:
            both = (pose.utc_bound_us, self._host.bound_us)
            between = math.nan if None in both else float(sum(filter(None, both)))
        return pose.t_bound_us + own_us + between


class LslOutput(Output):
    """The streams of a probe stay while it is away: inlets wait for it. A bridge that
    starts again has the same source ids, by which inlets find it.
    """

    topics = ("pose", "status", "event", "mark")

    def __init__(self, settings: LslSettings) -> None:
        self._lsl = library("pylsl", "lsl")
        scope = "machine" if settings.scope == "machine" else "site"
        self._lsl.set_config_content(
            f"[multicast]\nResolveScope = {scope}\n[log]\nlevel = -2\n"
        )
        self._settings = settings
        self._clock = Clock(self._lsl)
        self._streams: dict[str, tuple[str, Any, Any]] = {}  # by id: name, both outlets
        self._ids: dict[str, str] = {}  # by name
        self._states: dict[str, str] = {}

    def pose(self, pose: Pose) -> None:
        stream = self._streams.get(self._ids.get(pose.probe, ""))
        if stream is None or pose.t_ns is None:
            return  # until its first status
        stated = shown(pose, relative_heading=self._settings.relative_heading)
        yaw, pitch, roll = pose.angles("nautical")
        stamp, own_us = self._clock.at(pose.t_ns)
        has_level = stated.tilt_sigma_deg is not None
        values = (
            *(stated.q or (*NONE3, None)),
            yaw if stated.has_heading else None,
            *((pitch, roll) if has_level else (None, None)),
            *(stated.tilt_sigma_deg, stated.heading_sigma_deg),
            *(pose.position_m or NONE3),
            self._clock.bound_us(pose, own_us),
        )
        stream[1].push_sample([math.nan if v is None else v for v in values], stamp)

    def status(self, status: Status) -> None:
        name, probe_id = status.probe, status.probe_id
        known = self._streams.get(probe_id)
        if known is None and status.state in ABSENT:
            return
        if known is None or known[0] != name:
            self._streams.pop(probe_id, None)  # the outlets of its old name end
            self._streams[probe_id] = self._opened(name, probe_id, status)
            self._ids[name] = probe_id
        if self._states.get(name) != status.state:
            self._states[name] = status.state
            self._say(name, f"state {status.state}", status.t_ns)

    def event(self, event: Event) -> None:
        if event.event in PRESSES:
            self._say(event.probe, event.event, event.t_ns)

    def mark(self, mark: Mark) -> None:
        parts = (mark.state, mark.value, mark.unit, mark.text)
        said = " ".join(str(part) for part in parts if part not in (None, ""))
        self._say(mark.probe, f"mark {said}", mark.t_pose_ns or mark.t_ns)

    def tick(self) -> None:
        self._clock.look()

    def _say(self, name: str, text: str, t_ns: int | None) -> None:
        stream = self._streams.get(self._ids.get(name, ""))
        if stream is not None:
            stream[2].push_sample([text], self._clock.at(t_ns or time.time_ns())[0])

    def _opened(self, name: str, probe_id: str, status: Status) -> tuple[str, Any, Any]:
        lsl = self._lsl
        rate = float(status.hello.get("pose_rate") or lsl.IRREGULAR_RATE)
        own = f"imud-{probe_id}"
        info = lsl.StreamInfo(
            name, "MoCap", len(CHANNELS), rate, lsl.cf_double64, source_id=own
        )
        about = info.desc()
        about.append_child_value("manufacturer", "imu-probe")
        channels = about.append_child("channels")
        for label, unit, kind in CHANNELS:
            channel = channels.append_child("channel")
            for key, text in (("label", label), ("unit", unit), ("type", kind)):
                channel.append_child_value(key, text)
        said = lsl.StreamInfo(
            f"{name} markers", "Markers", 1, 0.0, lsl.cf_string, f"{own}-markers"
        )
        return (
            name,
            lsl.StreamOutlet(info, max_buffered=BUFFER_S),
            lsl.StreamOutlet(said, max_buffered=BUFFER_S),
        )

    def close(self) -> None:
        self._streams.clear()
