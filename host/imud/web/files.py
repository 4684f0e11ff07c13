# SPDX-License-Identifier: MIT
"""The files of the page. Only those that are there when the server starts are served,
each by its own name, so no path leads anywhere else.
"""

from __future__ import annotations

import gzip
import hashlib
from pathlib import Path

import msgspec

HERE = Path(__file__).resolve().parent
KINDS = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}


class File(msgspec.Struct, frozen=True):
    """A file as it goes to browsers."""

    kind: str
    body: bytes
    packed: bytes  # by gzip
    tag: str  # of its content, as an HTTP entity tag


class Files:
    """The files by path: /main.js of site/, /vendor/... of vendor/."""

    def __init__(self, root: Path = HERE) -> None:
        self._paths = {"/": root / "site" / "index.html"}
        for path in sorted((root / "site").rglob("*")):
            self._paths[f"/{path.relative_to(root / 'site').as_posix()}"] = path
        for path in sorted((root / "vendor").rglob("*")):
            self._paths[f"/{path.relative_to(root).as_posix()}"] = path
        self._paths = {
            url: path for url, path in self._paths.items() if path.suffix in KINDS
        }
        self._read: dict[str, tuple[int, File]] = {}

    @property
    def urls(self) -> list[str]:
        """The paths that are served."""
        return list(self._paths)

    def get(self, url: str) -> File | None:
        """The file at that path; None: there is none. Reads it again if it changed."""
        path = self._paths.get(url)
        if path is None:
            return None
        changed_ns = path.stat().st_mtime_ns
        known = self._read.get(url)
        if known is None or known[0] != changed_ns:
            known = changed_ns, _load(path)
            self._read[url] = known
        return known[1]


def _load(path: Path) -> File:
    body = path.read_bytes()
    tag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
    return File(KINDS[path.suffix], body, gzip.compress(body, 6, mtime=0), tag)
