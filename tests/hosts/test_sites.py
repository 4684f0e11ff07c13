# SPDX-License-Identifier: MIT
"""Two sites with a router each: whatever breaks between them, every receiver knows its
sequence gaps, and everything recovers automatically.
"""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fakes import Port
from imud.log.reader import Logged
from length import choose
from log_files import read_log
from sites import Desk, Lab, Node, configuration
from streaming import Streaming, until

CUT_S = 1.0

# The daemons of each site.
SITES = choose(
    everyday={"a": ("a1",), "b": ("b1",)}, long={"a": ("a1", "a2"), "b": ("b1", "b2")}
)
ROUTERS = {"a": "router-a", "b": "router-b"}


class Sites:
    """Routers, daemons, a consumer at each site and a recorder."""

    def __init__(self, lab: Lab, directory: Path) -> None:
        self.lab = lab
        self.directory = directory
        self.routers: dict[str, Node] = {}
        for site in ("b", "a"):  # router-a connects to router-b
            self.start_router(site)
        self.desks = [
            Desk(lab, host, self._file(f"site-{site}.toml"), number)
            for number, (site, host) in enumerate(
                (site, host) for site, hosts in SITES.items() for host in hosts
            )
        ]
        self.consumers = {
            site: lab.consumer(router, router) for site, router in ROUTERS.items()
        }
        self.kept = directory / "kept"
        self.recorder = lab.recorder("router-b", "router-b", self.kept)
        self.wait_until_all_hear()

    def _file(self, name: str) -> Path:
        return configuration(name, self.lab.addresses, self.directory)

    def start_router(self, site: str) -> None:
        router = ROUTERS[site]
        self.routers[site] = self.lab.router(router, self._file(f"{router}.json5"))

    def counts_at(self, site: str) -> dict[str, int]:
        """How many poses of each probe a consumer has got."""
        counts = self.consumers[site].ask()
        return {probe: of["got"] for probe, of in counts.items()}

    def wait_until_all_hear(self) -> float:
        """Waits until each consumer gets poses of each probe; seconds that it took."""
        return self.wait_until_heard(*self.desks)

    def wait_until_heard(self, *desks: Desk) -> float:
        """Of these desks' probes."""
        before = {site: self.counts_at(site) for site in self.consumers}

        def is_heard() -> bool:
            return all(
                self.counts_at(site).get(desk.name, 0) > before[site].get(desk.name, 0)
                for site in self.consumers
                for desk in desks
            )

        return until(is_heard)

    def assert_all_is_accounted_for(self) -> int:
        """Ends the streams; returns how many poses were missed."""
        missed = 0
        for desk in self.desks:
            desk.stream.stop()
        sent = {desk.name: desk.stream.sent for desk in self.desks}
        for consumer in self.consumers.values():

            def has_the_last(consumer: Node = consumer) -> bool:
                counts = consumer.ask()
                return all(counts[name]["last"] == sent[name] for name in sent)

            until(has_the_last)
            for name, of in consumer.ask().items():
                assert of["is_rising"]
                assert sent[name] - of["first"] + 1 - of["got"] == of["missed"]
                missed += of["missed"]
        self._assert_all_is_recorded(sent)
        return missed

    def _assert_all_is_recorded(self, sent: dict[str, int]) -> None:
        counts = self.recorder.finish()
        (path,) = self.kept.glob("*.mcap")
        numbers: dict[str, list[int]] = {name: [] for name in sent}
        gaps = dict.fromkeys(sent, 0)
        for each in read_log(path):
            if not isinstance(each, Logged) or not each.t_ns:
                continue
            if each.topic == "pose":
                numbers[each.probe].append(json.loads(each.data)["number"])
            elif each.topic == "gap":
                gaps[each.probe] += json.loads(each.data)["network"]
        for name, of in counts.items():
            heard = numbers[name]
            assert of["unwritten"] == 0
            assert of["last"]["pose"] == heard[-1] == sent[name]
            lost = sent[name] - heard[0] + 1 - len(heard)
            assert of["missed"]["network"] == gaps[name] == lost

    def assert_a_probe_can_move(self, leaver: Desk, taker: Desk) -> None:
        """Its subscribers hear it continue, on the same key, and know of the move."""
        before = leaver.stream.sent
        self._move(leaver, taker)
        self.wait_until_heard(leaver)
        leaver.stream.stop()
        sent = leaver.stream.sent
        for consumer in self.consumers.values():

            def has_the_last(consumer: Node = consumer) -> bool:
                return bool(consumer.ask()[leaver.name]["last"] == sent)

            until(has_the_last)
            of = consumer.ask()[leaver.name]
            assert of["restarts"] == 1
            # The daemon that took it counts from 1.
            assert before - of["first"] + 1 + sent == of["got"] + of["missed"]

    def _move(self, leaver: Desk, taker: Desk) -> None:
        """Unplugs a probe, and plugs it in at another host, where it continues."""
        leaver.stream.stop()
        leaver.port.vanish()
        leaver.port = Port(taker.spare)
        leaver.port.wait_open()
        leaver.port.write(leaver.probe.say("hello"))
        taker.daemon.expect(f"probe {leaver.name} found on {taker.spare}")
        leaver.stream = Streaming(leaver.port, leaver.probe, period_s=0.02)


