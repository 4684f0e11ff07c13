# SPDX-License-Identifier: MIT
"""`imud run --twin` beside the image: the same bits as it runs, and what isn't."""

from __future__ import annotations

from typing import Any

import pytest

from fakes import PATIENCE_S, DaemonProcess, Port
from fakes.records import calibrated_records
from imud.client import Client
from imud.recordings.decode import Tally, decode_file
from imud.stages.twin_outcomes import TwinStarted, TwinState
from imud.wire.frame import encode_frame
from imud.wire.params import digest_of
from system.live import LiveProbe, hear
from system.params_orders import upload
from system.virtual import Stub, run, write_hand
from twin_bench import run_twin

pytestmark = pytest.mark.sampled(2)

SECONDS = 14.0


def twin_when(client: Client, key: str, least: Any) -> dict[str, Any]:
    """The twin of the first status from here on that has come so far."""
    statuses = hear(client, "status")
    while True:
        twin: dict[str, Any] = statuses.get()["twin"]
        if twin[key] >= least:
            return twin


def test_it_follows_a_live_probe_through_a_tare_and_a_new_start(stub: Stub) -> None:
    hand = write_hand(stub.folder / "hand", 60)
    probe = LiveProbe(stub, "--motion", hand, "--press", "1500000:1600000")
    with DaemonProcess(probe.port, "--twin", directory=stub.folder) as daemon:
        daemon.expect("its twin compares from")
        with Client(daemon.endpoint) as client:
            name = client.wait_for(seconds=PATIENCE_S)
            for compared, what in ((100, "all"), (250, "heading")):
                twin_when(client, "compared", compared)
                assert client.command(name, "tare", what=what)["ok"]
            assert client.command(name, "stop")["ok"]
            daemon.expect("stream stopped")
            assert client.command(name, "start")["ok"]
            daemon.expect("its twin compares from")
            twin = twin_when(client, "compared", 1000)
            (status,) = client.statuses()
        summary = probe.end()
        daemon.stop()
    assert not summary["crashed"]
    assert (status["ledger"]["lost"], status["ledger"]["corrupt"]) == (0, 0)
    assert (twin["state"], twin["differed"]) == ("following", 0)
    assert (twin["lost"], twin["first_difference"]) == (None, None)


def test_a_probe_that_is_calibrated_as_it_runs_has_the_twins_bits(stub: Stub) -> None:
    records = calibrated_records(1)
    hand = write_hand(stub.folder / "hand", SECONDS)
    options = ["--press", "200000:300000", *stub.raw_too]
    options += upload(records, 6_000_000)
    done = run(stub, SECONDS, "--motion", hand, *options)
    twin, outcomes = run_twin(done.contents)
    assert [type(outcome) for outcome in outcomes] == [TwinStarted, TwinStarted]
    assert (twin.state, twin.differed) == (TwinState.FOLLOWING, 0)
    assert twin.compared == len(done.named("pose"))
    # The daemon says of each sample which params calibrate it.
    port = Port(stub.folder / "port")
    with DaemonProcess(port.path, "--twin", directory=stub.folder) as daemon:
        port.wait_open()
        data = b"".join(map(encode_frame, done.contents))
        for at in range(0, len(data), 2048):
            port.write(data[at : at + 2048])
        with Client(daemon.endpoint) as client:
            live = twin_when(client, "compared", twin.compared)
        daemon.stop()
    assert (live["state"], live["differed"]) == ("following", 0)
    raws = [item for item in decode_file(daemon.log, Tally()) if item["type"] == "raw"]
    digests = [item["params_digest"] for item in raws]
    changed = digests.index(digest_of(records))
    assert set(digests[:changed]) == {0}
    assert set(digests[changed:]) == {digest_of(records)}
    port.vanish()
