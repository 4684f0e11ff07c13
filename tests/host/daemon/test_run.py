# SPDX-License-Identifier: MIT
"""`imud run` as a process: what it publishes, its status, its end."""

from __future__ import annotations

import json
import queue
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zenoh

import reference
from chain import Chain
from fakes import EQUIPMENT, SOON_S, status_of
from imud import _core, cli
from imud.errors import ProbeUnknown
from imud.log.reader import Logged
from imud.probes import record
from imud.sinks import log
from imud.wire import schema
from log_files import read_log
from programs import ran

KINDS = ("pose", "raw", "event", "status", "frame")


def drain(heard: queue.Queue[bytes], last: bytes) -> list[bytes]:
    found = [heard.get()]
    while found[-1] != last:
        found.append(heard.get())
    return found


def subscribed(chain: Chain, topic: str) -> queue.Queue[bytes]:
    """Subscribes, and waits until the daemon knows: a sample comes."""
    heard = chain.hear(topic)
    name = {"frame": "pose"}.get(topic, topic)
    while heard.empty():
        chain.port.write(chain.probe.say(name))
        try:
            heard.get(timeout=0.2)
        except queue.Empty:
            continue
        break
    return heard


def test_poses_and_frames_reach_a_subscriber_whole_and_in_order(chain: Chain) -> None:
    poses, frames = subscribed(chain, "pose"), subscribed(chain, "frame")
    sent = [chain.probe.content("pose") for _ in range(500)]
    chain.port.write(b"".join(_core.encode_frame(schema.SEED, c) for c in sent))
    got = drain(frames, sent[-1])[-500:]
    assert got == sent
    first = chain.probe.sequence - 500
    while True:
        pose = json.loads(poses.get())
        if pose["seq"] >= first:
            break
    for number in range(first, first + 500):
        assert pose["seq"] == number
        assert list(pose) == [
            "type",
            "probe",
            "seq",
            "number",
            "missing",
            "t_device_us",
            "t_ns",
            "t_bound_us",
            "age_us",
            "utc_host",
            "utc_bound_us",
            "q",
            "position_m",
            "normal",
            "tilt_sigma_deg",
            "heading_sigma_deg",
            "flags",
            "since_origin",
        ]
        assert pose["t_device_us"] == number * 5000
        if number < first + 499:
            pose = json.loads(poses.get())


def test_raw_and_events_have_keys_of_their_own(chain: Chain) -> None:
    raw = json.loads(subscribed_first(chain, "raw"))
    assert raw["acc_counts"] == [0, -16, 2048]
    assert raw["mag_uT"] == pytest.approx([1.5, -3.0, 45.0])
    event = json.loads(subscribed_first(chain, "event"))
    assert (event["event"], event["cause"]) == ("stream_started", "button")
    chain.daemon.expect("stream started \\(button\\)")


def subscribed_first(chain: Chain, topic: str) -> bytes:
    heard = chain.hear(topic)
    while True:
        chain.port.write(chain.probe.say(topic))
        try:
            return heard.get(timeout=0.2)
        except queue.Empty:
            continue


def logged(status: dict[str, Any]) -> int:
    """Messages of the probe itself that are in the log."""
    by_topic = status["ledger"]["logged"]
    own = ("hello", "reply", "pose", "raw", "event")
    return sum(by_topic.get(topic, 0) for topic in own)


