# SPDX-License-Identifier: MIT
"""What `imud listen` and `imud list` show on a terminal or write to a pipe."""

from __future__ import annotations

import json
import queue
import struct
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TextIO

from imud.client import Client, Pose
from imud.errors import ProbeUnknown
from imud.probes.ledger import totals
from imud.probes.record import euler_deg
from imud.wire import schema

# Seconds between two looks: of a terminal in place, of a pipe a line a probe.
TERMINAL_S = 0.1
PIPE_S = 1.0

# A listener with nothing to show says so after this long.
HINT_S = 3.0

_HEADER = struct.Struct(schema.HEADER)

_COLUMNS = (
    f"{'probe':<16} {'yaw':>8} {'pitch':>7} {'roll':>8}  {'tilt':>7} {'heading':>7}"
    f"  {'rate':>8}  flags"
)


@dataclass(slots=True)
class Heard:
    """What came of one probe to this process."""

    poses: int = 0
    has_frames: bool = True  # else only poses are allowed, which have a count, too
    missing: int = 0  # numbers of messages, or of poses, that did not come
    pose: dict[str, Any] = field(default_factory=dict)
    status: dict[str, Any] = field(default_factory=dict)
    first_s: float = 0.0
    last_s: float = 0.0
    _last_number: int | None = None
    _recent_s: deque[float] = field(default_factory=deque)

    def take_pose(self, payload: bytes, now_s: float) -> None:
        self.pose = json.loads(payload)
        if self.poses == 0:
            self.first_s = now_s
        self.poses += 1
        self.last_s = now_s
        self._recent_s.append(now_s)
        if not self.has_frames:
            self._follow(self.pose["number"])

    def take_frame(self, content: bytes) -> None:
        """All messages of a probe share one count, and come in its order."""
        _, number, _ = _HEADER.unpack_from(content)
        self._follow(number)

    def _follow(self, number: int) -> None:
        """One that is not higher than the last is of a fresh boot or daemon."""
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


def ledger_words(status: dict[str, Any]) -> str:
    """The daemon's ledger of one probe: all boots since it heard of it."""
    ledger = status["ledger"]
    total = totals(ledger)
    dropped = sum(ledger["dropped"].values())
    return (
        f"{total.sent} sent = {total.received} received + "
        f"{total.skewed.total()} skewed + {total.lost} lost; "
        f"{ledger['corrupt']} corrupt, {total.duplicated} duplicated, {dropped} dropped"
    ) + (f"; twin {twin_words(status)}" if status["twin"]["state"] != "off" else "")


def balance_words(ledger: dict[str, Any]) -> str:
    """The way from data-ready to each sink, and whether it adds up."""
    if "adds_up" not in ledger:
        return ""
    sinks = []
    for name, counts in ledger["sinks"].items():
        off = [f"{counts[key]} {key}" for key in ("waiting", "dropped") if counts[key]]
        off = [f" ({', '.join(off)})"] if off else off
        sinks.append("".join([f"{name} {counts['taken']}", *off]))
    return f"{sum_words(ledger)}; {', '.join(sinks)}"


def sum_words(ledger: dict[str, Any]) -> str:
    if ledger["adds_up"]:
        return "adds up"
    return f"differs: {', '.join(ledger['differs'])}"


def sinks_words(ledger: dict[str, Any]) -> str:
    return ", ".join(
        f"{name} {counts['taken']} taken {counts['waiting']} waiting "
        f"{counts['dropped']} dropped"
        for name, counts in ledger.get("sinks", {}).items()
    )


def sensor_words(ledger: dict[str, Any]) -> str:
    """What the probe itself counted; nothing before its first counters."""
    sensor, probe = ledger.get("sensor"), ledger.get("probe")
    if sensor is None or probe is None:
        return ""
    return (
        f"{sensor['ready']} ready = {sensor['read']} read + {sensor['overruns']} "
        f"overrun + {sensor['unread']} unread; {sensor['fused']} fused; "
        f"{probe['numbers']} messages = {probe['sent']} sent + "
        f"{probe['dropped']} dropped"
    )


