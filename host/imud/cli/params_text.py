# SPDX-License-Identifier: MIT
"""`imud params`: params printed for people, saved, loaded and compared."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from imud.calibration.noise import KEYS
from imud.client import Client
from imud.errors import CommandRefused, FileError, ParamsError
from imud.gravity import GRAVITY_M_S2
from imud.params import file, handles
from imud.params.condition import TITLES
from imud.params.file import ParamsFile
from imud.params.parts import NAMES, kind_of
from imud.params.value import SENSORS, Calibration, Params
from imud.wire.params import calibrated_by, is_mag_off

# Units of a sensor's sigma and residual. A gyroscope's sigma is a share of the rate.
UNITS = {"acc": ("m/s2", "m/s2"), "gyr": ("%", "rad"), "mag": ("uT", "uT")}

_DIGEST = re.compile(r"[0-9a-f]{1,8}")


def show(client: Client, probe: str, *, as_json: bool) -> int:
    """Prints the active params of a probe, or the daemon's reply as one line of JSON.
    Returns the exit code.
    """
    reply = client.params(probe)
    if as_json:
        sys.stdout.write(json.dumps(reply, separators=(",", ":")) + "\n")
        return 0
    params = _decoded(reply)
    title = f"{probe}: params {params.digest:08x}"
    if probe != reply["probe_id"]:
        title = f"{probe} ({reply['probe_id']}): params {params.digest:08x}"
    sys.stdout.write(f"{title}, {len(params.encode())} bytes\n")
    for line in _lines(params, _own_field(client, probe)):
        sys.stdout.write(f"{line}\n")
    return 0


def _own_field(client: Client, probe: str) -> dict[str, Any] | None:
    """The own field that the probe stored, from its status."""
    for status in client.statuses(probe):
        found: dict[str, Any] | None = status["params"].get("own_field")
        return found
    return None


def _decoded(reply: dict[str, Any]) -> Params:
    return Params.decode(bytes.fromhex(reply["bytes"]))


def _lines(params: Params, own_field: dict[str, Any] | None) -> Iterator[str]:
    """The params in words: a title in front of the first line of each part."""
    for name in SENSORS:
        calibration = params.calibration(name)
        if calibration is None:
            yield from _titled(TITLES[name], ["not calibrated"])
        else:
            made, *lines = _calibration_lines(name, calibration)
            is_made = name in calibrated_by(params.encode())
            made = made if is_made else "not calibrated, but told its place"
            if name == "mag" and is_mag_off(params.encode()):
                made, lines = "switched off", []
            yield from _titled(TITLES[name], [made, *lines])
    if own_field is not None:
        field = " ".join(f"{value:.2f}" for value in own_field["field_uT"])
        sure = f"1-sigma error {_with_unit(own_field['sigma_uT'], 'uT')}"
        line = f"{field} uT, kept by the probe, {sure}; imud restart --forget drops it"
        yield from _titled("own field", [line])
    yield from _titled("tip", _tip_lines(params))
    options = params.options
    words = f"the button: {options.button_does}; at the start, origin: "
    yield from _titled("options", [words + str(options.reference)])
    if params.name:
        yield from _titled("name", [params.name])
    if noise := params.plain("noise"):
        yield from _titled("noise", [_noise_words(noise)])
    if params.unknown:
        tags = ", ".join(f"{tag} ({len(b)} bytes)" for tag, b in params.unknown.items())
        yield from _titled("unknown", [f"records of other firmware, kept: {tags}"])
    for fault in params.faults():
        yield from _titled("fault", [fault])


def _noise_words(noise: dict[str, Any]) -> str:
    acc, gyr = noise.get(KEYS["acc"]), noise.get(KEYS["gyr"])
    acc_ug = None if acc is None else 1e6 * acc / GRAVITY_M_S2
    gyr_mdps = None if gyr is None else 1e3 * math.degrees(gyr)
    words = f"{_with_unit(acc_ug, 'ug')}, {_with_unit(gyr_mdps, 'mdps')}"
    return f"when calibrated {words} in the root of a Hz"


def _titled(title: str, lines: list[str]) -> Iterator[str]:
    for index, line in enumerate(lines):
        yield f"  {'' if index else title:<14} {line}"


def _calibration_lines(name: str, of: Calibration) -> list[str]:
    made = _made(of.method, of.day, of.temperature_c)
    sigma_unit, residual_unit = UNITS[name]
    sigma = of.sigma
    if sigma is not None and sigma_unit == "%":
        sigma *= 100
    sure = f"1-sigma error {_with_unit(sigma, sigma_unit)}"
    if of.residual is not None:
        sure += f"; residual of the fit {_with_unit(of.residual, residual_unit)}"
    bias = " ".join(f"{value:.2f}" for value in of.bias_counts)
    lines = [made, sure, f"bias {bias} counts; {_matrix_words(of)}"]
    if of.drift_m_s2_k is not None:
        lines.append(f"{drift_words(of.drift_m_s2_k)}, of two calibrations")
    if of.norm_ut is not None or of.dip_deg is not None:
        norm, dip = _with_unit(of.norm_ut, "uT"), _with_unit(of.dip_deg, "deg")
        lines.append(f"in a field of {norm}, {dip} below the horizontal")
    if of.lag_s is not None:
        lines.append(f"{1000 * of.lag_s:.2f} ms behind the gyroscope")
    return lines


def drift_words(drift_m_s2_k: float) -> str:
    """What the temperature does to an accelerometer."""
    return f"{1000.0 * drift_m_s2_k / GRAVITY_M_S2:.2f} mg more error for each kelvin"


def _made(method: object, day: object, temperature_c: float | None) -> str:
    how = f"method {method}" if method not in (None, "unknown") else "unknown method"
    when = f"on {day}" if day is not None else "on an unknown day"
    at = f", at {temperature_c:.1f} degC" if temperature_c is not None else ""
    return f"calibrated {when}, {how}{at}"


def _with_unit(value: float | None, unit: str) -> str:
    return "not known" if value is None else f"{value:.4g} {unit}"


def _matrix_words(of: Calibration) -> str:
    """How far the matrix scales each axis, and turns the axes at most."""
    scales = [
        100 * (math.hypot(*column) - 1) for column in zip(*of.matrix, strict=True)
    ]
    turn = 0.0
    for axis, column in enumerate(zip(*of.matrix, strict=True)):
        aside = math.hypot(*(v for row, v in enumerate(column) if row != axis))
        turn = max(turn, math.degrees(math.atan2(aside, column[axis])))
    scale = " ".join(f"{each:+.2f}" for each in scales)
    return f"scale {scale} %; axes turned by up to {turn:.2f} deg"


def _tip_lines(params: Params) -> list[str]:
    tip = params.tip
    if tip is None:
        return ["not known"]
    lines = [_made(tip.method, tip.day, None).replace("calibrated", "found")]
    if tip.offset_m is not None:
        offset = " ".join(f"{1000 * value:.2f}" for value in tip.offset_m)
        sigma = None if tip.sigma_m is None else 1000 * tip.sigma_m
        lines.append(f"{offset} mm from the sensor; 1-sigma {_with_unit(sigma, 'mm')}")
    if tip.axis is not None:
        axis = " ".join(f"{value:.4f}" for value in tip.axis)
        lines.append(f"axis {axis}")
    return lines


def save(client: Client, probe: str, path: Path, *, is_forced: bool) -> int:
    reply = client.params(probe)
    params = _decoded(reply)
    if path.exists() and not is_forced:
        raise FileError(f"{path} exists; --force replaces it")
    file.write(path, params, reply["probe_id"])
    sys.stdout.write(f"{probe}: params {params.digest:08x} saved to {path}\n")
    return 0


def load(
    client: Client, probe: str, wanted: ParamsFile, *, is_forced: bool, is_dry: bool
) -> int:
    """Changes the params of a probe to those of a file, or prints what would change.
    CommandRefused if they are from another probe and it is not forced.
    """
    reply = client.params(probe)
    probe_id = reply["probe_id"]
    if wanted.probe_id not in (None, probe_id) and not is_forced:
        raise CommandRefused(
            f"these params are from probe {wanted.probe_id}, but {probe} is "
            f"{probe_id}; load them anyway with --force"
        )
    return _change(client, probe, wanted, reply, is_forced=is_forced, is_dry=is_dry)


def clear(client: Client, probe: str) -> int:
    return _change(client, probe, ParamsFile(Params()), client.params(probe))


def of_file(path: Path) -> ParamsFile | None:
    """Params that a probe would take; None where `path` is no file, but a digest or the
    name of a printed handle.
    """
    is_name = _DIGEST.fullmatch(str(path)) or str(path).startswith(handles.PREFIX)
    if is_name and not path.exists():
        return None
    found = file.read(path)
    for fault in found.params.faults():
        raise ParamsError(f"{path}: {fault}")
    return found


def of_name(client: Client, probe: str, name: str) -> ParamsFile:
    """Params of the history, by their digest; or those in force with the tip of a
    printed handle.
    """
    if name.startswith(handles.PREFIX):
        reply = client.params(probe)
        current = _decoded(reply)
        return ParamsFile(handles.applied(name, current), reply["probe_id"])
    return of_history(client, probe, name)


def of_history(client: Client, probe: str, digest: str) -> ParamsFile:
    kept = client.params_history(probe, digest)
    return ParamsFile(_decoded(kept), kept["probe_id"])


def undo(client: Client, probe: str, *, is_dry: bool = False) -> int:
    """Brings back what was in force before; without a history of it, no params."""
    current = client.params(probe)
    kept = [each["digest"] for each in client.params_history(probe)["entries"]]
    if current["digest"] in kept:
        kept = kept[kept.index(current["digest"]) + 1 :]
    earlier = next((each for each in kept if each != current["digest"]), None)
    if earlier is None and not _decoded(current).records:
        raise CommandRefused(f"{probe} has no params, and had none before")
    wanted = ParamsFile(Params())
    if earlier is not None:
        wanted = of_history(client, probe, earlier)
    return _change(client, probe, wanted, current, is_dry=is_dry)


def _change(
    client: Client,
    probe: str,
    wanted: ParamsFile,
    current: dict[str, Any],
    *,
    is_forced: bool = False,
    is_dry: bool = False,
) -> int:
    before, after = _decoded(current), wanted.params
    digest = f"{after.digest:08x}"
    if before.encode() == after.encode():
        sys.stdout.write(f"{probe}: params {digest} are already active\n")
        return 0
    for line in differences(before, after):
        sys.stdout.write(f"{line}\n")
    if is_dry:
        sys.stdout.write(
            f"{probe}: params {digest} would replace {current['digest']}\n"
        )
        return 0
    sys.stdout.flush()
    client.change_params(
        probe, after.encode(), wanted.probe_id or "", is_forced=is_forced
    )
    sys.stdout.write(
        f"{probe}: params {digest} are active; before: {current['digest']}\n"
    )
    return 0


def differences(before: Params, after: Params) -> list[str]:
    """A table of what differs: name, before, after."""
    old, new = dict(_cells(before)), dict(_cells(after))
    names = [*old, *(name for name in new if name not in old)]
    rows = [("", "before", "after")]
    rows += [
        (name, old.get(name, "-"), new.get(name, "-"))
        for name in names
        if old.get(name) != new.get(name)
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    return [
        "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _cells(params: Params) -> Iterator[tuple[str, str]]:
    """Each value of the params as text, by a name for people."""
    for name in NAMES:
        wire = params.wire(name) or {}
        for part in kind_of(name).parts:
            numbers = wire.get(part.name)
            if numbers is None or numbers == part.null:
                continue
            what = f"{name} {part.key}"
            texts = part.decimals(numbers)
            if part.is_matrix:
                for row in range(3):
                    yield f"{what} {row + 1}", " ".join(texts[3 * row : 3 * row + 3])
            elif part.is_day or part.words or part.is_text:
                yield what, str(part.plain(numbers))
            else:
                yield what, " ".join(texts)
    for record in params.records:
        kind = record.kind
        tail = record.body if kind is None else kind.split(record.body)[1]
        if tail:
            yield f"{record.name} other bytes", tail.hex()


def history(client: Client, probe: str) -> int:
    """Prints the params that were active, the latest first; returns the exit code."""
    kept = client.params_history(probe)
    if not kept["entries"]:
        sys.stdout.write(f"{probe}: no params were active so far\n")
        return 0
    in_force = client.params(probe)["digest"]
    for entry in kept["entries"]:
        stamp, digest = entry["time"], entry["digest"]
        time = f"{stamp[:4]}-{stamp[4:6]}-{stamp[6:8]} {stamp[9:11]}:{stamp[11:13]}"
        is_now = digest == in_force
        in_force = None if is_now else in_force
        words = f"{time} UTC  {digest}{'  active' if is_now else ''}"
        sys.stdout.write(f"{words}\n")
    sys.stdout.write(f"imud params load {probe} DIGEST restores one\n")
    return 0
