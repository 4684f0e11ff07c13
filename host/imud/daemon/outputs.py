# SPDX-License-Identifier: MIT
"""The sinks that a configuration asks for: opened at the start, changed at a reload."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import msgspec

from imud.config.settings import Config, ZenohSettings, listens_on
from imud.daemon.hub import Hub
from imud.daemon.lane import Sink
from imud.daemon.log_state import LOG
from imud.daemon.names import LIMBS, path_of
from imud.daemon.reports import NETWORK
from imud.endpoint import host_and_port
from imud.errors import FlashError, ListenFailed
from imud.flash import firmware
from imud.flash.firmware import Firmware
from imud.log.file import Settings
from imud.log.retention import Retention
from imud.net.network import Keys, own_file, read_keys
from imud.net.queries import OnCommand
from imud.net.refusals import tell_refusals
from imud.ports.local import LocalPorts
from imud.sinks.foxglove import FoxgloveSink
from imud.sinks.log import LogSink
from imud.sinks.openigtlink import OpenIgtLinkSink
from imud.sinks.page import PageSink
from imud.sinks.ros2 import Ros2Sink, own_network
from imud.sinks.zenoh import OnNotice, ZenohSink
from imud.virtual import sim
from imud.web.logs import LogFolder
from imud.web.server import Page
from imud.web.users import KeyUsers, Users

# Names of sinks.
ROS2, PAGE, FOXGLOVE, OPENIGTLINK = "ros2", "web", "foxglove", "openigtlink"
BESIDE = (PAGE, FOXGLOVE, OPENIGTLINK)

logger = logging.getLogger("imud")


@dataclass(frozen=True, slots=True)
class Wanted:
    """A sink, and the settings it is made of: other settings need another sink."""

    settings: object
    make: Callable[[], Sink]


class Outputs:
    """Keeps the hub's sinks as the configuration has them."""

    def __init__(
        self,
        hub: Hub,
        on_command: OnCommand,
        on_notice: OnNotice,
        id_of: Callable[[str], str | None],
    ) -> None:
        """`id_of`: the id of the probe of a name."""
        self._hub = hub
        self._id_of = id_of
        self._on_command = on_command
        self._on_notice = on_notice
        self.keys = Keys()  # who may connect; the next open() and apply() use them
        self._made_of: dict[str, object] = {}  # settings of each sink
        self._reports_refusals = False

    @property
    def is_logging(self) -> bool:
        return self._hub.sink(LOG) is not None

    @property
    def log_path(self) -> Path | None:
        """The file that is written, once there is one."""
        log = self._hub.sink(LOG)
        return log.path if isinstance(log, LogSink) else None

    def open(self, config: Config) -> None:
        """Opens all sinks; an ImudError if one can't be opened. What others use beside
        poses is opened later then, if its address is taken.
        """
        self.keys = read_keys(config)
        for name, wanted in self._wanted(config).items():
            try:
                self._hub.add(wanted.make())
            except ListenFailed:
                if name not in BESIDE:
                    raise
                self._hub.set(name, wanted.make())
            self._made_of[name] = wanted.settings

    def apply(
        self, config: Config, names: Mapping[str, str], put: Mapping[str, int]
    ) -> None:
        """Opens, replaces and closes what a reload changed. `names` are the old and new
        names of probes, `put` the records of each so far.
        """
        wanted = self._wanted(config)
        for name in self._made_of.keys() - wanted.keys():
            self._hub.set(name, None)
            del self._made_of[name]
        for name, want in wanted.items():
            # A renamed probe needs other keys and channels.
            if names or self._made_of.get(name) != want.settings:
                goes_on = self._made_of.get(name) == want.settings
                self._hub.set(name, want.make(), names, put, goes_on=goes_on)
                self._made_of[name] = want.settings

    def _wanted(self, config: Config) -> dict[str, Wanted]:
        """By name, in the order in which they are opened: the log last, so that none is
        begun by a daemon that can't start.
        """
        network, log, ros2 = config.zenoh, config.log, config.ros2
        keys = self.keys
        # With other keys all connect again, and who was removed can't.
        of_network = (network, keys.digest)
        wanted = {NETWORK: Wanted(of_network, lambda: self._zenoh(network))}
        if ros2.enabled:
            own = own_network(network.mode, network.listen, network.connect)
            wanted[ROS2] = Wanted(
                (ros2, own, keys.digest, keys.of_ros2),
                lambda: Ros2Sink(
                    ros2.connect or own,
                    ros2.domain,
                    ros2.namespace,
                    ros2.world_frame,
                    keys.of_ros2,
                ),
            )
        address = host_and_port(config.web.listen)
        if config.web.enabled and address is not None:
            logs = LogFolder(Path(log.dir)) if log.enabled else None
            of_page = (config.web, *of_network, log.enabled, log.dir, config.ports)
            wanted[PAGE] = Wanted(of_page, lambda: self._page(address, config, logs))
        served = host_and_port(config.foxglove.listen)
        if config.foxglove.enabled and served is not None:
            wanted[FOXGLOVE] = Wanted(
                (config.foxglove, network.prefix),
                lambda: FoxgloveSink(served, network.prefix),
            )
        heard = host_and_port(config.openigtlink.listen)
        if config.openigtlink.enabled and heard is not None:
            wanted[OPENIGTLINK] = Wanted(
                config.openigtlink, lambda: OpenIgtLinkSink(heard)
            )
        if log.enabled:
            settings = _log_settings(config)
            # A log stores the whole configuration, but only these settings change it.
            of_log = (log, network.prefix, settings.unlogged)
            wanted[LOG] = Wanted(of_log, lambda: LogSink(Path(log.dir), settings))
        return wanted

    def _page(
        self, address: tuple[str, int], config: Config, logs: LogFolder | None
    ) -> PageSink:
        keys, origins = self.keys, config.web.origins
        users: Users | None = None
        if config.zenoh.keys:
            users = KeyUsers(keys.roles, keys.passwords)
        # Once, and not with each try at a port that is taken.
        offered = offered_firmware()
        # Where browsers log in, a virtual hand can't.
        page = f"http://{config.web.listen}" if users is None and address[1] else None
        virtual = sim.offered(page) if config.ports.find else ()
        return PageSink(
            lambda: Page(
                address,
                self._on_command,
                users=users,
                logs=logs,
                ports=LocalPorts(config.ports),
                firmware=offered,
                virtual=virtual,
                limbs=(path_of(config, LIMBS), partial(_to_daemon, config.zenoh)),
                origins=origins,
                on_notice=self._on_notice,
            )
        )

    def _hear_body(self, key: str, payload: bytes) -> None:
        page = self._hub.sink(PAGE)
        if isinstance(page, PageSink):
            page.hear_body(key, payload)

    def _zenoh(self, network: ZenohSettings) -> ZenohSink:
        if network.keys and not self._reports_refusals:
            self._reports_refusals = True
            tell_refusals(self._tell_refusal)
        return ZenohSink(
            *(network, self._on_command, self._on_notice, self._hear_body, self._id_of)
        )

    def _tell_refusal(self, kind: str, text: str) -> None:
        """Called in a thread of its own."""
        network = self._hub.sink(NETWORK)
        text = network.name_of(text) if isinstance(network, ZenohSink) else text
        self._on_notice(kind, text, True)


