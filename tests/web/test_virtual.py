# SPDX-License-Identifier: MIT
"""The virtual probe that users of the page start."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from imud.virtual import sim
from imud.web.virtual import VirtualProbe


def test_a_virtual_probe_runs_once_and_ends_with_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    command = sim.offered(None)
    assert command  # the tests' set-up builds the Nano's emulator and image

    async def watch() -> None:
        changed = asyncio.Event()
        probe = VirtualProbe(command, changed.set, leave_s=0.0)
        assert probe.standing == "offered"
        assert await probe.begin() == ""
        assert probe.standing == "running"
        assert list(sim.running_links()) == [tmp_path / "imud-nano"]
        assert await probe.begin() == "a virtual probe is running"
        probe.leave(is_watched=True)
        changed.clear()
        probe.leave(is_watched=False)
        await changed.wait()
        assert probe.standing == "offered"
        assert not [*tmp_path.iterdir()]

    asyncio.run(watch())
