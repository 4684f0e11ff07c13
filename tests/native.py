# SPDX-License-Identifier: MIT
"""The firmware's C as a cffi library, compiled for this machine under sanitizers.

Prototypes, structs and enums are read from the headers, so that tests always use the
firmware's own layout.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import importlib.util
import io
import os
import re
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import compress
from pathlib import Path
from typing import Any

import cffi

from prototypes import NativeBuildError, declarations

ROOT = Path(__file__).resolve().parent.parent
CORE = ROOT / "firmware" / "core"
CHIPS = ROOT / "sim" / "chips"
CACHE = ROOT / "build" / "native"
OWN = (Path(__file__), Path(__file__).with_name("prototypes.py"))

# With the core and the chips' models in the library of load(): a library of their own
# would take seconds to build. Each has a header.
BESIDE = (
    *("firmware/generic/bus_recovery", "firmware/generic/identity"),
    *("firmware/generic/journal", "sim/run/motion"),
    *("tests/core/loops", "tests/generic/lines"),
)
BESIDE_HEADERS = ("firmware/generic/slots.h",)

WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror")

PLAIN = ("-std=gnu11", "-O1", "-g1", "-fPIC")
# Needed when compiling: given to the linker alone, -fsanitize instruments nothing.
UNDEFINED = ("-fsanitize=undefined", "-fno-sanitize-recover=undefined")
ADDRESS = ("-fsanitize=address", "-fno-omit-frame-pointer")

_preloaded: dict[str, str] = {}


def sanitizers() -> tuple[str, ...]:
    """The sanitizers' compiler flags, none for `make coverage`; IMU_ASAN=1 adds the
    address sanitizer, with which the interpreter must have been started (Makefile).
    """
    if coverage():
        return ()
    if os.environ.get("IMU_ASAN") == "1":
        return (*UNDEFINED, *ADDRESS)
    return UNDEFINED


def keep_sanitizer() -> None:
    """Remove LD_PRELOAD, so that child processes run without the address sanitizer."""
    if preloaded := os.environ.pop("LD_PRELOAD", None):
        _preloaded["LD_PRELOAD"] = preloaded


def ease_large_arrays() -> None:
    """Take numpy's large arrays from the C library in this process, which has the
    address sanitizer: large_arrays.c.
    """
    import ctypes
    import sysconfig

    import numpy as np

    source = Path(__file__).with_name("large_arrays.c")
    folders = (sysconfig.get_path("include"), np.get_include())
    words = ["gcc", "-O1", "-shared", "-fPIC", *ADDRESS, str(source)]
    words += [f"-I{folder}" for folder in folders]
    name = _Build._digest(source, text=" ".join(words))

    def build(made: Path) -> None:
        _run(*words, "-o", str(made))

    library = _Build._built(CACHE / f"large_arrays-{name}.so", build)
    assert ctypes.PyDLL(str(library)).large_arrays_use() == 0


def environment() -> dict[str, str]:
    """The environment for a child process that calls load() itself."""
    return os.environ | _preloaded | {"PYTHONPATH": str(Path(__file__).parent)}


def compile_flags() -> tuple[str, ...]:
    """The flags for every C file, without those for warnings."""
    return (*PLAIN, *sanitizers())


def coverage() -> tuple[str, ...]:
    """Flags for the firmware's files: with IMU_COVERAGE=1 they count executed lines."""
    return ("--coverage",) if os.environ.get("IMU_COVERAGE") == "1" else ()


def load(
    sources: Iterable[str | Path] | None = None,
    headers: Iterable[str | Path] = (),
    defines: Iterable[str] = (),
) -> tuple[Any, Any]:
    """Return (ffi, lib) of C files and what their headers declare; build it if needed.

    Without arguments, of firmware/core, the chips' models and the files BESIDE. Paths
    are relative to the project's root; a define is "NAME" or "NAME=VALUE". Raises
    NativeBuildError with the compiler's message.
    """
    if sources is None:
        sources = [*CORE.rglob("*.c"), *CHIPS.rglob("*.c")]
        sources += [f"{name}.c" for name in BESIDE]
        headers = [*CORE.rglob("*.h"), *CHIPS.glob("*.h"), *BESIDE_HEADERS]
        headers += [f"{name}.h" for name in BESIDE]
    return _load(
        tuple(sorted((ROOT / path).resolve() for path in sources)),
        tuple(sorted((ROOT / path).resolve() for path in headers)),
        tuple(defines),
        compile_flags(),
        coverage(),
    )


