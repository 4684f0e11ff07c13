# SPDX-License-Identifier: MIT
"""Two probes with different params in one daemon: each has its own, everywhere."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import pytest

from fakes import PATIENCE_S, DaemonProcess, Port
from fakes.records import calibrated_records
from imud import _core
from imud.client import Client
from imud.recordings.decode import Tally, decode_file
from imud.wire.frame import encode_frame
from imud.wire.params import digest_of
from system.live import hear
from system.params_orders import upload
from system.virtual import Run, Stub, run

SECONDS = 5.0
CHUNK = 1024  # bytes of one probe, then of the other


@dataclass(frozen=True)
class Recorded:
    """A probe that has loaded its params and then streamed, and its port."""

    done: Run
    params: bytes
    port: Port

    @property
    def name(self) -> str:
        probe_id = self.done.named("hello")[0].fields["probe_id"]
        assert isinstance(probe_id, bytes)
        return probe_id.hex()

    @property
    def count(self) -> int:
        return len(self.done.named("pose"))

    def pieces(self) -> list[bytes]:
        data = b"".join(map(encode_frame, self.done.contents))
        return [data[at : at + CHUNK] for at in range(0, len(data), CHUNK)]

    def quantities(self) -> list[tuple[Any, ...]]:
        """Digest and values of each raw sample, by the firmware's own C."""
        both = list(zip(self.done.messages, self.done.contents, strict=True))
        hello = [content for message, content in both if message.name == "hello"][-1]
        records, found = b"", []
        for message, content in both:
            if message.fields.get("event") == "params_changed":
                records = self.params
            elif message.name == "raw":
                values = _core.Calibrator(hello, records).apply(content)
                found.append((digest_of(records), *values))
        return found


def recorded(stub: Stub, seed: int) -> Recorded:
    folder = stub.folder / str(seed)
    folder.mkdir()
    params = calibrated_records(seed)
    # The params are 32 words of 60 ms.
    options = ["--press", "200000:300000", *stub.raw_too, *upload(params, 1_500_000)]
    done = run(replace(stub, folder=folder), SECONDS, "--seed", seed, *options)
    return Recorded(done, params, Port(folder / "port"))


@pytest.mark.nightly
@pytest.mark.parametrize("stub", ["nano"], indirect=True)
def test_each_of_two_probes_has_its_own_params(stub: Stub) -> None:
    probes = [recorded(stub, seed) for seed in (1, 2)]
    ports = [probe.port.path for probe in probes]
    with DaemonProcess(*ports, "--twin", directory=stub.folder) as daemon:
        for probe in probes:
            probe.port.wait_open()
        for pair in itertools.zip_longest(*(probe.pieces() for probe in probes)):
            for probe, piece in zip(probes, pair, strict=True):
                if piece:
                    probe.port.write(piece)
        with Client(daemon.endpoint) as client:
            statuses = hear(client, "status")
            last: dict[str, dict[str, Any]] = {}
            while not all(
                last.get(probe.name, {"twin": {"compared": 0}})["twin"]["compared"]
                == probe.count
                for probe in probes
            ):
                status = statuses.get(timeout=PATIENCE_S)
                last[status["probe"]] = status
            told = {probe.name: client.params(probe.name) for probe in probes}
        daemon.stop()
    items = list(decode_file(daemon.log, Tally()))
    for probe in probes:
        digest = f"{digest_of(probe.params):08x}"
        assert last[probe.name]["params"]["digest"] == digest
        assert told[probe.name]["digest"] == digest
        assert told[probe.name]["bytes"] == probe.params.hex()
        twin = last[probe.name]["twin"]
        assert (twin["state"], twin["differed"]) == ("following", 0)
        own = [item for item in items if item["probe"] == probe.name]
        raws = [
            tuple(
                item[key]
                for key in ("params_digest", "acc_m_s2", "gyr_rad_s", "mag_uT")
            )
            for item in own
            if item["type"] == "raw"
        ]
        assert raws == probe.quantities()
        assert [item["q"] for item in own if item["type"] == "pose"] == [
            pose.fields["q"] for pose in probe.done.named("pose")
        ]
        probe.port.vanish()
    assert probes[0].name != probes[1].name
    assert probes[0].params != probes[1].params
