# SPDX-License-Identifier: MIT
"""MQTT: the state of each probe as JSON whenever it changes, and what Home Assistant
needs to show it. The broker says `offline` for a bridge that has gone.
"""

from __future__ import annotations

import logging
import math
import ssl
from pathlib import Path
from typing import Any

import msgspec

from imud.bridge.output import ABSENT, STREAMING, Output, library, shown
from imud.client import Pose, Status
from imud.config.settings import MqttSettings
from imud.endpoint import host_and_port
from imud.errors import ConfigError, reason
from imud.rotation import angles_deg, matrix_rows
from imud.text_file import read_text

RETRY_S = (1, 30)  # between tries to reach the broker
KEEPALIVE_S = 15  # a broker that hangs is left after twice this
VALUES = ("tilt_deg", "tilt_sigma_deg", "heading_deg", "heading_sigma_deg")
# By key of the state: name, unit, device class.
SENSORS = {
    "tilt_deg": ("Tilt", "°", None),
    "tilt_sigma_deg": ("Tilt error", "°", None),
    "heading_deg": ("Heading", "°", None),
    "heading_sigma_deg": ("Heading error", "°", None),
    "battery_v": ("Battery", "V", "voltage"),
    "state": ("State", None, None),
}
ONLINE, OFFLINE = "online", "offline"

logger = logging.getLogger("imud")


