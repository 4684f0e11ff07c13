# SPDX-License-Identifier: MIT
"""The settings of `imud run`, with their defaults.

These structs are the only place where a setting is declared: a configuration file is
checked against them, and `imud config` prints them as TOML.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from imud.defaults import (
    ENDPOINT,
    FOXGLOVE,
    HISTORY,
    MAVLINK,
    MQTT,
    OPENIGTLINK,
    OSC,
    PAGE,
    PREFIX,
    STATE,
    VMC,
)


def state_home() -> str:
    """Where programs of this user keep their state; may begin with ~."""
    return os.environ.get("XDG_STATE_HOME", "") or STATE


class LogSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The log on disk, MCAP."""

    enabled: Annotated[bool, Meta(description="keep a log")] = True
    dir: Annotated[str, Meta(description="folder of its files")] = "logs"
    rotate_mb: Annotated[
        int, Meta(ge=1, description="start a new file after this many MB")
    ] = 1024
    rotate_minutes: Annotated[
        float, Meta(gt=0, le=240, description="or after this many minutes")
    ] = 60.0
    floor_mb: Annotated[
        int,
        Meta(
            ge=0,
            description="pause logging while the disk has less free space than this",
        ),
    ] = 500
    keep_mb: Annotated[
        int,
        Meta(
            ge=0,
            description="remove the oldest files of the daemon while all of them in "
            "that folder take more than this; 0: keep all",
        ),
    ] = 0
    keep_days: Annotated[
        float,
        Meta(
            ge=0,
            description="and those that ended this many days ago, once the clock "
            "is known to follow UTC; 0: keep all",
        ),
    ] = 0.0
    foxglove: Annotated[
        bool, Meta(description="also log poses as foxglove.PoseInFrame, for Foxglove")
    ] = True


class ParamsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The params of probes: what turns raw readings into poses."""

    history: Annotated[
        str,
        Meta(
            description="folder for all sets that were active; $XDG_STATE_HOME stands "
            "for ~/.local/state where it is set; empty: off"
        ),
    ] = HISTORY

    @property
    def folder(self) -> Path | None:
        """The folder on this machine; None: there is no history."""
        text = self.history
        if text.startswith(f"{STATE}/"):
            text = state_home() + text.removeprefix(STATE)
        path = os.path.expanduser(text)  # noqa: PTH111 - leaves a ~ of nobody
        return Path(path) if path and not path.startswith("~") else None


# Baud rates of our firmware: 500,000 on the Nano, which 16 MHz divides to exactly, and
# 921,600 on the F405, the rate of an RN-41.
RATES = (500_000, 921_600)
BAUD_MAX = 4_000_000

_PORT_AND_BAUD = re.compile(r"(.+)@(\d+)")

# As the firmware has it: SETTINGS_RATE_MAX_HZ, and never 0.
Rate = Annotated[int, Meta(ge=1, le=1000)]
Baud = Annotated[int, Meta(gt=0, le=BAUD_MAX)]


class PortSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Serial ports. A probe keeps its identity on whichever port it is."""

    find: Annotated[
        bool | Literal["all"],
        Meta(
            description="open USB and Bluetooth ports on which a probe was detected "
            'before, or that were adopted (imud ports adopt); "all": try all of them, '
            "which may disturb other devices"
        ),
    ] = True
    memory: Annotated[
        str,
        Meta(
            description="file with the list of adopted ports; empty: in /var/lib/imud "
            "for a service, else ~/.local/state/imud"
        ),
    ] = ""
    named: Annotated[
        tuple[str, ...],
        Meta(description="ports with a probe, also ptys: PORT or PORT@BAUD"),
    ] = ()
    ignore: Annotated[
        tuple[str, ...], Meta(description="ports never to open; * matches any text")
    ] = ()
    rates: Annotated[
        tuple[Baud, ...], Meta(description="baud rates to try, in this order")
    ] = RATES
    reset: Annotated[
        bool, Meta(description="reset a board by DTR when its port is opened")
    ] = False
    udp: Annotated[
        str,
        Meta(
            description="HOST:PORT for signed datagrams of probes, as 0.0.0.0:8736; "
            "empty: off"
        ),
    ] = ""
    udp_keys: Annotated[
        str, Meta(description="folder with the probes' keys, from `imud keys probe`")
    ] = ""


class ZenohSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The network."""

    mode: Annotated[
        Literal["router", "peer", "client"],
        Meta(description="a router works alone, a peer or client joins a network"),
    ] = "router"
    listen: Annotated[
        tuple[str, ...], Meta(description="endpoints for subscribers")
    ] = (ENDPOINT,)
    connect: Annotated[
        tuple[str, ...], Meta(description="endpoints of the network to join")
    ] = ()
    prefix: Annotated[str, Meta(description="first part of all keys")] = PREFIX
    history: Annotated[
        int,
        Meta(
            ge=0,
            le=100_000,
            description="how many of the last poses of each probe late subscribers get",
        ),
    ] = 100
    keys: Annotated[
        str,
        Meta(description="folder made by `imud keys`: TLS, users, roles; empty: off"),
    ] = ""
    mutual_tls: Annotated[
        bool, Meta(description="with keys: clients also need a certificate")
    ] = False
    credentials: Annotated[
        str,
        Meta(
            description="a daemon's file from `imud keys`, to join a network with keys"
        ),
    ] = ""
    open_to_all: Annotated[
        bool,
        Meta(description="listen for other machines without keys: anybody can command"),
    ] = False


class CalibrationSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Calibration without a procedure, from raw samples of probes that send them."""

    learn: Annotated[
        Literal["off", "propose", "apply"],
        Meta(
            description="all three sensors, while a probe is rotated: propose a "
            "calibration, or also activate it"
        ),
    ] = "propose"


class PlaceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the probes are: the Earth's magnetic field of the place."""

    latitude_deg: Annotated[
        Annotated[float, Meta(ge=-90, le=90)] | None,
        Meta(description="north is positive", examples=[52.2]),
    ] = None
    longitude_deg: Annotated[
        Annotated[float, Meta(ge=-180, le=360)] | None,
        Meta(description="east is positive", examples=[21.0]),
    ] = None
    altitude_m: Annotated[
        float, Meta(ge=-1000, le=100_000, description="above the sea")
    ] = 0.0
    north: Annotated[
        Literal["magnetic", "true"],
        Meta(description="reference of the heading of all published poses"),
    ] = "magnetic"


class Ros2Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """ROS 2 topics, as rmw_zenoh has them. This machine needs no ROS."""

    enabled: Annotated[bool, Meta(description="publish to ROS 2")] = False
    domain: Annotated[int, Meta(ge=0, le=232, description="ROS_DOMAIN_ID")] = 0
    namespace: Annotated[
        str, Meta(description="first part of the topics, before the probe's name")
    ] = "imud"
    world_frame: Annotated[
        str,
        Meta(
            min_length=1,
            description="frame_id of the world frame of poses: x east, z up",
        ),
    ] = "world"
    connect: Annotated[
        tuple[str, ...],
        Meta(description="endpoints of rmw_zenohd; empty: the daemon's own network"),
    ] = ()


class WebSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The page for browsers on this machine."""

    enabled: Annotated[bool, Meta(description="serve it")] = True
    listen: Annotated[
        str, Meta(description="its address, HOST:PORT of this machine alone")
    ] = PAGE
    origins: Annotated[tuple[str, ...], Meta(description="sites that may stream")] = ()


class FoxgloveSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A live server for Foxglove, on this machine."""

    enabled: Annotated[
        bool, Meta(description="serve it; needs pip install 'imu-probe[foxglove]'")
    ] = False
    listen: Annotated[
        str, Meta(description="its address, HOST:PORT of this machine alone")
    ] = FOXGLOVE
    open_to_all: Annotated[
        bool,
        Meta(
            description="with keys: serve every program on this machine, without users"
        ),
    ] = False


class OpenIgtLinkSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An OpenIGTLink server, for 3D Slicer and PLUS."""

    enabled: Annotated[bool, Meta(description="serve poses by OpenIGTLink")] = False
    listen: Annotated[str, Meta(description="its address, HOST:PORT")] = OPENIGTLINK
    open_to_all: Annotated[
        bool,
        Meta(
            description="allow a HOST reachable from other machines, and serve "
            "despite keys: anybody can read"
        ),
    ] = False


class BridgeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where `imud bridge` gets poses from. The sections of its outputs follow."""

    connect: Annotated[
        str, Meta(description="endpoint of the daemon, if the keys do not say it")
    ] = ENDPOINT
    keys: Annotated[
        str, Meta(description="clients/NAME.toml of `imud keys`; empty: none")
    ] = ""


class _Bridged(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    enabled: Annotated[bool, Meta(description="run it with imud bridge all")] = False


PoseRate = Annotated[
    float,
    Meta(ge=0, le=1000, description="most poses of a probe per second; 0: all"),
]
RelativeHeading = Annotated[
    bool,
    Meta(description="also send orientations whose heading has no stated error"),
]
Receiver = Annotated[str, Meta(description="HOST:PORT of the receiver")]


class OscSettings(_Bridged, frozen=True):
    """OSC over UDP, for TouchDesigner, Max and others."""

    to: Receiver = OSC
    rate_hz: PoseRate = 0.0
    angles: Annotated[
        Literal["aerospace", "nautical"], Meta(description="convention of yaw and roll")
    ] = "nautical"
    relative_heading: RelativeHeading = False


class VmcSettings(_Bridged, frozen=True):
    """The protocol of Virtual Motion Capture: bodies as bones, probes as trackers."""

    to: Receiver = VMC
    rate_hz: PoseRate = 60.0
    relative_heading: RelativeHeading = False


class LslSettings(_Bridged, frozen=True):
    """Streams of the Lab Streaming Layer, one a probe, and their markers."""

    scope: Annotated[
        Literal["machine", "network"],
        Meta(description="who can find the streams; LSL has no users"),
    ] = "machine"
    relative_heading: RelativeHeading = False


class MqttSettings(_Bridged, frozen=True):
    """An MQTT broker, with discovery by Home Assistant."""

    to: Annotated[str, Meta(description="HOST:PORT of the broker")] = MQTT
    tls: Annotated[bool, Meta(description="encrypt; port 8883 at most brokers")] = False
    ca_file: Annotated[
        str, Meta(description="certificates to trust; empty: the system's")
    ] = ""
    user: Annotated[str, Meta(description="empty: none")] = ""
    password_file: Annotated[str, Meta(description="its first line is used")] = ""
    topic: Annotated[str, Meta(description="first part of the topics")] = PREFIX
    discovery: Annotated[
        str, Meta(description="Home Assistant's discovery prefix; empty: off")
    ] = "homeassistant"
    rate_hz: Annotated[
        float,
        Meta(gt=0, le=100, description="most messages of a probe per second"),
    ] = 1.0
    digits: Annotated[
        int,
        Meta(ge=0, le=6, description="decimals of degrees: fewer, fewer messages"),
    ] = 1


class MavlinkSettings(_Bridged, frozen=True):
    """MAVLink 2 over UDP: HEARTBEAT and ATTITUDE_QUATERNION_COV."""

    to: Receiver = MAVLINK
    rate_hz: PoseRate = 50.0
    system: Annotated[int, Meta(ge=1, le=170, description="id of the system")] = 1
    relative_heading: RelativeHeading = False


class MetricsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Metrics for Prometheus."""

    listen: Annotated[
        str, Meta(description="HOST:PORT of /metrics, as 127.0.0.1:9735; empty: off")
    ] = ""
    open_to_all: Annotated[
        bool,
        Meta(
            description="allow a HOST reachable from other machines: anybody can read"
        ),
    ] = False


class JournalSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The daemon's lines on stderr."""

    level: Annotated[
        Literal["debug", "info", "warning", "error"],
        Meta(description="the lowest level that is written"),
    ] = "info"
    burst: Annotated[
        int,
        Meta(
            ge=1,
            description="lines of one kind within quiet_s; further ones are only "
            "counted",
        ),
    ] = 3
    quiet_s: Annotated[
        float,
        Meta(ge=0, le=3600, description="seconds in which repeated lines are counted"),
    ] = 10.0


ButtonAction = Literal["none", "stream", "stroke", "path", "origin", "undo", "mark"]
# Of a click, a double click, a hold of 1 to 3 s, and one of 3 to 10 s.
ButtonTable = tuple[ButtonAction, ButtonAction, ButtonAction, ButtonAction]
GESTURES = ("click", "double", "hold", "long")
BUTTON: ButtonTable = ("none", "path", "stroke", "none")


class ProbeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of one probe. What is left out stays as the probe has it."""

    name: Annotated[str, Meta(description="in keys in place of its id")] = ""
    # Examples are what `imud config` shows: the firmware has to accept them.
    pose_rate: Annotated[
        Rate | None, Meta(description="poses per second", examples=[100])
    ] = None
    raw_rate: Annotated[
        Rate | None, Meta(description="raw samples per second", examples=[100])
    ] = None
    streams: Annotated[
        Annotated[tuple[Literal["pose", "raw"], ...], Meta(min_length=1)] | None,
        Meta(
            description="messages that it sends while it streams", examples=[["pose"]]
        ),
    ] = None
    start: Annotated[
        bool,
        Meta(description="start it when it is detected, without a press of its button"),
    ] = False
    fuse_on_host: Annotated[
        bool,
        Meta(description="compute its poses on the host, from all its raw samples"),
    ] = False
    log: Annotated[bool, Meta(description="log its messages")] = True
    return_m: Annotated[
        float,
        Meta(
            description="how exactly its tip is put back onto a mark where a path of "
            "strokes is closed, m",
            ge=0.0,
            le=0.1,
        ),
    ] = 0.001
    button: Annotated[
        ButtonTable | None,
        Meta(
            description="what a click, a double click, a hold of 1 s and one of 3 s of "
            "its button do, with `button_does = tell` in its params",
            examples=[BUTTON],
        ),
    ] = None


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All settings and their defaults."""

    twin: Annotated[
        bool,
        Meta(description="recompute each pose and report the first that differs"),
    ] = False
    ports: PortSettings = PortSettings()
    zenoh: ZenohSettings = ZenohSettings()
    log: LogSettings = LogSettings()
    params: ParamsSettings = ParamsSettings()
    calibration: CalibrationSettings = CalibrationSettings()
    place: PlaceSettings = PlaceSettings()
    ros2: Ros2Settings = Ros2Settings()
    web: WebSettings = WebSettings()
    foxglove: FoxgloveSettings = FoxgloveSettings()
    openigtlink: OpenIgtLinkSettings = OpenIgtLinkSettings()
    bridge: BridgeSettings = BridgeSettings()
    osc: OscSettings = OscSettings()
    vmc: VmcSettings = VmcSettings()
    lsl: LslSettings = LslSettings()
    mqtt: MqttSettings = MqttSettings()
    mavlink: MavlinkSettings = MavlinkSettings()
    metrics: MetricsSettings = MetricsSettings()
    journal: JournalSettings = JournalSettings()
    probes: Annotated[
        dict[str, ProbeSettings], Meta(description="by the id shown by `imud list`")
    ] = {}

    def settings_of(self, probe_id: str) -> ProbeSettings:
        """The settings of a probe; the defaults where the file has none for it."""
        return self.probes.get(probe_id, ProbeSettings())

    def with_probe(self, probe_id: str, settings: ProbeSettings) -> Config:
        """The same with these settings of a probe."""
        probes = {**self.probes, probe_id: settings}
        return msgspec.structs.replace(self, probes=probes)

    def name_of(self, probe_id: str) -> str:
        """The name of a probe in keys: its configured name, else its id."""
        return self.settings_of(probe_id).name or probe_id


def port_and_baud(text: str) -> tuple[str, int | None]:
    """Splits PORT@BAUD, as in /dev/ttyUSB1@921600; the baud rate is None without it."""
    own = _PORT_AND_BAUD.fullmatch(text)
    return (own[1], int(own[2])) if own else (text, None)


def listens_on(network: ZenohSettings) -> tuple[str, ...]:
    """The endpoints to listen on: none for a client, none for a peer by default."""
    is_told = network.listen != (ENDPOINT,)
    if network.mode == "router" or (network.mode == "peer" and is_told):
        return network.listen
    return ()
