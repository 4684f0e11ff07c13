# SPDX-License-Identifier: MIT
"""Ids that are gone longest make room, those that said little first."""

from __future__ import annotations

from imud.config.settings import Config
from imud.daemon.registry import FORGET_NS, Registry
from imud.defaults import PROBES_MAX


def test_made_up_ids_make_room_for_a_probe_and_a_real_one_is_kept() -> None:
    registry = Registry(Config())
    for number in range(PROBES_MAX):
        entry = registry.add(f"{number:016x}")
        entry.heard_ns = number
    real = registry["0" * 16]
    real.received = 5000
    assert not registry.has_room("f" * 16)
    assert registry.forget(FORGET_NS // 2) is None
    gone = registry.forget(2 * FORGET_NS)
    assert gone.probe.probe_id == f"{1:016x}"
    assert registry.has_room("f" * 16)
    assert registry.named(real.name) is real
    assert registry.named(gone.name) is None


def test_a_probe_that_is_on_a_port_is_never_forgotten() -> None:
    registry = Registry(Config())
    entry = registry.add("0" * 16)

    class Port:
        name = "p"
        session = None
        baud = 1

        def write(self, data: bytes) -> None: ...
        def listen_again(self) -> None: ...

    entry.port = Port()
    assert registry.forget(10 * FORGET_NS) is None
