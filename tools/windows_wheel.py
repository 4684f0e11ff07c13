# SPDX-License-Identifier: MIT
"""Makes the wheel for Windows of the one for Linux: the same Python, and the C core
built by Debian's compiler for Windows.

It needs nothing of a Windows machine: Python's limited API (PEP 384) is the same
functions on all systems, the headers are this Python's but for pyconfig.h, and the
library to link with is made of the names that the core uses. No machine of ours has run
it.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

from auditwheel.wheeltools import InWheel

from imud import checkout

CROSS = "x86_64-w64-mingw32-"
TAG = "cp311-abi3-win_amd64"
MODULE = "imud/_core.pyd"
LIMITED_API = "0x030b0000"  # 3.11, as CMakeLists.txt has it

# What Python's headers ask of a system, for 64 bits: PC/pyconfig.h of its sources says
# more, which the limited API does not use.
PYCONFIG = """\
#define MS_WIN32 1
#define MS_WIN64 1
#define MS_WINDOWS 1
#define SIZEOF_INT 4
#define SIZEOF_LONG 4
#define SIZEOF_LONG_LONG 8
#define SIZEOF_VOID_P 8
#define SIZEOF_SIZE_T 8
#define SIZEOF_WCHAR_T 2
#define SIZEOF_PID_T 4
#define ALIGNOF_MAX_ALIGN_T 8
#define HAVE_DECLSPEC_DLL 1
#define HAVE_STDDEF_H 1
#define HAVE_SYS_STAT_H 1
#define HAVE_SYS_TYPES_H 1
#define HAVE_WCHAR_H 1
#define Py_ENABLE_SHARED 1
"""
# Libraries that every Windows 10 has, and the one of each Python.
SYSTEMS = {"kernel32.dll", "msvcrt.dll", "python3.dll"}
CRT = "api-ms-win-crt-"  # of other builds of the same compiler


class WindowsError(Exception):
    """The wheel can't be made: why."""


def make(linux: Path, source: Path, folder: Path) -> Path:
    """The wheel, in a folder; WindowsError if its module would not be loaded."""
    version = linux.name.split("-")[1]
    made = folder / f"imu_probe-{version}-{TAG}.whl"
    with tempfile.TemporaryDirectory() as room:
        module = build(source, Path(room))
        check(module)
        with InWheel(linux, made) as root:
            for path in Path(root).glob("imud/_core*.so"):
                path.unlink()
            for path in Path(root).glob("*.libs"):
                shutil.rmtree(path)
            shutil.copy(module, Path(root) / MODULE)
            (about,) = Path(root).glob("*.dist-info/WHEEL")
            text = re.sub(r"(?m)^Tag: .*\n", "", about.read_text())
            about.write_text(f"{text.rstrip()}\nTag: {TAG}\n")
    return made


def build(source: Path, room: Path) -> Path:
    """imud._core for Windows."""
    headers = room / "include"
    shutil.copytree(sysconfig.get_path("include"), headers)
    (headers / "pyconfig.h").write_text(PYCONFIG)
    sources = checkout.digest(checkout.CORE)  # by which a module is told
    words = (
        *("-std=c11", "-O2", "-ffp-contract=off", "-DNDEBUG"),
        *(f"-DPy_LIMITED_API={LIMITED_API}", f'-DIMUD_SOURCES="{sources}"'),
        *(f"-I{headers}", f"-I{source / 'firmware'}"),
        *(f"-ffile-prefix-map={source}=.", f"-ffile-prefix-map={room}=."),
        *("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"),
    )
    objects: list[Path] = []
    for folder in ("host/imud/native", "firmware/core"):
        for path in sorted((source / folder).rglob("*.c")):
            objects.append(room / f"{len(objects)}.o")
            _run(f"{CROSS}gcc", *words, "-c", path, "-o", objects[-1])
    wanted = _run(f"{CROSS}nm", "--undefined-only", *objects)
    names = sorted(set(re.findall(r"\bU (?:__imp_)?(_?Py\w+)", wanted)))
    definition = room / "python3.def"
    listed = "".join(f"{name}\n" for name in names)
    definition.write_text(f"LIBRARY python3.dll\nEXPORTS\n{listed}")
    library = room / "libpython3.a"
    _run(f"{CROSS}dlltool", "-d", definition, "-l", library)
    module = room / "_core.pyd"
    _run(
        f"{CROSS}gcc",
        *("-shared", "-static-libgcc", "-s", "-Wl,--no-insert-timestamp"),
        *("-o", module, *objects, library),
    )
    return module


def check(module: Path) -> None:
    """Checks that it imports only DLLs of Windows and Python, and starts as a
    module."""
    told = _run(f"{CROSS}objdump", "-p", module)
    needed = {name.lower() for name in re.findall(r"DLL Name: (\S+)", told)}
    other = {each for each in needed - SYSTEMS if not each.startswith(CRT)}
    if other:
        raise WindowsError(f"it needs {', '.join(sorted(other))}")
    if "PyInit__core" not in told:
        raise WindowsError("it has no PyInit__core")


def _run(*words: object) -> str:
    try:
        done = subprocess.run(
            [*map(str, words)], capture_output=True, text=True, check=False
        )
    except FileNotFoundError as error:
        raise WindowsError(
            f"{words[0]} is missing: apt install gcc-mingw-w64-x86-64-win32"
        ) from error
    if done.returncode != 0:
        raise WindowsError(f"{words[0]}: {done.stderr.strip()}")
    return done.stdout


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("linux", metavar="WHEEL", type=Path, help="the one for Linux")
    parser.add_argument("source", type=Path, help="source folder of its build")
    parser.add_argument("folder", type=Path, help="folder for the new one")
    args = parser.parse_args()
    try:
        make(args.linux, args.source, args.folder)
    except WindowsError as error:
        sys.stderr.write(f"windows_wheel: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
