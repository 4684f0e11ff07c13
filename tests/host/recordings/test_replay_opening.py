# SPDX-License-Identifier: MIT
"""A replay knows the params of its probes from the first message on, also where the log
is a later part of a longer one, and tells them to late subscribers.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
from pathlib import Path

import pytest
from msgspec.structs import replace

from fakes import PATIENCE_S, DaemonProcess, FakeProbe
from fakes.records import calibrated_records, parts_of
from imud.client import Client
from imud.errors import CommandRefused
from imud.params.value import payload_of
from imud.probes.record import Record, record_of
from imud.probes.session import Probe, Received, Session
from imud.recordings import replay
from imud.recordings.opening import HELLO, PARAMS, Opening
from imud.wire.frame import encode_frame
from imud.wire.params import digest_of
from log_files import BEGIN_NS, PERIOD_NS, replaying, write

ONE, OTHER = calibrated_records(1), calibrated_records(2)
RAWS = 20
HOURS = 3_600_000_000_000


def contents_with(records: bytes, before: int = 10) -> list[bytes]:
    """The messages of a probe with these params, then samples."""
    probe = FakeProbe(params_digest=digest_of(records))
    contents = [probe.content("pose") for _ in range(before)]
    contents += [probe.content("hello"), *parts_of(probe, records, probe.content)]
    return contents + [probe.content("raw") for _ in range(RAWS)]


def received(contents: list[bytes]) -> list[Received]:
    """The events of a daemon that reads these from their first byte on."""
    probe = Probe("left")
    session = Session(lambda _: probe, 0)
    events = session.receive(b"".join(map(encode_frame, contents)), 0)
    return [event for event in events if isinstance(event, Received)]


def later(contents: list[bytes], count: int = RAWS) -> list[Record]:
    """The last records of these: what a log holds that begins there."""
    made = []
    for number, event in enumerate(received(contents)[-count:]):
        t_ns = BEGIN_NS + number * PERIOD_NS
        stamp = replace(event.stamp, t_ns=t_ns, t_received_ns=t_ns)
        made.append(
            record_of(event.message, event.content, "left", stamp, event.scales)
        )
    return made


def params_record(records: bytes, t_ns: int) -> Record:
    """The message that a daemon publishes when it learns of params."""
    values = {"type": "params", "probe": "left", "t_ns": t_ns, **payload_of(records)}
    return Record("left", "params", json.dumps(values).encode(), b"", 0, t_ns, t_ns)


# On a pty.


def played(path: Path, link: Path) -> bytes:
    """The bytes of its replay."""
    data = b""
    with replaying(path, link) as playing:
        port = os.open(link, os.O_RDONLY | os.O_NOCTTY)
        # Until the replay has closed its end.
        with contextlib.suppress(OSError):
            while data.count(b"\0") < RAWS or playing.is_alive():
                data += os.read(port, 4096)
        os.close(port)
    return data


def test_a_later_part_of_a_log_is_calibrated_from_its_first_sample(
    tmp_path: Path,
) -> None:
    put = later(contents_with(ONE))
    data = played(write(tmp_path, put), tmp_path / "probe")
    probe = Probe("left")
    events = Session(lambda _: probe, 0).receive(data, 0)
    heard = [event for event in events if isinstance(event, Received)]
    raws = [event for event in heard if event.message.name == "raw"]
    assert [raw.content for raw in raws] == [record.content for record in put]
    assert {raw.params for raw in raws} == {ONE}
    # What comes ahead of them is the hello and the params, numbered without a gap.
    names = [event.message.name for event in heard[: -len(raws)]]
    assert names == ["hello"] + ["params"] * 5
    assert probe.account.counts()["lost"] == 0
    assert raws[0].message.sequence == heard[0].message.sequence + 6


def opening_of(*metadata: tuple[str, bytes]) -> Opening:
    opening = Opening()
    for topic, data in metadata:
        opening.add(topic, data)
    return opening


def hello_of(records: bytes) -> bytes:
    return FakeProbe(params_digest=digest_of(records)).content("hello")


@pytest.mark.parametrize(
    ("metadata", "records"),
    [
        ([], None),
        ([(PARAMS, ONE)], None),
        ([(HELLO, hello_of(ONE))], None),
        ([(HELLO, hello_of(ONE)), (PARAMS, OTHER)], None),
        ([(HELLO, hello_of(b""))], b""),
        ([(HELLO, hello_of(ONE)), (PARAMS, ONE)], ONE),
        ([(PARAMS, OTHER), (PARAMS, ONE), (HELLO, hello_of(ONE))], ONE),
        # A later hello has nothing to say of the beginning.
        ([(HELLO, hello_of(ONE)), (PARAMS, ONE), (HELLO, hello_of(OTHER))], ONE),
        ([(HELLO, b"\x03 no hello"), (HELLO, hello_of(ONE)), (PARAMS, ONE)], ONE),
    ],
)
def test_the_first_hello_says_which_params_a_log_begins_with(
    metadata: list[tuple[str, bytes]], records: bytes | None
) -> None:
    opening = opening_of(*metadata)
    assert opening.records == records
    assert bool(opening.payload("left", 1)) == (records is not None)
    assert bool(opening.contents(contents_with(ONE)[-1])) == bool(records)


def test_a_probe_that_has_just_booted_tells_its_params_itself() -> None:
    opening = opening_of((HELLO, hello_of(ONE)), (PARAMS, ONE))
    counts = [
        len(opening.contents(content)) for content in contents_with(ONE, before=8)
    ]
    assert counts[:8] == [0] * 6 + [6] * 2


# On a network.


class Held:
    """In place of the pace: waits before messages of a later hour until they may go."""

    def __init__(self) -> None:
        self.reached, self.go_on = threading.Event(), threading.Event()

    def wait(self, t_ns: int) -> None:
        if t_ns >= BEGIN_NS + HOURS:
            self.reached.set()
            assert self.go_on.wait(PATIENCE_S)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("is_later_part", [False, True])
def test_who_subscribes_late_asks_for_the_params_in_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_later_part: bool
) -> None:
    put = later(contents_with(ONE))
    if not is_later_part:
        put.insert(3, params_record(ONE, put[3].t_received_ns))
    late_ns = BEGIN_NS + HOURS
    put.append(params_record(OTHER, late_ns))
    path = write(tmp_path / "in", put)
    held = Held()
    monkeypatch.setattr(replay, "Pacer", lambda _: held)
    with contextlib.ExitStack() as stack:
        daemon = stack.enter_context(
            DaemonProcess(tmp_path / "none", directory=tmp_path, log=False)
        )
        daemon.expect("listens on")
        client, player = (
            stack.enter_context(Client(daemon.endpoint)) for _ in range(2)
        )
        what = replay.log_set([path])
        playing = threading.Thread(target=replay.to_network, args=(what, player, None))
        playing.start()
        try:
            assert held.reached.wait(PATIENCE_S)
            client.wait_for("left", seconds=PATIENCE_S)
            reply = client.params("left")
            with pytest.raises(CommandRefused, match="a replay of a log, which"):
                client.params_history("left")
        finally:
            held.go_on.set()
            playing.join()
        daemon.stop()
    assert reply["probe"] == "left"
    assert reply["digest"] == f"{digest_of(ONE):08x}"
    assert {key: reply[key] for key in payload_of(ONE)} == json.loads(
        json.dumps(payload_of(ONE))
    )
