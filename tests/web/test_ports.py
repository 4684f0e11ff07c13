# SPDX-License-Identifier: MIT
"""Ports of the daemon's machine on the page: which are opened, and adopting one."""

from __future__ import annotations

from playwright.sync_api import Browser

from imud.errors import PortRefused
from imud.ports.standing import PortRow
from imud.web.users import TokenHolder
from streaming import until
from web.served import Served


class Ports:
    """Two ports; the first can be adopted."""

    def __init__(self) -> None:
        self.ours: set[str] = set()

    def rows(self) -> list[PortRow]:
        first = "adopted" if "/dev/ttyUSB0" in self.ours else "unknown"
        return [
            PortRow(
                *("/dev/ttyUSB0", "CH340 (1a86:7523)", first, first == "adopted"),
                *("why", ["screen (process 7)"]),
            ),
            PortRow("/dev/ttyUSB1", "FT232R (0403:6001)", "unknown", False, "", []),
            PortRow("/dev/ttyS0", "not USB", "built in", False, "", []),
        ]

    def adopt(self, name: str) -> bool:
        if name != "/dev/ttyUSB0":
            raise PortRefused(f"{name} can't be adopted: a disk is full")
        self.ours.add(name)
        return True

    def release(self, name: str) -> bool:
        self.ours.discard(name)
        return True


def test_a_port_is_adopted_and_released_from_the_page(browser: Browser) -> None:
    ports = Ports()
    with Served(ports=ports) as served:
        page = browser.new_page()
        page.goto(f"{served.page.url}/#/probe")
        page.get_by_role("link", name="Probes").last.click()
        card = page.locator("[data-part=ports]")
        card.get_by_text("screen (process 7)").wait_for()
        assert "/dev/ttyS0" not in card.inner_text()
        button = card.locator('[data-port="/dev/ttyUSB0"]')
        assert button.inner_text() == "Adopt"
        button.click()
        until(lambda: ports.ours == {"/dev/ttyUSB0"})
        until(lambda: button.inner_text() == "Release")
        button.click()
        until(lambda: ports.ours == set())
        # Refused: the page says why.
        card.locator('[data-port="/dev/ttyUSB1"]').click()
        page.get_by_text("can't be adopted: a disk is full").wait_for()
        page.close()


def test_ports_are_for_who_may_command() -> None:
    for role, is_allowed in (("viewer", False), ("operator", True)):
        users = TokenHolder("viewer" if role == "viewer" else "operator")
        with Served(users, ports=Ports()) as served, served.live() as visitor:
            visitor.say(do="login", user="", secret=users.token)
            visitor.say(do="ports", id=1)
            assert bool(visitor.next("answer")["answer"]) == is_allowed
            visitor.say(do="adopt", id=2, port="/dev/ttyUSB0", ours=True)
            assert (visitor.next("answer")["error"] == "") == is_allowed


def test_a_page_for_a_daemon_elsewhere_has_no_ports(served: Served) -> None:
    with served.live() as visitor:
        assert visitor.next("page")["ports"] is False
        visitor.say(do="ports", id=1)
        assert visitor.next("answer")["error"] == "your role may not change ports"
