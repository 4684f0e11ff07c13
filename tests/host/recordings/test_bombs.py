# SPDX-License-Identifier: MIT
"""Files from strangers that are made to fill the memory: each reader uses some
megabytes, ends soon, and reports the problem of the file.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

import bombs

# What a command takes beyond that on a harmless file, and beyond the file.
MIB = 1 << 20
MORE_MIB = 64
SOON_S = 20.0
KILL_S = 30.0


def run(words: Sequence[str], folder: Path) -> tuple[int, str, float, float]:
    """Exit code, stderr, resident memory in MiB and seconds of a command."""
    begin = time.monotonic()
    with (folder / "err").open("w+") as err:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "imud", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=err,
            cwd=folder,
        )
        killing = threading.Timer(KILL_S, process.kill)
        killing.start()
        _, status, usage = os.wait4(process.pid, 0)
        killing.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        err.seek(0)
        text = err.read()
    seconds = time.monotonic() - begin
    return process.returncode, text, usage.ru_maxrss / 1024, seconds


CASES: list[tuple[Callable[[Path], Iterator[Path]], list[str]]] = [
    (bombs.logs, ["info", "{}"]),
    (bombs.logs, ["decode", "{}"]),
    (bombs.logs, ["export", "{}", "--to", "csv", "--out", "tables"]),
    (bombs.logs, ["recover", "{}", "--to", "{}.saved"]),
    (bombs.logs, ["sim", "nano", "--motion", "{}"]),
    (bombs.captures, ["info", "{}"]),
    (bombs.captures, ["decode", "{}"]),
    (bombs.tables, ["sim", "nano", "--motion", "{}"]),
    (bombs.tables, ["import", "{}", "--dry-run"]),
    (bombs.parquets, ["import", "{}", "--dry-run"]),
    (bombs.texts, ["config", "--check", "{}"]),
    (bombs.texts, ["params", "load", "p", "{}"]),
    (bombs.texts, ["body", "{}"]),
    (bombs.texts, ["calibrate", "tip", "p", "--method", "circle", "--positions", "{}"]),
]


@pytest.mark.sampled(8)
@pytest.mark.parametrize(
    ("make", "words"), CASES, ids=["-".join([m.__name__, *w]) for m, w in CASES]
)
def test_a_file_that_is_made_to_fill_the_memory_does_not(
    tmp_path: Path,
    make: Callable[[Path], Iterator[Path]],
    words: list[str],
    record_property: Callable[[str, object], None],
) -> None:
    plain_mib: float | None = None
    failed = []
    for path in make(tmp_path):
        given = [word.format(path) for word in words]
        code, error, took_mib, seconds = run(given, tmp_path)
        if plain_mib is None:
            plain_mib = took_mib
        more_mib = took_mib - plain_mib - path.stat().st_size / MIB
        told = f"{path.name}: {code}, {more_mib:.0f} MiB, {seconds:.1f} s"
        record_property(path.name, told)
        is_good = more_mib < MORE_MIB and seconds < SOON_S and code in (0, 1)
        if not is_good or error.count("\n") > 3 or "internal error" in error:
            failed.append(f"{told}: {error[-300:]}")
    assert not failed, "\n".join(failed)