def test_the_ledger_of_the_status_adds_up(chain: Chain) -> None:
    probe = chain.probe
    doubled = probe.say("pose")
    lost = probe.say("pose")
    flipped = bytearray(probe.say("pose"))
    flipped[-8] ^= 0x10
    (content,) = reference.contents(probe.say("pose"))
    torn = _core.encode_frame(schema.SEED, content[:-3])
    chain.port.write(doubled * 2 + bytes(flipped) + torn + probe.poses(10))
    assert lost
    status = chain.status_when(
        lambda s: (s["ledger"]["published"].get("pose"), logged(s)) == (11, 12)
    )
    ledger = status["ledger"]
    assert ledger["sent"] == 15  # hello, four that were struck, ten
    assert ledger["received"] == 12
    assert ledger["lost"] == 2
    assert ledger["skewed"] == {"missing": 1}
    assert (ledger["duplicated"], ledger["corrupt"]) == (1, 1)
    assert ledger["dropped"] == {"log": 0, "zenoh": 0}
    assert ledger["sent"] == (
        ledger["received"] + sum(ledger["skewed"].values()) + ledger["lost"]
    )
    chain.daemon.expect("skewed message \\(missing\\): pose: pose_flags is missing")
    chain.daemon.expect("2 lost, 1 corrupt, 1 duplicated")
    assert status["hello"]["firmware"] == "0.1.0+fake"
    assert status["state"] == "unknown"  # it said no status yet
    chain.port.write(probe.say("status", state="idle"))
    status = chain.status_when(lambda s: s["state"] != "unknown")
    assert (status["state"], status["counters"]["uptime"]) == ("idle", 5)


def test_late_joiners_ask_for_status_and_see_who_is_alive(chain: Chain) -> None:
    frames = subscribed(chain, "frame")
    content = chain.probe.content("status")
    chain.port.write(_core.encode_frame(schema.SEED, content))
    drain(frames, content)
    status = status_of(chain.client)
    assert status["probe"] == chain.probe.name
    assert chain.client.alive() == [chain.probe.name]
    assert chain.client.only_probe() == chain.probe.name
    with pytest.raises(ProbeUnknown, match="no probe stylus; choose one: 0011"):
        chain.client.only_probe("stylus")


