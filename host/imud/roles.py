# SPDX-License-Identifier: MIT
"""The roles of users on the network; what each may do is in `net/access.py`."""

from __future__ import annotations

from typing import Literal

Role = Literal["viewer", "operator", "recorder", "daemon"]
