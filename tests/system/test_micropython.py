# SPDX-License-Identifier: MIT
"""The virtual pyboard: MicroPython with the module imuprobe and the package inside."""

from __future__ import annotations

from pathlib import Path

import pytest

from bits.processors import replayed
from length import choose
from system.virtual import (
    MICROPYTHON,
    Stub,
    assert_nothing_is_lost,
    run,
    send,
    write_hand,
)

SECONDS = choose(everyday=4, long=62)


@pytest.fixture
def stub(f405: Path, micropython_image: Path, tmp_path: Path) -> Stub:
    return Stub(MICROPYTHON, f405, micropython_image, tmp_path)


@pytest.mark.long
def test_its_poses_are_in_every_bit_those_of_the_native_core(stub: Stub) -> None:
    hand = write_hand(stub.folder / "hand", SECONDS)
    words = ["--motion", hand, "--press", "200000:300000", *stub.raw_too]
    done = run(stub, SECONDS, *words, "--send", f"3500000:{send('tare', 1, token=9)}")
    assert_nothing_is_lost(done)
    poses = [content for content in done.contents if content[0] == 0x06]
    assert len(poses) > 100 * (SECONDS - 2)
    assert poses == list(replayed(done.contents))


def test_its_hello_tells_micropython_and_its_version(stub: Stub) -> None:
    hello = run(stub, 1).named("hello")[-1].fields
    assert hello["board"] == "micropython"
    assert str(hello["firmware"]).startswith("mpy 1.")
    assert str(hello["firmware"]).endswith(" pyboard")
    assert hello["reset_cause"] == ("power_on",)


def test_it_has_the_id_of_the_c_firmware(stub: Stub, f405_image: Path) -> None:
    other = Stub(stub.board, stub.simulator, f405_image, stub.folder)
    ids = {run(each, 1).named("hello")[0].fields["probe_id"] for each in (stub, other)}
    assert len(ids) == 1
