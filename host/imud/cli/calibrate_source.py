# SPDX-License-Identifier: MIT
"""Where `imud calibrate` gets raw samples from: a probe by its daemon, or a file."""

from __future__ import annotations

import contextlib
import itertools
import statistics
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec

from imud.calibration.earth import Earth
from imud.calibration.recording import Sample, Scale
from imud.client import Client, Event, Raw, subscribe
from imud.errors import DeviceError, FileError, ImudError, NoReply, ProbeUnknown
from imud.params.value import SENSORS, Params
from imud.probes.sensors import missing_magnetometer, out_of_work

# A probe that sends raw samples is heard within this time.
HEARD_S = 1.5
SILENT_S = 5.0
STATUS_S = 3.0
TICK_S = 0.1
RATE_MIN_HZ = 50.0
WHOLE = 0.9  # of the samples that there are: clocks differ by less than the rest
LONGEST_S = 900.0  # of a file: its last samples
# In so long a pause of the raw stream a probe may be turned to any heading.
PAUSE_US = 2_000_000


@dataclass(frozen=True, slots=True)
class CalibratedProbe:
    """Whose samples they are."""

    probe_id: str
    scale: Scale
    missing_mag: str  # why there is no magnetometer; empty: there is one
    params: Params
    earth: Earth | None = None  # the field of the place, if the daemon knows it

    @property
    def has_mag(self) -> bool:
        return not self.missing_mag


def scale_of(hello: Mapping[str, Any], rate_hz: float) -> Scale:
    """The values of a probe's counts."""
    is_sparse = rate_hz < WHOLE * hello["sample_rate"]
    acc, gyr, mag = (hello[f"{name}_lsb"] for name in SENSORS)
    return Scale(acc, gyr, mag, rate_hz, is_sparse)


def sample_of(raw: Raw) -> Sample:
    """A published raw sample."""
    return Sample(
        raw.t_device_us,
        raw.acc_counts,
        raw.gyr_counts,
        raw.mag_counts,
        raw.temperature_c,
        "acc_clipped" in raw.flags or "gyr_clipped" in raw.flags,
    )


def _status(client: Client, probe: str) -> dict[str, Any]:
    """The status of a probe; the first one comes a second after it was found."""
    until_s = time.monotonic() + STATUS_S
    while not (found := client.statuses(probe)):
        if time.monotonic() > until_s:
            raise NoReply(
                f"no status received from probe {probe}; see the output of imud run"
            )
        time.sleep(TICK_S)
    return found[0]


class LiveSamples:
    """The raw samples of a probe as they come. While it is open, the probe sends all of
    them; afterwards it does as before.
    """

    def __init__(
        self,
        client: Client,
        probe: str,
        prefix: str,
        keys: Path | None,
        *,
        needs_mag: bool = False,
    ) -> None:
        self._client = client
        self._probe = probe
        reply = client.params(probe)
        self._id = reply["probe_id"]  # which it has under every name
        self._digest = reply["digest"]
        status = _status(client, probe)
        self._hello = status["hello"]
        if why := out_of_work(status):
            raise DeviceError(f"probe {probe} can not be calibrated: {why}")
        self.subject = CalibratedProbe(
            self._id,
            scale_of(self._hello, self._hello["sample_rate"]),
            missing_magnetometer(self._hello, bytes.fromhex(reply["bytes"])),
            Params.decode(bytes.fromhex(reply["bytes"])),
            msgspec.convert(status.get("place"), Earth | None),
        )
        if needs_mag and self.subject.missing_mag:
            raise DeviceError(f"probe {probe}: {self.subject.missing_mag}")
        self._subscription = subscribe(
            self._id,
            topics=("raw", "event"),
            endpoint=client.endpoint,
            prefix=prefix,
            keys=keys,
        )
        self._undo: list[tuple[str, dict[str, str]]] = []

    def __enter__(self) -> Self:
        try:
            self._set_up()
        except BaseException:
            self._subscription.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._subscription.close()
        for name, arguments in reversed(self._undo):
            with contextlib.suppress(ImudError):  # it may be gone
                self._client.command(self._id, name, **arguments)

    def _set_up(self) -> None:
        """Makes the probe send raw samples, all of them."""
        sample_rate, raw_rate = self._hello["sample_rate"], self._hello["raw_rate"]
        if raw_rate != sample_rate:
            self._do("rate", {"stream": "raw", "hz": str(sample_rate)})
            self._undo.append(("rate", {"stream": "raw", "hz": str(raw_rate)}))
        if self._is_heard():
            return
        self._do("fields", {"streams": "pose,raw"})
        self._undo.append(("fields", {"streams": "pose"}))
        if not self._is_heard():
            self._do("start", {})
            self._undo.append(("stop", {}))

    def _do(self, name: str, arguments: dict[str, str]) -> None:
        self._client.command(self._id, name, **arguments)

    def _is_heard(self) -> bool:
        until_s = time.monotonic() + HEARD_S
        while (left_s := until_s - time.monotonic()) > 0:
            if isinstance(self._subscription.get(left_s), Raw):
                return True
        return False

    def samples(self) -> Iterator[Sample | None]:
        """Sample by sample; None when nothing came for a moment. DeviceError if the
        probe restarts, NoReply if it is gone.
        """
        last_us, heard_s = -1, time.monotonic()
        while True:
            message = self._subscription.get(TICK_S)
            if isinstance(message, Raw):
                if message.t_device_us < last_us:
                    raise DeviceError(
                        f"probe {self._probe} restarted: its calibration is "
                        "unchanged; start again"
                    )
                last_us, heard_s = message.t_device_us, time.monotonic()
                yield sample_of(message)
                continue
            if isinstance(message, Event) and message.event == "params_changed":
                self._is_changed()
            if time.monotonic() - heard_s > SILENT_S:
                raise NoReply(
                    f"no raw samples from probe {self._probe} for {SILENT_S:g} s: is "
                    "it unplugged? Its calibration is unchanged"
                )
            yield None

    def _is_changed(self) -> None:
        raise DeviceError(
            f"another client changed the params of probe {self._probe}; start again"
        )

    def put_in_force(self, params: Params) -> None:
        """All of them or none. DeviceError if others came into force meanwhile."""
        if self._client.params(self._id)["digest"] != self._digest:
            self._is_changed()
        self._client.change_params(self._id, params.encode(), self._id)


