# SPDX-License-Identifier: MIT
"""All rows, in the order of the table."""

from __future__ import annotations

from imud.check import axes, chips, field, readings, sampling, touch, wire
from imud.check.evidence import Evidence
from imud.check.rows import Row


def judged(evidence: Evidence) -> list[Row]:
    """The table for the evidence."""
    samples = evidence.samples()
    if evidence.other_schema:
        # Its other messages are unreadable.
        return [row for row in wire.rows(evidence, samples) if row.name == "firmware"]
    first = samples.first_pose()
    return [
        *wire.rows(evidence, samples),
        *chips.rows(evidence, first),
        *sampling.rows(evidence, samples),
        *readings.rows(evidence, first),
        *field.rows(evidence, first),
        *axes.rows(evidence),
        *touch.rows(evidence),
    ]
