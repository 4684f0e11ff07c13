# SPDX-License-Identifier: MIT
"""`imud listen`: poses on a terminal, into a pipe or as JSON, and what was missed."""

from __future__ import annotations

import contextlib
import json
import queue
import struct
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TextIO

from imud import rotation
from imud.cli.status_text import ledger_words, sigma_words, since_words
from imud.client import Client
from imud.errors import ProbeUnknown
from imud.wire import schema

# Seconds between two drawings: on a terminal in place, into a pipe as further lines.
TERMINAL_S = 0.1
PIPE_S = 1.0

# Seconds without a pose until a hint is shown.
HINT_S = 3.0

# A convention of docs/pose-details.md, or the rotation matrix.
Shape = rotation.Convention | Literal["matrix"]

_HEADER = struct.Struct(schema.HEADER)


@dataclass(slots=True)
class Reception:
    """The messages that this process received from one probe."""

    poses: int = 0
    has_frames: bool = True  # False: its keys allow poses only, which have numbers too
    missing: int = 0  # gaps in the numbers of frames, or of poses without frames
    pose: dict[str, Any] = field(default_factory=dict)
    status: dict[str, Any] = field(default_factory=dict)
    first_s: float = 0.0
    last_s: float = 0.0
    _last_number: int | None = None
    _recent_s: deque[float] = field(default_factory=deque)

    def on_pose(self, payload: bytes, now_s: float) -> None:
        """Counts a pose as published; `now_s` is when it arrived, monotonic."""
        self.pose = json.loads(payload)
        if self.poses == 0:
            self.first_s = now_s
        self.poses += 1
        self.last_s = now_s
        self._recent_s.append(now_s)
        if not self.has_frames:
            self._follow(self.pose["number"])

    def on_frame(self, content: bytes) -> None:
        """All messages of a probe share one sequence and arrive in its order."""
        _, number, _ = _HEADER.unpack_from(content)
        self._follow(number)

    def _follow(self, number: int) -> None:
        """A number that does not rise comes after a restart of probe or daemon."""
        if self._last_number is not None and number > self._last_number:
            self.missing += number - self._last_number - 1
        self._last_number = number

    def rate_hz(self, now_s: float) -> float:
        """Poses in the last second."""
        while self._recent_s and now_s - self._recent_s[0] >= 1.0:
            self._recent_s.popleft()
        return float(len(self._recent_s))

    @property
    def mean_hz(self) -> float:
        elapsed = self.last_s - self.first_s
        return (self.poses - 1) / elapsed if elapsed > 0 else 0.0


def head(shape: Shape | None) -> str:
    """The names of the columns; without a shape those of the nautical angles."""
    if shape == "matrix":
        attitude = f"{'world':<5} {'x':>7} {'y':>7} {'z':>7}"
    elif shape is None:
        attitude = f"{'yaw':>8} {'pitch':>7} {'roll':>8}"
    else:
        attitude = f"{'yaw °':>8} {'pitch °':>7} {'roll °':>8}"
    return (
        f"{'probe':<6}{shape or '':>10} {attitude}  {'tilt':>7} {'heading':>7}"
        f"  {'rate':>8}  flags"
    )


def pose_lines(
    name: str, received: Reception, now_s: float, shape: Shape | None
) -> list[str]:
    """The last pose of a probe: one line of angles, or the three rows of its matrix."""
    pose = received.pose
    rest = (
        f"{sigma_words(pose['tilt_sigma_deg']):>7} "
        f"{sigma_words(pose['heading_sigma_deg']):>7}  "
        f"{received.rate_hz(now_s):5.0f} Hz  {' '.join(pose['flags'])}"
    )
    # A daemon of another version may not tell it.
    since = pose.get("since_origin")
    if since is not None:
        errors = since["tilt_sigma_deg"], since["heading_sigma_deg"]
        rest += f"  {since_words(*errors, since['void'])}"
    if shape == "matrix":
        first, *others = (
            f"{axis:<5} {x:7.4f} {y:7.4f} {z:7.4f}"
            for axis, (x, y, z) in zip(
                ("east", "north", "up"), rotation.matrix_rows(pose["q"]), strict=True
            )
        )
        return [
            f"{name:<16} {first}  {rest}".rstrip(),
            *(f"{'':<16} {row}" for row in others),
        ]
    yaw, pitch, roll = rotation.angles_deg(pose["q"], shape or "nautical")
    return [f"{name:<16} {yaw:8.2f} {pitch:7.2f} {roll:8.2f}  {rest}".rstrip()]


def json_line(payload: bytes, shape: Shape | None) -> str:
    """A pose as published; with a shape, its angles (or matrix rows) are added."""
    if shape is None:
        return payload.decode()
    pose = json.loads(payload)
    if shape == "matrix":
        added: Any = rotation.matrix_rows(pose["q"])
    else:
        added = rotation.angles_deg(pose["q"], shape)._asdict()
    return json.dumps(pose | {shape: added}, separators=(",", ":"))