class MqttOutput(Output):
    """Nothing is kept for a broker that is away: when it is back it gets what is so."""

    def __init__(self, settings: MqttSettings) -> None:
        mqtt = library("paho.mqtt.client", "mqtt")
        self._settings = settings
        self.rate_hz = settings.rate_hz
        self._published: dict[str, str] = {}  # by topic, since the connection
        self._states: dict[str, dict[str, Any]] = {}  # by probe
        self._kept: set[str] = set()  # topics of a bridge before this one
        self._trouble = "not connected yet"
        self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        self._client.on_connect = self._on_connect
        self._client.on_disconnect = self._on_disconnect
        more = ", or its certificate is unknown: set ca_file" if settings.tls else ""
        silence = f"no broker answers there{more}"
        self._client.on_connect_fail = lambda *_: self._tell(silence)
        self._client.on_message = lambda _, __, message: self._kept.add(message.topic)
        self._client.will_set(f"{settings.topic}/availability", OFFLINE, 1, retain=True)
        self._client.reconnect_delay_set(*RETRY_S)
        self._log_in()
        address = host_and_port(settings.to) or ("", 0)
        self._client.connect_async(*address, KEEPALIVE_S)
        self._client.loop_start()

    def _log_in(self) -> None:
        settings = self._settings
        if settings.user:
            text = ""
            if settings.password_file:
                text = read_text(Path(settings.password_file), ConfigError)
            self._client.username_pw_set(settings.user, text.partition("\n")[0])
        if settings.tls:
            try:
                made = ssl.create_default_context(cafile=settings.ca_file or None)
            except OSError as error:
                raise ConfigError(
                    f"[mqtt] ca_file: {settings.ca_file}: {reason(error)}"
                ) from error
            self._client.tls_set_context(made)

    def _on_connect(self, _: Any, __: Any, ___: Any, code: Any, ____: Any) -> None:
        """In a thread of paho's."""
        if code.is_failure:
            return self._tell(f"{code}: check [mqtt] user and password_file")
        self._tell("")
        self._published = {}  # the broker may have forgotten it
        self._client.subscribe(f"{self._settings.topic}/+/availability")
        return None

    def _on_disconnect(self, _: Any, __: Any, ___: Any, code: Any, ____: Any) -> None:
        if code.is_failure and not self._trouble:
            self._tell(f"connection lost: {code}; trying again")

    def _tell(self, trouble: str) -> None:
        if trouble != self._trouble:
            self._trouble = trouble
            level = logging.WARNING if trouble else logging.INFO
            words = trouble or "connected"
            logger.log(level, "mqtt: %s: %s", self._settings.to, words)

    def pose(self, pose: Pose) -> None:
        state = self._states.get(pose.probe)
        if state is None:
            return  # until its first status
        stated = shown(pose, relative_heading=False)
        tilt = math.degrees(math.acos(max(-1.0, min(1.0, matrix_rows(pose.q)[2][2]))))
        yaw = angles_deg(pose.q, "aerospace").yaw_deg
        heading = round(yaw, self._settings.digits) % 360.0  # never 360.0
        has_level = stated.tilt_sigma_deg is not None
        found = (
            tilt if has_level else None,
            stated.tilt_sigma_deg,
            heading if stated.has_heading else None,
            stated.heading_sigma_deg if stated.has_heading else None,
        )
        for key, value in zip(VALUES, found, strict=True):
            state[key] = None if value is None else round(value, self._settings.digits)
        state["flags"] = pose.flags
        self._put_state(pose.probe)

    def status(self, status: Status) -> None:
        state = self._states.setdefault(status.probe, dict.fromkeys(VALUES))
        battery = (status.equipment or {}).get("battery_v")
        state |= {"state": status.state, "battery_v": battery}
        if status.state != STREAMING:
            state |= {**dict.fromkeys(VALUES), "flags": ()}
        if self._settings.discovery:
            self._announce(status, has_battery=battery is not None)
        is_there = status.state not in ABSENT
        self._put(
            f"{self._of(status.probe)}/availability", ONLINE if is_there else OFFLINE
        )
        self._put_state(status.probe)

    def tick(self) -> None:
        known = {f"{self._of(probe)}/availability" for probe in self._states}
        for place in self._kept.copy() - known:  # of a probe that has not come back
            self._put(place, OFFLINE)
        self._put(f"{self._settings.topic}/availability", ONLINE)

    def _announce(self, status: Status, *, has_battery: bool) -> None:
        own, of = f"imud_{status.probe_id}", self._of(status.probe)
        places = (f"{self._settings.topic}/availability", f"{of}/availability")
        common = {
            "state_topic": f"{of}/state",
            "availability": [{"topic": place} for place in places],
            "availability_mode": "all",
            "device": {
                "identifiers": [own],
                "name": status.probe,
                "model": f"imu-probe, {status.hello.get('sensor', 'unknown sensor')}",
                "sw_version": str(status.hello.get("firmware", "")),
            },
        }
        for key, (name, unit, kind) in SENSORS.items():
            if key == "battery_v" and not has_battery:
                continue
            config = {
                **common,
                "name": name,
                "unique_id": f"{own}_{key}",
                # JSON's null becomes None, which is Home Assistant's "unknown".
                "value_template": f"{{{{ value_json.{key} }}}}",
            }
            if unit:
                config |= {"unit_of_measurement": unit, "state_class": "measurement"}
            if kind:
                config["device_class"] = kind
            place = f"{self._settings.discovery}/sensor/{own}/{key}/config"
            self._put(place, msgspec.json.encode(config).decode())

    def _of(self, probe: str) -> str:
        return f"{self._settings.topic}/{probe.replace('+', '-')}"

    def _put_state(self, probe: str) -> None:
        text = msgspec.json.encode(self._states[probe]).decode()
        self._put(f"{self._of(probe)}/state", text)

    def _put(self, topic: str, text: str) -> None:
        """Publishes what differs from the last message on a topic."""
        published = self._published
        if self._client.is_connected() and published.get(topic) != text:
            published[topic] = text
            self._client.publish(topic, text, retain=True)

    def close(self) -> None:
        """Says that all are away, which a broker that is there gets."""
        if self._client.is_connected():
            place = f"{self._settings.topic}/availability"
            self._client.publish(place, OFFLINE, 1, retain=True)
        self._client.disconnect()
        self._client.loop_stop()
