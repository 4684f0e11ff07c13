# SPDX-License-Identifier: MIT
"""Whatever comes over the network or from a probe that lies: an error line or nothing,
and never a fault of imud's own. Poses go on meanwhile.
"""

from __future__ import annotations

import json
import queue
import random
import re
import select
import string
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from fakes import (
    EXAMPLES,
    PATIENCE_S,
    DaemonProcess,
    FakeProbe,
    Port,
    free_endpoint,
    status_of,
)
from imud.client import Client
from imud.daemon.registry import PROBES_MAX
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode

SEED = 20_260_102

# Known words of the control path, so that a guess is often nearly right.
COMMANDS = [command.name.lower() for command in schema.Command]
NAMES = ["stream", "streams", "hz", "what", "filter", "a", "", " hz", "HZ"]
VALUES = [
    *("pose", "raw", "pose,raw", "all", "undo", "heading", "fuse", "none", "", ","),
    *("0", "1", "50", "1000", "-1", "65536", "4294967296", "1e3", "0x10", "1.5"),
    *("١٢", "²", "1_0", "+5", " 5", "nan", "inf", "9" * 5000, "true", "null"),
]
pytestmark = pytest.mark.together

SIGNS = string.printable + "äß€\x00\x1b\x7f\u202e\u2028😀"


class Room:
    """A daemon with a probe that streams and answers, and a session of an intruder."""

    def __init__(self, folder: Path) -> None:
        self.probe = FakeProbe()
        self.port = Port(folder / "port")
        self.daemon = DaemonProcess(self.port.path, directory=folder)
        self.daemon.expect("listens on")
        self.port.wait_open()
        self.port.write(self.probe.say("hello"))
        self.daemon.expect("found on")
        self.client = Client(self.daemon.endpoint)
        self.client.wait_for(seconds=PATIENCE_S)
        self.heard: queue.Queue[int] = queue.Queue()
        self.client.subscribe(
            "pose", None, lambda _, data: self.heard.put(json.loads(data)["seq"])
        )
        self.sent: list[int] = []
        self._ended = threading.Event()
        self._streamer = threading.Thread(target=self._stream, daemon=True)
        self._streamer.start()
        self.heard.get(timeout=PATIENCE_S)  # the daemon knows of the subscriber
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([self.daemon.endpoint]))
        self.session = zenoh.open(config)

    def _stream(self) -> None:
        while not self._ended.is_set():
            self.port.write(self.port.answers(self.probe))
            is_due = self.probe.sequence % 200 == 0
            self.sent.append(self.probe.sequence)
            self.port.write(self.probe.say("hello" if is_due else "pose"))
            self._ended.wait(0.005)

    def ask(self, selector: str, payload: bytes) -> list[zenoh.Reply] | None:
        """All answers; None for what is no selector: the library refuses that."""
        try:
            asked = self.session.get(selector, payload=payload, timeout=PATIENCE_S)
        except (zenoh.ZError, ValueError):
            return None
        return list(asked)

    def stop_stream(self) -> None:
        self._ended.set()
        self._streamer.join()

    def close(self) -> None:
        self.stop_stream()
        self.session.close()
        self.client.close()
        self.daemon.__exit__(None, None, None)
        self.port.vanish()


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    made = Room(tmp_path_factory.mktemp("room"))
    yield made
    made.close()


def text(chance: random.Random, most: int = 12) -> str:
    return "".join(chance.choices(SIGNS, k=chance.randint(0, most)))


def parameters(chance: random.Random) -> str:
    """Pairs that are nearly right, or no pairs at all."""
    if chance.random() < 0.1:
        return text(chance, 40)
    if chance.random() < 0.02:
        return ";".join(f"p{n}={n}" for n in range(5000))
    pairs = []
    for _ in range(chance.randint(0, 3)):
        name = chance.choice([*NAMES, text(chance)])
        value = chance.choice([*VALUES, text(chance)])
        pairs.append(f"{name}{chance.choice(['=', '=', '=', '==', '', '?'])}{value}")
    return chance.choice([";", ";", ";;", "&"]).join(pairs)


def assert_honest(daemon: DaemonProcess) -> None:
    """Its journal has no fault of its own, and no line that somebody else wrote."""
    for line in daemon.lines:
        assert "internal error" not in line, line
        assert "Traceback" not in line, line
        assert line.isprintable(), line
        assert re.match(r"\d\d:\d\d:\d\d ", line), line


def test_queries_are_answered_or_refused_and_poses_go_on(room: Room) -> None:
    chance = random.Random(SEED)  # noqa: S311 - no secret
    answered = refused = 0
    for _ in range(600):
        command = chance.choice([*COMMANDS, *COMMANDS, text(chance), "*", "**", "cmd"])
        probe = chance.choice([room.probe.name] * 4 + ["*", "nobody", text(chance)])
        payload = chance.choice([b"", b"\xff\xfe\x00", chance.randbytes(300)])
        if chance.random() < 0.01:
            payload = bytes(1_000_000)
        said = parameters(chance)
        selector = f"imud/{probe}/cmd/{command}" + (f"?{said}" if said else "")
        replies = room.ask(selector, payload)
        for reply in replies or []:
            if reply.ok is not None:
                answer = json.loads(reply.ok.payload.to_bytes())
                assert answer["ok"], selector
                answered += 1
            else:
                assert reply.err is not None
                line = reply.err.payload.to_string()
                assert line, selector
                assert line.isprintable(), line
                assert len(line) < 500, line
                refused += 1
        if probe == room.probe.name and command in COMMANDS and replies is not None:
            assert replies, selector
    assert answered > 50
    assert refused > 50
    for command in room.probe.commands:
        first, second = command["arguments"]
        assert command["command"] in COMMANDS
        assert 0 <= first < 1 << 32
        assert 0 <= second <= 65_535


