# SPDX-License-Identifier: MIT
"""The site has each page; `make site` checks its links."""

from __future__ import annotations

import re
import runpy

from imud import checkout

DOCS = checkout.ROOT / "docs"


def test_each_page_is_in_the_tree() -> None:
    settings = runpy.run_path(str(checkout.ROOT / "tools" / "website" / "conf.py"))
    named = re.findall(r"^docs/.*$", "".join(settings["tree"]()), re.M)
    pages = [path.relative_to(checkout.ROOT) for path in DOCS.rglob("*.md")]
    assert sorted(named) == sorted(str(page.with_suffix("")) for page in pages)
