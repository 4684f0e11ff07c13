# SPDX-License-Identifier: MIT
"""How tools run other programs whose output is shown only if something is wrong."""

from __future__ import annotations

import subprocess
from typing import Any


def run(*words: object, **more: Any) -> subprocess.CompletedProcess[str]:
    """Run a program without input; all that it prints is its `stdout`."""
    return subprocess.run(
        [*map(str, words)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
        **more,
    )
