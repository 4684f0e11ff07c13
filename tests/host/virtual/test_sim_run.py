# SPDX-License-Identifier: MIT
"""`imud sim` with the real emulators and images."""

from __future__ import annotations

import json
import os
import subprocess
import tty
from pathlib import Path

import pytest

from demanded import BUILT
from fakes import Forked
from imud import cli
from imud.recordings import decode
from imud.virtual import sensors
from imud.virtual.boards import BOARDS
from imud.wire import messages
from imud.wire.frame import FrameDecoder


@pytest.mark.sampled(2)
@pytest.mark.parametrize("board", BUILT)
def test_it_streams_pose_and_raw_of_a_recording(
    boards: dict[str, tuple[Path, Path]], board: str, tmp_path: Path
) -> None:
    simulator, image = boards[board]
    path, record, summary = (tmp_path / name for name in ("m.npz", "r.bin", "s.json"))
    sensors.generate(4.0, seed=2).save(path)
    words = ["--simulator", simulator, "--image", image, "--motion", path, "--fast"]
    words += ["--stream", "--raw", "--record", record, "--summary", summary]
    assert cli.main(["sim", board, *map(str, words)]) == 0
    found = json.loads(summary.read_text())
    assert found["crashed"] is False
    assert found["motion_start_us"] == 100_000
    tally = decode.Tally()
    heard = list(decode.decode_file(record, tally))
    kinds = {kind: [m for m in heard if m["type"] == kind] for kind in ("pose", "raw")}
    assert len(kinds["raw"]) > 300
    ratio = BOARDS[board].sample_rate_hz / 100
    assert abs(len(kinds["raw"]) - ratio * len(kinds["pose"])) <= ratio
    replies = [m for m in heard if m["type"] == "reply"]
    assert [m["result"] for m in replies] == ["ok", "ok"]
    started = [m["cause"] for m in heard if m.get("event") == "stream_started"]
    assert started == ["button"]


@pytest.mark.parametrize("board", BUILT)
def test_its_serial_port_appears_speaks_and_goes(
    boards: dict[str, tuple[Path, Path]], board: str, tmp_path: Path
) -> None:
    simulator, image = boards[board]
    link = tmp_path / "port"
    words = ["--simulator", simulator, "--image", image, "--link", link]
    with Forked("-m", "imud", "sim", board, *words, stderr=subprocess.PIPE) as process:
        assert process.stderr.readline().startswith(f"ready {link} ")
        port = os.open(link, os.O_RDWR | os.O_NOCTTY)
        try:
            tty.setraw(port)
            decoder = FrameDecoder()
            contents: list[bytes] = []
            while not contents:
                contents += decoder.feed(os.read(port, 4096))
        finally:
            os.close(port)
        process.terminate()
        assert "samples" in process.stderr.read()
        assert process.wait() == 0
    message = messages.decode(contents[0])
    assert isinstance(message, messages.Message)
    assert not link.is_symlink()
