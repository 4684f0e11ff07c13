# SPDX-License-Identifier: MIT
"""What people have chosen for probes, their names and what their buttons do, in files
beside that of the ports that are ours. What the configuration says goes before.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Mapping
from pathlib import Path

import msgspec
from msgspec.structs import replace

from imud import json_file
from imud.config.rules import contradictions
from imud.config.settings import ButtonTable, Config
from imud.errors import FileError
from imud.ports.adopted import file_of

FILE, BUTTONS = "names.json", "buttons.json"
PARAMS = "params"  # in the place of a file
NONE: Mapping[str, str] = {}
LIMBS = "limbs"  # a folder of the page's

logger = logging.getLogger("imud")


def path_of(config: Config, file: str = FILE) -> Path:
    return file_of(config.ports.memory).with_name(file)


def known(path: Path) -> dict[str, str]:
    """Texts by id. FileError: the file is none of ours, or can't be read."""
    cure = "remove it, and name the probes, or choose their buttons' uses, again"
    return json_file.read(path, dict[str, str], cure, missing={})


def with_names(config: Config, told: Mapping[str, str] = NONE) -> Config:
    """The configuration with the names that were given, and the uses of buttons; then
    with the names that probes have `told` of themselves. What can't be read or can't be
    a name is told and left out: no probe is less useful for it.
    """
    for file in (FILE, BUTTONS):
        try:
            chosen = known(path_of(config, file))
        except FileError as error:
            logger.warning("%s", error)
        else:
            config = with_texts(config, chosen, file)
    return with_texts(config, told, PARAMS)


def with_texts(config: Config, chosen: Mapping[str, str], file: str) -> Config:
    """With texts by id of that file, where the configuration has none."""
    for probe_id, text in chosen.items():
        settings = config.settings_of(probe_id)
        if settings.button if file == BUTTONS else settings.name:
            continue
        if file == BUTTONS:
            settings = replace(settings, button=button_of(text))
        else:
            settings = replace(settings, name=text)
        found = config.with_probe(probe_id, settings)
        mistakes = [each.words for each in contradictions(found)]
        if mistakes:
            logger.warning("%s: the name of %s %s", file, probe_id, mistakes[0])
        else:
            config = found
    return config


def button_of(text: str) -> ButtonTable | None:
    """A table of gestures as `configure` and the file have it; None: it is none."""
    with contextlib.suppress(msgspec.ValidationError):
        found: ButtonTable = msgspec.convert(text.split(","), ButtonTable)
        return found
    return None


def keep(config: Config, probe_id: str, text: str, file: str = FILE) -> None:
    """Writes a text into the file. FileError if that is not possible."""
    path = path_of(config, file)
    texts = known(path) | {probe_id: text}
    json_file.write(path, dict(sorted(texts.items())))
