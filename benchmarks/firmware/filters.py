# SPDX-License-Identifier: MIT
"""The cost of a step of each filter alone on the ATmega328P.

Each filter is built into the same small program (benchmarks/avr), fed the same samples
and measured by build/sim/bench. Its answers must agree with those of the same filter on
this machine, or its figures do not count.
"""

from __future__ import annotations

import configparser
import json
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path

import numpy as np

from benchmarks.common.engines import OURS, vqf_quats
from benchmarks.common.feed import Samples
from benchmarks.common.paths import PROJECT
from imud import rotation
from imud.rotation import FloatArray

AVR = PROJECT / "benchmarks" / "avr"
FIRMWARE = PROJECT / "firmware"
CORE = FIRMWARE / "core"
BUILD = PROJECT / "build" / "benchmarks"
BENCH = PROJECT / "build" / "sim" / "bench"

# ATmega328P data sheet, table 2-1.
FLASH_BYTES = 32768
RAM_BYTES = 2048

MACHINE = ("-mmcu=atmega328p", "-DF_CPU=16000000L")
LINK = ("-Wl,--gc-sections", "-mrelax", "-Wl,-u,bench_sample", "-Wl,-u,bench_answer")
INCLUDE = (f"-I{FIRMWARE}", f"-I{AVR}", f"-I{PROJECT / 'sim'}")

# Largest angle at any time to the same filter in doubles. Single precision drifts, but
# the filters' own corrections limit that.
DEGREES_MAX = {"float Madgwick": 0.05, "float BasicVQF": 0.5, "float VQF": 0.5}
MADGWICK_GAIN = 0.041  # benchmarks/avr/madgwick_float.c
HELD = 2  # samples for each magnetometer reading, benchmarks/avr/bench.h


class FilterFailed(Exception):
    """A filter could not be built, or its answers are wrong."""


class Unmeasured(Exception):
    """A filter has no figures; the message says why."""


class DoesNotFit(Unmeasured):
    """The filter does not fit into flash or RAM."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Cycles and bytes that a filter takes, without the bench program's own share."""

    step_mean: float
    step_worst: int
    answer_mean: float
    answer_worst: int
    flash: int
    ram: int
    stack: int
    checked: str  # how the answers were checked

    @property
    def cycles_mean(self) -> float:
        return round(self.step_mean + self.answer_mean, 1)

    @property
    def cycles_worst(self) -> int:
        """The sum of the slowest step and the slowest answer."""
        return self.step_worst + self.answer_worst


@dataclass(frozen=True, slots=True)
class Filter:
    """How a filter is built, and what its answers are compared with."""

    name: str
    key: str  # its key in the JSON
    build: Callable[[Path], None]  # makes the image
    is_fixed: bool
    answers: Callable[[Samples, Path], FloatArray]  # on this machine


def flags() -> list[str]:
    """Compiler flags of the firmware, from platformio.ini."""
    ini = configparser.ConfigParser(interpolation=None, inline_comment_prefixes=(";",))
    ini.read(PROJECT / "platformio.ini")
    shared = ini["env"]["build_flags"]
    own = ini["firmware:nano"]["build_flags"].replace("${env.build_flags}", shared)
    return [flag for flag in own.split() if not flag.startswith("-W")]


