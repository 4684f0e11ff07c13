# SPDX-License-Identifier: MIT
"""Keeps each set of params that came into force at a probe, as a file. A thread of its
own writes them: a disk that is slow, full or gone holds up nothing.
"""

from __future__ import annotations

import asyncio
import logging
import os
import re
import time
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imud.errors import CommandRefused, FileError, ImudError
from imud.params import file
from imud.params.value import Params

FILES_MAX = 50  # of a probe; the oldest go
CLOSE_S = 1.0  # for what is still to be written when the daemon ends

_NAME = re.compile(r"([0-9]{8}T[0-9]{6}Z)-([0-9a-f]{8})\.toml")
_PREFIX = re.compile(r"[0-9a-f]{1,8}")
_PROBE_ID = re.compile(r"[0-9a-f]{16}")

logger = logging.getLogger("imud")


@dataclass(frozen=True, slots=True)
class Entry:
    """A set that came into force."""

    time: str  # UTC, as 20261122T173000Z
    digest: str
    path: Path


class HistoryFiles:
    """The files of all probes, in a folder for each; without a folder there is none."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._worker = ThreadPoolExecutor(1, "imud-history")
        self._last: Future[None] | None = None
        self._is_failing = False

    def configure(self, folder: Path | None) -> None:
        self._folder = folder

    def keep(self, probe_id: str, params: Params, t_ns: int) -> None:
        """Keeps a set that came into force at `t_ns` UTC, unless it is the last one."""
        if self._folder is not None and _PROBE_ID.fullmatch(probe_id):
            folder = self._folder / probe_id
            self._last = self._worker.submit(self._keep, folder, params, t_ns)

    def close(self) -> None:
        if self._last is not None:
            wait([self._last], CLOSE_S)
        self._worker.shutdown(wait=False, cancel_futures=True)

    async def command(
        self, probe_id: str, parameters: Mapping[str, str]
    ) -> dict[str, Any]:
        """The entries of a probe, the newest first; with `digest`, the bytes of the one
        that begins so. CommandRefused or FileError with the reason.
        """
        if self._folder is None:
            raise CommandRefused(
                "the daemon keeps no history of params: [params] history is empty"
            )
        call = asyncio.get_running_loop().run_in_executor
        folder = self._folder / probe_id
        digest = parameters.get("digest")
        if digest is not None:
            return await call(self._worker, _load, folder, digest)
        entries = await call(self._worker, entries_of, folder)
        listed = [{"time": each.time, "digest": each.digest} for each in entries]
        return {"folder": str(folder.absolute()), "entries": listed}

    def _keep(self, folder: Path, params: Params, t_ns: int) -> None:
        """Runs in the worker's thread."""
        try:
            _write(folder, params, t_ns)
        except OSError as error:
            if not self._is_failing:
                logger.warning(
                    "history of params: can't write to %s: %s; everything else "
                    "continues",
                    folder,
                    error.strerror,
                )
            self._is_failing = True
        else:
            self._is_failing = False


def entries_of(folder: Path) -> list[Entry]:
    """The files in a folder, the newest first; none if it can't be read."""
    try:
        names = sorted(path.name for path in folder.iterdir())
    except OSError:
        return []
    found = [_NAME.fullmatch(name) for name in reversed(names)]
    return [Entry(each[1], each[2], folder / each[0]) for each in found if each]


def _write(folder: Path, params: Params, t_ns: int) -> None:
    digest = f"{params.digest:08x}"
    entries = entries_of(folder)
    if entries and entries[0].digest == digest:
        return
    folder.mkdir(parents=True, exist_ok=True)
    stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(t_ns // 10**9))
    path = folder / f"{stamp}-{digest}.toml"
    # Whole, or not at all: the next start may read it.
    partial = path.with_suffix(".partial")
    try:
        with partial.open("w", encoding="utf-8") as out:
            out.write(file.written(params, folder.name))
            out.flush()
            os.fsync(out.fileno())
        partial.replace(path)
    except OSError:
        partial.unlink(missing_ok=True)
        raise
    for old in entries[FILES_MAX - 1 :]:
        old.path.unlink(missing_ok=True)


def _load(folder: Path, digest: str) -> dict[str, Any]:
    if not _PREFIX.fullmatch(digest):
        raise CommandRefused("a digest is up to 8 hexadecimal digits")
    found = [each for each in entries_of(folder) if each.digest.startswith(digest)]
    if not found:
        raise CommandRefused(f"there are no params {digest} in the history")
    if len({each.digest for each in found}) > 1:
        raise CommandRefused(
            f"more than one digest in the history starts with {digest}"
        )
    try:
        read = file.read(found[0].path)
    except ImudError as error:
        raise FileError(f"history: {error}") from error
    return {
        "time": found[0].time,
        "digest": found[0].digest,
        "probe_id": read.probe_id,
        "bytes": read.params.encode().hex(),
    }