def time_words(age_us: int | None, bound_us: int | None) -> str:
    """How old a sample was when it was read, and how sure that is."""
    if age_us is None:
        return "-"
    bound = "" if bound_us is None else f" ±{bound_us / 1000:.2f}"
    return f"{age_us / 1000:.2f}{bound} ms"


def age_words(pose: Pose | None) -> str:
    return "-" if pose is None else time_words(pose.age_us, pose.t_bound_us)


def twin_words(status: dict[str, Any]) -> str:
    twin = status["twin"]
    count = f", {twin['differed']} of {twin['compared']}" if twin["differed"] else ""
    return f"{twin['state']}{count}"


def notes_words(status: dict[str, Any]) -> str:
    """What is to be said beside the figures; nothing where all is as ever."""
    is_paused = status.get("log", {}).get("state") == "paused"
    said = ("log paused" if is_paused else "", equipment_words(status["equipment"]))
    return ", ".join(filter(None, said))


def equipment_words(equipment: dict[str, Any] | None) -> str:
    """What is to be said of a board's parts; nothing where all is as ever."""
    if equipment is None:
        return ""
    said = []
    if equipment["clock"] == "spare":
        said.append("spare clock")
    if equipment["battery_v"] is not None:
        flags = " ".join(flag for flag in equipment["power"] if flag != "external")
        said.append(f"battery {equipment['battery_v']:.2f} V {flags}".rstrip())
    radio, card = equipment["radio"], equipment["card"]
    if radio is not None and radio["state"] != "cable":
        said.append(f"radio {radio['state']}")
    if card is not None and card["state"] != "absent":
        used = (
            f" {100 * card['block'] / card['blocks']:.0f} %" if card["blocks"] else ""
        )
        said.append(f"card {card['state']}{used}")
        if card["unlogged"]:
            said.append(f"{card['unlogged']} not logged")
    return ", ".join(said)


def pose_words(name: str, heard: Heard, now_s: float) -> str:
    pose = heard.pose
    yaw, pitch, roll = euler_deg(pose["q"])
    return (
        f"{name:<16} {yaw:8.2f} {pitch:7.2f} {roll:8.2f}  "
        f"{_sigma(pose['tilt_sigma_deg']):>7} {_sigma(pose['heading_sigma_deg']):>7}  "
        f"{heard.rate_hz(now_s):5.0f} Hz  {' '.join(pose['flags'])}"
    ).rstrip()


def _sigma(sigma: float | None) -> str:
    return "?" if sigma is None else f"±{sigma:.2f}"


