# SPDX-License-Identifier: MIT
"""The names that people have given to probes, in a file beside that of the ports that
are ours. What the configuration names goes before.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from pathlib import Path

import msgspec
from msgspec.structs import replace

from imud.config.rules import contradictions
from imud.config.settings import Config
from imud.errors import FileError
from imud.ports.adopted import file_of

FILE = "names.json"
SIZE_MAX = 1_000_000

logger = logging.getLogger("imud")


def path_of(config: Config) -> Path:
    return file_of(config.ports.memory).with_name(FILE)


def known(path: Path) -> dict[str, str]:
    """Names by id. FileError: the file is none of ours, or can't be read."""
    try:
        with path.open("rb") as file:
            data = file.read(SIZE_MAX)
        return msgspec.json.decode(data, type=dict[str, str])
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror}") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise FileError(
            f"{path} is damaged ({error}); remove it, and name the probes again"
        ) from error


def with_names(config: Config) -> Config:
    """The configuration with the names that were given. What can't be read or can't be
    a name is told and left out: no probe is less useful for it.
    """
    try:
        names = known(path_of(config))
    except FileError as error:
        logger.warning("%s", error)
        return config
    for probe_id, name in names.items():
        settings = config.settings_of(probe_id)
        if settings.name:
            continue
        found = _named(config, probe_id, name)
        mistakes = [each.words for each in contradictions(found)]
        if mistakes:
            logger.warning("%s: the name of %s %s", FILE, probe_id, mistakes[0])
        else:
            config = found
    return config


def keep(config: Config, probe_id: str, name: str) -> None:
    """Writes a name into the file. FileError if that is not possible."""
    path = path_of(config)
    _write(path, known(path) | {probe_id: name})


def _named(config: Config, probe_id: str, name: str) -> Config:
    settings = replace(config.settings_of(probe_id), name=name)
    return replace(config, probes={**config.probes, probe_id: settings})


def _write(path: Path, names: Mapping[str, str]) -> None:
    """All of it or nothing."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        data = msgspec.json.encode(dict(sorted(names.items())))
        beside.write_bytes(msgspec.json.format(data, indent=2) + b"\n")
        beside.replace(path)
    except OSError as error:
        raise FileError(f"can't write {path}: {error.strerror}") from error
