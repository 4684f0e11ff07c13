# SPDX-License-Identifier: MIT
"""Recordings that are wrong without a word: what is counted, and what is kept."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, replace
from pathlib import Path

from benchmarks.accuracy import unsaid
from benchmarks.accuracy.unsaid import AS_SAID, SHOP, WORSE, Outcome, Task

SOUND = Outcome(
    *("pointing", AS_SAID, 1001, True, (), (0.5, 2.0, 1.0), False, False, ())
)


def arguments(kept: Path) -> argparse.Namespace:
    return argparse.Namespace(
        set="judging", seeds=1, groups=["pointing"], jobs=1, kept=kept
    )


def test_what_was_measured_is_kept_and_counted(tmp_path: Path) -> None:
    kept = tmp_path / "kept.jsonl"
    wrong = replace(SOUND, module=WORSE, wrong=("tilt",), worst_deg=(9.0, 2.0, 1.0))
    withheld = replace(SOUND, module=SHOP, heading_withheld=True, doubts=("why",))
    outcomes = [SOUND, wrong, withheld]
    kept.write_text("".join(f"{json.dumps(asdict(each))}\n" for each in outcomes))
    report = unsaid.measured(arguments(kept))
    assert [*unsaid.kept(kept)] == outcomes
    assert [row[-1] for row in report.tables[0].rows] == [0, 1, 0]
    assert [row[4] for row in report.tables[0].rows] == [0.0, 0.0, 100.0]
    figure = report.figures[1]
    assert (figure.value, figure.verdict) == (1, "MISSED")
    assert figure.detail == "pointing 1001"


def test_a_sound_recording_is_not_wrong() -> None:
    outcome = unsaid.measure(Task("pointing", AS_SAID, 1000))
    assert outcome.wrong == ()
    assert not outcome.all_withheld
    assert max(outcome.worst_deg) < unsaid.WRONG_DEG
