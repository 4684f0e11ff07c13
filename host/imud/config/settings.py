# SPDX-License-Identifier: MIT
"""What `imud run` is to do: defaults, then a TOML file, then arguments.

The structs below are the one truth: `imud config` writes their defaults and words out
as TOML.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from imud.config.toml import (
    SHOWN_MAX,
    Mistake,
    called,
    line_of,
    mistakes,
    parse,
    written,
)
from imud.defaults import ENDPOINT, PREFIX
from imud.endpoint import host_and_port, is_local, is_loopback, link_of
from imud.errors import ConfigError
from imud.ros2 import topics

# What our firmware speaks: the Nano 500,000 baud, to which 16 MHz divides exactly, the
# F405 921,600, an RN-41's own rate.
RATES = (500_000, 921_600)
BAUD_MAX = 4_000_000

# A part of a key expression: Zenoh gives the rest of the signs a meaning.
_NAME = re.compile(r"[^/*$#?\s]+")
_PREFIX = re.compile(rf"{_NAME.pattern}(/{_NAME.pattern})*")
_PORT_AND_BAUD = re.compile(r"(.+)@(\d+)")
_PROBE_ID = re.compile(r"[0-9a-f]{16}")

ABOUT = """\
Settings of imud, each with what it is for. What is not said is as `imud config`
prints it.

imud config --check FILE tells what is wrong with a file; a daemon that runs takes up
what was changed when it is told to: systemctl reload imud, or kill -HUP."""

# As the firmware has it: SETTINGS_RATE_MAX_HZ, and never 0.
Rate = Annotated[int, Meta(ge=1, le=1000)]
Baud = Annotated[int, Meta(gt=0, le=BAUD_MAX)]


class Ports(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Serial ports. A probe keeps its identity whichever it is on."""

    find: Annotated[
        bool, Meta(description="look for probes on all USB and Bluetooth ports")
    ] = True
    named: Annotated[
        tuple[str, ...],
        Meta(description="ports that are a probe's, also ptys: PORT or PORT@BAUD"),
    ] = ()
    ignore: Annotated[
        tuple[str, ...], Meta(description="ports that are never opened; * is any text")
    ] = ()
    rates: Annotated[
        tuple[Baud, ...], Meta(description="baud rates that are tried, in this order")
    ] = RATES
    reset: Annotated[
        bool, Meta(description="reset a board by DTR when its port is opened")
    ] = False


