# SPDX-License-Identifier: MIT
"""OSC: each pose is a bundle with the time of its sample; a message for each part."""

from __future__ import annotations

import re

from imud.bridge.output import Output, Udp, library, shown
from imud.client import Pose, Status
from imud.config.settings import OscSettings

_NOT_IN_ADDRESSES = re.compile(r"[^!-~]|[#*,/?\[\]{}]")


class OscOutput(Output):
    """The addresses are in docs/bridge.md."""

    def __init__(self, settings: OscSettings) -> None:
        self._messages = library("pythonosc.osc_message_builder", "osc")
        self._bundles = library("pythonosc.osc_bundle_builder", "osc")
        self._settings = settings
        self.rate_hz = settings.rate_hz
        self._udp = Udp("osc", settings.to)

    def pose(self, pose: Pose) -> None:
        stated = shown(pose, relative_heading=self._settings.relative_heading)
        parts: dict[str, tuple[float | str, ...]] = {}
        if stated.tilt_sigma_deg is not None:
            yaw, pitch, roll = pose.angles(self._settings.angles)
            level = {"pitch": (pitch,), "roll": (roll,)}
            parts |= {**level, "sigma/tilt": (stated.tilt_sigma_deg,)}
            if stated.q is not None:
                parts |= {"q": stated.q, "yaw": (yaw,)}
            if stated.heading_sigma_deg is not None:
                parts["sigma/heading"] = (stated.heading_sigma_deg,)
        if pose.position_m is not None:
            parts["position"] = pose.position_m
        parts["flags"] = (" ".join(pose.flags),)
        self._send(pose.probe, (pose.t_ns or 0) / 1e9, parts)

    def status(self, status: Status) -> None:
        self._send(status.probe, status.t_ns / 1e9, {"state": (status.state,)})

    def _send(
        self, probe: str, time_s: float, parts: dict[str, tuple[float | str, ...]]
    ) -> None:
        start = f"/imud/{_NOT_IN_ADDRESSES.sub('-', probe)}"
        bundle = self._bundles.OscBundleBuilder(time_s)
        for name, values in parts.items():
            message = self._messages.OscMessageBuilder(f"{start}/{name}")
            for value in values:
                message.add_arg(value)
            bundle.add_content(message.build())
        self._udp.send(bundle.build().dgram)

    def close(self) -> None:
        self._udp.close()
