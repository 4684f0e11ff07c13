# SPDX-License-Identifier: MIT
"""How Sphinx makes the site of README.md and docs/, as they lie in the project: search,
a tree of pages, links that are checked, a folder for each version. `make site` runs it.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from imud.web import packed

ROOT = Path(__file__).resolve().parent.parent.parent
PICTURES = "docs/pictures"

# Its sections, with the pages that they name, are the tables of contents of the site.
INDEX = ROOT / "docs" / "README.md"
# Beside docs/.
OTHERS = (
    *("protocol/PROTOCOL.md", "hardware/README.md", "CONTRIBUTING.md"),
    *("SECURITY.md", "CHANGELOG.md"),
)

project = "imu-probe"
author = "imu-probe authors"
release = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
    "version"
]
extensions = ["myst_parser"]
root_doc = "README"
include_patterns = ["README.md", "docs/**.md", *OTHERS]
templates_path = ["templates"]
html_theme = "furo"
html_title = f"imu-probe {release}"
html_show_sourcelink = False
html_copy_source = False
html_last_updated_fmt = None
html_theme_options = {"navigation_with_keys": True}
html_search_scorer = str(ROOT / "tools" / "website" / "scorer.js")
html_sidebars = {
    "**": [
        *("sidebar/brand.html", "sidebar/search.html", "sidebar/scroll-start.html"),
        *("sidebar/navigation.html", "versions.html", "sidebar/scroll-end.html"),
    ]
}
myst_heading_anchors = 5
suppress_warnings = ["misc.highlighting_failure"]


def setup(app: Any) -> None:
    """Sphinx calls this."""
    app.connect("source-read", add_tree)
    app.connect("build-finished", finish)


def add_tree(_app: Any, name: str, source: list[str]) -> None:
    """Puts the tables of contents, which show beside each page, below the first page;
    Sphinx fails if a page is in none of them.
    """
    if name == root_doc:
        source[0] += "".join(tree())


def tree() -> Iterator[str]:
    listed: set[Path] = set()
    for section in INDEX.read_text("utf-8").split("\n## ")[1:]:
        title = section.partition("\n")[0]
        links = re.findall(r"\]\(([\w./-]+\.md)\)", section)
        paths = [INDEX, *((INDEX.parent / link).resolve() for link in links)]
        if title == "Develop":
            paths += [ROOT / name for name in OTHERS]
        paths = [path for path in dict.fromkeys(paths) if path not in listed]
        listed.update(paths)
        files = "\n".join(str(path.relative_to(ROOT).with_suffix("")) for path in paths)
        if files:
            yield f"\n```{{toctree}}\n:caption: {title}\n:hidden:\n\n{files}\n```\n"


def finish(app: Any, error: Exception | None) -> None:
    """Adds what Sphinx leaves out: pictures that raw HTML names, a first page of the
    usual name, the page that reads a probe without a daemon, and a page with all
    versions, of which the latest comes first.
    """
    if error is not None:
        return
    folder = Path(app.outdir)
    shutil.copytree(ROOT / PICTURES, folder / PICTURES, dirs_exist_ok=True)
    shutil.copy(folder / f"{root_doc}.html", folder / "index.html")
    packed.write(folder / "page")
    names = [path.name for path in folder.parent.iterdir() if path.is_dir()]
    names.sort(
        key=lambda name: [int(n) for n in re.findall(r"\d+", name)], reverse=True
    )
    links = "".join(f'<li><a href="{name}/">{name}</a></li>\n' for name in names)
    (folder.parent / "index.html").write_text(
        "<!doctype html><meta charset=utf-8><title>imu-probe</title>\n"
        f"<h1>Versions</h1>\n<ul>\n{links}</ul>\n"
    )
