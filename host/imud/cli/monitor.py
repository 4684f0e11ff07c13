# SPDX-License-Identifier: MIT
"""`imud monitor`: all probes live on one screen.

A terminal of 80x24 or more is redrawn in place ten times a second; a pipe gets one line
per probe and second.
"""

from __future__ import annotations

import contextlib
import math
import sys
import textwrap
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from imud.cli.keyboard import Quit, keys_of, pressed
from imud.cli.pose_table import PIPE_S, TERMINAL_S
from imud.cli.status_text import age_words, balance_words, since_words, sinks_words
from imud.client import (
    Body,
    Missed,
    Pose,
    Published,
    Status,
    Subscription,
    subscribe,
)
from imud.probes.ledger import totals

# The daemon publishes a status each second: after three without, it is silent.
SILENT_S = 3.0

# Rows of a probe that is shown in full, without those about its sensors.
BLOCK = 6
WIDTH = 80

_STATES = {"streaming": "green", "idle": "cyan", "gone": "red", "silent": "red"}


@dataclass(slots=True)
class Shown:
    """The screen's data of a probe."""

    name: str
    pose: Pose | None = None
    pose_s: float = -math.inf
    status: Status | None = None
    status_s: float = -math.inf
    missed: Missed = field(default_factory=Missed)
    _recent_s: deque[float] = field(default_factory=deque)

    def add(self, message: Published, now_s: float) -> None:
        if isinstance(message, Pose):
            self.pose, self.pose_s = message, now_s
            self._recent_s.append(now_s)
        elif isinstance(message, Status):
            self.status, self.status_s = message, now_s

    def rate_hz(self, now_s: float) -> int:
        """Poses in the last second."""
        while self._recent_s and now_s - self._recent_s[0] > 1.0:
            self._recent_s.popleft()
        return len(self._recent_s)

    def state(self, now_s: float) -> str:
        if self.status is None:
            return "?"
        is_heard = now_s - self.status_s < SILENT_S
        return self.status.state if is_heard else "unheard"

    def has_pose(self, now_s: float) -> bool:
        return self.pose is not None and now_s - self.pose_s < SILENT_S


def _sigma(sigma: float | None) -> str:
    return "      " if sigma is None else f"±{sigma:<5.2f}"


def head_of(shown: Shown, now_s: float) -> Text:
    """A probe in one line."""
    state = shown.state(now_s)
    status = shown.status
    rate = f"{shown.rate_hz(now_s)} Hz"
    text = Text().append(f"{shown.name[:16]:<16} ", style="bold")
    text.append(f"{state:<10}", style=_STATES.get(state, "yellow"))
    text.append(f"{rate:>7}  ")
    text.append(f"{age_words(shown.pose):<17}" if shown.has_pose(now_s) else " " * 17)
    text.append(" ")
    if status is None:
        return text
    if shown.has_pose(now_s) and shown.pose is not None:
        yaw, pitch, roll = shown.pose.yaw_pitch_roll_deg
        text.append(f"{yaw:7.1f}{pitch:7.1f}{roll:7.1f}")
    else:
        text.append(f"{status.port or 'on no port'}", style="dim")
    return text


def loss_of(shown: Shown) -> Text:
    """The losses on the way, and where they occurred."""
    text = Text()
    if shown.status is None:
        return text
    ledger = shown.status.ledger
    total = totals(ledger)
    counts = (total.lost, ledger["corrupt"], shown.missed.network + shown.missed.queue)
    wire = f"lost {total.lost} of {total.sent}, {counts[1]} corrupt"
    wire += f", {counts[2]} in transit"
    return text.append(wire, style="red" if any(counts) else "default")


def block_of(shown: Shown, now_s: float) -> list[Text]:
    """A probe in full, in BLOCK lines."""
    pose, status = shown.pose, shown.status
    lines = [Text() for _ in range(BLOCK - 1)]
    yaw_line, pitch_line, roll_line, loss_line, balance_line = lines
    if pose is not None and shown.has_pose(now_s):
        yaw, pitch, roll = pose.yaw_pitch_roll_deg
        yaw_line.append(f"yaw   {yaw:8.2f}° {_sigma(pose.heading_sigma_deg)}  ")
        pitch_line.append(f"pitch {pitch:8.2f}° {_sigma(pose.tilt_sigma_deg)}  ")
        roll_line.append(f"roll  {roll:8.2f}° {_sigma(pose.tilt_sigma_deg)}  ")
        yaw_line.append(" ".join(pose.flags), style="dim")
        since = pose.since_origin
        if since is not None:
            errors = since.tilt_sigma_deg, since.heading_sigma_deg
            pitch_line.append(since_words(*errors, since.void), style="dim")
    if status is not None:
        port = status.port or "on no port"
        roll_line.append(f"{port} {status.hello.get('board', '')}", style="dim")
        loss_line.append_text(loss_of(shown))
        style = "default" if status.ledger.get("adds_up", True) else "red"
        balance_line.append(balance_words(status.ledger), style=style)
    return [head_of(shown, now_s), *(Text("  ").append_text(line) for line in lines)]


def concern_lines(shown: Shown) -> list[Text]:
    """Problems of a probe's sensors."""
    sensors = shown.status.sensors if shown.status else {}
    is_bad = not sensors.get("is_working", True) or bool(sensors.get("flags"))
    return [
        Text(line, style="red" if is_bad else "yellow")
        for sentence in sensors.get("words", ())
        for line in textwrap.wrap(sentence, WIDTH, subsequent_indent="  ")
    ]