@functools.cache
def _load(
    sources: tuple[Path, ...],
    headers: tuple[Path, ...],
    defines: tuple[str, ...],
    flags: tuple[str, ...],
    counting: tuple[str, ...],
) -> tuple[Any, Any]:
    build = _Build(sources, headers, defines, flags, counting)
    spec = importlib.util.spec_from_file_location(build.name, build.library())
    if spec is None or spec.loader is None:
        raise NativeBuildError(f"{build.name} is no extension module")
    module = importlib.util.module_from_spec(spec)
    # Lazy: functions whose file was left out fail only when they are called.
    before = sys.getdlopenflags()
    sys.setdlopenflags(os.RTLD_LAZY | os.RTLD_LOCAL)
    try:
        spec.loader.exec_module(module)
    finally:
        sys.setdlopenflags(before)
    return module.ffi, module.lib


def program(sources: Iterable[Path]) -> Path:
    """A program of C files, of their objects()."""
    return _checked(sources).program()


def objects(sources: Iterable[Path]) -> list[Path]:
    """C files under both sanitizers; in `make test` those of load()."""
    CACHE.mkdir(parents=True, exist_ok=True)
    with locked(CACHE / ".lock"):
        return _checked(sources).objects()


def _checked(sources: Iterable[Path]) -> _Build:
    headers = sorted(CORE.rglob("*.h"))
    return _Build([*sources], headers, (), (*PLAIN, *UNDEFINED, *ADDRESS), ())


def forget() -> None:
    """Make the next load() read the files again."""
    _load.cache_clear()


