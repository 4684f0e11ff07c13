# SPDX-License-Identifier: MIT
"""What `imud run` is to do: defaults, then a TOML file, then arguments."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

import msgspec

from imud.errors import ConfigError

BAUD = 500_000  # of the Nano: 16 MHz divides to it exactly. The F405 has 921,600
BAUD_MAX = 4_000_000

# A part of a key expression: Zenoh gives the rest of the signs a meaning.
_NAME = re.compile(r"[^/*$#?\s]+")
_PREFIX = re.compile(rf"{_NAME.pattern}(/{_NAME.pattern})*")
_PORT_AND_BAUD = re.compile(r"(.+)@(\d+)")
_PROBE_ID = re.compile(r"[0-9a-f]{16}")


class Log(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The log on disk."""

    enabled: bool = True
    dir: str = "logs"


class Config(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that can be set, with what holds where nothing is said."""

    ports: tuple[str, ...] = ()
    baud: int = BAUD
    prefix: str = "imud"
    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    log: Log = Log()
    twin: bool = False  # computes each pose again and tells what differs
    names: dict[str, str] = {}  # probe id to the name that its keys carry

    def ports_and_bauds(self) -> list[tuple[str, int]]:
        """A port may carry a rate of its own: /dev/ttyUSB1@921600."""
        found = [(_PORT_AND_BAUD.fullmatch(port), port) for port in self.ports]
        return [
            (own[1], int(own[2])) if own else (port, self.baud) for own, port in found
        ]


def load(
    path: Path | None,
    *,
    ports: Sequence[str] = (),
    listen: str | None = None,
    log_dir: Path | None = None,
    is_logging: bool = True,
    is_twin: bool = False,
) -> Config:
    config = _read(path) if path is not None else Config()
    if ports:
        config = msgspec.structs.replace(config, ports=tuple(ports))
    if listen is not None:
        config = msgspec.structs.replace(config, listen=(listen,))
    if log_dir is not None:
        log = Log(enabled=True, dir=str(log_dir))
        config = msgspec.structs.replace(config, log=log)
    if not is_logging:
        log = msgspec.structs.replace(config.log, enabled=False)
        config = msgspec.structs.replace(config, log=log)
    if is_twin:
        config = msgspec.structs.replace(config, twin=True)
    _check(config, str(path) if path is not None else "arguments")
    return config


def _read(path: Path) -> Config:
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise ConfigError(f"can't read {path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not TOML: {error}") from error
    try:
        return msgspec.convert(table, Config)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{path}: {error}") from error


def _check(config: Config, source: str) -> None:
    if not config.ports:
        raise ConfigError(
            "no port is named; imud run /dev/ttyUSB0, or imud sim nano --link PATH "
            "for a virtual probe and imud run PATH"
        )
    if len({port for port, _ in config.ports_and_bauds()}) < len(config.ports):
        raise ConfigError(f"{source}: a port is named twice")
    if not config.listen:
        raise ConfigError(f'{source}: listen is empty; try ["tcp/127.0.0.1:7447"]')
    for baud in (config.baud, *(own for _, own in config.ports_and_bauds())):
        if not 0 < baud <= BAUD_MAX:
            raise ConfigError(f"{source}: baud {baud} is not in 1..{BAUD_MAX}")
    if not _PREFIX.fullmatch(config.prefix):
        raise ConfigError(f"{source}: prefix {config.prefix!r} can't be part of a key")
    for probe_id, name in config.names.items():
        if not _PROBE_ID.fullmatch(probe_id):
            raise ConfigError(
                f"{source}: names.{probe_id}: an id is 16 hexadecimal digits; "
                "imud list shows them"
            )
        if not _NAME.fullmatch(name):
            raise ConfigError(
                f"{source}: names.{probe_id}: {name!r} can't be part of a key"
            )
    if len(set(config.names.values())) < len(config.names):
        raise ConfigError(f"{source}: names: two probes have one name")
