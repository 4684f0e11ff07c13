# SPDX-License-Identifier: MIT
"""Phrases for a probe's status and a pose's age, shared by listen, list and monitor.

Each takes an object as the daemon publishes it (docs/pose.md).
"""

from __future__ import annotations

from typing import Any

from imud.client import Pose
from imud.probes.ledger import totals


def ledger_words(status: dict[str, Any]) -> str:
    """The messages of one probe, over all its boots, and the state of its twin."""
    ledger = status["ledger"]
    total = totals(ledger)
    dropped = sum(ledger["dropped"].values())
    return (
        f"{total.sent} sent = {total.received} received + "
        f"{total.skewed.total()} skewed + {total.lost} lost; "
        f"{ledger['corrupt']} corrupt, {total.duplicated} duplicated, {dropped} dropped"
    ) + (f"; twin {twin_words(status)}" if status["twin"]["state"] != "off" else "")


def balance_words(ledger: dict[str, Any]) -> str:
    """Whether the ledger adds up, and the counts of each sink in short."""
    if "adds_up" not in ledger:
        return ""
    sinks = []
    for name, counts in ledger["sinks"].items():
        off = [f"{counts[key]} {key}" for key in ("waiting", "dropped") if counts[key]]
        off = [f" ({', '.join(off)})"] if off else off
        sinks.append("".join([f"{name} {counts['taken']}", *off]))
    return f"{sum_words(ledger)}; {', '.join(sinks)}"


def sum_words(ledger: dict[str, Any]) -> str:
    """Whether the ledger adds up, or which of its links do not."""
    if ledger["adds_up"]:
        return "adds up"
    return f"differs: {', '.join(ledger['differs'])}"


def sinks_words(ledger: dict[str, Any]) -> str:
    """The counts of each sink."""
    return ", ".join(
        f"{name} {counts['taken']} taken {counts['waiting']} waiting "
        f"{counts['dropped']} dropped"
        for name, counts in ledger.get("sinks", {}).items()
    )


def sensor_words(ledger: dict[str, Any]) -> str:
    """The probe's own counts; empty before the daemon has received them."""
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
    """The age of a sample when the daemon read it, and the bound of its error."""
    if age_us is None:
        return "-"
    bound = "" if bound_us is None else f" ±{bound_us / 1000:.2f}"
    return f"{age_us / 1000:.2f}{bound} ms"


def age_words(pose: Pose | None) -> str:
    """time_words() of a pose."""
    return "-" if pose is None else time_words(pose.age_us, pose.t_bound_us)


def twin_words(status: dict[str, Any]) -> str:
    """The state of the twin; if poses differed, how many of those compared."""
    twin = status["twin"]
    count = f", {twin['differed']} of {twin['compared']}" if twin["differed"] else ""
    return f"{twin['state']}{count}"


def concerns(status: dict[str, Any]) -> list[str]:
    """Sentences about problems for the user to solve: the sensors first, then their
    calibration, then why errors are withheld.
    """
    advice = status["params"].get("advice")
    return [
        *status.get("sensors", {}).get("words", ()),
        *([advice] if advice else []),
        *status["quality"].get("withheld", {}).get("words", ()),
    ]


def notes_words(status: dict[str, Any]) -> str:
    """Anything unusual about log and board; empty if all is normal."""
    is_paused = status.get("log", {}).get("state") == "paused"
    notes = ("log paused" if is_paused else "", equipment_words(status["equipment"]))
    return ", ".join(filter(None, notes))


def equipment_words(equipment: dict[str, Any] | None) -> str:
    """Clock, battery, radio and card of a board, each if there is anything to say."""
    if equipment is None:
        return ""
    parts = []
    if equipment["clock"] == "spare":
        parts.append("spare clock")
    if equipment["battery_v"] is not None:
        flags = " ".join(flag for flag in equipment["power"] if flag != "external")
        parts.append(f"battery {equipment['battery_v']:.2f} V {flags}".rstrip())
    radio, card = equipment["radio"], equipment["card"]
    if radio is not None and radio["state"] != "cable":
        parts.append(f"radio {radio['state']}")
    if card is not None and card["state"] != "absent":
        used = (
            f" {100 * card['block'] / card['blocks']:.0f} %" if card["blocks"] else ""
        )
        parts.append(f"card {card['state']}{used}")
        if card["unlogged"]:
            parts.append(f"{card['unlogged']} not logged")
    return ", ".join(parts)


# Why errors since the origin are not known any more.
VOID_WORDS = {
    "starting": "the attitude was lost",
    "gap": "samples are missing",
    "restarted": "it has restarted",
    "params_changed": "its params have changed",
    "unheard": "it was set before the daemon received the probe",
}


def since_words(
    tilt_deg: float | None, heading_deg: float | None, void: str | None
) -> str:
    """1-sigma errors since the origin; or why they are not known."""
    if void is not None:
        return f"since origin ? ({VOID_WORDS.get(void, void)})"
    return f"since origin {sigma_words(tilt_deg)} {sigma_words(heading_deg)}"


def sigma_words(sigma_deg: float | None) -> str:
    """A 1-sigma error in degrees; a question mark where it is not known."""
    return "?" if sigma_deg is None else f"±{sigma_deg:.2f}"