def test_who_waits_finds_a_probe_that_its_history_left_out(
    chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Forgetful:
        """A session whose subscribers are not told of members that are already
        present."""

        def __init__(self, session: zenoh.Session) -> None:
            self._session = session

        def liveliness(self) -> Forgetful:
            return self

        def get(self, key: str, *, timeout: float) -> object:
            return self._session.liveliness().get(key, timeout=timeout)

        def declare_subscriber(
            self, key: str, on_token: Callable[[zenoh.Sample], None], *, history: bool
        ) -> object:
            assert history
            return self._session.liveliness().declare_subscriber(key, on_token)

    chain.client.wait_for(chain.probe.name)
    monkeypatch.setattr(chain.client, "_session", Forgetful(chain.client.session))
    assert chain.client.wait_for(chain.probe.name) == chain.probe.name
    assert chain.client.wait_for() == chain.probe.name
    with pytest.raises(
        ProbeUnknown, match=r"no probe stylus found within 0\.6 s; plug it"
    ):
        chain.client.wait_for("stylus", seconds=0.6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("by", [signal.SIGTERM, signal.SIGINT])
def test_it_stops_within_a_second_and_finishes_its_log(
    chain: Chain, by: signal.Signals
) -> None:
    sent = [chain.probe.content("pose") for _ in range(50)]
    chain.port.write(b"".join(_core.encode_frame(schema.SEED, c) for c in sent))
    chain.port.write(chain.probe.say("event"))
    chain.daemon.expect("stream started")
    seconds = chain.daemon.stop(by)
    assert seconds < 1.0
    assert (
        "stopped; probe 00112233445566aa: 52 received, 0 lost"
        in (chain.daemon.lines[-1])
    )
    decoded = ran(
        *(sys.executable, "-m", "imud", "decode", str(chain.daemon.log), "--json"),
        check=True,
    )
    items = [json.loads(line) for line in decoded.stdout.splitlines()]
    assert [i["seq"] for i in items] == list(range(chain.probe.sequence))
    assert "52 sent = 52 received" in decoded.stderr
    assert "ends without" not in decoded.stderr


# A slow end of the interpreter, as on a busy machine, and a callback of Zenoh's that
# returns only in it.
LATE = """
import runpy, sys, time
from imud.net.queries import Queries

class Slow:
    def __del__(self):
        time.sleep(20)

def tell_late(queries, probe, of, topic, query):
    sys.stderr.write("asked\\n")
    while not sys.is_finalizing():
        time.sleep(0.01)

sys.slow = Slow()
Queries.tell = tell_late
runpy.run_module("imud", run_name="__main__")
"""

# A disk that takes what is written and never says that it has it.
STUCK_DISK = """
import os, runpy, threading, time

def never(descriptor):
    os.write(2, b"stuck\\n")
    threading.Event().wait()

os.fdatasync = never
runpy.run_module("imud", run_name="__main__")
"""


def test_a_callback_of_zenohs_that_is_late_does_not_abort_the_end(
    tmp_path: Path,
) -> None:
    made = Chain(tmp_path, program=("-c", LATE))
    asker = threading.Thread(target=made.client.statuses)
    asker.start()
    made.daemon.expect("asked")
    assert made.daemon.stop() < SOON_S
    assert "stopped; probe 00112233445566aa: 1 received" in made.daemon.lines[-1]
    asker.join()
    made.close()


def test_a_disk_that_is_stuck_holds_up_the_end_only_so_long_and_costs_nothing(
    tmp_path: Path,
) -> None:
    made = Chain(tmp_path, program=("-c", STUCK_DISK))
    made.daemon.expect("stuck")
    made.port.write(made.probe.poses(20) + made.probe.say("event"))
    made.daemon.expect("stream started")
    assert made.daemon.stop() < log.PATIENCE_S + SOON_S
    assert "log did not finish in time" in "\n".join(made.daemon.lines)
    frames = [m for m in read_log(made.daemon.log) if isinstance(m, Logged)]
    assert sum(m.topic == "frame" for m in frames) == made.probe.sequence
    made.close()


def test_a_probe_has_the_name_that_the_configuration_gives_it(tmp_path: Path) -> None:
    file = tmp_path / "imud.toml"
    file.write_text(
        '[zenoh]\nprefix = "lab/a"\n[probes.00112233445566aa]\nname = "stylus"\n'
    )
    made = Chain(tmp_path, "--config", file, prefix="lab/a")
    try:
        assert made.client.only_probe("stylus") == "stylus"
        with pytest.raises(ProbeUnknown, match=r"no probe needle found within 0\.1 s"):
            made.client.wait_for("needle", seconds=0.1)
    finally:
        made.close()


def test_equipment_is_in_the_status_and_in_the_list(
    chain: Chain, capsys: pytest.CaptureFixture[str]
) -> None:
    listing = ["list", "--connect", chain.daemon.endpoint]
    status = status_of(chain.client)
    assert status["equipment"] is None
    assert cli.main(listing) == 0
    head, _, advice = capsys.readouterr().out.splitlines()
    assert "equipment" not in head
    sensors = "accelerometer, gyroscope and magnetometer"
    assert advice == f"{chain.probe.name}: {sensors} not calibrated: imud calibrate"
    low = {"battery": 3310, "power": ("low",), "clock": "spare", "card_block": 32768}
    chain.port.write(chain.probe.say("equipment", **low))
    status = chain.status_when(lambda s: s["equipment"] is not None)
    assert status["equipment"] == {
        "clock": "spare",
        "battery_v": 3.31,
        "power": ["low"],
        "radio": None,
        "card": {
            "state": "logging",
            "recording": 1,
            "block": 32768,
            "blocks": 65536,
            "faults": 0,
            "busy_ms": 3,
            "logged": 100,
            "unlogged": 0,
        },
    }
    assert cli.main(listing) == 0
    head, row, _ = capsys.readouterr().out.splitlines()
    assert head.endswith("equipment")
    assert row.endswith("spare clock, battery 3.31 V low, card logging 50 %")


def test_equipment_that_cannot_tell_its_battery_has_none() -> None:
    fields = EQUIPMENT | {"battery": None, "card": "none", "radio": "cable"}
    found = record.equipment_of(fields)
    assert (found["battery_v"], found["card"]) == (None, None)
    assert found["radio"] == {"state": "cable", "resets": 0}
