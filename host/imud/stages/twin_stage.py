# SPDX-License-Identifier: MIT
"""The twin as a stage: its outcomes as commands, records and lines of the journal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from imud.config.settings import Config
from imud.probes.session import ProbeFound, Received
from imud.stages import Outcome, Says, Tells, Wants
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import (
    Began,
    Differs,
    Lost,
    Stopped,
    WantsParams,
    WantsRaw,
    WantsRestart,
)

FAILURE = "its twin can't begin"


class TwinStage:
    """The twin of one probe, or none where the configuration has it off."""

    name = "twin"

    def __init__(self, config: Config) -> None:
        self._twin = Twin() if config.twin else None
        self._lost: dict[str, Any] | None = None
        self._first_difference: dict[str, Any] | None = None

    def configure(self, config: Config) -> None:
        if config.twin != (self._twin is not None):
            self._twin = Twin() if config.twin else None

    def appear(self, found: ProbeFound) -> None:  # noqa: ARG002 - any boot ends it
        if self._twin is not None:
            self._twin.appear()

    def take(self, received: Received) -> Iterable[Outcome]:
        return () if self._twin is None else self._compare(self._twin, received)

    def _compare(self, twin: Twin, received: Received) -> Iterator[Outcome]:
        state = twin.state
        outcome = twin.take(received.message, received.content, received.params)
        place = {
            "seq": received.message.sequence,
            "t_device_us": received.stamp.t_device_us,
            "t_ns": received.stamp.t_ns,
        }
        if isinstance(outcome, WantsRaw | WantsRestart | WantsParams):
            yield Wants(_commands(outcome), FAILURE)
        elif outcome is not None:
            self._note(outcome, place)
            yield from _lines(outcome)
        if twin.state is not state:
            yield Says(self.name, place | self.status())

    def status(self) -> dict[str, Any]:
        twin = self._twin
        return {
            "state": twin.state.value if twin is not None else "off",
            "compared": twin.compared if twin is not None else 0,
            "differed": twin.differed if twin is not None else 0,
            "lost": self._lost,
            "first_difference": self._first_difference,
        }

    def farewell(self) -> str:
        twin = self._twin
        return f"{twin.differed} of {twin.compared} poses differ" if twin else ""

    def _note(
        self, outcome: Began | Stopped | Lost | Differs, place: dict[str, Any]
    ) -> None:
        """Keeps what the status tells."""
        if isinstance(outcome, Began):
            self._lost = None
        elif isinstance(outcome, Lost):
            self._lost = place | {"seq": outcome.sequence, "reason": outcome.reason}
        elif isinstance(outcome, Differs) and self._first_difference is None:
            self._first_difference = place | {
                "fields": outcome.fields,
                "probe": outcome.probe.hex(),
                "twin": outcome.twin.hex(),
            }


def _commands(
    wants: WantsRaw | WantsRestart | WantsParams,
) -> tuple[tuple[str, dict[str, str]], ...]:
    if isinstance(wants, WantsRestart):
        return (("restart", {}),)
    if isinstance(wants, WantsParams):
        return (("params_tell", {}),)
    fields = ("fields", {"streams": "pose,raw"})
    if wants.rate_hz is None:
        return (fields,)
    return (("rate", {"stream": "raw", "hz": str(wants.rate_hz)}), fields)


def _lines(outcome: Began | Stopped | Lost | Differs) -> Iterator[Tells]:
    if isinstance(outcome, Began):
        yield Tells(Began, f"its twin follows from #{outcome.sequence} on")
    elif isinstance(outcome, Lost):
        yield Tells(
            Lost,
            f"its twin can't follow from #{outcome.sequence} on: {outcome.reason}; "
            "imud restart begins anew",
            is_warning=True,
        )
    elif isinstance(outcome, Differs) and outcome.is_first:
        yield Tells(
            Differs,
            f"pose #{outcome.sequence} is not what its samples give: "
            f"{', '.join(outcome.fields)} differ",
            is_warning=True,
        )
