# SPDX-License-Identifier: MIT
"""The site has each page; `make site` checks its links."""

from __future__ import annotations

import runpy

from imud import checkout

DOCS = checkout.ROOT / "docs"


def test_each_page_is_in_the_tree() -> None:
    settings = runpy.run_path(str(checkout.ROOT / "tools" / "website" / "conf.py"))
    named = [page for pages in settings["TREE"].values() for page in pages]
    assert sorted(named) == sorted(path.stem for path in DOCS.glob("*.md"))


def test_each_decision_is_listed() -> None:
    listed = (DOCS / "decisions" / "README.md").read_text("utf-8")
    names = {path.name for path in (DOCS / "decisions").glob("0*.md")}
    assert {name for name in names if f"({name})" in listed} == names
