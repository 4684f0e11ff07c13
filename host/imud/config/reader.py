# SPDX-License-Identifier: MIT
"""Reads the settings of `imud run`: defaults, then a TOML file, then arguments."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from imud.config.rules import contradictions
from imud.config.settings import Config
from imud.config.toml import (
    Mistake,
    called,
    changed,
    cut,
    line_of,
    mistakes,
    parse,
    written,
)
from imud.errors import ConfigError
from imud.text_file import read_text

ABOUT = """\
Settings of imud, each with its purpose. Omitted settings have the defaults that
`imud config` prints.

imud config --check FILE lists the mistakes in a file. A running daemon applies changes
on systemctl reload imu-probe, or kill -HUP."""


def load(
    path: Path | None,
    *,
    ports: Sequence[str] = (),
    listen: str | None = None,
    keys: Path | None = None,
    log_dir: Path | None = None,
    is_logging: bool = True,
    is_twin: bool = False,
    page: str | None = None,
    is_page: bool = True,
    level: str | None = None,
    changes: Mapping[str, Mapping[str, object]] | None = None,
) -> Config:
    """The settings of a file, with arguments of the command line in their place.
    `changes`: others by section and key; None: as they are.

    Raises ConfigError with the first mistake and the number of others.
    """
    replace = msgspec.structs.replace
    config = _read(path) if path is not None else Config()
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
    if page is not None:
        config = replace(config, web=replace(config.web, enabled=True, listen=page))
    if not is_page:
        config = replace(config, web=replace(config.web, enabled=False))
    if level is not None:
        config = _with(config, "journal", {"level": level})
    for section, values in (changes or {}).items():
        config = _with(config, section, values)
    found = list(contradictions(config))
    if found:
        raise ConfigError(
            f"{path if path is not None else 'arguments'}: {_first(found)}"
        )
    return config


def _with(config: Config, section: str, values: Mapping[str, object]) -> Config:
    before = getattr(config, section)
    given = {key: value for key, value in values.items() if value is not None}
    if found := mistakes({section: given}, Config):
        raise ConfigError(f"arguments: {_first(found)}")
    held = msgspec.convert(msgspec.to_builtins(before) | given, type(before))
    return msgspec.structs.replace(config, **{section: held})


def _read(path: Path) -> Config:
    text, table, found = _parsed(path)
    if found:
        raise ConfigError(f"{_place(path, text, found[0])}: {_first(found)}")
    return msgspec.convert(table, Config)


def check(path: Path) -> list[str]:
    """One line for each mistake in a file: `FILE:LINE: [section] key: ...`."""
    text, table, found = _parsed(path)
    if not found:
        found = list(contradictions(msgspec.convert(table, Config)))
    return [f"{_place(path, text, each)}: {_text_of(each)}" for each in found]


def as_toml(config: Config) -> str:
    """A configuration file with every setting and a comment on each."""
    return written(config, ABOUT)


def changed_in(path: Path) -> str:
    """The settings in that file that differ from the defaults, as TOML; ConfigError."""
    return changed(load(path), Config())


def _parsed(path: Path) -> tuple[str, dict[str, Any], list[Mistake]]:
    text = read_text(path, ConfigError)
    try:
        table = parse(text)
    except tomllib.TOMLDecodeError as error:
        # The parser's message may quote the file, line breaks included.
        words = "".join(c if c.isprintable() else "?" for c in str(error))
        raise ConfigError(f"{path} is not TOML: {words}") from error
    return text, table, mistakes(table, Config)


def _place(path: Path, text: str, mistake: Mistake) -> str:
    line = line_of(text, mistake.path)
    return f"{path}:{line}" if line is not None else str(path)


def _first(found: list[Mistake]) -> str:
    more = len(found) - 1
    also = f" (and {more} more: imud config --check FILE)" if more else ""
    return f"{_text_of(found[0])}{also}"


def _text_of(mistake: Mistake) -> str:
    name = called(tuple(map(cut, mistake.path)))
    # A quoted key may hold any character that TOML can escape.
    return "".join(c if c.isprintable() else "?" for c in f"{name}: {mistake.words}")
