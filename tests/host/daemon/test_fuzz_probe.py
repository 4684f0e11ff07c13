# SPDX-License-Identifier: MIT
"""A probe that sends nonsense with a good CRC causes no internal error, no flood of
lines and no growth of memory.
"""

from __future__ import annotations

import json
import queue
import random
import select
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from chain import Chain
from fakes import (
    EXAMPLES,
    PATIENCE_S,
    SOON_S,
    DaemonProcess,
    FakeProbe,
    Port,
    assert_honest,
    free_endpoint,
)
from imud._core import CONTENT_MAX
from imud.client import Client
from imud.defaults import PROBES_MAX
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode
from length import choose

SEED = 20_260_104
LIES = choose(everyday=5_000, long=20_000)  # and as many events


def lies(chance: random.Random, probe: FakeProbe, count: int) -> Iterator[bytes]:
    """Frames whose CRC is good and whose content is not, among good ones."""
    for _ in range(count):
        name = chance.choice([*EXAMPLES, "pose", "hello"])
        draw = chance.random()
        if name == "command":
            continue
        if draw < 0.3:
            yield probe.say(name)
            continue
        if name == "reply" and draw < 0.7:
            yield probe.say(name, replied_token=chance.randrange(1 << 16))
            continue
        content = bytearray(probe.content(name))
        for _ in range(chance.randint(1, 4)):
            at = chance.randrange(len(content))
            kind = chance.random()
            if kind < 0.6:
                content[at] = chance.choice([0, 0xFF, 0x80, 0x0A, 0x1B, *content])
            elif kind < 0.8:
                del content[at:]
                content = content or bytearray(b"\x01")
            else:
                content[at:at] = chance.randbytes(chance.randint(1, 6))
        yield encode_frame(bytes(content[:CONTENT_MAX]))


HOSTILE = (
    *(b"0.1\nerror: x", b"\x1b[31mred", b"\x9b31m", b"a\r\x00b", b"\xff\xfe"),
    *(b"100% \xe2\x80\xae", b"%s%n{0}"),
)


def with_firmware(probe: FakeProbe, firmware: bytes, fingerprint: int) -> bytes:
    """A hello whose text no encoder of ours would write."""
    content = probe.content("hello", schema_fingerprint=fingerprint)
    place = content.index(b"0.1.0+fake")
    return encode_frame(
        content[:place] + firmware[:10].ljust(10, b"\0") + content[place + 10 :]
    )


@pytest.mark.long
def test_a_probe_that_lies_is_no_fault_and_writes_no_line_of_the_journal(
    tmp_path: Path,
) -> None:
    chance = random.Random(SEED)  # noqa: S311 - no secret
    probe, port = FakeProbe(), Port(tmp_path / "port")
    listen = free_endpoint().removeprefix("tcp/")
    file = tmp_path / "imud.toml"
    file.write_text(
        f"twin = true\n[metrics]\nlisten = '{listen}'\n[ros2]\nenabled = true\n"
        f"[ports]\nfind = false\nnamed = ['{port.path}']\n"
    )
    with DaemonProcess("--config", file, directory=tmp_path) as daemon:
        daemon.find(port, probe)
        with Client(daemon.endpoint) as client:
            client.wait_for(probe.name, seconds=PATIENCE_S)
            for firmware in HOSTILE:
                port.write(with_firmware(probe, firmware, schema.FINGERPRINT))
                port.write(with_firmware(probe, firmware, 1))
            for turn, frame in enumerate(lies(chance, probe, LIES)):
                port.write(frame)
                # Commands of the daemon's: else its writes come to nothing.
                if turn % 50 == 0 and select.select([port.master], [], [], 0)[0]:
                    port.read()
            # Then it is honest: back at once, in a boot of its own.
            probe.restart()
            heard: queue.Queue[dict[str, Any]] = queue.Queue()
            client.subscribe(
                "pose", probe.name, lambda _, data: heard.put(json.loads(data))
            )
            while True:
                port.write(probe.say("hello") + probe.say("pose"))
                try:
                    last = heard.get(timeout=0.1)
                except queue.Empty:
                    continue
                if last["seq"] < probe.sequence and last["seq"] < 1000:
                    break
        assert daemon.stop() < SOON_S
    assert_honest(daemon)
    # Three of a kind and probe in 10 s: so many lies, of a hundred ids, are no flood.
    assert len(daemon.lines) < 1000


def test_a_device_that_makes_up_ids_fills_no_memory(chain: Chain) -> None:
    honest, port = chain.probe, chain.port
    for number in range(2 * PROBES_MAX):
        port.write(FakeProbe(probe_id=number.to_bytes(8, "big")).say("hello"))
    chain.daemon.expect(f"{PROBES_MAX} probes are the limit, so probe .* is ignored")
    while True:  # an answer is of the turn in which it is asked
        port.write(honest.say("hello"))
        if chain.client.alive() == [honest.name]:
            assert len(chain.client.statuses()) <= PROBES_MAX
            break
    chain.daemon.stop()
    assert_honest(chain.daemon)


@pytest.mark.long
def test_a_flood_of_events_is_a_few_lines(chain: Chain) -> None:
    daemon, probe = chain.daemon, chain.probe
    for number in range(LIES):
        chain.port.write(probe.say("event", event="bus_fault", detail=number))
    chain.status_when(lambda s: s["ledger"]["received"] == probe.sequence)
    daemon.stop()
    assert_honest(daemon)
    assert sum("bus fault" in line for line in daemon.lines) <= 9
    assert any("like it before" in line for line in daemon.lines) or (
        sum("bus fault" in line for line in daemon.lines) == 3
    )


def test_text_of_a_hello_that_could_harm_a_terminal_is_no_text() -> None:
    probe = FakeProbe()
    for firmware in HOSTILE:
        hello = with_firmware(probe, firmware, schema.FINGERPRINT)
        (content,) = FrameDecoder().feed(b"\0" + hello)
        decoded = decode(content)
        is_plain = firmware.isascii() and firmware.decode("ascii").isprintable()
        assert isinstance(decoded, Message) == is_plain
