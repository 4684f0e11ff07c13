# SPDX-License-Identifier: MIT
"""OpenIGTLink gets each probe's place, and words where that is not known. Two clients
read it: pyigtl's, and one of our own.
"""

from __future__ import annotations

import contextlib
import logging
import re
import select
import socket
import struct
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyigtl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray

from configured import running
from fakes import PATIENCE_S, free_address
from fakes.records import parts_of, record
from imud import rotation
from imud.igtl import messages, names
from imud.igtl.server import CLIENTS_MAX, Server
from imud.probes.record import Presence, Record
from imud.sinks.openigtlink import GONE, OK, IgtlTranslator, OpenIgtLinkSink
from streaming import until

# A client written from the protocol's description alone, strict about each field, so
# that what it takes another client takes too.

HEADER_BYTES = 58


class Heard(NamedTuple):
    """A message; `matrix` of a TRANSFORM, in mm, and `text` of a STRING."""

    kind: str
    name: str
    seconds: float
    metadata: dict[str, str]
    matrix: NDArray[np.float64]
    text: str


@cache
def crc_of(data: bytes) -> int:
    """The remainder of the data, with 64 zeros behind it, by ECMA-182's polynomial."""
    divisor = 1 << 64 | 0x42F0E1EBA9EA3693
    rest = int.from_bytes(data, "big") << 64
    while rest.bit_length() > 64:
        rest ^= divisor << rest.bit_length() - 65
    return rest


def parsed(data: bytes) -> Heard:
    """One whole message."""
    version, kind, name = struct.unpack(">H12s20s", data[:34])
    seconds, fraction, size, crc = struct.unpack(">IIQQ", data[34:HEADER_BYTES])
    body = data[HEADER_BYTES:]
    assert version == 2
    assert len(body) == size
    assert crc_of(body) == crc
    extended, index, texts, number = struct.unpack(">HHII", body[:12])
    assert (extended, number) == (12, 0)
    content = body[12 : size - texts - index]
    metadata = dict(
        metadata_of(body[size - index - texts : size - texts], body[-texts:])
    )
    matrix, text = np.full((4, 4), np.nan), ""
    if kind.rstrip(b"\0") == b"TRANSFORM":
        columns = np.array(struct.unpack(">12f", content)).reshape(4, 3)
        matrix = np.vstack([columns.T, [0.0, 0.0, 0.0, 1.0]])
    else:
        assert kind.rstrip(b"\0") == b"STRING"
        encoding, length = struct.unpack(">HH", content[:4])
        assert (encoding, length) == (3, len(content) - 4)
        text = content[4:].decode("ascii")
    names = kind.rstrip(b"\0").decode(), name.rstrip(b"\0").decode()
    return Heard(*names, seconds + fraction / 2**32, metadata, matrix, text)


def metadata_of(index: bytes, texts: bytes) -> Iterator[tuple[str, str]]:
    (count,) = struct.unpack(">H", index[:2])
    assert len(index) == 2 + 8 * count
    at = 0
    for number in range(count):
        entry = index[2 + 8 * number : 10 + 8 * number]
        key_bytes, encoding, value_bytes = struct.unpack(">HHI", entry)
        assert encoding == 3
        key, at = texts[at : at + key_bytes], at + key_bytes
        value, at = texts[at : at + value_bytes], at + value_bytes
        yield key.decode("ascii"), value.decode("ascii")


