# SPDX-License-Identifier: MIT
"""The names that people have given to probes, in a file beside that of the ports that
are ours. What the configuration names goes before.
"""

from __future__ import annotations

import logging
from pathlib import Path

from msgspec.structs import replace

from imud import json_file
from imud.config.rules import contradictions
from imud.config.settings import Config
from imud.errors import FileError
from imud.ports.adopted import file_of

FILE = "names.json"

logger = logging.getLogger("imud")


def path_of(config: Config) -> Path:
    return file_of(config.ports.memory).with_name(FILE)


def known(path: Path) -> dict[str, str]:
    """Names by id. FileError: the file is none of ours, or can't be read."""
    cure = "remove it, and name the probes again"
    return json_file.read(path, dict[str, str], cure, missing={})


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
        found = config.with_probe(probe_id, replace(settings, name=name))
        mistakes = [each.words for each in contradictions(found)]
        if mistakes:
            logger.warning("%s: the name of %s %s", FILE, probe_id, mistakes[0])
        else:
            config = found
    return config


def keep(config: Config, probe_id: str, name: str) -> None:
    """Writes a name into the file. FileError if that is not possible."""
    path = path_of(config)
    names = known(path) | {probe_id: name}
    json_file.write(path, dict(sorted(names.items())))