def run(*command: str | Path, given: bytes = b"") -> bytes:
    done = subprocess.run(command, input=given, capture_output=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        for line in lines:
            if "not fit in region" in line or "not within region" in line:
                raise DoesNotFit(line.rpartition("ld: ")[2])
        lines = [line for line in lines if "error" in line.lower()] or lines
        raise FilterFailed(lines[0] if lines else f"{command[0]} failed")
    return done.stdout


def build_main(out: Path, *sources: Path, options: Sequence[str] = ()) -> None:
    run("avr-gcc", *MACHINE, *flags(), *LINK, *INCLUDE, *options, "-o", out,
        AVR / "main.c", *sources, "-lm")  # fmt: skip


def build_house(name: str, out: Path) -> None:
    core = [path for path in sorted(CORE.rglob("*.c")) if path.name != "fixed_mul.c"]
    products = FIRMWARE / "avr" / "fixed_mul.S"
    define = f"-DFILTER={name}"
    build_main(out, AVR / "house.c", *core, products, options=[define])


def build_madgwick(out: Path) -> None:
    build_main(out, AVR / "madgwick_float.c")


def build_vqf(out: Path, *, is_basic: bool) -> None:
    source = vqf_source()
    main = out.with_suffix(".main.o")
    run("avr-gcc", *MACHINE, *flags(), *INCLUDE, "-c", "-o", main, AVR / "main.c")
    options = ("-std=gnu++11", "-fno-exceptions", "-fno-threadsafe-statics")
    options += ("-DVQF_SINGLE_PRECISION", *(("-DBASIC",) if is_basic else ()))
    # With room for arguments made at a function's entry avr-gcc 5.4 makes code of VQF
    # that reads outside the memory.
    left_out = ("-std=gnu11", "-maccumulate-args")
    shared = [flag for flag in flags() if flag not in left_out]
    run("avr-g++", *MACHINE, *shared, *options, *LINK, *INCLUDE,
        f"-I{AVR / 'std'}", f"-I{source}", "-o", out, main, AVR / "vqf_float.cpp",
        source / ("basicvqf.cpp" if is_basic else "vqf.cpp"), "-lm")  # fmt: skip


def vqf_source() -> Path:
    """The C++ source of the installed version of VQF, downloaded once."""
    version = metadata.version("vqf")
    name = f"vqf-{version}"
    folder = BUILD / name / "vqf" / "cpp"
    if not (folder / "vqf.cpp").is_file():
        BUILD.mkdir(parents=True, exist_ok=True)
        try:
            run(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps",
                "--no-binary", "vqf", "--dest", BUILD, f"vqf=={version}")  # fmt: skip
        except FilterFailed as error:
            raise Unmeasured(f"its source can't be fetched: {error}") from error
        shutil.unpack_archive(BUILD / f"{name}.tar.gz", BUILD)
    return folder


def records(samples: Samples, *, is_fixed: bool) -> bytes:
    """Samples in the layout of `bench_sample`."""
    values = (samples.gyr, samples.acc, np.nan_to_num(samples.mag))
    if is_fixed:
        # struct measurement: q7_25, q11_21, q14_18.
        rows = [np.rint(v * 2.0**n) for v, n in zip(values, (25, 21, 18), strict=True)]
        columns = np.concatenate(rows, axis=1).astype("<i4")
    else:
        columns = np.concatenate(values, axis=1).astype("<f4")
    return b"".join(
        row.tobytes() + struct.pack("B", flag)
        for row, flag in zip(columns, samples.has_mag.tolist(), strict=True)
    )


def quaternions(answers: bytes, *, is_fixed: bool) -> FloatArray:
    if is_fixed:
        return np.frombuffer(answers, "<i4").reshape(-1, 4) * 2.0**-30
    return np.frombuffer(answers, "<f4").reshape(-1, 4).astype(float)


def by_core(name: str, samples: Samples, folder: Path) -> FloatArray:
    """Answers of the firmware's C."""
    program = folder / f"{name}-host"
    define = f"-DFILTER={name}"
    run("gcc", "-std=gnu11", "-O2", *INCLUDE, define, "-o", program, AVR / "main.c",
        AVR / "house.c", *sorted(CORE.rglob("*.c")))  # fmt: skip
    answers = run(program, given=records(samples, is_fixed=True))
    return quaternions(answers, is_fixed=True)


def by_ahrs(samples: Samples, folder: Path) -> FloatArray:
    """Answers of Madgwick's filter from PyPI, started from the same orientation."""
    from ahrs.filters import Madgwick

    del folder
    filter_ = Madgwick(frequency=samples.rate_hz, gain=MADGWICK_GAIN)
    held = np.where(np.isfinite(samples.mag), samples.mag, 0.0)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    found = np.empty((len(samples), 4))
    mag = np.zeros(3)
    for index in range(len(samples)):
        mag = held[index] if held[index].any() else mag
        q = filter_.updateMARG(q, samples.gyr[index], samples.acc[index], mag)
        found[index] = q
    # Its world frame has x north and y west.
    quarter = rotation.from_rotation_vector(np.array([0.0, 0.0, np.pi / 2]))
    return rotation.multiply(quarter, found)


def by_vqf(samples: Samples, folder: Path, *, is_basic: bool) -> FloatArray:
    """Answers of the authors' own build of VQF, in doubles."""
    del folder
    return vqf_quats(samples, HELD, is_basic=is_basic)


def filters() -> list[Filter]:
    """Our filters, and the others in floats."""
    found = [
        Filter(name, name, partial(build_house, name), True, partial(by_core, name))
        for name in OURS
    ]
    found.append(
        Filter("float Madgwick", "float_madgwick", build_madgwick, False, by_ahrs)
    )
    for name, key in (("BasicVQF", "float_basic_vqf"), ("VQF", "float_vqf")):
        make = partial(build_vqf, is_basic=name == "BasicVQF")
        answer = partial(by_vqf, is_basic=name == "BasicVQF")
        found.append(Filter(f"float {name}", key, make, False, answer))
    return found


def measure(image: Path, samples: bytes) -> tuple[dict[str, int], bytes]:
    """Run an image in the bench; return its figures and answers."""
    given, answers = image.with_suffix(".samples"), image.with_suffix(".answers")
    summary = image.with_suffix(".json")
    if not BENCH.is_file():
        raise FilterFailed(f"{BENCH} is missing; run `make sim`")
    given.write_bytes(samples)
    run(BENCH, "--image", image, "--samples", given, "--answers", answers,
        "--summary", summary)  # fmt: skip
    figures = json.loads(summary.read_text())
    for work in ("step", "answer"):
        for figure, value in figures.pop(work).items():
            figures[f"{work}_{figure}"] = value
    return figures, answers.read_bytes()


def require_room(image: Path) -> None:
    """Raise DoesNotFit if the filter's program alone exceeds flash or RAM."""
    sizes = run("avr-size", image).decode().splitlines()[1].split()
    text, data, bss = (int(size) for size in sizes[:3])
    if text + data > FLASH_BYTES or data + bss >= RAM_BYTES:
        raise DoesNotFit(f"{text + data} bytes of flash, {data + bss} of RAM")


def furthest_deg(left: FloatArray, right: FloatArray) -> float:
    """The largest angle between two rows of orientations."""
    turns = rotation.multiply(rotation.inverse(left), right)
    angles = np.linalg.norm(rotation.to_rotation_vector(turns), axis=1)
    return float(np.degrees(angles).max())


def check(filter_: Filter, found: FloatArray, wanted: FloatArray) -> str:
    """Compare answers; say how well they agree, or raise FilterFailed."""
    if found.shape != wanted.shape:
        raise FilterFailed(f"{len(found)} answers to {len(wanted)} samples")
    if filter_.is_fixed:
        differing = int((found != wanted).any(axis=1).sum())
        if differing:
            raise FilterFailed(f"{differing} answers differ from this machine's")
        return "same bits as here"
    away = furthest_deg(found, wanted)
    limit = DEGREES_MAX[filter_.name]
    if not away <= limit:
        raise FilterFailed(f"{away:.3f} deg from the same in doubles, of {limit:g}")
    return f"within {away:.2g} deg of doubles"


def cost(filter_: Filter, samples: Samples, folder: Path) -> Cost:
    """Build, run and check a filter."""
    image, empty = folder / f"{filter_.key}.elf", folder / "empty.elf"
    build_main(empty, AVR / "empty.c")
    filter_.build(image)
    require_room(image)
    given = records(samples, is_fixed=filter_.is_fixed)
    idle, _ = measure(empty, given)
    figures, answers = measure(image, given)
    found = quaternions(answers, is_fixed=filter_.is_fixed)
    checked = check(filter_, found, filter_.answers(samples, folder))
    net = {name: figures[name] - idle[name] for name in figures}
    count = len(samples)
    return Cost(
        step_mean=round(net["step_cycles"] / count, 1),
        step_worst=net["step_worst"],
        answer_mean=round(net["answer_cycles"] / count, 1),
        answer_worst=net["answer_worst"],
        flash=net["flash"],
        ram=net["ram"],
        stack=net["stack"],
        checked=checked,
    )
