# SPDX-License-Identifier: MIT
"""Messages since the browsers were last served. Any thread may add payloads; the
server's loop removes them.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable, Mapping

import msgspec

Key = tuple[str, str]  # probe and topic

CALIBRATION = "calibration"  # the server's own: how a guided calibration does
UPDATE = "update"  # the server's own: how new firmware gets into a probe
BODY = "body"  # the state of a limb, in the place of a probe

# Topics that everybody sees, as their last payload; of events every one.
LATEST = frozenset(
    {"pose", "status", "params", "marks", "clock", "log", "twin"}
    | {CALIBRATION, UPDATE, BODY}
)
EVENT = "event"
# Topics of which everybody gets every payload.
EVENTS = frozenset({EVENT, "command"})
# Topics of which a browser can ask for every payload of one probe.
STREAMS = frozenset({"pose", "aim", "raw", "stroke", "path", "mark", BODY})

# Payloads of one key that wait for the loop: a second of a probe at 1000 Hz.
FRESH_MAX = 1000
# Keys that are kept: a network without keys could bring any number of names.
KEYS_MAX = 2048


class _Status(msgspec.Struct):
    probe_id: str = ""


_STATUS = msgspec.json.Decoder(_Status)


def _id_in(status: bytes) -> str:
    """The id of the probe; empty if the status does not say it."""
    try:
        return _STATUS.decode(status).probe_id
    except msgspec.DecodeError:
        return ""


class Feed:
    """Gathers payloads by probe and topic."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._fresh: dict[Key, deque[bytes]] = {}
        self._last: dict[Key, bytes] = {}
        self.ids: dict[str, str] = {}  # of probes, by name, as their statuses say
        self.is_watched = False  # else only the last payload is kept

    def add(self, payloads: Iterable[tuple[Key, bytes]]) -> None:
        """Adds payloads by probe and topic; any thread may call it. Of topics that are
        no stream the last one counts.
        """
        with self._lock:
            for key, payload in payloads:
                if key not in self._last and len(self._last) >= KEYS_MAX:
                    continue
                self._last[key] = payload
                if key[1] == "status":
                    self.ids[key[0]] = _id_in(payload)
                if not self.is_watched:
                    continue
                if key[1] not in STREAMS and key[1] not in EVENTS:
                    self._fresh[key] = deque((payload,))
                elif (fresh := self._fresh.get(key)) is not None:
                    fresh.append(payload)
                else:
                    self._fresh[key] = deque((payload,), FRESH_MAX)

    def forget(self) -> None:
        """Forgets what was said of probes; that of bodies stays."""
        with self._lock:
            self._last = {
                key: last for key, last in self._last.items() if key[1] == BODY
            }
            self.ids.clear()

    def swap(self) -> Mapping[Key, deque[bytes]]:
        """Messages since the last call."""
        with self._lock:
            fresh, self._fresh = self._fresh, {}
        return fresh

    def known(self, key: Key) -> bytes | None:
        """The last payload of a key."""
        with self._lock:
            return self._last.get(key)

    def last(self) -> dict[Key, deque[bytes]]:
        """The last payload of each key that a new browser begins with."""
        with self._lock:
            return {
                key: deque((payload,))
                for key, payload in self._last.items()
                if key[1] in LATEST
            }