@dataclass(slots=True)
class _Heard:
    """Samples in a file from one boot of a probe, from one pause to the next."""

    hello: Mapping[str, Any]
    samples: list[Sample]


def of_file(path: Path, probe: str | None) -> tuple[str, CalibratedProbe, list[Sample]]:
    """The probe in a log or capture, and its samples: the most between two pauses or
    boots. FileError if there are none.
    """
    from imud.recordings.decode import Tally, decode_file

    tally = Tally()
    hellos: dict[str, Mapping[str, Any]] = {}
    pieces: dict[str, list[_Heard]] = {}
    for item in decode_file(path, tally):
        name = item["probe"]
        if item["type"] == "hello":
            hellos[name] = item
        elif item["type"] == "raw" and name in hellos:
            own = pieces.setdefault(name, [])
            t_us = item["t_device_us"]
            last_us = own[-1].samples[-1].t_us if own else -PAUSE_US
            if not 0 <= t_us - last_us < PAUSE_US:
                own.append(_Heard(hellos[name], []))
            own[-1].samples.append(_logged(item))
    name = _chosen(path, pieces, tally, probe)
    best = max(pieces[name], key=lambda each: len(each.samples))
    return name, _subject(path, name, best, tally), best.samples


def _logged(item: Mapping[str, Any]) -> Sample:
    flags = item["flags"]
    return Sample(
        item["t_device_us"],
        item["acc_counts"],
        item["gyr_counts"],
        item["mag_counts"],
        item["temperature_c"],
        "acc_clipped" in flags or "gyr_clipped" in flags,
    )


def _chosen(
    path: Path, pieces: Mapping[str, Any], tally: Any, probe: str | None
) -> str:
    if not pieces:
        words = tally.damage.words()
        why = f" and is {words}" if words else ""
        raise FileError(
            f"{path} has no raw samples{why}; set streams = "
            '["pose", "raw"] for the probe, and log again'
        )
    if probe in pieces:
        return str(probe)
    if len(pieces) > 1:
        raise ProbeUnknown(f"{path} holds {', '.join(pieces)}; choose one")
    return str(next(iter(pieces)))


def _subject(path: Path, name: str, best: _Heard, tally: Any) -> CalibratedProbe:
    hello, samples = best.hello, best.samples
    steps = [b.t_us - a.t_us for a, b in itertools.pairwise(samples)]
    rate_hz = 1e6 / statistics.median(steps) if steps else 0.0
    if rate_hz < RATE_MIN_HZ:
        raise FileError(
            f"{path}: {rate_hz:.0f} raw samples per second are too few; set the "
            f"probe's raw_rate to {RATE_MIN_HZ:g} or more"
        )
    del samples[: -round(LONGEST_S * rate_hz)]
    heard = tally.probes.get(name)
    records = heard.params if heard is not None else None
    return CalibratedProbe(
        str(hello["probe_id"]),
        scale_of(hello, rate_hz),
        missing_magnetometer(hello, records),
        Params.decode(records or b""),
    )
