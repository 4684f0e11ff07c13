# SPDX-License-Identifier: MIT
"""What the daemon says of its probes and ports, in words; and how often it says it."""

from __future__ import annotations

import logging
import time
from collections import Counter, deque
from collections.abc import Sequence

from imud.probes.record import plain
from imud.probes.session import OnlyNoise, OtherSchema, Silent
from imud.wire import schema
from imud.wire.messages import Message

# Of one kind of line about one thing so many are written in so many seconds; the rest
# is counted.
BURST = 3
QUIET_S = 10.0

FAULTS = frozenset(
    {
        "bus_fault",
        "overrun",
        "calibration_refused",
        "sensor_fault",
        "settings_restored",
        "settings_failed",
        "clock_failed",
        "card_fault",
        "card_full",
        "battery_low",
        "going_to_sleep",
        "radio_dropped",
        "radio_fault",
    }
)

# What the detail of an event is; where it is none of these, a bare number.
DETAILS = {
    "calibration_done": "{} samples",
    "calibration_refused": "{} counts of motion",
    "overrun": "{} missed",
    "card_ready": "at block {}",
    "card_fault": "at block {}",
    "card_full": "at block {}",
    "log_started": "recording {}",
    "log_ended": "recording {}",
    "battery_low": "{} mV",
    "going_to_sleep": "{} mV",
}
# Of a clock that failed; it goes on by the spare one.
CLOCK_FAILED = ("at its start", "while it ran")

# Causes of a reset that leave the address at which it struck.
WITH_ADDRESS = frozenset({"hard_fault", "watchdog"})

logger = logging.getLogger("imud")


class Limiter:
    """Lets a few lines of a kind through in a while and counts the others."""

    def __init__(self, quiet_s: float = QUIET_S, burst: int = BURST) -> None:
        self._quiet_s = quiet_s
        self._burst = burst
        self._spoken_s: dict[object, deque[float]] = {}
        self._withheld: Counter[object] = Counter()

    def configure(self, quiet_s: float, burst: int) -> None:
        self._quiet_s = quiet_s
        self._burst = burst

    def allow(self, kind: object, now_s: float) -> str | None:
        """What to add to the line, or None to withhold it."""
        spoken = self._spoken_s.setdefault(kind, deque())
        while spoken and now_s - spoken[0] >= self._quiet_s:
            spoken.popleft()
        if len(spoken) >= self._burst:
            self._withheld[kind] += 1
            return None
        spoken.append(now_s)
        withheld = self._withheld.pop(kind, 0)
        return f" (and {withheld} like it before)" if withheld else ""


class Speaker:
    """Writes lines about what happens, few of each kind in a while."""

    def __init__(self, quiet_s: float = QUIET_S, burst: int = BURST) -> None:
        self._limiter = Limiter(quiet_s, burst)

    def configure(self, quiet_s: float, burst: int) -> None:
        self._limiter.configure(quiet_s, burst)

    def say(
        self,
        kind: object,
        text: str,
        *,
        is_warning: bool = False,
        is_total: bool = False,
    ) -> bool:
        """Whether it was written; what was not is counted in the next of its kind,
        unless that says the total.
        """
        more = self._limiter.allow(kind, time.monotonic())
        if more is not None:
            level = logging.WARNING if is_warning else logging.INFO
            logger.log(level, "%s%s", text, "" if is_total else more)
        return more is not None


def port_problem(
    port: str, event: OnlyNoise | Silent | OtherSchema, bauds: Sequence[int]
) -> str:
    """The line about a port on which no probe of ours speaks."""
    if isinstance(event, OnlyNoise):
        return (
            f"{port}: {event.count} bytes and no message among them; "
            f"is it a probe, at {' or '.join(map(str, bauds))} baud?"
        )
    if isinstance(event, Silent):
        return f"{port}: nothing heard for {event.seconds:.0f} s; is the probe alive?"
    return (
        f"{port}: probe {event.probe_id} speaks schema {event.fingerprint:#010x} "
        f"(firmware {event.firmware}), this imud speaks {schema.FINGERPRINT:#010x}: "
        "update one of them"
    )


def who(hello: Message) -> str:
    """What a probe says of itself, for people."""
    fields = {name: plain(value) for name, value in hello.fields.items()}
    rates = ", ".join(
        f"{label} {fields[name]} Hz" if fields[name] else f"{label} off"
        for label, name in (
            ("samples", "sample_rate"),
            ("pose", "pose_rate"),
            ("raw", "raw_rate"),
        )
    )
    has_sensor = fields["sensor"] != "none"
    runs = f"{fields['sensor']}, {rates}, filter {fields['filter']}"
    sensor = runs if has_sensor else "no sensor yet"
    cause = ", ".join(
        f"{name} at {fields['reset_address']:#010x}"
        if name in WITH_ADDRESS and fields["reset_address"]
        else name
        for name in fields["reset_cause"]
    ).replace("_", " ")
    return (
        f"{fields['board']}, firmware {fields['firmware']}, {sensor}, "
        f"boot {fields['boot_count']} ({cause or 'no cause known'})"
    )


def event_words(name: str, cause: str, detail: int) -> str:
    """An event for people: what, why, and the number that belongs to it."""
    what = name.replace("_", " ")
    why = "" if cause == "none" else f" ({cause.replace('_', ' ')})"
    if name == "clock_failed":
        return f"{what}{why}, {CLOCK_FAILED[detail != 0]}"
    if detail == 0:
        return f"{what}{why}"
    return f"{what}{why}, {DETAILS.get(name, '{}').format(detail)}"
