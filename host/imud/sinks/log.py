# SPDX-License-Identifier: MIT
"""The log: MCAP files that lose at most the last 0.25 s to a kill -9."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from io import BufferedWriter
from pathlib import Path

from imud.errors import FileError
from imud.log.file import LogFile, Settings
from imud.log.finish import finish_all
from imud.log.retention import STAMP, KeptLogs, origin, ours_in
from imud.machine import system
from imud.machine.utc import sync_of_host
from imud.probes.record import Presence, Record

# Data goes to the kernel this often. The promise is 0.25 s; the rest is for a busy
# machine.
FLUSH_S = 0.1

# Time to close: what is not written by then is lost, so a busy machine gets time.
# Service managers give a process 10 s and more.
PATIENCE_S = 5.0

# Entries of the index that the writer keeps in memory until a file ends, one for each
# channel and flush: an hour of four probes with four channels. Each takes 86 bytes,
# measured.
INDEX_MAX = 600_000

# Old logs are looked for this often, and when a file begins.
SWEEP_S = 10.0

# No log is removed for its age until this machine's clock has followed UTC without a
# step for so long.
STEADY_S = 600.0
STEP_S = 60.0

# Logging resumes when the free space is this many times the floor: no new file for each
# few blocks that become free.
ROOM_AGAIN = 1.1

logger = logging.getLogger("imud")


class LogSink:
    """Writes records to files of its own; after one that fails it begins another.

    A record that can't be written is a FileError; the lane counts it and tries again.
    A full disk at the start is no error: logging is paused.
    """

    name = "log"
    period_s = FLUSH_S
    patience_s = PATIENCE_S

    def __init__(self, directory: Path, settings: Settings | None = None) -> None:
        self._directory = directory
        self.settings = settings or Settings()
        self._syncer: ThreadPoolExecutor | None = None
        self._syncing: Future[None] | None = None
        self._sweeping: Future[KeptLogs] | None = None
        self._swept_s = -math.inf
        self._finishing: threading.Thread | None = None
        self._ahead_s = math.nan  # of UTC to the monotonic clock
        self._steady_s = math.inf  # monotonic, since when that is the same
        self._excess = ""
        self.kept: KeptLogs | None = None  # of the last look at the folder
        self._log: LogFile | None = None
        self._began_s = 0.0
        self._has_flushed = False
        self._is_paused = False
        self._timeline = 1  # of the times in the file
        self.path: Path | None = None

    def open(self) -> None:
        """Begins a file, or pauses on a full disk; FileError if it can't be written."""
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            if self._is_full(system.free_bytes(self._directory)):
                self._is_paused = True
                return
            before = [path for path, _ in ours_in(self._directory)]
            stamp = time.strftime(STAMP, time.gmtime())
            is_dated = sync_of_host().is_synchronised is not False
            place = origin(self._directory, stamp, is_dated=is_dated)
            self.path, file = self._create(stamp)
        except OSError as error:
            raise FileError(
                f"can't log to {self._directory}: {error.strerror}; choose another "
                "folder with --log DIR, or pass --no-log"
            ) from error
        self._is_paused = False
        self._has_flushed = False
        self._syncer = self._syncer or ThreadPoolExecutor(1, "imud-sync")
        self._began_s = time.monotonic()
        self._log = LogFile(file, self.settings, place)
        self._swept_s = -math.inf
        if self._finishing is None:
            self._finishing = threading.Thread(
                target=self._finish_old, args=(before,), name="imud-finish", daemon=True
            )
            self._finishing.start()

    def write(self, record: Record | Presence) -> None:
        """Adds a record to the file, and begins one if there is none. FileError while
        the disk is full.
        """
        if not isinstance(record, Record) or record.probe in self.settings.unlogged:
            return
        if record.topic == "clock":
            self._follow(record)
        if self._log is None and not self._is_paused:
            self.open()
        if self._log is None:
            raise FileError(
                f"{self._directory} is on a disk with less than "
                f"{self.settings.floor_bytes / 1e6:.0f} MB free (log.floor_mb); "
                "logging is paused until space is free"
            )
        self._log.add(record)

    def _follow(self, clock: Record) -> None:
        """A file has one timeline: in another one times may be earlier than in it."""
        timeline = json.loads(clock.payload)["timeline"]
        if timeline != self._timeline:
            self._timeline = timeline
            self._end()

    def flush(self) -> None:
        """Writes what was added and has it synced; removes old files, pauses on a full
        disk and begins another file when this one is long. FileError if that is not
        possible.
        """
        log = self._log
        if log is None or self._syncer is None:
            return
        if os.fstat(log.fileno()).st_nlink == 0:
            raise FileError(f"{self.path} was removed during writing")
        try:
            log.flush()
            self._has_flushed = True
            if self._syncing is None or self._syncing.done():
                if self._syncing is not None:
                    self._syncing.result()
                # Takes 20 ms, and longer on a busy disk: not in this thread.
                self._syncing = self._syncer.submit(system.sync, log.fileno())
        except OSError as error:
            raise FileError(f"can't write {self.path}: {error.strerror}") from error
        self._sweep()
        self._is_paused = self._is_full(
            system.free_bytes(self._directory, log.fileno())
        )
        if (
            self._is_paused
            or log.size() >= self.settings.rotate_bytes
            or log.index_size >= INDEX_MAX
            or time.monotonic() - self._began_s >= self.settings.rotate_s
        ):
            self._end()

    def _finish_old(self, paths: list[Path]) -> None:
        """Gives logs that were cut off their ends; in a thread of its own."""
        done = []
        for found in finish_all(paths, self.settings.floor_bytes):
            if found.fault:
                logger.warning("log: %s", found.fault)
            else:
                done.append(found)
        if done:
            logger.info(
                "log: finished %d of %s that were cut off, with %d messages",
                *(len(done), self._directory, sum(each.messages for each in done)),
            )

    def _is_dated(self) -> bool:
        """Whether UTC is known well enough to remove a log for its age."""
        now_s = time.monotonic()
        ahead_s = time.time() - now_s
        if not abs(ahead_s - self._ahead_s) < STEP_S:
            self._steady_s = now_s
        self._ahead_s = ahead_s
        is_utc = sync_of_host().is_synchronised is not False
        return is_utc and now_s - self._steady_s >= STEADY_S

    def _sweep(self) -> None:
        """Looks for logs to remove, now and then, and tells of what was removed."""
        retention = self.settings.retention
        if not retention or self._syncer is None:
            return
        if self._finishing is not None and self._finishing.is_alive():
            return  # what it finishes has its place among those to remove
        if self._sweeping is not None and self._sweeping.done():
            sweeping, self._sweeping = self._sweeping, None
            with contextlib.suppress(OSError):
                self.kept = sweeping.result()
                self._tell_removed(self.kept)
                self._tell_excess(self.kept)
        if self._sweeping is None and time.monotonic() - self._swept_s >= SWEEP_S:
            self._swept_s = time.monotonic()
            # To remove a large file takes seconds on a slow disk.
            sweep = partial(retention.sweep, is_dated=self._is_dated())
            self._sweeping = self._syncer.submit(sweep, self._directory)

    def _tell_removed(self, kept: KeptLogs) -> None:
        if not kept.removed:
            return
        files = "1 old file" if kept.removed == 1 else f"{kept.removed} old files"
        logger.info(
            "log: removed %s, %.0f MB; kept %d files, %.0f MB (log.keep_mb, "
            "log.keep_days)",
            *(files, kept.removed_bytes / 1e6, kept.files, kept.bytes / 1e6),
        )

    def _tell_excess(self, kept: KeptLogs) -> None:
        """Once, that the folder can't be kept as small as told."""
        why = kept.fault or (
            "the newest logs stay: choose a smaller log.rotate_mb or a larger "
            "log.keep_mb"
        )
        excess = why if kept.excess else ""
        if excess and excess != self._excess:
            logger.warning(
                "log: %s has %.0f MB more than log.keep_mb; %s",
                *(self._directory, kept.excess / 1e6, excess),
            )
        self._excess = excess

    def close(self) -> None:
        try:
            self._finish()
        except OSError as error:
            raise FileError(f"can't finish {self.path}: {error.strerror}") from error
        if self._syncer is not None:
            self._syncer.shutdown()
            self._syncer = None

    def go_on_for(self, other: LogSink) -> None:
        """The file goes on."""
        self.settings = other.settings

    def _is_full(self, free_bytes: int) -> bool:
        floor = self.settings.floor_bytes * (ROOM_AGAIN if self._is_paused else 1.0)
        return free_bytes < floor

    def _end(self) -> None:
        """Finishes a file that has all its data; the next record begins another."""
        try:
            self._finish()
        except OSError as error:
            logger.warning(
                "log: can't finish %s: %s; imud recover repairs it",
                self.path,
                error.strerror,
            )

    def _finish(self) -> None:
        log, self._log = self._log, None
        syncing, self._syncing = self._syncing, None
        if log is None:
            return
        try:
            # The kernel gets everything before anything waits for a disk that hangs.
            log.finish()
            if syncing is not None:
                syncing.result()
        except OSError:
            self._leave_no_empty_one()
            raise
        finally:
            log.close()

    def _leave_no_empty_one(self) -> None:
        """On a full disk each attempt would leave an empty file."""
        if not self._has_flushed and self.path is not None:
            self.path.unlink(missing_ok=True)

    def _create(self, stamp: str) -> tuple[Path, BufferedWriter]:
        number = 1
        while True:
            # Sorted by name is sorted by time: '_' comes after '.'.
            suffix = "" if number == 1 else f"_{number:03}"
            path = self._directory / f"imud-{stamp}{suffix}.mcap"
            number += 1
            try:
                file = path.open("xb")
            except FileExistsError:
                continue
            # Tells others that it is being written; not every file system can.
            with contextlib.suppress(OSError):
                if not system.try_lock(file):
                    file.close()  # another daemon looks at it as at one cut off
                    continue
            return path, file