@pytest.fixture
def sites(tmp_path: Path) -> Iterator[Sites]:
    hosts = [host for hosts in SITES.values() for host in hosts]
    with Lab(*ROUTERS.values(), *hosts) as lab:
        made: list[Desk] = []
        try:
            built = Sites(lab, tmp_path)
            made = built.desks
            yield built
        finally:
            for desk in made:
                desk.__exit__()


def cut_both_ways(sites: Sites) -> None:
    for ways in (("router-a", "router-b"), ("router-b", "router-a")):
        sites.lab.cut(*ways)
    time.sleep(CUT_S)  # the fault lasts
    for ways in (("router-a", "router-b"), ("router-b", "router-a")):
        sites.lab.heal(*ways)


def cut_one_way(sites: Sites) -> None:
    sites.lab.cut("router-a", "router-b")
    time.sleep(CUT_S)  # the fault lasts
    sites.lab.heal("router-a", "router-b")


def cut_for_longer_than_a_lease(sites: Sites) -> None:
    """Zenoh gives a silent link up after 10 s."""
    sites.lab.cut("router-b", "router-a")
    time.sleep(12.0)  # longer than a lease
    sites.lab.heal("router-b", "router-a")


def cut_off_a_host(sites: Sites) -> None:
    """Also for longer than a lease: its daemon opens another session."""
    host = next(iter(SITES["a"]))
    for ways in ((host, "router-a"), ("router-a", host)):
        sites.lab.cut(*ways)
    time.sleep(12.0)  # longer than a lease
    for ways in ((host, "router-a"), ("router-a", host)):
        sites.lab.heal(*ways)


def kill_a_router(sites: Sites) -> None:
    sites.routers["a"].process.kill()
    sites.routers["a"].process.wait()
    sites.start_router("a")


def freeze_a_daemon(sites: Sites) -> None:
    process = sites.desks[0].daemon.process
    process.send_signal(signal.SIGSTOP)
    time.sleep(CUT_S)  # the fault lasts
    process.send_signal(signal.SIGCONT)


FAULTS: tuple[Callable[[Sites], None], ...] = choose(
    everyday=(cut_both_ways,),
    long=(
        cut_both_ways,
        cut_one_way,
        kill_a_router,
        freeze_a_daemon,
        cut_off_a_host,
        cut_for_longer_than_a_lease,
    ),
)


@pytest.mark.long
def test_what_is_lost_between_sites_is_known_by_number(
    sites: Sites, record_property: Callable[[str, object], None]
) -> None:
    for fault in FAULTS:
        fault(sites)
        record_property(fault.__name__, sites.wait_until_all_hear())
    record_property("missed", sites.assert_all_is_accounted_for())
    sites.assert_a_probe_can_move(sites.desks[0], sites.desks[-1])
