# SPDX-License-Identifier: MIT
"""States of a body as lines for people, or as JSON."""

from __future__ import annotations

import sys

from imud.body.state import BodyState, JointState

PRINT_S = 1.0


class Printer:
    """Prints what the person should do, what is missing, and the angles."""

    def __init__(self, *, as_json: bool) -> None:
        self._as_json = as_json
        self._instruction: str | None = None
        self._missing: tuple[str, ...] = ()
        self._remarks: set[str] = set()
        self._printed_s = 0.0

    def put(self, state: BodyState, payload: bytes) -> None:
        if self._as_json:
            self._print(payload.decode())
            return
        if state.instruction != self._instruction:
            self._instruction = state.instruction
            self._print(
                f"{state.body}: {state.instruction or 'aligned; move as you like'}"
            )
        for remark in state.remarks:
            if remark not in self._remarks:
                self._remarks.add(remark)
                self._print(f"{state.body}: {remark}")
        if state.stage != "running":
            return
        if state.missing != self._missing:
            self._missing = state.missing
            away = [f"{s.name} {s.presence}" for s in state.segments]
            away = [s for s in away if not s.endswith(" ok")]
            self._print(f"{state.body}: {', '.join(away) or 'all probes are present'}")
        time_s = state.t_ns * 1e-9
        if time_s - self._printed_s >= PRINT_S:
            self._printed_s = time_s
            self._print("  ".join(map(line_of, state.joints)))

    def close(self) -> None:
        """Nothing to do: each line is out."""

    def _print(self, text: str) -> None:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()


def line_of(joint: JointState) -> str:
    """The angles of a joint and their errors, degrees."""
    if joint.angles_deg is None or joint.sigmas_deg is None:
        return f"{joint.child}: unknown"
    parts = [
        f"{name} {angle:.0f}±{joint.sigmas_deg[name]:.0f}"
        for name, angle in joint.angles_deg.items()
    ]
    return f"{joint.child}: {' '.join(parts)}"
