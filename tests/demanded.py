# SPDX-License-Identifier: MIT
"""Tests whose tools the README's two commands do not install.

`make check` installs them and sets IMU_DEMANDED: there, such a test may not be left
out.
"""

from __future__ import annotations

import os

import pytest

from imud.virtual.boards import BOARDS, MEGA, PICO
from length import choose

# The virtual boards that `make test` builds; `make test-long` builds the others, too.
OTHERS = (PICO.name, MEGA.name)
BUILT = choose(everyday=[name for name in BOARDS if name not in OTHERS], long=[*BOARDS])


def leave_out(what: str, *, is_whole_file: bool = False) -> None:
    """Skips a test, or a whole file's, for want of `what`; fails in `make check`."""
    why = f"{what} (make check installs it)"
    if os.environ.get("IMU_DEMANDED") == "1":
        pytest.fail(why)
    # Without its tool it can't run. CI calls make check, which fails above.
    pytest.skip(why, allow_module_level=is_whole_file)
