# SPDX-License-Identifier: MIT
"""The virtual probe for tests of the whole chain."""

from __future__ import annotations

from pathlib import Path

import pytest

from system.virtual import Stub


@pytest.fixture
def stub(nano: Path, image: Path, tmp_path: Path) -> Stub:
    return Stub(nano, image, tmp_path)
