# SPDX-License-Identifier: MIT
"""Guided calibrations that browsers have begun, one a probe: has the probe send its raw
samples, hands them to a calibrator, and tells its states on the topic `calibration`.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

import msgspec

from imud.calibration.earth import Earth
from imud.calibration.recording import Scale
from imud.calibration.session import Kind
from imud.probes.sensors import missing_magnetometer, out_of_work
from imud.web import processes
from imud.web.calibrator import End, Task
from imud.web.feed import CALIBRATION, Feed, Key

KNOWN_S = 5.0  # a probe tells its params within this time
HEARD_S = 1.0  # a probe that sends raw samples is heard within this time
SILENT_S = 5.0
TICK_S = 0.25
RUNNING = b'"phase":"running"'
WAITING_MAX = 4 << 20  # bytes that the calibrator has not read
EARLY_MAX = 4000  # samples that come before the calibrator is there

# Has a command carried out: probe, command, parameters; GuideError if it is refused.
Ask = Callable[[str, str, Mapping[str, str]], Awaitable[Any]]
# Gets the state of a probe's calibration, as a line of JSON.
Tell = Callable[[str, bytes], None]

_encode = msgspec.json.Encoder().encode


class GuideError(Exception):
    """A calibration can't go on, or a command was refused: why."""


class NotCalibrated(GuideError):
    """All sensors have to be calibrated first."""


class CalibrationGuide:
    """One calibration. Belongs to the server's loop."""

    def __init__(
        self,
        probe: str,
        kind: Kind,
        feed: Feed,
        ask: Ask,
        tell: Tell,
        before: CalibrationGuide | None,
    ) -> None:
        self._probe, self._kind = probe, kind
        self._feed, self._ask, self._tell = feed, ask, tell
        self._before = before  # leaves the probe as it was, before this one begins
        self.is_told = False  # its end was reported; the user may start again
        self._heard = asyncio.Event()
        self._early: deque[bytes] = deque(maxlen=EARLY_MAX)
        self._process: processes.Process | None = None
        self._undo: list[tuple[str, dict[str, str]]] = []
        self._task = asyncio.get_running_loop().create_task(self._run())

    @property
    def is_over(self) -> bool:
        return self._task.done()

    def add_samples(self, payloads: deque[bytes]) -> None:
        """Raw samples, as they were published."""
        self._heard.set()
        if self._process is None:
            self._early.extend(payloads)
        else:
            self._write(b"\n".join(payloads))

    def end(self) -> None:
        """Has the samples so far evaluated."""
        self._write(_encode(End()))

    def _write(self, lines: bytes) -> None:
        processes.write(self._process, lines)

    async def stop(self) -> None:
        """Gives it up, and leaves the probe as it was."""
        self._task.cancel()
        await self._wait()

    async def _wait(self) -> None:
        """Waits until it has left the probe as it was."""
        await asyncio.wait([self._task])
        if self._before is not None:
            await self._before._wait()

    async def _run(self) -> None:
        try:
            self._say(phase="preparing", says="The probe is asked for raw samples.")
            if self._before is not None:
                await self._before._wait()
                self._before = None
                self._early.clear()
            await self._until_known()
            task = self._make_task()
            await self._set_up()
            await self._follow(task)
        except GuideError as error:
            self.is_told = True
            needs = "all" if isinstance(error, NotCalibrated) else None
            self._say(phase="refused", why=str(error), needs=needs)
        finally:
            await processes.end(self._process)
            for command, parameters in reversed(self._undo):
                with contextlib.suppress(GuideError):  # it may be gone
                    await self._ask(self._name_now(), command, parameters)

    async def _until_known(self) -> None:
        """Waits for what a probe tells right after it was plugged in."""
        until_s = time.monotonic() + KNOWN_S
        while not self._is_known() and time.monotonic() < until_s:
            await asyncio.sleep(TICK_S)

    def _is_known(self) -> bool:
        hello = self._known("status").get("hello")
        return bool(hello) and self._known("params").get("bytes") is not None

    def _make_task(self) -> Task:
        status, params = self._known("status"), self._known("params")
        hello = status.get("hello") or {}
        if hello and (why := out_of_work(status)):
            raise GuideError(why)
        if not self._is_known():
            raise GuideError("the probe has not sent its params yet; try again")
        rate_hz = hello["sample_rate"]
        scale = Scale(hello["acc_lsb"], hello["gyr_lsb"], hello["mag_lsb"], rate_hz)
        earth = msgspec.convert(status.get("place"), Earth | None)
        of = status.get("params") or {}
        known = [(of.get(name) or {}).get("is_calibrated") for name in ("acc", "gyr")]
        if self._kind == "tip" and not all(known):
            raise NotCalibrated("the tip can only be found with calibrated sensors")
        if self._kind == "verify" and not any(known):
            raise NotCalibrated("there is no calibration to check")
        missing_mag = missing_magnetometer(hello, bytes.fromhex(params["bytes"]))
        if missing_mag and self._kind == "mag":
            raise GuideError(missing_mag)
        digest, has_mag = params.get("digest") or "", not missing_mag
        return Task(
            self._probe, self._kind, scale, has_mag, params["bytes"], digest, earth
        )

    def _name_now(self) -> str:
        """The probe's current name: a user may have renamed it."""
        last = self._feed.last().items()
        all_now = {
            name: msgspec.json.decode(payloads[0])
            for (name, topic), payloads in last
            if topic == "status"
        }
        probe_id = all_now.get(self._probe, {}).get("probe_id")
        same = [
            name for name, each in all_now.items() if each.get("probe_id") == probe_id
        ]
        if probe_id is None:
            return self._probe
        return max(same, key=lambda name: int(all_now[name].get("t_ns") or 0))

    def _known(self, topic: str) -> dict[str, Any]:
        payload = self._feed.known((self._probe, topic))
        return msgspec.json.decode(payload) if payload is not None else {}

    async def _set_up(self) -> None:
        """Has the probe send all its raw samples."""
        hello = self._known("status")["hello"]
        sample_hz, raw_hz = hello["sample_rate"], hello["raw_rate"]
        if raw_hz != sample_hz:
            await self._do("rate", stream="raw", hz=str(sample_hz))
            self._undo.append(("rate", {"stream": "raw", "hz": str(raw_hz)}))
        if await self._is_heard():
            return
        await self._do("fields", streams="pose,raw")
        self._undo.append(("fields", {"streams": "pose"}))
        if not await self._is_heard():
            await self._do("start")
            self._undo.append(("stop", {}))

    async def _do(self, command: str, **parameters: str) -> None:
        await self._ask(self._probe, command, parameters)

    async def _is_heard(self) -> bool:
        self._heard.clear()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._heard.wait(), HEARD_S)
        return self._heard.is_set()

    async def _follow(self, task: Task) -> None:
        """Hands over what comes until the calibrator is done."""
        self._process = process = await processes.start("imud.web.calibrator")
        self._write(b"\n".join((_encode(task), *self._early)))
        loop = asyncio.get_running_loop()
        watching = loop.create_task(self._watch(process))
        try:
            last = b""
            while process.stdout and (line := await process.stdout.readline()):
                last = line.rstrip(b"\n")
                self.is_told = RUNNING not in last
                self._tell(self._probe, last)
        finally:
            watching.cancel()
            await asyncio.wait([watching])
        if not watching.cancelled() and (error := watching.exception()) is not None:
            raise error
        if not self.is_told:
            raise GuideError("the calibration ended early; start again")

    async def _watch(self, process: processes.Process) -> None:
        """Ends the calibrator if nothing comes, or it does not keep up."""
        while True:
            self._heard.clear()
            try:
                await asyncio.wait_for(self._heard.wait(), SILENT_S)
            except TimeoutError:
                processes.kill(process)
                why = "the probe stopped sending raw samples; is it unplugged?"
                if (name := self._name_now()) != self._probe:
                    why = f"the probe was renamed to {name}; start again"
                raise GuideError(why) from None
            await asyncio.sleep(TICK_S)
            waiting = process.stdin.transport.get_write_buffer_size()  # type: ignore[union-attr]
            if waiting > WAITING_MAX:
                processes.kill(process)
                raise GuideError("this machine is too busy to calibrate; start again")

    def _say(self, **fields: Any) -> None:
        name = self._name_now()
        head = {"type": CALIBRATION, "probe": name, "kind": self._kind}
        self._tell(name, _encode(head | fields))