@dataclass(slots=True)
class MonitorScreen:
    """All probes, by name; one that is gone stays on the screen, as gone."""

    endpoint: str
    probes: dict[str, Shown] = field(default_factory=dict)
    is_connected: bool = True

    def add(self, message: Published, now_s: float) -> None:
        if isinstance(message, Body):
            return
        shown = self.probes.setdefault(message.probe, Shown(message.probe))
        shown.add(message, now_s)

    def lines(self, now_s: float, height: int) -> list[Text]:
        """At most `height` lines."""
        probes = [shown for _, shown in sorted(self.probes.items())]
        count = f"{len(probes)} probe{'' if len(probes) == 1 else 's'}"
        head = Text().append(f"imud at {self.endpoint}, {count}", style="bold")
        if not self.is_connected:
            head.append("  not running; waiting for it", style="bold red")
        foot = Text("q ends", style="dim")
        room = height - 2
        body = [Text("no probe yet", style="dim")]
        if probes:
            body = self._body(probes, now_s, room)
        return [head, *body[:room], foot][: max(1, height)]

    def _body(self, probes: list[Shown], now_s: float, room: int) -> list[Text]:
        """The most of each probe for which there is room."""
        concerns = [concern_lines(shown) for shown in probes]
        titles = f"{'probe':<16} {'state':<10}{'rate':>7}  {'age':<17} "
        body = [Text(f"{titles}{'yaw':>7}{'pitch':>7}{'roll':>7}", style="dim")]
        count = len(probes) * BLOCK
        is_large = count + sum(map(len, concerns)) <= room
        if is_large:
            body.clear()
        for shown, lines in zip(probes, concerns, strict=True):
            body += block_of(shown, now_s) if is_large else [head_of(shown, now_s)]
            if is_large or 1 + len(probes) + sum(map(len, concerns)) <= room:
                body += lines
        if len(body) > room:
            left_out = len(body) - room + 1
            words = f"and {left_out} more; enlarge the window"
            body = [*body[: room - 1], Text(words)]
        return body

    def draw(self, now_s: float, height: int) -> Group:
        lines = self.lines(now_s, height)
        for line in lines:
            line.no_wrap, line.overflow = True, "crop"
        return Group(*lines)


def pipe_line(shown: Shown, now_s: float) -> str:
    """A probe as one line for a pipe, without colours."""
    text = head_of(shown, now_s).plain.rstrip()
    sinks = sinks_words(shown.status.ledger) if shown.status else ""
    words = "; ".join(shown.status.sensors.get("words", ())) if shown.status else ""
    return "  ".join(
        part for part in (text, loss_of(shown).plain, sinks, words) if part
    )


def _is_ended(keyboard: int | None) -> bool:
    try:
        pressed(keyboard)
    except Quit:
        return True
    return False


def follow(
    subscription: Subscription[Published], screen: MonitorScreen, until_s: float
) -> float:
    """Takes what arrives until `until_s`; returns the time then. time.monotonic()."""
    while (now_s := time.monotonic()) < until_s:
        message = subscription.get(until_s - now_s)
        if message is not None:
            screen.add(message, time.monotonic())
    for name, shown in screen.probes.items():
        shown.missed = subscription.missed_of(name)
    screen.is_connected = subscription.is_connected
    return now_s


def run(
    endpoint: str,
    prefix: str,
    keys: Path | None = None,
    seconds: float | None = None,
) -> int:
    """Shows the probes until q, Ctrl-C or the end of `seconds`."""
    until_s = math.inf if seconds is None else time.monotonic() + seconds
    with (
        subscribe(
            topics=("pose", "status"), endpoint=endpoint, prefix=prefix, keys=keys
        ) as subscription,
        contextlib.suppress(KeyboardInterrupt),
    ):
        screen = MonitorScreen(subscription.endpoint)
        for status in subscription.last_statuses():
            screen.add(status, time.monotonic())
        console = Console(highlight=False)
        if console.is_terminal:
            _show(console, subscription, screen, until_s)
        else:
            _write(subscription, screen, until_s)
    return 0


def _show(
    console: Console,
    subscription: Subscription[Published],
    screen: MonitorScreen,
    until_s: float,
) -> None:
    now_s = time.monotonic()
    with (
        keys_of(sys.stdin) as keyboard,
        Live(
            screen.draw(now_s, console.height),
            console=console,
            screen=True,
            auto_refresh=False,
        ) as live,
    ):
        while now_s < until_s and not _is_ended(keyboard):
            now_s = follow(subscription, screen, min(now_s + TERMINAL_S, until_s))
            live.update(screen.draw(now_s, console.height), refresh=True)


def _write(
    subscription: Subscription[Published], screen: MonitorScreen, until_s: float
) -> None:
    now_s = time.monotonic()
    while now_s < until_s:
        now_s = follow(subscription, screen, min(now_s + PIPE_S, until_s))
        for _, shown in sorted(screen.probes.items()):
            sys.stdout.write(pipe_line(shown, now_s) + "\n")
        if not screen.is_connected:
            sys.stdout.write("imud is not running; waiting for it\n")
        sys.stdout.flush()
