# SPDX-License-Identifier: MIT
"""Mistakes in settings that their types allow: texts that can't be a key or an
address, settings that contradict each other, and doors left open to everybody.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from imud.config.settings import (
    BAUD_MAX,
    RATES,
    Config,
    FoxgloveSettings,
    LogSettings,
    MetricsSettings,
    OpenIgtLinkSettings,
    PlaceSettings,
    PortSettings,
    ProbeSettings,
    WebSettings,
    ZenohSettings,
    listens_on,
    port_and_baud,
)
from imud.config.toml import Mistake, cut
from imud.defaults import (
    ENDPOINT,
    FOXGLOVE,
    MAVLINK,
    MQTT,
    OPENIGTLINK,
    OSC,
    PAGE,
    PREFIX,
    VMC,
)
from imud.endpoint import (
    KEY,
    NAME,
    is_local,
    link_of,
    misspelt,
    unfit,
)
from imud.igtl import names as igtl
from imud.ros2 import topics

BRIDGED = {"osc": OSC, "vmc": VMC, "mqtt": MQTT, "mavlink": MAVLINK}
_OR_ANYBODY = ", or let anybody read: open_to_all = true"
_ORIGIN = re.compile(r"null|https?://(\[[0-9a-f:.]+\]|[\w.-]+)(:[0-9]{1,5})?")
_PROBE_ID = re.compile(r"[0-9a-f]{16}")


def contradictions(config: Config) -> Iterator[Mistake]:
    """Every mistake that the type of a setting does not exclude."""
    yield from _of_ports(config.ports)
    if config.zenoh.mode == "router" and not config.zenoh.listen:
        yield Mistake(("zenoh", "listen"), f"is empty; try [{_quoted(ENDPOINT)}]")
    yield from _of_network(config.zenoh)
    for endpoint in config.ros2.connect:
        if wrong := misspelt(endpoint, ENDPOINT):
            yield Mistake(("ros2", "connect"), wrong)
    if not KEY.fullmatch(config.zenoh.prefix):
        yield Mistake(("zenoh", "prefix"), unfit(config.zenoh.prefix, PREFIX))
    yield from _of_page(config.web)
    if config.foxglove.enabled:
        yield from _of_foxglove(config.foxglove, config.zenoh.keys)
    if config.openigtlink.enabled:
        yield from _of_openigtlink(config.openigtlink, config.zenoh.keys)
        yield from _of_frames(config)
    yield from _of_log(config.log)
    yield from _of_metrics(config.metrics)
    yield from _of_place(config.place)
    yield from _of_probes(config.probes)
    if config.ros2.enabled:
        yield from _of_ros2(config)
    yield from _of_bridge(config)


def _of_ports(section: PortSettings) -> Iterator[Mistake]:
    named = [port_and_baud(port) for port in section.named]
    if not named and not section.find and not section.udp:
        yield Mistake(
            ("ports", "find"),
            "is off and no port is listed; give one: imud run /dev/ttyUSB0",
        )
    if len({port for port, _ in named}) < len(named):
        yield Mistake(("ports", "named"), "a port is listed twice")
    for baud in (own for _, own in named if own is not None):
        if not 0 < baud <= BAUD_MAX:
            yield Mistake(("ports", "named"), f"baud {baud} is not in 1..{BAUD_MAX}")
    if not section.rates:
        yield Mistake(("ports", "rates"), f"is empty; try {list(RATES)}")
    if section.udp and (wrong := misspelt(section.udp, "0.0.0.0:8736")):
        yield Mistake(("ports", "udp"), wrong)
    if section.udp and not section.udp_keys:
        yield Mistake(
            ("ports", "udp_keys"),
            "is empty: only datagrams from probes with a key are accepted; create "
            "one with imud keys probe DIR ID",
        )


def _of_page(section: WebSettings) -> Iterator[Mistake]:
    more = ", and use imud view --connect on other machines"
    yield from _of_address("web", section.listen, PAGE, more)
    for origin in section.origins:
        if not _ORIGIN.fullmatch(origin):
            yield Mistake(
                ("web", "origins"),
                f"{_quoted(origin)} is not an origin such as https://example.org",
            )


def _of_foxglove(section: FoxgloveSettings, keys: str) -> Iterator[Mistake]:
    yield from _of_address("foxglove", section.listen, FOXGLOVE)
    if keys and not section.open_to_all:
        yield Mistake(
            ("foxglove", "enabled"),
            "Foxglove has no login, but zenoh.keys admits only users; turn it off, "
            "or let every program on this machine read: open_to_all = true",
        )


def _of_openigtlink(section: OpenIgtLinkSettings, keys: str) -> Iterator[Mistake]:
    is_open, more = section.open_to_all, _OR_ANYBODY
    yield from _of_address(
        "openigtlink", section.listen, OPENIGTLINK, more, is_open=is_open
    )
    if keys and not section.open_to_all:
        yield Mistake(
            ("openigtlink", "enabled"),
            "OpenIGTLink has no users, but zenoh.keys admits only users; turn it "
            "off, or let anybody read: open_to_all = true",
        )


def _of_bridge(config: Config) -> Iterator[Mistake]:
    """Of imud bridge, which sends to where it is told."""
    if wrong := misspelt(config.bridge.connect, ENDPOINT):
        yield Mistake(("bridge", "connect"), wrong)
    for name, usual in BRIDGED.items():
        if wrong := misspelt(getattr(config, name).to, usual):
            yield Mistake((name, "to"), wrong)
    for name in ("topic", "discovery"):
        text = getattr(config.mqtt, name)
        if text and not KEY.fullmatch(text):
            yield Mistake(("mqtt", name), unfit(text, PREFIX))


def _of_log(section: LogSettings) -> Iterator[Mistake]:
    if 0 < section.keep_mb < section.rotate_mb:
        yield Mistake(
            ("log", "keep_mb"),
            f"{section.keep_mb} is less than the size of one file (rotate_mb = "
            f"{section.rotate_mb}); reduce that as well",
        )


def _of_metrics(section: MetricsSettings) -> Iterator[Mistake]:
    if section.listen:
        more, is_open = _OR_ANYBODY, section.open_to_all
        yield from _of_address(
            "metrics", section.listen, "127.0.0.1:9735", more, is_open=is_open
        )


def _of_address(
    name: str, listen: str, example: str, more: str = "", *, is_open: bool = False
) -> Iterator[Mistake]:
    """The address of a server that asks nobody who they are."""
    if wrong := misspelt(listen, example):
        yield Mistake((name, "listen"), wrong)
    elif not is_open and not is_local(f"tcp/{listen}"):
        host = cut(listen.rpartition(":")[0])
        yield Mistake(
            (name, "listen"),
            f"{host} is reachable from other machines; listen on 127.0.0.1{more}",
        )


def _of_place(section: PlaceSettings) -> Iterator[Mistake]:
    is_known = section.latitude_deg is not None
    if is_known != (section.longitude_deg is not None):
        missing = "longitude_deg" if is_known else "latitude_deg"
        yield Mistake(("place", missing), "is missing: a place needs both")
    elif section.north == "true" and not is_known:
        yield Mistake(
            ("place", "north"), "true north needs latitude_deg and longitude_deg"
        )


def _of_probes(probes: dict[str, ProbeSettings]) -> Iterator[Mistake]:
    names: set[str] = set()
    for probe_id, probe in probes.items():
        path = ("probes", probe_id)
        if not _PROBE_ID.fullmatch(probe_id):
            yield Mistake(path, "an id has 16 hexadecimal digits; imud list shows it")
        for name in ("raw_rate", "streams"):
            if probe.fuse_on_host and getattr(probe, name) is not None:
                yield Mistake((*path, name), "is set by fuse_on_host: leave it out")
        if not probe.name:
            continue
        if not NAME.fullmatch(probe.name):
            yield Mistake((*path, "name"), unfit(probe.name))
        if _PROBE_ID.fullmatch(probe.name) and probe.name != probe_id:
            yield Mistake(
                (*path, "name"),
                f"{_quoted(probe.name)} could be the id of another probe",
            )
        elif probe.name in names or probe.name in probes.keys() - {probe_id}:
            yield Mistake(
                (*path, "name"),
                f"{_quoted(probe.name)} is also the name of another probe",
            )
        names.add(probe.name)


def _of_ros2(config: Config) -> Iterator[Mistake]:
    """ROS allows fewer characters in a name than Zenoh does."""
    if not re.fullmatch(topics.NAMESPACE, config.ros2.namespace):
        yield Mistake(
            ("ros2", "namespace"),
            f"{cut(config.ros2.namespace)!r} can't be part of a topic; letters, "
            "digits and single _ can, no digit first",
        )
    names: dict[str, str] = {}
    for probe_id in config.probes:
        name = config.name_of(probe_id)
        other = names.setdefault(topics.ros_name(name), name)
        if other != name:
            yield Mistake(
                ("probes", probe_id, "name"),
                f"{cut(name)!r} and {cut(other)!r} are both "
                f"{cut(topics.ros_name(name))} in ROS",
            )


def _of_frames(config: Config) -> Iterator[Mistake]:
    """A transform's name in OpenIGTLink has 20 characters, of which few are left."""
    frames: dict[str, str] = {}
    for probe_id in config.probes:
        name = config.name_of(probe_id)
        frame = igtl.frame_of(name)
        other = frames.setdefault(frame, name)
        if not frame:
            yield Mistake(
                ("probes", probe_id, "name"),
                f"{cut(name)!r} does not fit OpenIGTLink: letters and digits, a letter "
                f"first, at most {igtl.PROBE_MAX}, without To before a digit",
            )
        elif other != name:
            yield Mistake(
                ("probes", probe_id, "name"),
                f"{cut(name)!r} and {cut(other)!r} are both {frame} in OpenIGTLink",
            )


