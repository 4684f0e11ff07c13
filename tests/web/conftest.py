# SPDX-License-Identifier: MIT
"""Shared by the tests of the page: its server alone, a browser, and both together."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, sync_playwright

from chromium import CHROMIUM
from web.desk import ARGUMENTS, Desk, Seen, seen
from web.served import Served


@pytest.fixture
def served() -> Iterator[Served]:
    with Served() as made:
        yield made


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """The system's Chromium, one for all tests of a file."""
    if CHROMIUM is None:
        # As on Ubuntu, which has no package of it: docs/limits.md.
        pytest.skip("chromium is not there")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=CHROMIUM, args=[*ARGUMENTS]
        )
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """A probe and a daemon that serves the page, for all tests of a file."""
    with Desk(tmp_path_factory.mktemp("desk")) as made:
        yield made


@pytest.fixture(scope="module")
def shown(browser: Browser, desk: Desk) -> Iterator[Seen]:
    """Their page in the browser."""
    with seen(browser, desk) as found:
        yield found
