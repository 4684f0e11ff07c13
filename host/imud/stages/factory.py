# SPDX-License-Identifier: MIT
"""Which stages a probe has, in the order in which they get its messages."""

from __future__ import annotations

from imud.config.settings import Config
from imud.stages import Stage
from imud.stages.fusion import FusionStage
from imud.stages.learn import LearnStage
from imud.stages.twin_stage import TwinStage


def stages_of(config: Config) -> list[Stage]:
    """New stages for one probe."""
    return [TwinStage(config), FusionStage(config), LearnStage(config)]
