# SPDX-License-Identifier: MIT
"""Limbs that users of the page set up: which probe sits on which segment. Each is kept
as a file for `imud body`, which runs one of them in a process beside the daemon.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from imud.body import chain
from imud.body.chain import Side
from imud.errors import ImudError
from imud.text_file import read_text
from imud.web import processes

SegmentName = Literal["thigh", "shank", "foot", "upper-arm", "forearm"]
LimbName = Annotated[str, Meta(pattern=f"^{chain.NAME.pattern}$")]
ProbeId = Annotated[str, Meta(pattern="^[0-9a-f]{16}$")]
LISTED_MAX = 50

# Parents before children. All joints are hinges, which show the direction ahead.
SEGMENTS: Mapping[SegmentName, str] = {
    "thigh": "length_m = 0.42",
    "shank": 'length_m = 0.43\nparent = "thigh"\njoint = "knee"',
    "foot": 'length_m = 0.08\nparent = "shank"\njoint = "ankle"\ncontact = true\n'
    "marks = { toe = [0.17, -0.08, 0.0] }",
    "upper-arm": "length_m = 0.30",
    "forearm": 'length_m = 0.27\nparent = "upper-arm"\njoint = "elbow"',
}
LIMBS = (("thigh", "shank", "foot"), ("upper-arm", "forearm"))

# Arguments by which `imud body` finds the daemon; an ImudError if it can't.
FindDaemon = Callable[[], tuple[str, ...]]


class LimbError(ImudError):
    """A limb can't be kept or run: why."""


class Setup(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The probes on the segments of a limb, by their ids."""

    side: Side
    probes: Annotated[dict[SegmentName, ProbeId], Meta(max_length=len(SEGMENTS))]


def text_of(name: str, setup: Setup) -> str:
    """The file of a limb; LimbError with what is to be chosen instead."""
    chosen = tuple(each for each in SEGMENTS if each in setup.probes)
    runs = {each[at:end] for each in LIMBS for at in (0, 1) for end in (2, 3)}
    if len(chosen) < 2 or chosen not in runs:
        known = "; ".join(", ".join(each) for each in LIMBS)
        raise LimbError(f"choose probes for two or three neighbours of: {known}")
    lines = [f'name = "{name}"', f'side = "{setup.side}"']
    for segment in chosen:
        rest = SEGMENTS[segment].splitlines()
        if segment == chosen[0]:
            rest = [each for each in rest if not each.startswith(("parent", "joint"))]
        lines += ["", f"[segments.{segment}]", f'probe = "{setup.probes[segment]}"']
        lines += rest
    text = "\n".join(lines) + "\n"
    chain.read(text, name)  # as `imud body` will: each probe only once
    return text


class Limbs:
    """The saved limbs, and the one that runs. Belongs to the server's loop; saved() and
    save() may be called in any thread.
    """

    def __init__(
        self, folder: Path, find: FindDaemon, on_change: Callable[[], None]
    ) -> None:
        self.running = ""
        self.why = ""  # the last one has ended
        self._folder, self._find, self._on_change = folder, find, on_change
        self._task: asyncio.Task[None] | None = None

    def saved(self) -> list[dict[str, Any]]:
        """Name, side and probes of each; files that are none of ours are left out."""
        found = []
        for path in sorted(self._folder.glob("*.toml"))[:LISTED_MAX]:
            with contextlib.suppress(ImudError):
                read = chain.read(read_text(path), path.name)
                probes = {each.name: each.probe for each in read.segments}
                found.append({"name": path.stem, "side": read.side, "probes": probes})
        return found

    def save(self, name: str, setup: Setup, *, replace: bool) -> None:
        """Writes the file whole or not at all; ImudError."""
        text, path = text_of(name, setup), self._folder / f"{name}.toml"
        beside = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and not replace:
                raise LimbError(f"a limb {name} is saved already")
            beside.write_text(text)
            beside.replace(path)
        except OSError as error:
            raise LimbError(f"can't write {path}: {error.strerror}") from error

    async def run(self, name: str) -> None:
        """Runs a saved limb instead of the one that runs; ImudError."""
        path = self._folder / f"{name}.toml"
        # What it prints also ends it, if this daemon is killed.
        words = ("imud", "body", str(path), "--json", *self._find())
        while self._task is not None:
            await self.end()
        self.why = ""
        ready = asyncio.Event()
        self._task = asyncio.create_task(self._run(name, words, ready))
        self._task.add_done_callback(lambda _: ready.set())
        await ready.wait()
        if not self.running:
            raise LimbError(self.why or "it was ended at once")

    async def end(self) -> None:
        task, self._task = self._task, None
        if task is not None:
            self.running = ""
            task.cancel()
            await asyncio.wait([task])
            self._on_change()

    async def _run(
        self, name: str, words: tuple[str, ...], ready: asyncio.Event
    ) -> None:
        process = None
        try:
            process = await processes.start(*words, stderr=asyncio.subprocess.PIPE)
            # Its first line is a state, which is published by then.
            while process.stdout and await process.stdout.readline():
                if not ready.is_set():
                    self.running = name
                    ready.set()
                    self._on_change()
            said = await process.stderr.read() if process.stderr else b""
            lines = said.decode("utf-8", "replace").strip().splitlines()
            self.why = lines[-1].removeprefix("imud: ") if lines else ""
        finally:
            await processes.end(process)
            if self._task is asyncio.current_task():  # it has ended by itself
                self.running = ""
                self._on_change()
