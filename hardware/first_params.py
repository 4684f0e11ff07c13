# SPDX-License-Identifier: MIT
"""Writes where the tip of each printed handle is, as files of params that imud ships:
`python -m hardware.first_params`. With --check it only checks whether they are up to
date.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from hardware.layout import Layout, boards
from imud.params import handles
from imud.params.file import written
from imud.params.value import Params

# The direction out of a surface that the tip stands on: the rod points ahead.
AXIS = (-1.0, 0.0, 0.0)
COMMAND = ".venv/bin/python -m hardware.first_params"


def params_of(name: str) -> Params:
    """Of the handle of a board: its tip alone."""
    layout = Layout(name)
    values = {
        "offset_m": [mm / 1000 for mm in layout.tip_from_chip],
        "axis": list(AXIS),
        "sigma_m": round(layout.tip_error / 1000, 4),
        "method": "typed",
    }
    return Params().replaced("tip", values)


def files() -> dict[Path, str]:
    """The content of each file."""
    return {
        handles.FOLDER / f"{handles.PREFIX}{name}.toml": written(params_of(name))
        for name in boards()
    }


def main() -> int:
    parser = argparse.ArgumentParser(prog="hardware.first_params", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing")
    is_check = parser.parse_args().check
    wrong = 0
    for path, text in files().items():
        if path.exists() and path.read_text("utf-8") == text:
            continue
        wrong += 1
        if is_check:
            sys.stderr.write(f"{path.name} is out of step; run {COMMAND}\n")
        else:
            path.write_text(text, "utf-8")
            sys.stdout.write(f"wrote {path}\n")
    return int(is_check and wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
