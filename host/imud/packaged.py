# SPDX-License-Identifier: MIT
"""Files of the packages that may be installed beside this one: images, emulators."""

from __future__ import annotations

import importlib.util
from pathlib import Path

FIRMWARE = "imu_probe_firmware"
SIM = "imu_probe_sim"


def folder_of(package: str) -> Path | None:
    """Where the files of a package lie; None if it is not installed."""
    spec = importlib.util.find_spec(package)
    places = spec.submodule_search_locations if spec is not None else None
    return Path(places[0]) if places else None
