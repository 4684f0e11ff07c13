# SPDX-License-Identifier: MIT
"""The twin as a stage: its outcomes as commands, records and lines of the journal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from imud.config.settings import Config
from imud.probes.session import ProbeFound, Received
from imud.stages import LogLine, Publish, SendCommands, StageResult
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import (
    AskParams,
    AskRaw,
    AskRestart,
    TwinDiffers,
    TwinLost,
    TwinStarted,
    TwinStopped,
)

FAILURE = "its twin can't start"


class TwinStage:
    """The twin of one probe, or none where the configuration has it off."""

    name = "twin"
    replaced: frozenset[str] = frozenset()

    def __init__(self, config: Config) -> None:
        self._twin = Twin() if config.twin else None
        self._lost: dict[str, Any] | None = None
        self._first_difference: dict[str, Any] | None = None

    def configure(self, config: Config) -> None:
        if config.twin != (self._twin is not None):
            self._twin = Twin() if config.twin else None

    def on_probe_found(self, found: ProbeFound) -> None:  # noqa: ARG002 - any boot ends it
        if self._twin is not None:
            self._twin.on_probe_found()

    def on_message(self, received: Received) -> Iterable[StageResult]:
        return () if self._twin is None else self._compare(self._twin, received)

    def _compare(self, twin: Twin, received: Received) -> Iterator[StageResult]:
        state = twin.state
        outcome = twin.on_message(received.message, received.content, received.params)
        place = {
            "seq": received.message.sequence,
            "t_device_us": received.stamp.t_device_us,
            "t_ns": received.stamp.t_ns,
        }
        if isinstance(outcome, AskRaw | AskRestart | AskParams):
            yield SendCommands(_commands(outcome), FAILURE)
        elif outcome is not None:
            self._note(outcome, place)
            yield from _lines(outcome)
        if twin.state is not state:
            yield Publish(self.name, place | self.status())

    def status(self) -> dict[str, Any]:
        """Poses compared with the probe's, those that differed, and those lost."""
        twin = self._twin
        return {
            "state": twin.state.value if twin is not None else "off",
            "compared": twin.compared if twin is not None else 0,
            "differed": twin.differed if twin is not None else 0,
            "lost": self._lost,
            "first_difference": self._first_difference,
        }

    def closing_line(self) -> str:
        twin = self._twin
        return f"{twin.differed} of {twin.compared} poses differ" if twin else ""

    def _note(
        self,
        outcome: TwinStarted | TwinStopped | TwinLost | TwinDiffers,
        place: dict[str, Any],
    ) -> None:
        """Keeps what the status tells."""
        if isinstance(outcome, TwinStarted):
            self._lost = None
        elif isinstance(outcome, TwinLost):
            self._lost = place | {"seq": outcome.sequence, "reason": outcome.reason}
        elif isinstance(outcome, TwinDiffers) and self._first_difference is None:
            self._first_difference = place | {
                "fields": outcome.fields,
                "probe": outcome.probe.hex(),
                "twin": outcome.twin.hex(),
            }


def _commands(
    asked: AskRaw | AskRestart | AskParams,
) -> tuple[tuple[str, dict[str, str]], ...]:
    if isinstance(asked, AskRestart):
        return (("restart", {}),)
    if isinstance(asked, AskParams):
        return (("params_tell", {}),)
    fields = ("fields", {"streams": "pose,raw"})
    if asked.rate_hz is None:
        return (fields,)
    return (("rate", {"stream": "raw", "hz": str(asked.rate_hz)}), fields)


def _lines(
    outcome: TwinStarted | TwinStopped | TwinLost | TwinDiffers,
) -> Iterator[LogLine]:
    if isinstance(outcome, TwinStarted):
        yield LogLine(TwinStarted, f"its twin compares from #{outcome.sequence} on")
    elif isinstance(outcome, TwinLost):
        yield LogLine(
            TwinLost,
            f"its twin stops at #{outcome.sequence}: {outcome.reason}; start it "
            "again with imud restart",
            is_warning=True,
        )
    elif isinstance(outcome, TwinDiffers) and outcome.is_first:
        yield LogLine(
            TwinDiffers,
            f"pose #{outcome.sequence} differs from the twin's: "
            f"{', '.join(outcome.fields)}",
            is_warning=True,
        )
