# SPDX-License-Identifier: MIT
"""Stages: work on a probe's messages as they arrive. A message goes in; commands,
records, journal lines and computed messages come out. A stage does no I/O and does not
know the daemon.

Each probe has a list of stages, made by `factory.py`. A stage that needs several
probes, such as a limb, can stand in the lists of all of them: `Received.probe` says
whose message it is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Protocol

import msgspec

from imud.config.settings import Config
from imud.probes.session import ProbeFound, Received

# Kinds of messages that a stage may compute in the place of the probe.
COMPUTED = frozenset({"pose", "stroke"})


class SendCommands(msgspec.Struct, frozen=True):
    """Commands that the probe should get, in this order, until one fails."""

    commands: tuple[tuple[str, Mapping[str, str]], ...]  # name and parameters
    failure: str  # the journal's words for one that failed; its reason is appended


class Publish(msgspec.Struct, frozen=True):
    """A record about the probe, published and logged as JSON under its own topic."""

    topic: str
    values: Mapping[str, Any]  # `type` and `probe` are put before them


class LogLine(msgspec.Struct, frozen=True):
    """A line of the journal about the probe, whose name is put before it."""

    kind: object  # lines of one kind are limited together
    text: str
    is_warning: bool = False


class InjectMessage(msgspec.Struct, frozen=True):
    """A message that the probe did not send, computed from the one at hand: published
    with that one's times, and not sent on as a frame.
    """

    content: bytes  # as its frame would hold it


StageResult = SendCommands | Publish | LogLine | InjectMessage


class Stage(Protocol):
    """One kind of work on messages. Its calls come from one thread and must not block.

    `name` is the key under which `status` stands in the status of the probe.
    `replaced` are the kinds of messages that it computes now: those that the probe
    sends itself are not published beside them, but for their frames.
    """

    name: str
    replaced: frozenset[str]

    def configure(self, config: Config) -> None:
        """Takes up a configuration that was reloaded."""

    def on_probe_found(self, found: ProbeFound) -> None:
        """The probe was found on a port, or it restarted. Its messages follow."""

    def on_message(self, received: Received) -> Iterable[StageResult]:
        """Works on one good message, in the order in which the probe sent them. Every
        message passes here: a stage that has nothing to do with one returns ().
        """

    def status(self) -> Mapping[str, Any]:
        """This stage's part of the probe's status, as JSON values."""

    def closing_line(self) -> str:
        """This stage's part of the daemon's last line about the probe; empty: none."""
