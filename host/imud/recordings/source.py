# SPDX-License-Identifier: MIT
"""Files that commands read: one on this disk, or stdin; and logs of captures."""

from __future__ import annotations

import contextlib
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from imud.card.probe_log import MAGIC as CARD_MAGIC
from imud.errors import ConfigError, FileError
from imud.log.reader import legible
from imud.log.undated import write_capture
from imud.log.writer import MAGIC
from imud.probes.first_hello import first_hello, probe_in_file
from imud.probes.session import Probe
from imud.recordings.foreign_log import log_of_foreign
from imud.recordings.foreign_table import is_foreign

_CHUNK = 65536

STDIN = Path("-")


@contextlib.contextmanager
def local(path: Path) -> Iterator[Path]:
    """The file at `path`. What `-` names is read from stdin to its end first, into a
    file of its own, since some readers seek in theirs.
    """
    if path != STDIN:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="imud-") as folder:
        copy = Path(folder) / "stdin"
        with copy.open("wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file)
        yield copy


@contextlib.contextmanager
def log_of(path: Path) -> Iterator[Path]:
    """The log at `path`, or one that is made of the capture there, or of what comes on
    stdin, or of a foreign recording; its name has the stem of `path`. FileError if it
    is none of these.
    """
    if is_foreign(path):
        with log_of_foreign(path) as log:
            yield log
        return
    with local(path) as file, tempfile.TemporaryDirectory(prefix="imud-") as folder:
        with legible(path), file.open("rb") as opened:
            magic = opened.read(len(MAGIC))
        if magic == MAGIC:
            yield file
            return
        if magic == CARD_MAGIC:
            raise FileError(
                f"{path} is from a card; convert it to logs with imud card read {path}"
            )
        log = Path(folder) / f"{file.stem}.mcap"
        probe = probe_in_file(first_hello(chunks_of(file)), Probe)
        if not write_capture(chunks_of(file), probe, log):
            raise FileError(
                f"{path} is neither a log nor a capture with messages of a probe"
            )
        yield log


def beside(source: Path, to: Path | None, ending: str) -> Path:
    """Where what is made of a log goes: to `to`, else beside it."""
    if to is None and source == STDIN:
        raise ConfigError("standard input has no name: name what is written with --to")
    return to or source.with_name(f"{source.stem}{ending}")


def chunks_of(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while data := file.read(_CHUNK):
            yield data