class Zenoh(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The network."""

    mode: Annotated[
        Literal["router", "peer", "client"],
        Meta(description="router: needs no other; peer, client: of a network there is"),
    ] = "router"
    listen: Annotated[
        tuple[str, ...], Meta(description="where subscribers connect to")
    ] = (ENDPOINT,)
    connect: Annotated[
        tuple[str, ...], Meta(description="routers or peers of a network there is")
    ] = ()
    prefix: Annotated[str, Meta(description="first part of all keys")] = PREFIX
    history: Annotated[
        int,
        Meta(ge=0, le=100_000, description="poses of a probe kept for who comes late"),
    ] = 100
    keys: Annotated[
        str,
        Meta(description="folder that `imud keys` made: TLS, users, roles; none: open"),
    ] = ""
    mutual_tls: Annotated[
        bool, Meta(description="with keys: clients show a certificate, too")
    ] = False
    credentials: Annotated[
        str,
        Meta(description="a daemon's file of `imud keys`, to connect where keys rule"),
    ] = ""
    open_to_all: Annotated[
        bool,
        Meta(
            description="listen beyond this machine without keys: anybody can command"
        ),
    ] = False


class Log(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The log on disk, MCAP."""

    enabled: Annotated[bool, Meta(description="keep a log")] = True
    dir: Annotated[str, Meta(description="folder of its files")] = "logs"
    rotate_mb: Annotated[
        int, Meta(ge=1, description="a fresh file after so many MB")
    ] = 1024
    rotate_minutes: Annotated[
        float, Meta(gt=0, le=240, description="and after so many minutes")
    ] = 60.0
    floor_mb: Annotated[
        int,
        Meta(ge=0, description="logging pauses where the disk has less than this free"),
    ] = 500
    foxglove: Annotated[
        bool, Meta(description="poses also as foxglove.PoseInFrame, to be drawn")
    ] = True


class Ros2(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """ROS 2 topics as rmw_zenoh carries them; no ROS is needed here."""

    enabled: Annotated[bool, Meta(description="publish to ROS 2")] = False
    domain: Annotated[int, Meta(ge=0, le=232, description="ROS_DOMAIN_ID")] = 0
    namespace: Annotated[
        str, Meta(description="first part of the topics, before the probe's name")
    ] = "imud"
    world_frame: Annotated[
        str,
        Meta(
            min_length=1, description="frame_id in which poses are said: x east, z up"
        ),
    ] = "world"
    connect: Annotated[
        tuple[str, ...],
        Meta(description="an rmw_zenohd; none: this daemon's own network"),
    ] = ()


class Metrics(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Prometheus."""

    listen: Annotated[
        str, Meta(description="HOST:PORT of /metrics, as 127.0.0.1:9735; none: off")
    ] = ""
    open_to_all: Annotated[
        bool, Meta(description="let it be a HOST beyond this machine: anybody can read")
    ] = False


class Journal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The lines on stderr."""

    level: Annotated[
        Literal["debug", "info", "warning", "error"],
        Meta(description="the least that is written"),
    ] = "info"
    burst: Annotated[
        int, Meta(ge=1, description="lines of one kind in quiet_s; more are counted")
    ] = 3
    quiet_s: Annotated[
        float, Meta(ge=0, le=3600, description="for how long those are counted")
    ] = 10.0


class ProbeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One probe's own; nothing said leaves it as it is."""

    name: Annotated[str, Meta(description="in keys instead of its id")] = ""
    # Examples are what `imud config` shows: the firmware has to accept them.
    pose_rate: Annotated[
        Rate | None, Meta(description="poses a second", examples=[100])
    ] = None
    raw_rate: Annotated[
        Rate | None, Meta(description="raw samples a second", examples=[100])
    ] = None
    streams: Annotated[
        Annotated[tuple[Literal["pose", "raw"], ...], Meta(min_length=1)] | None,
        Meta(description="what it sends while it streams", examples=[["pose"]]),
    ] = None
    start: Annotated[
        bool, Meta(description="have it stream when it is found, without its button")
    ] = False
    log: Annotated[bool, Meta(description="keep it in the log")] = True


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that can be set, with what holds where nothing is said."""

    twin: Annotated[
        bool,
        Meta(description="compute each pose again and tell the first that differs"),
    ] = False
    ports: Ports = Ports()
    zenoh: Zenoh = Zenoh()
    log: Log = Log()
    ros2: Ros2 = Ros2()
    metrics: Metrics = Metrics()
    journal: Journal = Journal()
    probes: Annotated[
        dict[str, ProbeSettings], Meta(description="by id, which `imud list` shows")
    ] = {}

    def settings_of(self, probe_id: str) -> ProbeSettings:
        return self.probes.get(probe_id, ProbeSettings())

    def name_of(self, probe_id: str) -> str:
        """What its keys carry."""
        return self.settings_of(probe_id).name or probe_id


def port_and_baud(text: str) -> tuple[str, int | None]:
    """A port may carry a rate of its own: /dev/ttyUSB1@921600."""
    own = _PORT_AND_BAUD.fullmatch(text)
    return (own[1], int(own[2])) if own else (text, None)


def load(
    path: Path | None,
    *,
    ports: Sequence[str] = (),
    listen: str | None = None,
    keys: Path | None = None,
    log_dir: Path | None = None,
    is_logging: bool = True,
    is_twin: bool = False,
    level: str | None = None,
) -> Config:
    """ConfigError names the first mistake and says how many more there are."""
    replace = msgspec.structs.replace
    config = read(path) if path is not None else Config()
    if ports:
        named = replace(config.ports, find=False, named=tuple(ports))
        config = replace(config, ports=named)
    if listen is not None:
        config = replace(config, zenoh=replace(config.zenoh, listen=(listen,)))
    if keys is not None:
        config = replace(config, zenoh=replace(config.zenoh, keys=str(keys)))
    if log_dir is not None:
        log = replace(config.log, enabled=True, dir=str(log_dir))
        config = replace(config, log=log)
    if not is_logging:
        config = replace(config, log=replace(config.log, enabled=False))
    if is_twin:
        config = replace(config, twin=True)
    if level is not None:
        said: dict[str, object] = {"level": level}
        journal = msgspec.convert(msgspec.to_builtins(config.journal) | said, Journal)
        config = replace(config, journal=journal)
    found = list(_contradictions(config))
    if found:
        raise ConfigError(
            f"{path if path is not None else 'arguments'}: {_first(found)}"
        )
    return config


def read(path: Path) -> Config:
    """What a file says, where each value by itself can be."""
    text, table, found = _parsed(path)
    if found:
        raise ConfigError(f"{_place(path, text, found[0])}: {_first(found)}")
    return msgspec.convert(table, Config)


def check(path: Path) -> list[str]:
    """A line for each mistake in a file."""
    text, table, found = _parsed(path)
    if not found:
        found = list(_contradictions(msgspec.convert(table, Config)))
    return [f"{_place(path, text, each)}: {_said(each)}" for each in found]


def as_toml(config: Config) -> str:
    """A file that says all of it."""
    return written(config, ABOUT)


def _parsed(path: Path) -> tuple[str, dict[str, Any], list[Mistake]]:
    try:
        text = path.read_text("utf-8")
        table = parse(text)
    except OSError as error:
        raise ConfigError(f"can't read {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(
            f"{path} is not TOML: byte {error.start} is not UTF-8"
        ) from error
    except tomllib.TOMLDecodeError as error:
        # Its words may repeat what the file holds, also a line's end.
        words = "".join(c if c.isprintable() else "?" for c in str(error))
        raise ConfigError(f"{path} is not TOML: {words}") from error
    return text, table, mistakes(table, Config)


def _place(path: Path, text: str, mistake: Mistake) -> str:
    line = line_of(text, mistake.path)
    return f"{path}:{line}" if line is not None else str(path)


def _first(found: list[Mistake]) -> str:
    more = len(found) - 1
    also = f" (and {more} more: imud config --check FILE)" if more else ""
    return f"{_said(found[0])}{also}"


def _said(mistake: Mistake) -> str:
    name = called(tuple(map(_cut, mistake.path)))
    # A key of a file may hold anything that TOML can escape.
    return "".join(c if c.isprintable() else "?" for c in f"{name}: {mistake.words}")


def _contradictions(config: Config) -> Iterator[Mistake]:
    """What no value says by itself."""
    yield from _of_ports(config.ports)
    if config.zenoh.mode == "router" and not config.zenoh.listen:
        yield Mistake(("zenoh", "listen"), f"is empty; try [{_quoted(ENDPOINT)}]")
    yield from _open_doors(config.zenoh)
    if not _PREFIX.fullmatch(config.zenoh.prefix):
        yield Mistake(
            ("zenoh", "prefix"), f"{_cut(config.zenoh.prefix)!r} can't be part of a key"
        )
    yield from _of_metrics(config.metrics)
    yield from _of_probes(config.probes)
    if config.ros2.enabled:
        yield from _of_ros2(config)


def _of_ports(section: Ports) -> Iterator[Mistake]:
    named = [port_and_baud(port) for port in section.named]
    if not named and not section.find:
        yield Mistake(
            ("ports", "find"),
            "is off and no port is named; name one: imud run /dev/ttyUSB0",
        )
    if len({port for port, _ in named}) < len(named):
        yield Mistake(("ports", "named"), "a port is named twice")
    for baud in (own for _, own in named if own is not None):
        if not 0 < baud <= BAUD_MAX:
            yield Mistake(("ports", "named"), f"baud {baud} is not in 1..{BAUD_MAX}")
    if not section.rates:
        yield Mistake(("ports", "rates"), f"is empty; try {list(RATES)}")


def _of_metrics(section: Metrics) -> Iterator[Mistake]:
    if not section.listen:
        return
    path = ("metrics", "listen")
    address = host_and_port(section.listen)
    if address is None:
        yield Mistake(
            path, f"{_quoted(section.listen)} is not HOST:PORT, as 127.0.0.1:9735"
        )
    elif not is_loopback(address[0]) and not section.open_to_all:
        yield Mistake(
            path,
            f"{_cut(address[0])} is beyond this machine; 127.0.0.1 is not, or let "
            "anybody read: open_to_all = true",
        )


def _of_probes(probes: dict[str, ProbeSettings]) -> Iterator[Mistake]:
    names: set[str] = set()
    for probe_id, probe in probes.items():
        path = ("probes", probe_id)
        if not _PROBE_ID.fullmatch(probe_id):
            yield Mistake(path, "an id is 16 hexadecimal digits; imud list shows them")
        if not probe.name:
            continue
        if not _NAME.fullmatch(probe.name):
            yield Mistake(
                (*path, "name"), f"{_cut(probe.name)!r} can't be part of a key"
            )
        if probe.name in names or probe.name in probes.keys() - {probe_id}:
            yield Mistake((*path, "name"), f"{_quoted(probe.name)} is another's, too")
        names.add(probe.name)


def _of_ros2(config: Config) -> Iterator[Mistake]:
    """ROS allows fewer signs in a name than Zenoh does."""
    if not re.fullmatch(topics.NAMESPACE, config.ros2.namespace):
        yield Mistake(
            ("ros2", "namespace"),
            f"{_cut(config.ros2.namespace)!r} can't be part of a topic; letters, "
            "digits and single _ can, no digit first",
        )
    names: dict[str, str] = {}
    for probe_id in config.probes:
        name = config.name_of(probe_id)
        other = names.setdefault(topics.ros_name(name), name)
        if other != name:
            yield Mistake(
                ("probes", probe_id, "name"),
                f"{_cut(name)!r} and {_cut(other)!r} are both "
                f"{_cut(topics.ros_name(name))} in ROS",
            )


def _cut(text: str) -> str:
    return text if len(text) <= SHOWN_MAX else f"{text[: SHOWN_MAX - 3]}..."


def _quoted(text: str) -> str:
    return f'"{_cut(text)}"'


def listens_on(network: Zenoh) -> tuple[str, ...]:
    """A client listens nowhere, a peer only where it was told to."""
    is_told = network.listen != (ENDPOINT,)
    if network.mode == "router" or (network.mode == "peer" and is_told):
        return network.listen
    return ()


def _open_doors(network: Zenoh) -> Iterator[Mistake]:
    """Where others could come in who should not."""
    listen = listens_on(network)
    if network.mode != "router" and not (network.connect or listen):
        yield Mistake(
            ("zenoh", "connect"),
            f"is empty; a {network.mode} needs one, as "
            f"[{_quoted('tcp/192.168.1.10:7447')}]",
        )
    if network.keys:
        for endpoint in listen:
            if link_of(endpoint) != "tls":
                meant = _cut(f"tls/{endpoint.partition('/')[2]}")
                yield Mistake(
                    ("zenoh", "listen"),
                    f"{_cut(endpoint)} sends passwords in clear; with keys it is "
                    f"{meant}",
                )
    elif not network.open_to_all:
        for endpoint in listen:
            if not is_local(endpoint):
                yield Mistake(
                    ("zenoh", "listen"),
                    f"{_cut(endpoint)} lets in all who reach this machine; keys keep "
                    "them out: imud keys init DIR, then --keys DIR or zenoh.keys; or "
                    "allow it: zenoh.open_to_all = true",
                )