def _to_daemon(network: ZenohSettings) -> tuple[str, ...]:
    """Arguments by which a command of this machine finds this daemon; ConfigError."""
    prefix = ("--prefix", network.prefix)
    if (keys := own_file(network, is_abroad=False)) is not None:
        return (*prefix, "--keys", str(keys))
    own = own_network(network.mode, listens_on(network), network.connect)
    return (*prefix, "--connect", own[0]) if own else prefix


def offered_firmware() -> tuple[Firmware, ...]:
    """Images for the page's button; none if they can't be trusted, which is told."""
    try:
        return firmware.offered()
    except FlashError as error:
        logger.warning("no firmware is offered: %s", error)
        return ()


def _log_settings(config: Config) -> Settings:
    log = config.log
    return Settings(
        prefix=config.zenoh.prefix,
        rotate_bytes=log.rotate_mb * 10**6,
        rotate_s=log.rotate_minutes * 60,
        floor_bytes=log.floor_mb * 10**6,
        retention=Retention(log.keep_days, log.keep_mb * 10**6),
        unlogged=frozenset(
            config.name_of(probe_id)
            for probe_id, probe in config.probes.items()
            if not probe.log
        ),
        has_foxglove=log.foxglove,
        configuration=msgspec.json.encode(config).decode(),
    )
