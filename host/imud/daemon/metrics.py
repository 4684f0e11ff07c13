# SPDX-License-Identifier: MIT
"""Serves the numbers of each probe's status to Prometheus over HTTP, in a thread of its
own: https://prometheus.io/docs/instrumenting/exposition_formats/, version 0.0.4.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import socket
from collections import Counter, defaultdict
from collections.abc import AsyncIterator, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from imud.endpoint import host_of, is_loopback
from imud.machine import system
from imud.serving import ServerThread, listen
from imud.throttle import Rate, Throttle
from imud.version import version

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

# Limits of a request: the head of a scrape has 100 to 500 bytes and comes at once.
HEAD_MAX = 8192
REQUEST_S = 2.0
CLIENTS_MAX = 16
# Prometheus asks every 5 to 60 s.
RATE = Rate(at_once=30, a_second=5.0)

# Counters, since the daemon or the probe started; everything else is a gauge.
_COUNTED = re.compile(
    r"ledger_(?!.*(waiting|adds_up|_un))|link_|twin_(compared|differed)"
    r"|clock_(exchanges|restarts|data_skew)"
    r"|counters_(samples|overruns|bus|messages|commands)"
)
# Objects whose keys become values of a label: key of the object, name of the label.
_LABELS = {
    "published": "topic",
    "logged": "topic",
    "dropped": "sink",
    "sinks": "sink",
    "corrupt": "kind",
    "skewed": "kind",
    "data_skew": "kind",
}
_INFO = ("state", "port", "probe_id")
_NO_NAME = re.compile(r"[^a-zA-Z0-9_]")

Labels = tuple[tuple[str, str], ...]


class DaemonCounts(msgspec.Struct, frozen=True):
    """Counters beside those of probes: failures by sink, refused clients and messages
    by server and reason, faults of imud's own, and lines of the journal dropped.
    """

    failures: Mapping[str, int] = {}
    refused: Mapping[str, Mapping[str, int]] = {}
    faults: int = 0
    journal_dropped: int = 0


def text_of(statuses: Mapping[str, Mapping[str, Any]], counts: DaemonCounts) -> str:
    """The whole text, one family after the other, as the format requires."""
    families: dict[str, list[tuple[Labels, float]]] = defaultdict(list)
    for name, status in sorted(statuses.items()):
        probe = (("probe", name),)
        for path, labels, value in _numbers(status, "", ()):
            families[f"imud_{path}"].append(((*probe, *labels), value))
        about = tuple((key, str(status.get(key) or "")) for key in _INFO)
        hello = status.get("hello", {})
        boards = tuple((key, str(hello.get(key, ""))) for key in ("board", "firmware"))
        families["imud_probe_info"].append(((*probe, *about, *boards), 1))
    families["imud_info"].append(((("version", version()),), 1))
    for sink, count in sorted(counts.failures.items()):
        families["imud_sink_failures"].append(((("sink", sink),), count))
    for server, reasons in sorted(counts.refused.items()):
        for reason, count in sorted(reasons.items()):
            labels = ("server", server), ("reason", reason)
            families["imud_refused"].append((labels, count))
    families["imud_faults"].append(((), counts.faults))
    families["imud_journal_dropped"].append(((), counts.journal_dropped))
    for name, value in _process():
        families[name].append(((), value))
    return "".join(_family(name, samples) for name, samples in families.items())


def _numbers(
    held: Mapping[str, Any], path: str, labels: Labels
) -> Iterator[tuple[str, Labels, float]]:
    for key, value in held.items():
        inner = "_".join(filter(None, (path, str(key))))
        label = _LABELS.get(key)
        if isinstance(value, bool | int | float):
            yield _NO_NAME.sub("_", inner), labels, value
        elif isinstance(value, Mapping) and label is not None:
            for name, each in value.items():
                own = (*labels, (label, str(name)))
                if isinstance(each, Mapping):
                    yield from _numbers(each, inner, own)
                else:
                    yield from _numbers({"": each}, inner, own)
        elif isinstance(value, Mapping):
            yield from _numbers(value, inner, labels)


def _family(name: str, samples: list[tuple[Labels, float]]) -> str:
    path = name.removeprefix("imud_")
    is_counted = _COUNTED.match(path) or name in _COUNTERS
    lines = [f"# TYPE {name} {'counter' if is_counted else 'gauge'}"]
    for labels, value in samples:
        pairs = ",".join(f'{key}="{_escaped(text)}"' for key, text in labels)
        number = int(value) if isinstance(value, bool) else value
        lines.append(f"{name}{{{pairs}}} {number}" if pairs else f"{name} {number}")
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")


_COUNTERS = frozenset(
    {
        *("imud_sink_failures", "imud_refused", "imud_faults"),
        "imud_journal_dropped",
        "process_cpu_seconds_total",
    }
)


def _process() -> Iterator[tuple[str, float]]:
    """The process itself, under the names that Prometheus clients use."""
    yield "process_cpu_seconds_total", system.cpu_seconds()
    try:
        pages = int(Path("/proc/self/statm").read_text("ascii").split()[1])
        descriptors = len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - names only
    except OSError:
        return
    yield "process_resident_memory_bytes", pages * os.sysconf("SC_PAGE_SIZE")
    yield "process_open_fds", descriptors


class MetricsServer:
    """Serves the latest status of each probe at /metrics."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._address = address
        self._statuses: dict[str, Mapping[str, Any]] = {}  # by id: names may change
        self._counts = DaemonCounts()
        self._clients = 0
        self.refused = Counter[str]()  # by reason
        self._thread = ServerThread("imud-metrics", self._serve)

    @property
    def port(self) -> int:
        """The port in use, which the system chose if 0 was asked for."""
        return self._thread.port or self._address[1]

    def start(self) -> None:
        """Listens, then serves in a thread; ListenFailed where that is not possible."""
        throttle = Throttle(RATE, lambda _: self.refused.update(("rate",)))
        self._thread.start(
            listen(self._address, "metrics", "[metrics] listen", CLIENTS_MAX, throttle)
        )

    def update(self, status: Mapping[str, Any]) -> None:
        self._statuses = {**self._statuses, str(status["probe_id"]): status}

    def forget(self, probe_id: str) -> None:
        self._statuses = {k: v for k, v in self._statuses.items() if k != probe_id}

    def update_counts(self, counts: DaemonCounts) -> None:
        self._counts = counts

    def close(self) -> None:
        self._thread.close()

    @contextlib.asynccontextmanager
    async def _serve(self, listening: socket.socket) -> AsyncIterator[None]:
        async with await asyncio.start_server(
            self._client, sock=listening, limit=HEAD_MAX
        ):
            yield

    async def _client(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._clients += 1
        try:
            if self._clients > CLIENTS_MAX:
                self.refused["clients"] += 1
            else:
                async with asyncio.timeout(REQUEST_S):
                    head = await reader.readuntil(b"\r\n\r\n")
                    writer.write(self._answer(head))
                    await writer.drain()
        except asyncio.LimitOverrunError:
            writer.write(_reply("431 Request Header Fields Too Large"))
        except (OSError, EOFError, TimeoutError):
            pass  # the client left, or is too slow
        finally:
            self._clients -= 1
            writer.close()

    def _answer(self, head: bytes) -> bytes:
        parts = head.partition(b"\r\n")[0].split(b" ")
        if len(parts) != 3 or not parts[2].startswith(b"HTTP/"):
            return _reply("400 Bad Request")
        if not self._is_for_us(head):
            self.refused["host"] += 1
            return _reply("421 Misdirected Request", b"It is not asked for by name.\n")
        method, target, _ = parts
        if method not in (b"GET", b"HEAD"):
            return _reply("405 Method Not Allowed", more="Allow: GET, HEAD\r\n")
        if target.partition(b"?")[0] != b"/metrics":
            return _reply("404 Not Found", b"It is at /metrics.\n")
        by_name = {str(each["probe"]): each for each in self._statuses.values()}
        body = text_of(by_name, self._counts).encode()
        return _reply("200 OK", body, kind=CONTENT_TYPE, is_sent=method == b"GET")

    def _is_for_us(self, head: bytes) -> bool:
        """A web site can have its visitor's browser ask this machine by a name of its
        own. On loopback only names of loopback are taken; elsewhere who reaches the
        address may read.
        """
        if not is_loopback(self._address[0]):
            return True
        lines = head.decode("latin-1").split("\r\n")[1:]
        hosts = [
            text.strip()
            for name, _, text in (line.partition(":") for line in lines)
            if name.lower() == "host"
        ]
        return all(is_loopback(host_of(host)) for host in hosts)


def _reply(
    result: str,
    body: bytes = b"",
    *,
    kind: str = "text/plain; charset=utf-8",
    more: str = "",
    is_sent: bool = True,
) -> bytes:
    head = (
        f"HTTP/1.1 {result}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
        f"{more}Connection: close\r\n\r\n"
    )
    return head.encode("ascii") + (body if is_sent else b"")