class PoseTable:
    """The last pose of each probe, redrawn in place or, into a pipe, as more lines."""

    def __init__(self, out: TextIO, shape: Shape | None = None) -> None:
        self._out = out
        self._shape = shape
        self._is_terminal = out.isatty()
        self._height = 0
        self.period_s = TERMINAL_S if self._is_terminal else PIPE_S

    def draw(self, probes: dict[str, Reception], now_s: float) -> None:
        """Draws a line a probe: over the last drawing on a terminal, else below it."""
        lines: list[str] = []
        for name, received in sorted(probes.items()):
            if received.pose:
                lines += pose_lines(name, received, now_s, self._shape)
        if not lines:
            return
        up = ""
        if self._is_terminal or self._height == 0:
            lines.insert(0, head(self._shape))
        if self._is_terminal and self._height:
            up = f"\x1b[{self._height}F"  # to the first line of the last drawing
        end = "\x1b[K\n" if self._is_terminal else "\n"  # and clear the rest of a line
        self._out.write(up + "".join(f"{line}{end}" for line in lines))
        self._out.flush()
        self._height = len(lines)


@dataclass(slots=True)
class _Listener:
    """Takes what arrives, and prints it as JSON at once or as a table now and then."""

    table: PoseTable
    has_frames: bool
    as_json: bool
    shape: Shape | None
    begin_s: float
    probes: dict[str, Reception] = field(default_factory=dict)
    is_hinted: bool = False

    def on_delivery(self, topic: str, name: str, payload: bytes, now_s: float) -> None:
        received = self.probes.setdefault(name, Reception(has_frames=self.has_frames))
        if topic == "pose":
            received.on_pose(payload, now_s)
            if self.as_json:
                sys.stdout.write(f"{json_line(payload, self.shape)}\n")
        elif topic == "frame":
            received.on_frame(payload)
        else:
            received.status = json.loads(payload)

    def show(self, now_s: float) -> None:
        if self.as_json:
            sys.stdout.flush()
        else:
            self.table.draw(self.probes, now_s)

    def hint(self, now_s: float) -> None:
        """Once, if no pose has arrived for a while."""
        is_due = not self.is_hinted and now_s - self.begin_s > HINT_S
        if is_due and not any(received.poses for received in self.probes.values()):
            self.is_hinted = True
            sys.stderr.write("no pose yet; try imud list, and imud start\n")


def listen(
    client: Client,
    probe: str | None,
    seconds: float | None,
    *,
    as_json: bool,
    shape: Shape | None = None,
) -> int:
    """Prints poses for some seconds or until Ctrl-C, then a summary.

    ProbeUnknown if no pose arrived.
    """
    arrived: queue.SimpleQueue[tuple[str, str, bytes]] = queue.SimpleQueue()

    def keeper(topic: str) -> Callable[[str, bytes], None]:
        return lambda name, payload: arrived.put((topic, name, payload))

    begin_s = time.monotonic()
    until_s = begin_s + seconds if seconds is not None else float("inf")
    table = PoseTable(sys.stdout, shape)
    has_frames = client.may("frame")
    listener = _Listener(table, has_frames, as_json, shape, begin_s)
    show_s = begin_s + table.period_s
    topics = ("pose", "frame", "status") if has_frames else ("pose", "status")
    undeclares = [client.subscribe(topic, probe, keeper(topic)) for topic in topics]
    with contextlib.suppress(KeyboardInterrupt):
        while (now_s := time.monotonic()) < until_s:
            with contextlib.suppress(queue.Empty):
                wait_s = max(0.0, min(show_s, until_s) - now_s)
                listener.on_delivery(*arrived.get(timeout=wait_s), time.monotonic())
            now_s = time.monotonic()
            if now_s >= show_s:
                show_s = now_s + table.period_s
                listener.show(now_s)
            listener.hint(now_s)
    for undeclare in undeclares:
        undeclare()
    return _summary(listener.probes, sys.stderr if as_json else sys.stdout)


def _summary(probes: dict[str, Reception], out: TextIO) -> int:
    with_poses = {name: received for name, received in probes.items() if received.poses}
    if not with_poses:
        raise ProbeUnknown(
            "no pose arrived; is a probe streaming? try imud list, and imud start"
        )
    for name, received in sorted(with_poses.items()):
        out.write(
            f"{name}: {received.poses} poses received, {received.mean_hz:.1f} Hz, "
            f"{received.missing} {'messages' if received.has_frames else 'poses'} "
            "missing (sequence gaps)\n"
        )
        if received.status:
            out.write(f"  {ledger_words(received.status)}\n")
    return 0
