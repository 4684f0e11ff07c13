# SPDX-License-Identifier: MIT
"""The command `configure`: settings of a probe that change while the daemon runs."""

from __future__ import annotations

from collections.abc import Mapping

from msgspec.structs import replace

from imud.commands import COMMANDS
from imud.config.rules import contradictions
from imud.config.settings import BUTTON, Config
from imud.daemon.names import button_of
from imud.endpoint import unfit
from imud.errors import CommandRefused

CONFIGURE = COMMANDS["configure"]
LOG = CONFIGURE.argument("log").choices


def configured(config: Config, probe_id: str, parameters: Mapping[str, str]) -> Config:
    """The configuration with another name of a probe, with or without its log, or with
    other gestures of its button, until
    it is read again from its file; CommandRefused if that can't be.
    """
    if not parameters:
        raise CommandRefused(CONFIGURE.usage)
    settings = config.settings_of(probe_id)
    if "rename" in parameters:
        if not parameters["rename"]:
            raise CommandRefused(unfit(""))
        settings = replace(settings, name=parameters["rename"])
    if "log" in parameters:
        if parameters["log"] not in LOG:
            raise CommandRefused(CONFIGURE.usage)
        if not config.log.enabled:
            raise CommandRefused(
                "the daemon writes no log: enable it with [log] enabled or --log DIR"
            )
        settings = replace(settings, log=bool(LOG[parameters["log"]]))
    if "button" in parameters:
        table = button_of(parameters["button"] or ",".join(BUTTON))
        if table is None:
            raise CommandRefused(CONFIGURE.usage)
        settings = replace(settings, button=table)
    found = config.with_probe(probe_id, settings)
    for mistake in contradictions(found):
        raise CommandRefused(f"this configuration is invalid: its name {mistake.words}")
    return found