def test_other_keys_and_puts_are_ignored_and_told_seldom(room: Room) -> None:
    chance = random.Random(SEED + 1)  # noqa: S311 - no secret
    before = len(room.probe.commands)
    keys = [f"imud/{room.probe.name}/cmd/{command}" for command in COMMANDS]
    keys += [f"imud/{room.probe.name}/{topic}" for topic in ("status", "alive", "x")]
    keys += ["imud", "imud/cmd/start", f"imud/{room.probe.name}", "a/b/c"]
    forged = f"imud/{room.probe.name}/x\n00:00:00 warning: forged\x1b[31m\u202e"
    room.session.put(forged, b"")
    room.daemon.expect(
        r"another program publishes on .*/x\?00:00:00 warning: forged\?\[31m\?"
    )
    for _ in range(400):
        key = chance.choice([*keys, f"imud/{room.probe.name}/{text(chance)}"])
        try:
            if chance.random() < 0.3:
                room.session.delete(key)
            else:
                room.session.put(key, chance.randbytes(chance.randint(0, 2000)))
        except (zenoh.ZError, ValueError):
            continue
    for key in ("imud/nobody/cmd/start", "imud/cmd/start", "imud/x/y/z"):
        assert room.ask(key, b"") == []
    assert len(room.probe.commands) == before


def test_nothing_was_lost_and_nothing_was_a_fault(room: Room) -> None:
    """After the tests above."""
    room.stop_stream()
    seen: list[int] = []
    hellos = {n for n in room.sent if n % 200 == 0}
    while not seen or seen[-1] < max(set(room.sent) - hellos):
        seen.append(room.heard.get(timeout=PATIENCE_S))
    assert set(room.sent) - hellos >= set(seen)
    expected = [n for n in room.sent if n not in hellos and n >= seen[0]]
    assert seen == expected
    until = time.monotonic() + PATIENCE_S
    while True:
        (status,) = room.client.statuses(room.probe.name)
        ledger = status["ledger"]
        if ledger["received"] == room.probe.sequence or time.monotonic() > until:
            break
        time.sleep(0.1)
    assert ledger["lost"] == 0
    assert ledger["adds_up"], ledger
    assert room.daemon.stop() < 1.0
    assert_honest(room.daemon)
    # However many keys somebody makes up.
    assert (
        sum("another program publishes on" in line for line in room.daemon.lines) <= 6
    )


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
        yield encode_frame(bytes(content[:200]))


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


def test_a_probe_that_lies_is_no_fault_and_writes_no_line_of_the_journal(
    tmp_path: Path,
) -> None:
    chance = random.Random(SEED + 2)  # noqa: S311 - no secret
    probe, port = FakeProbe(), Port(tmp_path / "port")
    listen = free_endpoint().removeprefix("tcp/")
    file = tmp_path / "imud.toml"
    file.write_text(
        f"twin = true\n[metrics]\nlisten = '{listen}'\n[ros2]\nenabled = true\n"
        f"[ports]\nfind = false\nnamed = ['{port.path}']\n"
    )
    with DaemonProcess("--config", file, directory=tmp_path) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        with Client(daemon.endpoint) as client:
            client.wait_for(probe.name, seconds=PATIENCE_S)
            for firmware in HOSTILE:
                port.write(with_firmware(probe, firmware, schema.FINGERPRINT))
                port.write(with_firmware(probe, firmware, 1))
            for turn, frame in enumerate(lies(chance, probe, 20_000)):
                port.write(frame)
                # Commands of the daemon's: else its writes come to nothing.
                if turn % 50 == 0 and select.select([port.master], [], [], 0)[0]:
                    port.read()
            # Then it is honest: back at once, in a boot of its own.
            probe.restart()
            begin = time.monotonic()
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
                assert time.monotonic() < begin + PATIENCE_S
        assert daemon.stop() < 2.0
    assert_honest(daemon)
    # Three of a kind and probe in 10 s: 20,000 lies, of a hundred ids, are no flood.
    assert len(daemon.lines) < 1000


def test_a_device_that_makes_up_ids_fills_no_memory(tmp_path: Path) -> None:
    honest, port = FakeProbe(), Port(tmp_path / "port")
    with DaemonProcess(port.path, directory=tmp_path) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        port.write(honest.say("hello"))
        daemon.expect("found on")
        for number in range(2 * PROBES_MAX):
            port.write(FakeProbe(probe_id=number.to_bytes(8, "big")).say("hello"))
        daemon.expect(f"{PROBES_MAX} probes were heard, so probe .* is ignored")
        while True:  # an answer is of the turn in which it is asked
            port.write(honest.say("hello"))
            with Client(daemon.endpoint) as client:
                if client.alive() == [honest.name]:
                    assert len(client.statuses()) <= PROBES_MAX
                    break
        daemon.stop()
    assert_honest(daemon)


def test_a_flood_of_events_is_a_few_lines(tmp_path: Path) -> None:
    probe, port = FakeProbe(), Port(tmp_path / "port")
    with DaemonProcess(port.path, directory=tmp_path) as daemon:
        daemon.expect("listens on")
        port.wait_open()
        port.write(probe.say("hello"))
        daemon.expect("found on")
        for number in range(20_000):
            port.write(probe.say("event", event="bus_fault", detail=number))
        with Client(daemon.endpoint) as client:
            until = time.monotonic() + PATIENCE_S
            while True:
                status = status_of(client)
                ledger = status["ledger"]
                if ledger["received"] == probe.sequence:
                    break
                assert time.monotonic() < until, ledger
                time.sleep(0.1)
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
        said = decode(content)
        is_plain = firmware.isascii() and firmware.decode("ascii").isprintable()
        assert isinstance(said, Message) == is_plain
