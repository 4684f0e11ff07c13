# SPDX-License-Identifier: MIT
"""The site has each page, and its links are checked."""

from __future__ import annotations

from pathlib import Path

import pytest
import site_pages

from imud import checkout


def test_each_page_is_in_the_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    told = "".join(site_pages.tree())
    assert "docs/install" in told
    monkeypatch.setitem(site_pages.TREE, "Use", ("install",))
    with pytest.raises(site_pages.BrokenSite, match=r"differ in .*calibration"):
        list(site_pages.tree())


@pytest.mark.parametrize(
    ("page", "link", "there"),
    [
        ("docs/install.md", "../README.md", "../index.md"),
        (
            "docs/decisions/0001-wire.md",
            "../../README.md#limits",
            "../../index.md#limits",
        ),
        ("CONTRIBUTING.md", "README.md", "index.md"),
        ("docs/install.md", "README.md", "README.md"),
        ("docs/decisions/0001-wire.md", "../README.md", "../README.md"),
    ],
)
def test_only_the_readme_of_the_project_is_the_first_page(
    tmp_path: Path, page: str, link: str, there: str
) -> None:
    text = site_pages.with_index(f"see [it]({link}).", tmp_path / page, tmp_path)
    assert text == f"see [it]({there})."


def test_each_decision_is_listed() -> None:
    folder = checkout.ROOT / "docs" / "decisions"
    listed = (folder / "README.md").read_text("utf-8")
    names = {path.name for path in folder.glob("0*.md")}
    assert {name for name in names if f"({name})" in listed} == names


def test_a_picture_that_is_not_there_is_told(tmp_path: Path) -> None:
    page = tmp_path / "index.html"
    page.write_text('<img src="there.png"><a href="https://example.org">x</a>')
    with pytest.raises(site_pages.BrokenSite, match=r"index\.html: there\.png"):
        site_pages.check_pictures(tmp_path)
    (tmp_path / "there.png").touch()
    site_pages.check_pictures(tmp_path)


def test_the_latest_version_comes_first(tmp_path: Path) -> None:
    for name in ("0.9.0", "0.10.0", "0.2.0"):
        (tmp_path / name).mkdir()
    site_pages.list_versions(tmp_path)
    assert "url=0.10.0/" in (tmp_path / "index.html").read_text()
    listed = (tmp_path / "versions.html").read_text()
    assert listed.index("0.10.0") < listed.index("0.9.0") < listed.index("0.2.0")
