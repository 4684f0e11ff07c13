# SPDX-License-Identifier: MIT
"""Where the tip of each printed handle is: the files in `printed/`, which
hardware/first_params.py writes from the dimensions of the parts.
"""

from __future__ import annotations

from pathlib import Path

from imud.errors import ParamsError
from imud.params import file
from imud.params.value import Params

FOLDER = Path(__file__).with_name("printed")
PREFIX = "handle-"


def names() -> list[str]:
    return sorted(path.stem for path in FOLDER.glob(f"{PREFIX}*.toml"))


def applied(name: str, current: Params) -> Params:
    """`current` with the tip of the handle `name` in place of its own; ParamsError if
    there is no such handle.
    """
    if name not in names():
        raise ParamsError(
            f"there is no file {name}, and no handle of this name, only "
            f"{', '.join(names())}"
        )
    for record in file.read(FOLDER / f"{name}.toml").params.records:
        current = current.having(record)
    return current