class Guides:
    """All calibrations under way. Belongs to the server's loop."""

    def __init__(self, feed: Feed, ask: Ask, tell: Tell) -> None:
        self._feed, self._ask, self._tell = feed, ask, tell
        self._all: dict[str, CalibrationGuide] = {}

    def begin(self, probe: str, kind: Kind) -> None:
        """Begins one; GuideError if there is one of that probe."""
        before = self._all.get(probe)
        if before is not None and not (before.is_told or before.is_over):
            raise GuideError("this probe is already being calibrated")
        self._all[probe] = CalibrationGuide(
            probe, kind, self._feed, self._ask, self._tell, before
        )

    def end(self, probe: str) -> None:
        """Has the guide of a probe evaluate the samples so far."""
        if probe in self._all:
            self._all[probe].end()

    async def stop(self, probe: str) -> None:
        """Cancels the guide of a probe, and forgets its result."""
        guide = self._all.pop(probe, None)
        if guide is not None:
            await guide.stop()
            state = {"type": CALIBRATION, "probe": probe, "phase": "none"}
            self._tell(probe, _encode(state))

    def pass_on(self, fresh: Mapping[Key, deque[bytes]]) -> None:
        """What was published."""
        for probe, guide in self._all.items():
            payloads = fresh.get((probe, "raw"))
            if payloads and not guide.is_over:
                guide.add_samples(payloads)

    async def close(self) -> None:
        for probe in [*self._all]:
            await self.stop(probe)