class _Build:
    """One library: its files and flags, and a name made from a digest of them."""

    def __init__(
        self,
        sources: Sequence[Path],
        headers: Sequence[Path],
        defines: Sequence[str],
        flags: Sequence[str],
        counting: Sequence[str],
    ) -> None:
        self.sources = sources
        self.headers = headers
        folders = {path.parent for path in (*sources, *headers)}
        # All headers beside the files, also those that the library does not export.
        self.seen = sorted(
            {*headers, *(p for f in folders for p in f.glob("*.h"))}
            | {ROOT / "firmware" / "board.h"} & {*(ROOT / "firmware").glob("*.h")}
        )
        self.folders = [ROOT, *folders]
        self.flags = (
            *flags,
            *(f"-D{define}" for define in defines),
            *(f"-I{folder}" for folder in (CORE.parent, CHIPS.parent)),
        )
        self.object_flags = (*self.flags, *counting, *WARNINGS)
        self.libraries = ("-lgcov", "-lm") if counting else ("-lm",)
        self.name = "_native_" + self._digest(
            *sources, *self.seen, *OWN, text=" ".join(self.object_flags)
        )

    def library(self) -> Path:
        """Return the extension module's path; build the module if it is absent."""
        return self._built(CACHE / f"{self.name}.so", self._build)

    def program(self) -> Path:
        """Return the path of a program of the sources; link it if it is absent."""
        return self._built(CACHE / f"{self.name}.elf", self._link)

    @staticmethod
    def _built(target: Path, build: Callable[[Path], None]) -> Path:
        if target.exists():
            return target
        CACHE.mkdir(parents=True, exist_ok=True)
        with locked(CACHE / ".lock"):
            if not target.exists():
                made = target.with_suffix(".part")  # others load only what is whole
                build(made)
                made.rename(target)
        return target

    def _link(self, made: Path) -> None:
        objects = map(str, self.objects())
        _run("gcc", *self.flags, *objects, *self.libraries, "-o", str(made))

    def _build(self, made: Path) -> None:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            are_whole = pool.map(self._is_whole, self.headers)
            headers = list(compress(self.headers, are_whole))
        objects = self.objects()
        self._refuse_twins(headers)
        seam = "".join(f'#include "{path}"\n' for path in headers)
        defined = _defined_symbols(objects)
        cdef = "\n".join(declarations(self._preprocess(seam), self.folders, defined))
        ffi = cffi.FFI()
        try:
            ffi.cdef(cdef)
        except cffi.CDefError as error:
            raise NativeBuildError(f"cffi on the headers: {error}") from error
        ffi.set_source(self.name, seam)
        with tempfile.TemporaryDirectory(dir=CACHE) as room:
            glue = Path(room) / "glue.c"
            with contextlib.redirect_stdout(io.StringIO()):  # it prints its file's name
                ffi.emit_c_code(str(glue))
            # cffi's code is compiled without our warnings, but with the sanitizers for
            # the headers' inline functions, and unoptimised to save time.
            _run(
                *("gcc", *self.flags, "-O0"),
                f"-I{sysconfig.get_path('include')}",
                "-shared",
                "-Wl,-Bsymbolic",
                *(str(path) for path in (glue, *objects)),
                *self.libraries,
                "-o",
                str(made),
            )

    def objects(self) -> list[Path]:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return [made for made in pool.map(self._object, self.sources) if made]

    def _object(self, source: Path) -> Path | None:
        """Compile one file with warnings as errors, unless its object is in the cache.

        The key is a digest of the preprocessed text, in which -D flags have taken
        effect: libraries with other flags share an object where those change nothing.
        A link named by what the text comes from saves preprocessing it again.
        """
        known = self._cached(source, self.object_flags, ".known")
        if known.exists():
            return known.resolve()
        try:
            text = _run("gcc", *self.object_flags, "-E", str(source))
            others = [flag for flag in self.object_flags if not flag.startswith("-D")]
            key = self._digest(text=f"{' '.join(others)}\0{text}")
            target = CACHE / f"{source.stem}-{key}.o"
            if not target.exists():
                # Compiled in this folder: the coverage notes are written beside it.
                made = target.with_suffix(".part.o")
                _run("gcc", *self.object_flags, "-c", str(source), "-o", str(made))
                made.rename(target)
        except NativeBuildError as error:
            if not _is_partial():
                raise
            sys.stderr.write(f"{source.name} is left out: {error}\n")
            return None
        known.unlink(missing_ok=True)
        known.symlink_to(target.name)
        return target

    def _is_whole(self, header: Path) -> bool:
        """Whether a header compiles alone; if not, raises unless _is_partial().

        A header that does is not compiled again until it or one beside it changes.
        """
        known = self._cached(header, self.flags, ".whole")
        if known.exists():
            return True
        seam = f'#include "{header}"\n'
        strict = (*self.flags, *WARNINGS, "-fsyntax-only", "-xc", "-")
        try:
            _run("gcc", *strict, stdin=seam)
        except NativeBuildError as error:
            if not _is_partial():
                raise
            sys.stderr.write(f"{header.name} is left out: {error}\n")
            return False
        known.touch()
        return True

    def _cached(self, path: Path, flags: Sequence[str], suffix: str) -> Path:
        """A name in the cache for a file, the flags, and all headers that it may see.

        Files of the core include only the core's (tests/test_house.py), so that what
        is known of them holds for every library.
        """
        near = [p for p in self.seen if p.is_relative_to(CORE)]
        seen = near if path.is_relative_to(CORE) else self.seen
        key = self._digest(path, *seen, text=" ".join(flags))
        return CACHE / f"{path.stem}-{key}{suffix}"

    @staticmethod
    def _refuse_twins(headers: Sequence[Path]) -> None:
        """Raise if two headers share an include guard, which would hide one of them."""
        guards: dict[str, Path] = {}
        for header in headers:
            guard = re.search(r"^#ifndef (\w+)", header.read_text(), re.MULTILINE)
            if guard and guards.setdefault(guard[1], header) != header:
                other = guards[guard[1]]
                raise NativeBuildError(f"{header} and {other} both guard by {guard[1]}")

    def _preprocess(self, seam: str) -> str:
        return _run("gcc", *self.flags, "-E", "-dD", "-xc", "-", stdin=seam)

    @staticmethod
    def _digest(*files: Path, text: str) -> str:
        digest = hashlib.sha256(text.encode())
        for path in files:
            digest.update(f"\0{path}\0".encode())
            digest.update(path.read_bytes())
        return digest.hexdigest()[:16]


def _is_partial() -> bool:
    return os.environ.get("IMU_NATIVE_PARTIAL") == "1"


def _run(*command: str, stdin: str | None = None) -> str:
    done = subprocess.run(
        command, input=stdin, capture_output=True, text=True, check=False
    )
    if done.returncode:
        hint = "" if _is_partial() else "\n(IMU_NATIVE_PARTIAL=1 leaves such files out)"
        raise NativeBuildError(f"{' '.join(command)}\n{done.stderr}{hint}")
    return done.stdout


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a lock file, so that one process builds and the others find it built."""
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _defined_symbols(objects: Sequence[Path]) -> set[str]:
    if not objects:
        return set()
    listing = _run("nm", "-g", "--defined-only", *(str(path) for path in objects))
    return set(re.findall(r"^[0-9a-f]+ [A-Z] (\w+)$", listing, re.MULTILINE))
