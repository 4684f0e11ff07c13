# SPDX-License-Identifier: MIT
"""Work for several processes at once, with a progress bar."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

from imud.progress import Progress

Work = TypeVar("Work")
Done = TypeVar("Done")


def each(
    task: Callable[[Work], Done], work: Sequence[Work], jobs: int, label: str
) -> Iterator[Done]:
    """The results in the order of the work, `jobs` processes at a time."""
    progress = Progress(f"{len(work)} {label}", len(work))
    # VQF is called from Python for each sample: threads would share one lock.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max(1, min(jobs, len(work))), context) as pool:
        for done in pool.map(task, work):
            yield done
            progress.advance()
    progress.end()
