# SPDX-License-Identifier: MIT
"""The commands `aim`, what a probe should be brought to, or nothing any more; and
`capture`, which keeps its present orientation for that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec

from imud.commands import COMMANDS
from imud.daemon.registry import ProbeEntry
from imud.errors import CommandRefused
from imud.probes.aim import Aim, Target

AIM = COMMANDS["aim"]
NAME_MAX = AIM.argument("target").length_max or 0


def aim_at(entry: ProbeEntry, parameters: Mapping[str, str]) -> dict[str, Any] | None:
    """Sets or removes the target of a probe, and returns it; CommandRefused if the
    parameters are wrong.
    """
    if parameters == {"off": "1"}:
        entry.aim = None
        return None
    unknown = parameters.keys() - {*Target.__struct_fields__}
    given: dict[str, Any] = dict(parameters)
    try:
        q = [float(part) for part in given.pop("q", "").split(",")]
        length = math.hypot(*q)
        given["q"] = [part / length for part in q]
        target = msgspec.convert(given, Target, strict=False)
    except (ValueError, ZeroDivisionError, msgspec.ValidationError) as error:
        raise CommandRefused(AIM.usage) from error
    limits = (length, target.tolerance_deg, target.hold_s)
    if unknown or not all(map(math.isfinite, limits)) or len(target.target) > NAME_MAX:
        raise CommandRefused(AIM.usage)
    entry.aim = Aim(target)
    found: dict[str, Any] = msgspec.to_builtins(target)
    return found


def capture(entry: ProbeEntry, parameters: Mapping[str, str]) -> dict[str, Any]:
    """Keeps the present orientation of a probe as a reference. Returns it, and the name
    by which `aim` takes it up; CommandRefused if there is no pose.
    """
    if parameters:
        raise CommandRefused("capture takes no arguments")
    name = entry.probe.references.capture()
    if not entry.pose:
        raise CommandRefused(
            f"probe {entry.name} has sent no pose; start it with imud start"
        )
    keys = "q", "t_device_us", "t_ns"
    return {key: entry.pose[key] for key in keys} | {"capture": name}