def _of_network(network: ZenohSettings) -> Iterator[Mistake]:
    """Also refuses to listen for other machines without keys, unless that is
    allowed."""
    listen = listens_on(network)
    if network.mode != "router" and not (network.connect or listen):
        yield Mistake(
            ("zenoh", "connect"),
            f"is empty; a {network.mode} needs one, such as "
            f"[{_quoted('tcp/192.168.1.10:7447')}]",
        )
    for name in ("listen", "connect"):
        for endpoint in getattr(network, name):
            if wrong := misspelt(endpoint, ENDPOINT):
                yield Mistake(("zenoh", name), wrong)
    if network.keys:
        for endpoint in listen:
            if link_of(endpoint) != "tls":
                meant = cut(f"tls/{endpoint.partition('/')[2]}")
                yield Mistake(
                    ("zenoh", "listen"),
                    f"{cut(endpoint)} sends passwords in clear; with keys it is "
                    f"{meant}",
                )
    elif not network.open_to_all:
        for endpoint in listen:
            if not is_local(endpoint):
                yield Mistake(
                    ("zenoh", "listen"),
                    f"{cut(endpoint)} is open to everybody who can reach this "
                    "machine; require keys: imud keys init DIR, then --keys DIR or "
                    "zenoh.keys; or allow it: zenoh.open_to_all = true",
                )


def _quoted(text: str) -> str:
    return f'"{cut(text)}"'
