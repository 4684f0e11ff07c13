# SPDX-License-Identifier: MIT
"""The settings of what imud keeps on disk: the part of settings.py about that."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from imud.defaults import HISTORY, STATE


def state_home() -> str:
    """Where programs of this user keep their state; may begin with ~."""
    return os.environ.get("XDG_STATE_HOME", "") or STATE


class LogSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The log on disk, MCAP."""

    enabled: Annotated[bool, Meta(description="keep a log")] = True
    dir: Annotated[str, Meta(description="folder of its files")] = "logs"
    rotate_mb: Annotated[
        int, Meta(ge=1, description="start a new file after this many MB")
    ] = 1024
    rotate_minutes: Annotated[
        float, Meta(gt=0, le=240, description="or after this many minutes")
    ] = 60.0
    floor_mb: Annotated[
        int,
        Meta(
            ge=0,
            description="pause logging while the disk has less free space than this",
        ),
    ] = 500
    keep_mb: Annotated[
        int,
        Meta(
            ge=0,
            description="remove the oldest finished files of the daemon while all of "
            "them in that folder take more than this; 0: keep all",
        ),
    ] = 0
    keep_days: Annotated[
        float,
        Meta(ge=0, description="and those that ended this many days ago; 0: keep all"),
    ] = 0.0
    foxglove: Annotated[
        bool, Meta(description="also log poses as foxglove.PoseInFrame, for Foxglove")
    ] = True


class ParamsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The params of probes: what turns raw readings into poses."""

    history: Annotated[
        str,
        Meta(
            description="folder for all sets that were active; $XDG_STATE_HOME stands "
            "for ~/.local/state where it is set; empty: off"
        ),
    ] = HISTORY

    @property
    def folder(self) -> Path | None:
        """The folder on this machine; None: there is no history."""
        text = self.history
        if text.startswith(f"{STATE}/"):
            text = state_home() + text.removeprefix(STATE)
        path = os.path.expanduser(text)  # noqa: PTH111 - leaves a ~ of nobody
        return Path(path) if path and not path.startswith("~") else None
