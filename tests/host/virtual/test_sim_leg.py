# SPDX-License-Identifier: MIT
"""`imud sim leg`: three emulators that begin together, and the files beside them."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

import pytest

from imud import cli
from imud.body import chain
from imud.config.reader import load
from imud.virtual import leg, sim_leg
from imud.virtual.motion import STREAM_HEADER, STREAM_MAGIC

# In place of an emulator: it tells its hello, or takes a second of the motion.
EMULATOR = """#!{python}
import sys, time
sys.path[:0] = {path!r}
words = sys.argv
args = dict(zip(words[1::1], words[2::1]))
if "--record" in args:
    from imud.wire import frame, messages
    from imud.body import fused
    hello = messages.decode(fused.hello((1e-4, 1e-3, 0.1)))
    fields = dict(hello.fields) | {{"probe_id": int(args["--seed"]).to_bytes(8, "big")}}
    content = messages.encode("hello", fields, 0, 0)
    open(args["--record"], "wb").write(frame.encode_frame(content))
    open(args["--eeprom"], "wb").write(b"kept")
else:
    assert open(args["--eeprom"], "rb").read() == b"kept"
    data = sys.stdin.buffer.read({size})
    open(args["--pty"] + ".felt", "wb").write(data)
    print("ready", args["--pty"], file=sys.stderr)
"""
SIZE = STREAM_HEADER.size + 36 * 1000


def test_three_probes_get_a_leg_and_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    emulator, image = tmp_path / "emulator", tmp_path / "image"
    paths = [str(Path(leg.__file__).parents[2])]
    emulator.write_text(EMULATOR.format(python=sys.executable, path=paths, size=SIZE))
    emulator.chmod(emulator.stat().st_mode | stat.S_IXUSR)
    image.touch()
    folder = tmp_path / "leg"
    words = ["--dir", str(folder), "--walk", "4", "--simulator", str(emulator)]
    assert cli.main(["sim", "leg", *words, "--image", str(image)]) == 0
    body = chain.read((folder / "leg.toml").read_text(), "leg.toml")
    config = load(folder / "imud.toml")
    names = {name for name in config.probes}
    assert names == {f"{10 + index:016x}" for index in range(3)}
    wearers = {each.probe for each in body.segments}
    assert {each.name for each in config.probes.values()} == wearers
    ports = [str(folder / name) for name in leg.SEGMENTS]
    assert list(config.ports.named) == ports
    felt = [Path(f"{port}.felt").read_bytes() for port in ports]
    assert all(each.startswith(STREAM_MAGIC) and len(each) == SIZE for each in felt)
    assert len(set(felt)) == 3
    told = capsys.readouterr().err + capsys.readouterr().out
    assert f"imud body {folder / 'leg.toml'}" in told


def test_an_emulator_that_fails_is_told(tmp_path: Path):
    image = tmp_path / "image"
    image.touch()
    words = ["--dir", str(tmp_path / "leg"), "--simulator", "/bin/false"]
    assert cli.main(["sim", "leg", *words, "--image", str(image)]) == 1


def test_the_legs_motion_goes_on_where_it_began():
    made = leg.made(1, leg.Manner(walk_s=4.6, squats=1, raises=1)).motions["shank"]
    pieces = sim_leg.again(made)
    records = sum(len(next(pieces)) for _ in range(len(made) // 1024 + 1))
    assert records == len(made)
    assert (next(pieces).gyr == made.gyr[:1024]).all()
