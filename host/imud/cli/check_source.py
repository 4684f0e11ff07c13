# SPDX-License-Identifier: MIT
"""Where `imud check` gets its messages from: a probe by a daemon, which it starts if
none runs, or a file.
"""

from __future__ import annotations

import argparse
import contextlib
import queue
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from imud.calibration.earth import Earth
from imud.check.evidence import Evidence
from imud.cli import check_ports, reached
from imud.client import Client
from imud.client.client import Delivery
from imud.errors import (
    FileError,
    ImudError,
    NoReply,
    ProbeUnknown,
)
from imud.probes.ledger import totals
from imud.wire import messages
from imud.wire.messages import Message

TICK_S = 0.1
HEARD_S = 1.5  # a probe that sends raw samples is heard within this time
# One part a second, up to nine parts (imud.wire.params).
PARAMS_S = 16.0
SILENT_S = 8.0  # longer than a board needs to start again


class LiveMessages:
    """The messages of a probe as they come. While it is open, the probe sends all raw
    samples; afterwards it sends as before.
    """

    def __init__(
        self,
        client: Client,
        status: Mapping[str, Any],
        title: str,
        topics: Sequence[str] = (),
    ) -> None:
        self.title = title
        self._client = client
        self._status = status
        self._probe = str(status["probe"])
        self._id = str(status["probe_id"])  # which it has under every name
        self._queue: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._undo: list[tuple[str, dict[str, str]]] = []
        topics = ["raw", "event", "status", *topics]
        if client.may("frame"):  # recorders only; it has the self-test
            topics.append("frame")
        self._unlisten = [
            client.listen(topic, self._id, partial(self._put, topic))
            for topic in topics
        ]

    def close(self) -> None:
        """Unsubscribes, and makes the probe send as before."""
        for unlisten in self._unlisten:
            unlisten()
        for name, arguments in reversed(self._undo):
            self._try(name, arguments)

    def _put(self, topic: str, delivery: Delivery) -> None:
        """In a thread of Zenoh's."""
        if topic == "frame":
            message = messages.decode(delivery.payload)
            if isinstance(message, Message) and message.name == "self_test":
                self._queue.put({"type": "self_test", **message.fields})
            return
        with contextlib.suppress(msgspec.DecodeError):
            item: dict[str, Any] = msgspec.json.decode(delivery.payload)
            item["type"] = topic
            self._queue.put(item)

    def begin(self, evidence: Evidence) -> None:
        """Makes the probe send raw samples, all of them."""
        evidence.add_status(self._status)
        evidence.earth = msgspec.convert(self._status.get("place"), Earth | None)
        evidence.wire = check_ports.wire_of(self._status.get("port"))
        hello = evidence.hello
        if evidence.other_schema or hello["sensor"] == "none":
            return
        rate, raw_rate = hello["sample_rate"], hello["raw_rate"]
        if raw_rate != rate and self._try("rate", {"stream": "raw", "hz": str(rate)}):
            self._undo.append(("rate", {"stream": "raw", "hz": str(raw_rate)}))
            hello["raw_rate"] = rate
        is_streaming = self._status["state"] == "streaming"
        # After the button was pressed, too.
        self._undo.append(("start" if is_streaming else "stop", {}))
        if self._is_heard():
            return
        if self._try("fields", {"streams": "pose,raw"}):
            self._undo.append(("fields", {"streams": "pose"}))
        self._try("start", {})

    def params(self) -> bytes:
        """The records of its params, once it has sent them. ProbeUnknown if it does
        not.
        """
        until_s = time.monotonic() + PARAMS_S
        while True:
            try:
                return bytes.fromhex(self._client.params(self._id)["bytes"])
            except ProbeUnknown:
                if time.monotonic() > until_s:
                    raise
            time.sleep(TICK_S)

    def add_params(self, evidence: Evidence) -> None:
        """Gives its params to the evidence, if they are known by now."""
        with contextlib.suppress(ImudError):
            evidence.params = bytes.fromhex(self._client.params(self._id)["bytes"])

    def _try(self, name: str, arguments: dict[str, str]) -> bool:
        """Whether the probe accepted it: one without a sensor may refuse."""
        try:
            self._client.command(self._id, name, **arguments)
        except ImudError:
            return False
        return True

    def _is_heard(self) -> bool:
        until_s = time.monotonic() + HEARD_S
        while time.monotonic() < until_s:
            with contextlib.suppress(queue.Empty):
                if self._queue.get(timeout=TICK_S)["type"] == "raw":
                    return True
        return False

    def items(self) -> Iterator[dict[str, Any] | None]:
        """Message by message; None when nothing came for a moment. NoReply if the probe
        is gone.
        """
        heard_s = time.monotonic()
        while True:
            try:
                item = self._queue.get(timeout=TICK_S)
            except queue.Empty:
                if time.monotonic() - heard_s > SILENT_S:
                    raise NoReply(
                        f"nothing received from probe {self._probe} for "
                        f"{SILENT_S:g} s: is it unplugged?"
                    ) from None
                yield None
                continue
            if item["type"] != "status" or item["state"] not in ("gone", "silent"):
                heard_s = time.monotonic()
            yield item

    def record(self, item: dict[str, Any], evidence: Evidence) -> None:
        """Gives an item to the evidence."""
        if item["type"] != "status":
            evidence.add_message(item)
            return
        raw_rate = evidence.hello.get("raw_rate")
        evidence.add_status(item)
        # Of the daemon's last hello, which may be from before the command.
        evidence.hello["raw_rate"] = raw_rate


@contextlib.contextmanager
def opened(
    args: argparse.Namespace, topics: Sequence[str] = ()
) -> Iterator[LiveMessages]:
    """The selected probe, by the running daemon or by one of its own, with further
    topics. Raises ImudError with what to do if there is none.
    """
    with contextlib.ExitStack() as stack:
        found = reached.probe(args, args.probe, "imud check", stack)
        source = LiveMessages(found.client, found.status, found.title, topics)
        stack.callback(source.close)
        yield source


def of_file(path: Path, probe: str | None) -> tuple[str, Evidence]:
    """The name of the probe in a log or capture, and its evidence."""
    from imud.recordings.decode import Tally, decode_file

    tally = Tally()
    found: dict[str, Evidence] = {}
    for item in decode_file(path, tally):
        found.setdefault(item["probe"], Evidence()).add_message(item)
    if tally.other is not None and not found:
        raise FileError(next(line for line in tally.lines() if "schema" in line))
    if probe is None and len(found) > 1:
        raise ProbeUnknown(f"{path} holds {', '.join(found)}; choose one")
    if not found:
        raise FileError(f"{path} has no messages of a probe")
    name = probe if probe is not None else next(iter(found))
    if name not in found:
        raise FileError(
            f"{path} has no data of probe {name}, only of {', '.join(found)}"
        )
    evidence = found[name]
    evidence.link = tally.links[-1] if tally.links else None
    evidence.params = tally.probes[name].params
    known: Any = tally.probes[name].account.counts()
    evidence.lost = totals(known).lost
    return f"{name} in {path}", evidence
