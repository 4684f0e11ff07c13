# SPDX-License-Identifier: MIT
"""What the tests of the page share: its server, and a browser."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest

from web.served import Served


@pytest.fixture
def served() -> Iterator[Served]:
    made = Served()
    with contextlib.closing(made.page):
        yield made
