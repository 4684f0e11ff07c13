# SPDX-License-Identifier: MIT
"""The fleet's benchmark counts what was lost, where, and how long messages took."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.host import hosts
from benchmarks.host.hosts import counted, delays

MS = 1_000_000


def fleet(
    tmp_path: Path, sent: list[Any], heard: list[Any], told: dict[int, int]
) -> Any:
    """`told`: the number of the last pose in the status of each probe."""
    names = ("sent_path", "heard_path", "told_path")
    made = SimpleNamespace(**{name: tmp_path / f"{name}.npy" for name in names})
    np.save(made.sent_path, np.array(sent, dtype=np.int64).reshape(-1, 4))
    np.save(made.heard_path, np.array(heard, dtype=np.int64).reshape(-1, 6))
    np.save(made.told_path, np.array([*told.items()], dtype=np.int64).reshape(-1, 2))
    return made


def sent(probe: int, sequence: int, *, overrun: int = 0) -> tuple[int, ...]:
    return (probe, sequence, sequence * 10 * MS, overrun)


def row_of(probe: int, sequence: int, number: int) -> tuple[int, ...]:
    """Read 2 ms after it was written, and 3 ms later with the consumer."""
    t_ns = sequence * 10 * MS
    return (probe, sequence, number, 0, t_ns + 2 * MS, t_ns + 5 * MS)


def test_a_loss_is_explained_by_a_pty_or_by_a_gap_in_numbers(tmp_path: Path) -> None:
    made = fleet(
        tmp_path,
        [sent(1, n, overrun=int(n == 4)) for n in range(1, 9)]
        + [sent(2, n) for n in range(1, 4)],
        # The first came before the subscription, 4 overran, 6 is a sequence gap.
        [
            row_of(1, 2, 2),
            row_of(1, 3, 3),
            row_of(1, 5, 4),
            row_of(1, 7, 6),
            row_of(1, 8, 7),
        ],
        {1: 7},
    )
    assert counted(made) == {"got": 5, "lost": 2, "unexplained": 0, "unheard": 1}


def test_a_loss_without_a_gap_is_not_explained(tmp_path: Path) -> None:
    received = [row_of(1, 1, 1), row_of(1, 3, 2)]
    made = fleet(tmp_path, [sent(1, n) for n in range(1, 5)], received, {})
    assert counted(made) == {"got": 2, "lost": 2, "unexplained": 2, "unheard": 0}


def test_a_loss_at_the_end_is_explained_by_the_status(tmp_path: Path) -> None:
    received = [row_of(1, 1, 1), row_of(1, 2, 2)]
    made = fleet(tmp_path, [sent(1, n) for n in range(1, 6)], received, {1: 4})
    assert counted(made) == {"got": 2, "lost": 3, "unexplained": 1, "unheard": 0}


def test_delays_are_told_by_hop(tmp_path: Path) -> None:
    received = [row_of(1, n, n) for n in (1, 2, 3)]
    made = fleet(tmp_path, [sent(1, n) for n in range(1, 5)], received, {1: 3})
    found = delays(made, 0, 100 * MS)
    assert found["to_daemon_ms"] == {"p50": 2.0, "p99": 2.0}
    assert found["to_consumer_ms"] == {"p50": 3.0, "p99": 3.0}
    assert found["sent_hz"] == pytest.approx(40.0)


def test_a_loss_that_nothing_explains_is_missed() -> None:
    row = {"lost": 2, "unexplained": 0, "unheard": 0}
    found = {each.name: each.verdict for each in hosts.figures_of([row, row])}
    assert found == {"unexplained": "goal", "unheard": "goal", "lost": "must"}
    for name in ("unexplained", "unheard"):
        first, second, _ = hosts.figures_of([row, row | {name: 1}])
        assert "MISSED" in (first.verdict, second.verdict)
