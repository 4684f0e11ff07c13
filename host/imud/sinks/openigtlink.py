# SPDX-License-Identifier: MIT
"""Serves poses to 3D Slicer and PLUS by OpenIGTLink: docs/ros2.md."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec

from imud.igtl import names
from imud.igtl.messages import MessageBody, Vector, message, string, transform
from imud.igtl.server import Server
from imud.probes.record import Presence, Record
from imud.rotation import matrix_rows
from imud.wire.params import parts_of

UNTURNED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
OK = "OK"
GONE = "the probe is disconnected"
NO_PARAMS = "its params are unknown so far"

ORIGIN_HEADING = 1  # detail of the event `tared`

# States of a probe that has no poses to tell.
STATES = {
    "gone": GONE,
    "silent": "the probe is silent",
    "fault": "its sensor does not work",
    "other schema": "its firmware has another schema",
    "idle": "it does not stream: imud start",
    "calibrating": "it does not stream: imud start",
}

logger = logging.getLogger("imud")

Fields = Mapping[str, Any]
Named = tuple[str, bytes]  # a message by its device name


class IgtlTranslator:
    """What OpenIGTLink gets of one probe, whose frame has that name. No I/O."""

    def __init__(self, frame: str) -> None:
        self._place = names.to_reference(frame)
        self._tip = names.tip_to(frame)
        self._status = names.status_of(frame)
        self._params: bytes | None = None
        self._offset: Vector | None = None  # of the tip, m, in the probe's frame
        self._tip_body: MessageBody | None = None
        self._origin: int | None = None  # as the last event `tared` told it
        self._end = ""  # of the last stroke, if that has no length
        self._is_news = False
        self.words = "it has sent no pose yet"  # why its place is not known, or OK

    def learn(self, record: Record | Presence) -> None:
        """Accepts every record, whether a client is connected or not."""
        if isinstance(record, Presence):
            if not record.is_alive:
                self._say(GONE)
            return
        values = record.values
        if record.topic == "pose":
            self._learn_params(record.params)
            self._say(self._reason(values))
        elif record.topic == "event" and values["event"] == "tared":
            self._origin, self._end = values["detail"], ""
        elif record.topic == "stroke" and values["end"] != "running":
            self._end = values["end"] if values["displacement_m"] is None else ""
        elif record.topic == "status" and record.payload:
            state = msgspec.json.decode(record.payload).get("state")
            if state in STATES:
                self._say(STATES[state])

    def messages(self, record: Record | Presence) -> Iterator[Named]:
        """The messages to send after learn() of the same record."""
        if isinstance(record, Presence):
            yield from self._news(0)
        elif record.topic == "status":
            # Not with each pose: PLUS takes it for a tool that it was not told of.
            if self._tip_body is not None:
                yield self._tip, message(self._tip, record.t_ns, self._tip_body)
            self._is_news = True
            yield from self._news(record.t_ns)
        elif record.topic == "pose":
            if self.words == OK:
                body = self._to_reference(record.values)
                yield self._place, message(self._place, record.t_ns, body)
            yield from self._news(record.t_ns)

    def _news(self, t_ns: int) -> Iterator[Named]:
        if self._is_news:
            self._is_news = False
            yield self._status, message(self._status, t_ns, string(self.words))

    def _say(self, words: str) -> None:
        self._is_news |= words != self.words
        self.words = words

    def _learn_params(self, params: bytes | None) -> None:
        if params == self._params:
            return
        self._params = params
        offset = parts_of(params or b"").get("tip", {}).get("offset")
        self._offset, self._tip_body = None, None
        if isinstance(offset, tuple):
            self._offset = [float(each) for each in offset]
            self._tip_body = transform(UNTURNED, self._offset)

    def _reason(self, pose: Fields) -> str:
        if pose["tilt_sigma_deg"] is None:
            return "the filter starts"
        if "tared" in pose["flags"] and self._origin != ORIGIN_HEADING:
            return (
                "its attitude is relative to an origin: undo that with imud tare "
                "--heading"
            )
        if self._params is None:
            return NO_PARAMS
        if self._offset is None:
            return "the position of its tip is unknown: imud calibrate tip"
        if pose["position_m"] is not None:
            return OK
        if self._end:
            return f"a stroke has no length ({self._end}): imud tare --heading"
        return "it has no origin: imud tare --heading; a Nano also needs fuse_on_host"

    def _to_reference(self, pose: Fields) -> MessageBody:
        """The transform of the sensor, from the pose of its tip."""
        rows, offset = matrix_rows(pose["q"]), self._offset or ()
        sensor = [
            tip - sum(a * b for a, b in zip(row, offset, strict=True))
            for tip, row in zip(pose["position_m"], rows, strict=True)
        ]
        return transform(rows, sensor)


class OpenIgtLinkSink:
    """One IgtlTranslator for each probe whose name fits and is not that of another."""

    name = "openigtlink"
    period_s = 0.0
    patience_s = 0.8

    def __init__(self, address: tuple[str, int]) -> None:
        self._address = address
        self._server: Server | None = None
        self._frames: dict[str, str] = {}  # of each probe
        self._translators: dict[str, IgtlTranslator] = {}  # by frame

    def open(self) -> None:
        self._server = Server(self._address)
        self._server.start()
        host, port = self._address[0], self._server.port
        logger.info("OpenIGTLink clients connect to %s:%s", host, port)

    def write(self, record: Record | Presence) -> None:
        translator = self._translator(record.probe)
        if translator is None or self._server is None:
            return
        translator.learn(record)
        if self._server.is_heard:
            self._server.send(translator.messages(record))

    @property
    def refused(self) -> Mapping[str, int]:
        return self._server.refused if self._server is not None else {}

    def flush(self) -> None:
        """Nothing to do: the server sends without this."""

    def close(self) -> None:
        server, self._server = self._server, None
        if server is not None:
            server.close()

    def _translator(self, probe: str) -> IgtlTranslator | None:
        frame = self._frames.get(probe)
        if frame is None:
            frame = names.frame_of(probe)
            if frame in self._translators:
                frame = ""
            self._frames[probe] = frame
            if frame:
                self._translators[frame] = IgtlTranslator(frame)
            else:
                logger.warning(
                    "OpenIGTLink can't publish %s: give the probe a unique name of "
                    "at most %d letters and digits",
                    probe,
                    names.PROBE_MAX,
                )
        return self._translators.get(frame)