class Screen:
    """Lines that are drawn over in place, or written one after the other."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._is_terminal = out.isatty()
        self._height = 0
        self.period_s = TERMINAL_S if self._is_terminal else PIPE_S

    def draw(self, probes: dict[str, Heard], now_s: float) -> None:
        lines: list[str] = []
        for name, heard in sorted(probes.items()):
            if heard.pose:
                lines.append(pose_words(name, heard, now_s))
        if not lines:
            return
        if self._is_terminal:
            lines.insert(0, _COLUMNS)
            # Up over the last drawing, and each line cleared to its end.
            up = f"\x1b[{self._height}F" if self._height else ""
            self._out.write(up + "".join(f"{line}\x1b[K\n" for line in lines))
            self._height = len(lines)
        else:
            if self._height == 0:
                self._out.write(f"{_COLUMNS}\n")
                self._height = 1
            self._out.write("".join(f"{line}\n" for line in lines))
        self._out.flush()


def listen(
    client: Client, probe: str | None, seconds: float | None, *, as_json: bool
) -> int:
    """Shows poses for some time or until Ctrl-C, then what came of them."""
    arrived: queue.SimpleQueue[tuple[str, str, bytes]] = queue.SimpleQueue()

    def keeper(topic: str) -> Callable[[str, bytes], None]:
        return lambda name, payload: arrived.put((topic, name, payload))

    probes: dict[str, Heard] = {}
    screen = Screen(sys.stdout)
    begin_s = time.monotonic()
    until_s = begin_s + seconds if seconds is not None else float("inf")
    look_s = begin_s + screen.period_s
    is_hinted = False
    has_frames = client.may("frame")
    topics = ("pose", "frame", "status") if has_frames else ("pose", "status")
    undeclares = [client.subscribe(topic, probe, keeper(topic)) for topic in topics]
    try:
        while (now_s := time.monotonic()) < until_s:
            try:
                wait_s = max(0.0, min(look_s, until_s) - now_s)
                topic, name, payload = arrived.get(timeout=wait_s)
            except queue.Empty:
                pass
            else:
                heard = probes.setdefault(name, Heard(has_frames=has_frames))
                if topic == "pose":
                    heard.take_pose(payload, time.monotonic())
                    if as_json:
                        sys.stdout.write(payload.decode() + "\n")
                elif topic == "frame":
                    heard.take_frame(payload)
                else:
                    heard.status = json.loads(payload)
            now_s = time.monotonic()
            if now_s >= look_s:
                look_s = now_s + screen.period_s
                if as_json:
                    sys.stdout.flush()
                else:
                    screen.draw(probes, now_s)
            is_waiting = not any(heard.poses for heard in probes.values())
            if is_waiting and not is_hinted and now_s - begin_s > HINT_S:
                is_hinted = True
                sys.stderr.write("no pose yet; imud list, and imud start\n")
    except KeyboardInterrupt:
        pass  # asked to end, as the seconds would have
    for undeclare in undeclares:
        undeclare()
    return _summary(probes, sys.stderr if as_json else sys.stdout)


def _summary(probes: dict[str, Heard], out: TextIO) -> int:
    heard_any = {name: heard for name, heard in probes.items() if heard.poses}
    if not heard_any:
        raise ProbeUnknown(
            "no pose came; is a probe streaming? imud list, and imud start"
        )
    for name, heard in sorted(heard_any.items()):
        out.write(
            f"{name}: {heard.poses} poses received, {heard.mean_hz:.1f} Hz, "
            f"{heard.missing} {'messages' if heard.has_frames else 'poses'} missing by "
            "sequence\n"
        )
        if heard.status:
            out.write(f"  {ledger_words(heard.status)}\n")
    return 0


def show_probes(client: Client, *, as_json: bool, has_ledger: bool = False) -> int:
    statuses = client.statuses()
    if as_json:
        for status in statuses:
            sys.stdout.write(json.dumps(status, separators=(",", ":")) + "\n")
        return 0
    if not statuses:
        sys.stdout.write("no probe was heard yet\n")
        return 0
    alive = set(client.alive())
    head: tuple[str, ...] = (
        *("probe", "state", "board", "firmware", "rate", "age", "lost", "ledger"),
        *("tilt", "heading", "twin", "equipment"),
    )
    rows = [head, *(_row(status, alive) for status in statuses)]
    if not any(row[-1] for row in rows[1:]):
        rows = [row[:-1] for row in rows]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        sys.stdout.write("  ".join(cells).rstrip() + "\n")
    if has_ledger:
        for status in statuses:
            _write_ledger(status)
    return 0


def _write_ledger(status: dict[str, Any]) -> None:
    """From the sensor to each sink, a line a link."""
    ledger = status["ledger"]
    lines = (
        ("probe", sensor_words(ledger)),
        ("wire", ledger_words(status)),
        ("sinks", f"{ledger['put']} records each: {sinks_words(ledger)}"),
    )
    sys.stdout.write(f"\n{status['probe']}\n")
    for name, words in lines:
        sys.stdout.write(f"  {name:<6} {words or '-'}\n")


def _row(status: dict[str, Any], alive: set[str]) -> tuple[str, ...]:
    name = str(status["probe"])
    hello = status["hello"]
    quality = status["quality"]
    ledger = status["ledger"]
    total = totals(ledger)
    is_measured = status["pose_rate_hz"] > 0
    return (
        name,
        str(status["state"]) if name in alive or status["port"] else "gone",
        str(hello.get("board", "?")),
        str(hello.get("firmware", "?")),
        f"{status['pose_rate_hz']:.0f} Hz",
        time_words(quality.get("age_us"), quality.get("t_bound_us")),
        f"{total.lost} of {total.sent}",
        sum_words(ledger),
        _sigma(quality["tilt_sigma_deg"]) if is_measured else "-",
        _sigma(quality["heading_sigma_deg"]) if is_measured else "-",
        twin_words(status),
        notes_words(status),
    )
