# SPDX-License-Identifier: MIT
"""Shared by exports: one log after the other, with its contents and losses."""

from __future__ import annotations

import sys
from collections.abc import Callable, Container, Iterator, Sequence
from pathlib import Path

from imud.errors import FileError, told
from imud.log.parts import Damage
from imud.log.reader import Logged, salvage, size_of
from imud.progress import Progress
from imud.recordings.damage import DamageCount
from imud.recordings.fused import FusedLog
from imud.recordings.source import log_of


def each_of(paths: Sequence[Path], export: Callable[[Path, Path], None]) -> int:
    """Exports all logs and captures, each with the folder that it is in, and then
    raises one FileError of those that failed or are damaged.
    """
    problems = []
    for path in paths:
        try:
            with log_of(path) as log:
                export(log, path.parent)
        except FileError as error:
            problems.append(told(error))
    if problems:
        raise FileError("; ".join(problems))
    return 0


def items_of(
    path: Path,
    topics: Container[str],
    damage: DamageCount,
    fused: FusedLog | None = None,
) -> Iterator[Logged]:
    """The messages of a log on these topics, with poses and strokes of `fused` in the
    place of the log's; adds to `damage`. Shows the progress.
    """
    bar = Progress("exporting", size_of(path))
    try:
        items = salvage(path, bar.update)
        for item in fused.items(path, items) if fused else items:
            if isinstance(item, Damage):
                damage.add(item)
            elif isinstance(item, Logged) and item.topic in topics:
                yield item
    finally:
        bar.end()


def tell_fused(fused: FusedLog | None) -> None:
    """At the end of an export, what was computed."""
    for name, poses in fused.probes.items() if fused else ():
        sys.stdout.write(f"{name}: {poses.words()}\n")


def tell_flaws(path: Path, strange: int, damage: DamageCount) -> None:
    """At the end of an export. FileError if the log is damaged."""
    if strange:
        sys.stderr.write(f"{path}: {strange} messages are not imud's JSON objects\n")
    if words := damage.words():
        raise FileError(f"{path} is {words}")