class Client:
    """Hears messages one after the other."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection

    def hear(self) -> Heard:
        head = self._take(HEADER_BYTES)
        (size,) = struct.unpack(">Q", head[42:50])
        return parsed(head + self._take(size))

    def hear_first(
        self,
        send: Callable[[], object],
        is_it: Callable[[Heard], bool] = lambda _: True,
    ) -> Heard:
        """The first message that is it, sending until it is heard: a server knows of
        a client a while after that has connected.
        """
        while True:
            while not select.select([self.connection], [], [], 0.05)[0]:
                send()
            if is_it(message := self.hear()):
                return message

    def hear_named(self, *names: str) -> Heard:
        """The next message that has one of these names."""
        while (message := self.hear()).name not in names:
            pass
        return message

    def _take(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            more = self.connection.recv(count - len(data))
            if not more:
                raise EOFError
            data += more
        return data


@contextlib.contextmanager
def connected(address: tuple[str, int], patience_s: float) -> Iterator[Client]:
    """A client whose system keeps as little as it can of what is not yet read."""
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.settimeout(patience_s)
        connection.connect(address)
        yield Client(connection)


T_NS = 1_795_000_000_250_000_000
TIP_M = (0.118, 0.006, -0.014)
TIP = record(4, struct.pack("<3i", *(round(1e6 * each) for each in TIP_M)))
NOWHERE = {"position_m": None}
HEADING, FULL = 1, 0


def about(topic: str, values: dict[str, Any], params: bytes | None = TIP) -> Record:
    return Record("tip", topic, b"{}", b"", 1, T_NS, T_NS, params=params, values=values)


def pose(params: bytes | None = TIP, **fields: Any) -> Record:
    values = {
        "type": "pose",
        "q": (0.5, 0.5, -0.5, 0.5),
        "position_m": (1.0, 2.0, 3.0),
        "tilt_sigma_deg": 0.5,
        "flags": (),
    }
    return about("pose", values | fields, params)


def tared(kind: int) -> Record:
    return about("event", {"event": "tared", "detail": kind})


def stroke(end: str, length: object = None) -> Record:
    return about("stroke", {"end": end, "displacement_m": length})


def state(name: str) -> Record:
    return replace(about("status", {}), payload=b'{"state":"%s"}' % name.encode())


def sent_by(translator: IgtlTranslator, *records: Record | Presence) -> list[Heard]:
    pairs = []
    for each in records:
        translator.learn(each)
        pairs += [(name, parsed(data)) for name, data in translator.messages(each)]
    assert all(name == message.name for name, message in pairs)
    return [message for _, message in pairs]


def words_after(*records: Record | Presence) -> str:
    """The status, where nothing is said of a place."""
    received = sent_by(IgtlTranslator("Stylus"), *records)
    assert {message.name for message in received} <= {"StylusStatus", "TipToStylus"}
    return received[-1].text


def test_the_crc_is_that_of_the_standard() -> None:
    # The check value of CRC-64/ECMA-182 in catalogues of CRCs.
    assert messages.crc64(b"123456789") == 0x6C40DF5F0B497347


@given(st.binary(max_size=150))
def test_the_crc_is_the_remainder_of_a_division(data: bytes) -> None:
    assert messages.crc64(data) == crc_of(data)


@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(*[st.floats(-2.0, 2.0)] * 3),
)
def test_tip_and_probe_lead_to_the_position_of_the_pose(
    q: tuple[float, ...], position_m: tuple[float, ...]
) -> None:
    q = tuple(np.array(q) / np.linalg.norm(q))
    records = pose(q=q, position_m=position_m), state("streaming")
    to_reference, status, tip, again = received = sent_by(
        IgtlTranslator("Stylus"), *records
    )
    assert again.text == OK
    assert (to_reference.name, tip.name) == ("StylusToReference", "TipToStylus")
    assert (status.name, status.text) == ("StylusStatus", OK)
    assert tip.matrix[:3, 3] == pytest.approx(1000 * np.array(TIP_M), abs=1e-4)
    assert tip.matrix[:3, :3] == pytest.approx(np.eye(3))
    whole = to_reference.matrix @ tip.matrix
    assert whole[:3, 3] == pytest.approx(1000 * np.array(position_m), abs=1e-3)
    assert whole[:3, :3] == pytest.approx(rotation.to_matrix(np.array(q)), abs=1e-6)
    for message in received:
        assert message.seconds == pytest.approx(T_NS / 1e9, abs=1e-6)
    assert to_reference.metadata == tip.metadata == {"TransformStatus": "OK"}


@pytest.mark.parametrize(
    ("records", "words"),
    [
        ([pose(tilt_sigma_deg=None)], "the filter starts"),
        ([pose(params=None)], "params are unknown"),
        ([pose(params=b"")], "the position of its tip"),
        (
            [pose(params=record(4, struct.pack("<3i", -(2**31), 0, 0)))],
            "the position of its tip",
        ),
        ([pose(**NOWHERE)], "no origin"),
        ([stroke("too_long"), pose(**NOWHERE)], r"no length \(too_long\)"),
        ([stroke("gap"), pose(**NOWHERE)], r"no length \(gap\)"),
        ([stroke("gap"), tared(HEADING), pose(**NOWHERE)], "no origin"),
        ([pose(flags=("tared",))], "relative to an origin"),
        ([tared(FULL), pose(flags=("tared",))], "relative to an origin"),
        ([state("idle")], "does not stream"),
        ([state("silent")], "silent"),
        ([Presence("tip", is_alive=False)], GONE),
    ],
)
def test_a_place_that_is_not_known_is_said_in_words_alone(
    records: list[Record | Presence], words: str
) -> None:
    assert re.search(words, words_after(*records))


def test_an_origin_of_the_heading_leaves_the_place_known() -> None:
    received = sent_by(IgtlTranslator("Stylus"), tared(HEADING), pose(flags=("tared",)))
    assert received[0].name == "StylusToReference"


def test_a_place_comes_back_with_the_next_origin() -> None:
    translator = IgtlTranslator("Stylus")
    lost = stroke("gap"), pose(**NOWHERE)
    received = sent_by(translator, pose(), *lost, pose(**NOWHERE), tared(1), pose())
    texts = [message.text for message in received if message.kind == "STRING"]
    assert texts == [OK, "a stroke has no length (gap): imud tare --heading", OK]


def test_the_status_comes_each_second() -> None:
    received = sent_by(
        IgtlTranslator("Stylus"), pose(), state("streaming"), state("streaming")
    )
    texts = [message.text for message in received if message.kind == "STRING"]
    assert texts == [OK] * 3


@given(st.text(min_size=1))
def test_a_frame_fits_and_plus_can_split_its_transforms(probe: str) -> None:
    frame = names.frame_of(probe)
    if not frame:
        return
    for name in (names.to_reference(frame), names.tip_to(frame)):
        assert len(name.encode("ascii")) <= 20
        # As PLUS splits: at "To" where what follows is the same in capitals.
        places = [match.end() for match in re.finditer("To", name)]
        assert sum(name[at].upper() == name[at] for at in places) == 1


@pytest.mark.parametrize(
    ("probe", "frame"),
    [
        ("517312c07bcbb16f", "Probe5173"),
        ("probe", "Probe"),
        ("left_foot", "Leftfoot"),
        ("toe", "Toe"),
        ("to5", ""),
        ("to", ""),
        ("ultrasound", ""),
        ("5", ""),
        ("ü", ""),
    ],
)
def test_names_of_frames(probe: str, frame: str) -> None:
    assert names.frame_of(probe) == frame


def test_two_probes_never_share_a_frame(caplog: pytest.LogCaptureFixture) -> None:
    address = free_address()
    sink = OpenIgtLinkSink(address)
    sink.open()

    def send() -> None:
        sink.write(replace(pose(position_m=(9.0, 9.0, 9.0)), probe="517312c07bcbb16f"))
        sink.write(replace(pose(), probe="5173000000000000"))

    with caplog.at_level(logging.WARNING), connected(address, PATIENCE_S) as client:
        received = [client.hear_first(send)]
        send()
        received.append(client.hear_named(received[0].name))
    sink.close()
    places = [
        each.matrix[0, 3] for each in received if each.name == "Probe5173ToReference"
    ]
    assert places
    assert min(places) > 8000
    (told,) = (each for each in caplog.records if each.levelno >= logging.WARNING)
    assert "can't publish 5173000000000000" in told.getMessage()


LONG = messages.string("-" * 1000)


def put(server: Server, name: str, second: int = 0) -> None:
    server.send([(name, messages.message(name, second * 10**9, LONG))])


def test_a_client_that_stands_still_holds_nobody_up_and_hears_what_is_newest() -> None:
    address = free_address()
    server = Server(address)
    server.start()
    with (
        connected(address, PATIENCE_S) as live,
        connected(address, PATIENCE_S) as stopped,
    ):
        live.hear_first(lambda: put(server, "Greeting"))
        stopped.hear_first(lambda: put(server, "Greeting"))
        count = 300  # far more than its connection's buffers hold
        for second in range(count):
            put(server, "Often", second)
            assert live.hear_named("Often").seconds == second
            if second == count // 2:
                put(server, "Rare", second)
        received = [stopped.hear_named("Often", "Rare")]
        while received[-1].seconds != count - 1:
            received.append(stopped.hear_named("Often", "Rare"))
        received.append(stopped.hear_named("Often", "Rare"))
    server.close()
    often = [each.seconds for each in received if each.name == "Often"]
    assert often == sorted(often)
    assert often[-1] == count - 1
    assert len(often) < count // 2
    assert [each.seconds for each in received if each.name == "Rare"] == [count // 2]


def test_clients_come_and_go_and_what_they_send_is_left_at_that() -> None:
    address = free_address()
    server = Server(address)
    server.start()
    for _ in range(3):
        with connected(address, PATIENCE_S) as client:
            client.connection.sendall(bytes(100_000))
            client.hear_first(lambda: put(server, "Greeting"))
            client.connection.shutdown(socket.SHUT_WR)
        until(lambda: not server.is_heard)
    server.close()


def test_there_may_be_only_so_many_clients(caplog: pytest.LogCaptureFixture) -> None:
    address = free_address()
    server = Server(address)
    server.start()
    with contextlib.ExitStack() as stack:
        clients = [
            stack.enter_context(connected(address, PATIENCE_S))
            for _ in range(CLIENTS_MAX)
        ]
        for client in clients:
            client.hear_first(lambda: put(server, "Greeting"))
        with pytest.raises((EOFError, ConnectionError)):
            stack.enter_context(connected(address, PATIENCE_S)).hear()
        until(lambda: server.refused["clients"] == 1)
    server.close()
    assert "refused a client: there are 16" in caplog.text


def test_a_daemon_serves_two_clients_that_are_not_of_one_making(tmp_path: Path) -> None:
    host, port = free_address()
    section = f"[openigtlink]\nenabled = true\nlisten = '{host}:{port}'"
    with running(tmp_path, section) as (daemon, probe, pty):
        told = [line for line in daemon.lines if "OpenIGTLink" in line]
        assert told[0].endswith(f"clients connect to {host}:{port}")
        probe.params.records = TIP
        pty.write(probe.say("hello") + b"".join(parts_of(probe, TIP)))
        frame = f"Probe{probe.name[:4]}"
        here, there = (0.1, 0.2, 0.3), {"position": None}
        with connected((host, port), PATIENCE_S) as client:
            other = pyigtl.OpenIGTLinkClient(host, port)
            client.hear_first(
                lambda: pty.write(probe.say("pose", **there)),
                lambda message: "no origin" in message.text,
            )
            mine = client.hear_first(
                lambda: pty.write(probe.say("pose", position=here)),
                lambda message: message.name == f"{frame}ToReference",
            )
            theirs = None
            while theirs is None:  # it may have come later than the pose
                pty.write(probe.say("pose", position=here))
                theirs = other.wait_for_message(mine.name, timeout=0.2)
            tip = other.wait_for_message(f"TipTo{frame}", timeout=PATIENCE_S)
            status = other.wait_for_message(f"{frame}Status", timeout=PATIENCE_S)
            other.stop()
    assert theirs.matrix == pytest.approx(mine.matrix)
    assert theirs.metadata == mine.metadata == {"TransformStatus": "OK"}
    assert (theirs.matrix @ tip.matrix)[:3, 3] == pytest.approx([100, 200, 300])
    assert status.string == OK
    assert abs(theirs.timestamp - time.time()) < 60
