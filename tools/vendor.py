# SPDX-License-Identifier: MIT
"""Makes host/imud/web/vendor/ of the npm packages that tools/web/package.json pins: one
minified ES module a library, its style and its licence. --check compares it with that.

To take up another version: change it in package.json, run `npm install
--package-lock-only` in tools/web/, then this script.
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENDOR = ROOT / "host" / "imud" / "web" / "vendor"
RECIPE = ROOT / "tools" / "web"
MODULES = ROOT / "build" / "web" / "node_modules"
SUMS = "checksums.txt"

# File below vendor/, and what it is made of, below node_modules/.
SCRIPTS = {
    "three/three.module.min.js": "three/build/three.module.js",
    "uplot/uPlot.esm.min.js": "uplot/dist/uPlot.esm.js",
}
COPIES = {
    "three/LICENSE": "three/LICENSE",
    "uplot/LICENSE": "uplot/LICENSE",
    "uplot/uPlot.min.css": "uplot/dist/uPlot.min.css",
}
# Types of the scripts, for TypeScript alone.
TYPES = {
    "three/three.module.min.d.ts": 'export * from "three";\n',
    "uplot/uPlot.esm.min.d.ts": 'export { default } from "uplot";\n',
}


def install() -> None:
    """Has npm install what package-lock.json names; again only if it changed."""
    folder = MODULES.parent
    files = ("package.json", "package-lock.json", ".npmrc", "eslint.config.js")
    wanted = {name: (RECIPE / name).read_bytes() for name in files}
    stamp = folder / "installed"
    digest = hashlib.sha256(b"\0".join(wanted.values())).hexdigest()
    if stamp.exists() and stamp.read_text() == digest:
        return
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in wanted.items():
        (folder / name).write_bytes(content)
    # No package's own script is run.
    subprocess.run(["npm", "ci", "--ignore-scripts"], cwd=folder, check=True)
    stamp.write_text(digest)


def make(folder: Path) -> None:
    """Writes all files of vendor/ into a folder."""
    for name, source in SCRIPTS.items():
        minified(MODULES / source, folder / name)
    for name, source in COPIES.items():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(MODULES / source, target)
    for name, text in TYPES.items():
        (folder / name).write_text(text)
    names = sorted([*SCRIPTS, *COPIES, *TYPES])
    (folder / SUMS).write_text("".join(f"{digest(folder / n)}  {n}\n" for n in names))


def minified(source: Path, target: Path) -> None:
    """One module without imports, which begins with its licence."""
    subprocess.run(
        [
            str(MODULES / ".bin" / "esbuild"),
            str(source),
            "--bundle",
            "--minify",
            "--format=esm",
            "--legal-comments=inline",
            "--log-level=warning",
            f"--outfile={target}",
        ],
        cwd=ROOT,
        check=True,
    )


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def main() -> int:
    parser = argparse.ArgumentParser(prog="tools/vendor.py", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing")
    parser.add_argument("--install", action="store_true", help="only install the tools")
    args = parser.parse_args()
    install()
    if args.install:
        return 0
    if not args.check:
        make(VENDOR)
        return 0
    with tempfile.TemporaryDirectory() as temporary:
        make(Path(temporary))
        wanted = (Path(temporary) / SUMS).read_text()
    if (VENDOR / SUMS).read_text() != wanted:
        sys.stdout.write("vendor/ has other versions: update it with tools/vendor.py\n")
        return 1
    wrong = [
        name
        for line in wanted.splitlines()
        for sha, name in [line.split("  ")]
        if digest(VENDOR / name) != sha
    ]
    sys.stdout.write("".join(f"{name} was changed by hand\n" for name in wrong))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
