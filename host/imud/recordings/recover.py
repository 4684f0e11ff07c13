# SPDX-License-Identifier: MIT
"""`imud recover`: writes the good part of a cut or damaged log as a complete log."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

from imud.errors import FileError
from imud.log.copy import copy_good
from imud.log.parts import Damage
from imud.log.reader import size_of
from imud.progress import Progress


def run(path: Path, to: Path | None) -> int:
    """Writes a complete log beside the damaged one, or to `to`; returns 0.

    Raises FileError if nothing is good or the file exists.
    """
    size = size_of(path)
    to = to or path.with_name(f"{path.stem}-recovered.mcap")
    if os.path.lexists(to):
        raise FileError(f"{to} already exists; choose another file with --to")
    part = to.with_name(f"{to.name}.part")
    try:
        bar = Progress("recovering", size)
        try:
            copy = copy_good(path, part, bar.update)
        finally:
            bar.end()
        damages = copy.damages
        if damages and copy.messages:
            _put(part, to)
    except OSError as error:
        raise FileError(f"can't recover {path} to {to}: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    if not damages:
        sys.stdout.write(f"{path} is intact, with {_messages(copy.messages)}\n")
        return 0
    if not copy.messages:
        raise FileError(f"{path} has no intact messages")
    sys.stdout.write(f"{to}: {_messages(copy.messages)} saved; {_words(damages)}\n")
    if copy.unknown:
        sys.stdout.write(
            f"{_messages(copy.unknown)} left out: their probe is unknown, as that "
            "part is lost\n"
        )
    return 0


def _put(part: Path, to: Path) -> None:
    """Gives a finished file its name; fails if that exists."""
    try:
        os.link(part, to)
    except FileExistsError:
        raise
    except OSError:
        # A file system without hard links, as on cards.
        with contextlib.suppress(FileNotFoundError):
            part.rename(to)


def _words(damages: list[Damage]) -> str:
    holes = [each for each in damages if not each.is_tail]
    tails = [each for each in damages if each.is_tail]
    sentences = []
    if holes:
        lost = sum(each.size for each in holes)
        sentences.append(f"{lost} damaged bytes in {_places(len(holes))} lost")
    if tails:
        lost = sum(each.size for each in tails)
        sentences.append(
            f"truncated, {lost} bytes at its end lost" if lost else "truncated"
        )
    return ", ".join(sentences)


def _places(count: int) -> str:
    return "1 place" if count == 1 else f"{count} places"


def _messages(count: int) -> str:
    return "1 message" if count == 1 else f"{count} messages"
