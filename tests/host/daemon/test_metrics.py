# SPDX-License-Identifier: MIT
"""Metrics: every number of the status, as another implementation reads them; and a
server that no request harms.
"""

from __future__ import annotations

import http.client
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families

from imud.daemon import metrics
from imud.daemon.metrics import HEAD_MAX, DaemonCounts, MetricsServer, text_of
from imud.throttle import Rate
from length import examples

STATUS: dict[str, Any] = {
    "probe": 'sty"l\\us\n',
    "probe_id": "00112233445566aa",
    "state": "streaming",
    "port": None,
    "pose_rate_hz": 99.8,
    "quality": {"tilt_sigma_deg": 0.37, "heading_sigma_deg": None, "flags": ["x"]},
    "ledger": {
        "received": 7,
        "corrupt": 2,
        "adds_up": True,
        "published": {"pose": 5, "raw": 6},
        "sinks": {"log": {"taken": 3, "waiting": 1}},
    },
    "clock": {"data_skew": {"tag": 4}},
    "hello": {"board": "nano", "firmware": "0.1.0", "acc_lsb": 0.5},
}


def values(text: str) -> dict[tuple[str, tuple[str, ...]], float]:
    """By name and labels, those that are not the probe's name."""
    return {
        (
            sample.name,
            tuple(v for k, v in sorted(sample.labels.items()) if k != "probe"),
        ): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_every_number_is_there_and_is_read_by_another_implementation() -> None:
    text = text_of(
        {STATUS["probe"]: STATUS},
        DaemonCounts({"log": 2}, {"web": {"host": 3}}, 4),
    )
    found = values(text)
    for name, labels, value in (
        ("imud_pose_rate_hz", (), 99.8),
        ("imud_quality_tilt_sigma_deg", (), 0.37),
        ("imud_ledger_received_total", (), 7),
        ("imud_ledger_corrupt_total", (), 2),
        ("imud_ledger_published_total", ("pose",), 5),
        ("imud_ledger_published_total", ("raw",), 6),
        ("imud_ledger_sinks_taken_total", ("log",), 3),
        ("imud_ledger_sinks_waiting", ("log",), 1),
        ("imud_ledger_adds_up", (), 1),
        ("imud_clock_data_skew_total", ("tag",), 4),
        ("imud_hello_acc_lsb", (), 0.5),
        ("imud_sink_failures_total", ("log",), 2),
    ):
        plain = found.get((name, labels), found.get((name[:-6], labels)))
        assert plain == value, name
    assert found["process_resident_memory_bytes", ()] > 1e6
    names = {
        sample.labels["probe"]
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if "probe" in sample.labels
    }
    assert names == {STATUS["probe"]}


def test_counts_are_counters_and_states_are_gauges() -> None:
    types = {
        family.name: family.type
        for family in text_string_to_metric_families(
            text_of({"a": STATUS}, DaemonCounts())
        )
    }
    assert types["imud_ledger_received"] == "counter"
    assert types["imud_ledger_published"] == "counter"
    assert types["imud_ledger_sinks_waiting"] == "gauge"
    assert types["imud_ledger_adds_up"] == "gauge"
    assert types["imud_pose_rate_hz"] == "gauge"


@pytest.fixture(scope="module")
def served() -> Iterator[MetricsServer]:
    served = MetricsServer(("127.0.0.1", 0))
    with pytest.MonkeyPatch.context() as patch:
        # These tests ask oftener than any Prometheus: tests/host/test_throttle.py.
        patch.setattr(metrics, "RATE", Rate(at_once=10_000, a_second=1000.0))
        served.start()
    served.update(STATUS)
    try:
        yield served
    finally:
        served.close()


def ask(server: MetricsServer, data: bytes) -> bytes:
    """All that the server says to these bytes, after which nothing more comes."""
    with socket.create_connection(("127.0.0.1", server.port), 10) as end:
        try:
            end.sendall(data)
            end.shutdown(socket.SHUT_WR)
            answer = b""
            while part := end.recv(65536):
                answer += part
        except (ConnectionError, OSError):
            return b""
    return answer


def assert_serves(server: MetricsServer) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.port)
    connection.request("GET", "/metrics")
    response = connection.getresponse()
    assert response.status == 200
    assert "imud_pose_rate_hz" in response.read().decode()
    connection.close()


@pytest.mark.parametrize(
    ("request_line", "status"),
    [
        (b"GET /metrics HTTP/1.1", b"200"),
        (b"HEAD /metrics?x=1 HTTP/1.0", b"200"),
        (b"GET / HTTP/1.1", b"404"),
        (b"GET /metrics/../etc HTTP/1.1", b"404"),
        (b"POST /metrics HTTP/1.1", b"405"),
        (b"GET /metrics", b"400"),
        (b"\xff\xfe", b"400"),
    ],
)
def test_a_request_has_its_answer(
    served: MetricsServer, request_line: bytes, status: bytes
) -> None:
    answer = ask(served, request_line + b"\r\nHost: localhost\r\n\r\n")
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.split()[1] == status
    assert (b"imud_" in body) == (request_line.startswith(b"GET") and status == b"200")


@pytest.mark.parametrize(
    ("host", "status"),
    [
        (b"Host: 127.0.0.1:9735", b"200"),
        (b"host: [::1]:9735", b"200"),
        (b"Host: LOCALHOST:1", b"200"),
        (b"Host: evil.example", b"421"),
        (b"Host: evil.example:9735", b"421"),
        (b"Host: localhost\r\nHost: evil.example", b"421"),
    ],
)
def test_a_name_of_a_web_site_is_not_answered(
    served: MetricsServer, host: bytes, status: bytes
) -> None:
    """A page could have its visitor's browser read what the daemon knows."""
    before = served.refused["host"]
    answer = ask(served, b"GET /metrics HTTP/1.1\r\n" + host + b"\r\n\r\n")
    assert answer.split()[1] == status
    assert served.refused["host"] - before == (status == b"421")


@given(st.binary(max_size=300))
@settings(
    max_examples=examples(60),
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_no_bytes_harm_it(served: MetricsServer, data: bytes) -> None:
    answer = ask(served, data + b"\r\n\r\n")
    assert not answer or answer.startswith(b"HTTP/1.1 ")


def test_a_head_without_end_is_refused_and_idle_clients_are_let_go(
    served: MetricsServer,
) -> None:
    assert ask(served, b"GET /metrics HTTP/1.1\r\nX: " + b"x" * 2 * HEAD_MAX)[:13] in (
        b"HTTP/1.1 431 ",
        b"",  # reset while it still sent
    )
    idle = [socket.create_connection(("127.0.0.1", served.port)) for _ in range(15)]
    assert_serves(served)
    for end in idle:
        end.settimeout(10)
        assert end.recv(1) == b""  # after REQUEST_S
        end.close()
    assert_serves(served)
