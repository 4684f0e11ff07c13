# SPDX-License-Identifier: MIT
"""Whether calibrations are accepted and refused rightly: a thousand simulated modules
in hands of all kinds, as they are, and where a hand that lacks poses lays those that
the guide asks for until both errors are good enough.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any

from benchmarks import harness
from benchmarks.calibration import simulated
from benchmarks.calibration.cases import Judged, Laid, crowd, judged, laid
from benchmarks.harness import Figure, Report, Table
from imud.calibration import poses
from imud.calibration.guided import faults
from imud.calibration.guided.procedure import POSES_MAX
from imud.rotation import FloatArray

CROWD_SEED = 301_000  # the first; the limit of the heading was chosen on those before

Row = dict[str, Any]


def measure(seed: int) -> Row:
    """A recording; not asked for poses are hands that never let go."""
    case = crowd(seed)
    found = laid(case, seed)
    first = judged(found.recording())
    row = row_of(found, first)
    if row["refused"] in faults.LACKS and not case.is_held:
        row["asked"] = laid_as_asked(found, first)
    return row


def row_of(found: Laid, verdict: Judged) -> Row:
    """Why it is refused, if it is, and the true errors."""
    fit, fault = verdict
    row: Row = {"refused": fault.kind if fault is not None else None}
    return row if fit is None else row | simulated.fit_errors(found.module, fit)


def laid_as_asked(found: Laid, verdict: Judged) -> Row:
    """The row after the requested poses, and their number. `verdict`: before them."""
    more: list[FloatArray] = []
    fit, fault = verdict
    while fault is not None and fault.kind in faults.LACKS:
        if len(found.ups) + len(more) >= POSES_MAX:
            break
        more.append(poses.wanted(fit.acc if fit is not None else None).up)
        fit, fault = judged(found.recording(more))
    return {"more": len(more)} | row_of(found, (fit, fault))


def is_good(row: Row) -> bool:
    """Whether a recording gives a calibration that may be accepted."""
    tilt, heading = row.get("tilt", math.inf), row.get("heading", math.inf)
    return bool(tilt <= 0.5 and heading <= 3.0)


def as_asked(rows: Iterable[Row]) -> list[Row]:
    """The recordings after the poses that the guide asks for."""
    return [{**row, **row["asked"]} if "asked" in row else row for row in rows]


def verdicts(name: str, rows: Sequence[Row], last: Sequence[Row]) -> Row:
    """Right and wrong verdicts on the last state of recordings. Good ones are those
    whose first state is: a user who follows the guide may rarely be refused.
    """
    accepted = [row for row in last if row["refused"] is None]
    good = [now for row, now in zip(rows, last, strict=True) if is_good(row)]
    return {
        "": name,
        "recordings": len(rows),
        "accepted": len(accepted),
        "bad": sum(not is_good(row) for row in accepted),
        "good": len(good),
        "good refused": sum(row["refused"] is not None for row in good),
    }


COLUMNS = {
    "": ("", ""),
    "recordings": ("recordings", "d"),
    "accepted": ("accepted", "d"),
    "bad ones of these": ("bad", "d"),
    "good": ("good", "d"),
    "refused ones of these": ("good refused", "d"),
}
AS_THEY_ARE, ASKED = "as they are", "asked for poses"
REFUSED = {AS_THEY_ARE: (35.0, 15.0), ASKED: (15.0, 8.0)}  # %: must and goal


def figures(rows: Iterable[Row]) -> Iterator[Figure]:
    """How often the verdict is wrong."""
    for row in rows:
        wrong = 100.0 * row["bad"] / max(row["accepted"], 1)
        lost = 100.0 * row["good refused"] / max(row["good"], 1)
        must, goal = REFUSED[row[""]]
        yield Figure(f"{row['']}: accepted and bad, %", wrong, (0, 0.5), (0, 0.2))
        yield Figure(f"{row['']}: good and refused, %", lost, (0, must), (0, goal))


def measured(args: argparse.Namespace) -> Report:
    seeds = harness.seeds_of(args, CROWD_SEED)
    found = [*harness.each(measure, seeds, args.jobs, "recordings")]
    rows = [
        verdicts(AS_THEY_ARE, found, found),
        verdicts(ASKED, found, as_asked(found)),
    ]
    return Report([Table.of("verdicts", COLUMNS, rows)], [*figures(rows)])


main = partial(
    harness.run,
    *("calibration-verdicts", __doc__, measured),
    harness.options(seeds=1000, jobs=1),
)
