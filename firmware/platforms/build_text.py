# SPDX-License-Identifier: MIT
"""Gives main.c FIRMWARE_BUILD, the text that the probe's hello carries (described.py).
Only main.c is compiled with it, so that a commit rebuilds one file.

Writes manifest.json next to the .hex, which tells `imud flash` what that file is.

Gives the .elf a section with the digest of its sources, which takes no flash: who runs
it can tell whether they have changed since (host/imud/checkout.py)."""

import sys
from pathlib import Path
from typing import Any

BOARDS = {"imu_nano": "nano", "imu_mega": "mega", "imu_f405": "f405"}

Import("env")  # type: ignore[name-defined]  # noqa: F821  SCons puts it there
env: Any = globals()["env"]
root = Path(env.subst("$PROJECT_DIR"))
# Of the project's folder, found only now.
sys.path[:0] = [str(root / "host"), str(root / "firmware" / "platforms")]
import described  # noqa: E402

from imud import checkout  # noqa: E402
from imud.flash.stk500v2 import MONITOR  # noqa: E402


def with_build_text(middleware_env: Any, node: Any) -> Any:
    text = middleware_env.StringifyMacro(described.build_text(root))
    defines = [*middleware_env["CPPDEFINES"], ("FIRMWARE_BUILD", text)]
    return middleware_env.Object(node, CPPDEFINES=defines)


def add_sources(target: Any, source: Any, env: Any) -> int:  # noqa: ARG001, SCons's
    """Put the digest of the sources into a linked image."""
    (elf,) = map(str, target)
    return checkout.note(env.subst("$OBJCOPY"), Path(elf), sources)


def write_manifest(target: Any, source: Any, env: Any) -> str | None:  # noqa: ARG001, SCons's
    """Write the manifest of a .hex; a fault where a bootloader hangs at it."""
    path = Path(str(target[0]))
    chosen = dict(filter(is_pair, env["CPPDEFINES"])).get("ATTITUDE_ONLY", "all")
    records = path.read_text("ascii").splitlines()
    # Intel HEX: records of data.
    data = b"".join(bytes.fromhex(line[9:-2]) for line in records if line[7:9] == "00")
    board = BOARDS[env["BOARD"]]
    row = described.row(root, path, board, chosen, len(data))
    described.write_manifest(path.parent, row)
    is_refused = board == "mega" and MONITOR in data
    return f"an older Mega can't take {MONITOR!r}" if is_refused else None


def is_pair(define: Any) -> bool:
    return isinstance(define, tuple | list) and len(define) == 2


sources = checkout.noted(checkout.BOARD, root)
image = "$BUILD_DIR/${PROGNAME}.elf"
env.AddBuildMiddleware(with_build_text, "*main.c")
env.AddPostAction(image, add_sources)
env.Depends(image, env.Value(sources))
env.AddPostAction("$BUILD_DIR/${PROGNAME}.hex", write_manifest)
