# SPDX-License-Identifier: MIT
"""The virtual probes for tests of the whole chain."""

from __future__ import annotations

from pathlib import Path

import pytest

from system.virtual import ALL_BOARDS, BOARDS, Stub


@pytest.fixture(params=BOARDS)
def stub(
    request: pytest.FixtureRequest, boards: dict[str, tuple[Path, Path]], tmp_path: Path
) -> Stub:
    """Each board in turn, unless a test says which."""
    name = request.param
    return Stub(ALL_BOARDS[name], *boards[name], tmp_path)
