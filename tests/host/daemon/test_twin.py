# SPDX-License-Identifier: MIT
"""The twin in a running daemon: what it asks for, tells and publishes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from fakes import FakeProbe
from imud import _core, cli
from imud.wire import messages, schema


@pytest.fixture
def twinned(tmp_path: Path) -> Iterator[Chain]:
    made = Chain(tmp_path, "--twin")
    yield made
    made.close()


class Truth:
    """Samples of a fake probe and the poses that a true one makes of them."""

    def __init__(self, probe: FakeProbe) -> None:
        self.probe = probe
        hello = messages.encode("hello", probe.hello_fields, 0, 0)
        self.replay = _core.Replay(hello)
        self.time_us = probe.time_us

    def sample(self, flip: int = 0) -> bytes:
        """A raw message and a pose, of whose x some bits are flipped."""
        probe, time_us = self.probe, self.time_us
        probe.time_us = time_us  # whatever else was said since the last one
        self.time_us += 5000
        raw = probe.content("raw", gyr=(time_us // 5000 % 7, -3, 2))
        self.replay.step(raw)
        pose = bytearray(self.replay.pose(probe.sequence, time_us))
        pose[14] ^= flip
        probe.sequence += 1
        contents = (raw, bytes(pose))
        return b"".join(_core.encode_frame(schema.SEED, each) for each in contents)


def twin_when(chain: Chain, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    return chain.status_when(lambda s: is_so(s["twin"]))["twin"]


def test_the_twin_asks_follows_tells_a_difference_and_a_loss(
    twinned: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    chain, probe, port = twinned, twinned.probe, twinned.port
    truth = Truth(probe)
    told = chain.hear("twin")
    port.write(probe.say("pose"))  # it asks for raw messages, then for a beginning
    port.serve(probe, commands=2)
    asked = [(c["command"], c["arguments"]) for c in probe.commands]
    assert asked == [("rate", (1, 200)), ("fields", (3, 0))]
    port.write(truth.sample() + truth.sample())
    port.serve(probe, commands=1)
    assert probe.commands[-1]["command"] == "restart"
    began = probe.sequence - 2
    chain.daemon.expect(f"its twin compares from #{began} on$")
    truth.replay.restart(schema.Filter.FUSE)
    port.write(b"".join(truth.sample() for _ in range(100)))
    tare = chain.command("tare", what="heading")
    assert tare["ok"]
    truth.replay.origin(1)
    port.write(b"".join(truth.sample() for _ in range(100)))
    twin = twin_when(chain, lambda t: t["compared"] == 200)
    assert twin == {
        **{"state": "following", "compared": 200, "differed": 0},
        **{"lost": None, "first_difference": None},
    }
    # It reports the first pose that differs, and counts the others.
    struck = probe.sequence + 1
    port.write(truth.sample(flip=1) + truth.sample() + truth.sample(flip=2))
    chain.daemon.expect(f"pose #{struck} differs from the twin's: q$")
    twin = twin_when(chain, lambda t: t["compared"] == 203)
    assert (twin["state"], twin["differed"]) == ("differs", 2)
    first = twin["first_difference"]
    assert (first["seq"], first["fields"]) == (struck, ["q"])
    received, computed = (bytes.fromhex(first[name]) for name in ("probe", "twin"))
    assert received[14] ^ computed[14] == 1
    assert received[:14] + received[15:] == computed[:14] + computed[15:]
    assert cli.main(["list", "--connect", chain.daemon.endpoint]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].endswith("  twin")
    assert shown[1].endswith("  differs, 2 of 203")
    # A loss is none.
    lost = probe.sequence
    assert truth.sample()
    port.write(truth.sample() + truth.sample())
    chain.daemon.expect(f"its twin stops at #{lost}: a message is missing")
    twin = twin_when(chain, lambda t: t["state"] == "lost")
    assert (twin["lost"]["seq"], twin["differed"]) == (lost, 2)
    # Any restart starts it again.
    assert chain.command("restart")["ok"]
    chain.daemon.expect("its twin compares from")
    assert twin_when(chain, lambda t: t["state"] == "following")["lost"] is None
    states = [json.loads(told.get()) for _ in range(4)]
    names = ["following", "differs", "lost", "following"]
    assert [each["state"] for each in states] == names
    assert states[1]["seq"] == struck
    assert states[1]["first_difference"] == first
    chain.daemon.stop()
    assert "2 of 203 poses differ" in chain.daemon.lines[-1]


def test_a_twin_that_is_not_served_says_so_once(twinned: Chain) -> None:
    chain = twinned
    chain.probe.results["fields"] = "not_ready"
    for _ in range(2):
        chain.port.write(chain.probe.say("pose"))
    chain.port.serve(chain.probe, commands=2)
    chain.daemon.expect("its twin can't start: probe .* refused fields: not ready")
    assert twin_when(chain, lambda _: True)["state"] == "waiting"
    chain.daemon.stop()
    assert sum("can't start" in line for line in chain.daemon.lines) == 1


def test_no_twin_is_off(chain: Chain) -> None:
    assert twin_when(chain, lambda _: True)["state"] == "off"
