# SPDX-License-Identifier: MIT
"""Programs that run to their end."""

from __future__ import annotations

import subprocess
from typing import Any


def ran(*words: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """The exit code of a program, and what it wrote. Options are those of
    subprocess.run().
    """
    command = [*map(str, words)]
    options = {"check": False, "capture_output": True, "text": True} | options
    return subprocess.run(command, **options)
