# SPDX-License-Identifier: MIT
"""The models of sim/chips, compiled for tests."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import native

CHIPS = native.ROOT / "sim" / "chips"


def load(name: str, *, core: bool = True) -> tuple[Any, Any]:
    """Return (ffi, lib) of a model and, unless told otherwise, of firmware/core.

    A model is sim/chips/NAME.h, all files of sim/chips/NAME/, and what models share.
    """
    return native.load(sources(name), [CHIPS / f"{name}.h"], core=core)


def sources(name: str) -> list[Path]:
    return sorted([*CHIPS.glob("*.c"), *(CHIPS / name).glob("*.c")])
