# SPDX-License-Identifier: MIT
"""Builds the site from README.md and docs/ with Sphinx: search, a tree of pages, links
that are checked, a folder for each version. What is broken fails it.
"""

from __future__ import annotations

import argparse
import html
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PLACE = ROOT / "build" / "site"
PICTURES = Path("docs/pictures")

# Pages as people look for them; each page of docs/ is in one of these.
TREE = {
    "Start": ("README", "safety", "install"),
    "Use": (
        *("build", "flash", "first-contact", "check", "imud", "page"),
        *("calibration", "calibration-methods", "testplan"),
        *("tip", "strokes", "strokes-methods", "limb", "limb-methods", "params"),
        *("logs", "import", "card", "glossary"),
    ),
    "Poses in your program": (
        *("pose", "status", "since-origin", "subscribe", "languages", "stream", "ros2"),
        *("slicer", "angles", "clock", "fleet"),
    ),
    "Boards": (
        *("nano", "mega", "f405", "pico", "micropython"),
        *("udp", "ports", "no-port"),
    ),
    "How far to trust it": (
        *("limits", "accuracy", "honesty", "motions", "faults", "twin"),
        *("fuse-on-host", "security", "proof"),
    ),
    "Develop": ("architecture", "change", "followed", "motion-files"),
}
# Beside docs/.
OTHERS = (
    *("protocol/PROTOCOL.md", "hardware/README.md", "CONTRIBUTING.md"),
    *("SECURITY.md", "CHANGELOG.md"),
)
# Files that pages link to, and that are given as they are.
GIVEN = (
    *("examples", "benchmarks/results", "tests/test_house.py", "LICENSE"),
    "firmware/micropython/pico/main.py",
)

CONF = """\
project = "imu-probe"
author = "imu-probe authors"
release = {version!r}
extensions = ["myst_parser"]
html_theme = "furo"
html_title = "imu-probe {version}"
html_show_sourcelink = False
html_copy_source = False
html_last_updated_fmt = None
templates_path = ["templates"]
html_theme_options = {{"navigation_with_keys": True}}
html_sidebars = {{
    "**": [
        *("sidebar/brand.html", "sidebar/search.html", "sidebar/scroll-start.html"),
        *("sidebar/navigation.html", "versions.html", "sidebar/scroll-end.html"),
    ]
}}
myst_heading_anchors = 5
suppress_warnings = ["misc.highlighting_failure"]
exclude_patterns = ["templates"]
"""
VERSIONS = """\
<div class="sidebar-tree"><ul><li class="toctree-l1">
<a class="reference internal" href="{{ pathto('', 1) }}../versions.html">
All versions</a></li></ul></div>
"""


class BrokenSite(Exception):
    """It can't be built; the message says why."""


def stage(source: Path, version: str) -> None:
    """The pages as they lie in the project, so that their links hold, with a tree."""
    shutil.rmtree(source, ignore_errors=True)
    (source / "templates").mkdir(parents=True)
    shutil.copytree(ROOT / "docs", source / "docs")
    for name in (*OTHERS, *GIVEN):
        path = ROOT / name
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if path.is_dir() else shutil.copy)(path, source / name)
    text = (ROOT / "README.md").read_text("utf-8")
    (source / "index.md").write_text(text + "\n" + "".join(tree()), "utf-8")
    (source / "conf.py").write_text(CONF.format(version=version))
    (source / "templates" / "versions.html").write_text(VERSIONS)
    for page in source.rglob("*.md"):
        page.write_text(with_index(page.read_text("utf-8"), page, source), "utf-8")


def with_index(text: str, page: Path, source: Path) -> str:
    """The text of a page, whose links to the README lead to the site's first page."""

    def renamed(link: re.Match[str]) -> str:
        target = (page.parent / link[1] / "README.md").resolve()
        is_first = target == (source / "README.md").resolve()
        return f"]({link[1]}index.md" if is_first else link[0]

    return re.sub(r"\]\(((?:\.\./)*)README\.md", renamed, text)


def tree() -> Iterator[str]:
    """The tables of contents, which show beside each page. BrokenSite if a page is in
    none of them.
    """
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")}
    named = {page for pages in TREE.values() for page in pages}
    if pages != named:
        raise BrokenSite(
            "TREE in tools/site_pages.py and docs/ differ in "
            f"{', '.join(sorted(pages ^ named))}"
        )
    for title, names in TREE.items():
        files = [f"docs/{name}" for name in names]
        if title == "Develop":
            files += [name.removesuffix(".md") for name in OTHERS]
            files.append("docs/decisions/README")
            decisions = sorted((ROOT / "docs" / "decisions").glob("0*.md"))
            files += [f"docs/decisions/{path.stem}" for path in decisions]
        listed = "\n".join(files)
        yield f"\n```{{toctree}}\n:caption: {title}\n:hidden:\n\n{listed}\n```\n"


def build(source: Path, site: Path, version: str) -> None:
    """One version into its folder of a site."""
    folder = site / version
    shutil.rmtree(folder, ignore_errors=True)
    words = ("-q", "-W", "--keep-going", "-b", "html", str(source), str(folder))
    done = subprocess.run([sys.executable, "-m", "sphinx", *words], check=False)
    if done.returncode != 0:
        raise BrokenSite("the site has broken links or pages; see above")
    # Raw HTML names them, which Sphinx leaves alone.
    shutil.copytree(ROOT / PICTURES, folder / PICTURES, dirs_exist_ok=True)
    shutil.rmtree(folder / ".doctrees", ignore_errors=True)
    check_pictures(folder)
    list_versions(site)


def check_pictures(folder: Path) -> None:
    """BrokenSite if a page shows or links a file of the site that is not there."""
    missing = set()
    for page in folder.rglob("*.html"):
        text = page.read_text("utf-8")
        for found in re.findall(r"""(?:src|srcset|href)=["']([^"'#?]+)""", text):
            name = html.unescape(found)
            if "://" in name or name.startswith(("mailto:", "data:")):
                continue
            target = page.parent / name
            if target.name != "versions.html" and not target.exists():
                missing.add(f"{page.relative_to(folder)}: {name}")
    if missing:
        raise BrokenSite("not there: " + "; ".join(sorted(missing)[:20]))


def list_versions(site: Path) -> None:
    """A page with all versions, and a first page that leads to the latest."""
    versions = sorted(
        (path.name for path in site.iterdir() if path.is_dir()),
        key=lambda name: [int(each) for each in re.findall(r"\d+", name)],
        reverse=True,
    )
    links = "".join(f'<li><a href="{each}/">{each}</a></li>\n' for each in versions)
    head = "<!doctype html><meta charset=utf-8><title>imu-probe</title>\n"
    (site / "versions.html").write_text(
        f"{head}<h1>Versions</h1>\n<ul>\n{links}</ul>\n"
    )
    to = f'<meta http-equiv="refresh" content="0; url={versions[0]}/">'
    (site / "index.html").write_text(
        f"{head}{to}\n<a href={versions[0]}/>imu-probe</a>\n"
    )


def main() -> int:
    from release import version_of

    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: python tools/site_pages.py"
    )
    parser.add_argument(
        "--into",
        type=Path,
        default=PLACE / "html",
        help="folder of the site, which may have other versions (default: %(default)s)",
    )
    args = parser.parse_args()
    version = version_of(ROOT)
    try:
        args.into.mkdir(parents=True, exist_ok=True)
        stage(PLACE / "source", version)
        build(PLACE / "source", args.into, version)
    except BrokenSite as error:
        sys.stderr.write(f"site: {error}\n")
        return 1
    sys.stdout.write(f"{args.into / version / 'index.html'}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
