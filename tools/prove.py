# SPDX-License-Identifier: MIT
"""Proves with Frama-C's Eva that what parses strangers' bytes has no undefined
behaviour, whatever the bytes are: no access beyond an array, no value that was never
set, no overflow of signed numbers. docs/limits.md lists the assumptions.

The functions that are proved are called by tests/proof/*.c. Runs again only when one of
their files has changed, unless --force is given.

example: python tools/prove.py --force --entry params.read
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks import tables
from benchmarks.tables import Table

ROOT = Path(__file__).resolve().parent.parent
DRIVERS = Path("tests/proof")
# The state that was proved last, in the tree: a fresh clone has it, too. The night
# proves all of it again, whatever this says.
STAMP = ROOT / DRIVERS / "proved.txt"
FRAMA_C = "frama-c"
SECONDS_MAX = 180

# Integers of a host and of MicroPython, of the F405, and of the AVR: 16 bits, where a
# sum of two bytes is as wide as the numbers that it is compared with.
HOST, ARM, AVR = "gcc_x86_64", "gcc_x86_32", "gcc_x86_16"
EVERYWHERE = (HOST, ARM, AVR)

COMMON = (
    "-cpp-extra-args=-std=gnu11 -D_Alignof=__alignof__ -Ifirmware -I. -Itests/proof",
    *("-c11", "-eva", "-eva-no-show-progress", "-eva-auto-loop-unroll", "600"),
)

WIRE = ("core/wire/messages.c",)
PARAMS = tuple(
    f"core/{name}.c"
    for name in (
        *("params/params", "storage/memory", "storage/crc32", "fusion/calibrate"),
        *("math/fixed", "math/fixed_mul", "math/vector"),
    )
)


@dataclass(frozen=True, slots=True)
class Proof:
    """A driver, its functions, and the files that they are about."""

    driver: str
    functions: Sequence[str]
    files: Sequence[str]  # in firmware/
    options: Sequence[str]
    machines: Sequence[str] = EVERYWHERE

    @property
    def sources(self) -> list[str]:
        return [
            str(DRIVERS / f"{self.driver}.c"),
            *(f"firmware/{f}" for f in self.files),
        ]


PROOFS = (
    # The longest first.
    Proof("frame", ("encode", "decode", "crc"), ("core/wire/frame.c",), ()),
    Proof(
        "commands",
        ("receive",),
        (
            *("core/probe/commands.c", "core/wire/frame.c", *WIRE),
            *("core/params/store.c", "core/storage/bank.c", *PARAMS),
        ),
        ("-eva-precision", "3", "-eva-partition-history", "4"),
    ),
    Proof(
        "library",
        ("content", "command"),
        ("core/wire/frame.c", *WIRE),
        ("-eva-precision", "7"),
    ),
    Proof(
        "params",
        ("read",),
        PARAMS,
        ("-eva-precision", "3", "-eva-partition-history", "6"),
    ),
    Proof(
        "messages",
        (
            *("hello", "raw", "pose", "event", "status", "equipment", "params"),
            *("stroke", "self_test", "command", "reply"),
        ),
        WIRE,
        ("-eva-precision", "7"),
    ),
    Proof(
        "fixed",
        ("clamps", "sums", "halves", "products", "scales", "roots", "angles"),
        tuple(f"core/math/{name}.c" for name in ("fixed", "fixed_mul", "fixed_trig")),
        ("-eva-precision", "7", "-eva-partition-history", "3"),
    ),
    # Only the F405 has a card.
    Proof(
        "card",
        ("partitions", "volume", "root", "root_link", "file_chain"),
        ("core/storage/logbook_file.c",),
        ("-eva-precision", "3"),
        (ARM,),
    ),
)

_ALARM = re.compile(r"^\[eva:alarm\] (?P<place>\S+): Warning:\s*(?P<what>.*)$")
_FAULT = re.compile(r"User Error|Plug-in|Unexpected error|Degeneration")
_REACHED = re.compile(r"(\d+) statements reached \(out of (\d+)\)")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The proof of one function on one machine."""

    name: str
    machine: str
    alarms: list[str]
    reached: str
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="tools/prove.py",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--force", action="store_true", help="even if nothing changed")
    parser.add_argument(
        "--entry", metavar="DRIVER.FUNCTION", help="only this one, such as params.read"
    )
    parser.add_argument(
        "--if-there", action="store_true", help="report it and succeed without Frama-C"
    )
    options = parser.parse_args()
    if shutil.which(FRAMA_C) is None:
        words = "Frama-C is missing, nothing was proved: apt install frama-c-base"
        if not options.if_there:
            sys.exit(words)
        sys.stdout.write(f"{words}\n")
        return
    state = _state()
    if not (options.force or options.entry) and _known() == state:
        sys.stdout.write("unchanged since the last proof\n")
        return
    outcomes = list(_run(options.entry))
    for each in outcomes:
        sys.stdout.write(
            f"{each.name:22} {each.machine:12} {each.reached:>9} "
            f"{len(each.alarms)} alarms {each.seconds:6.1f} s\n"
        )
    bad = [each for each in outcomes if each.alarms]
    for each in bad:
        for alarm in each.alarms:
            sys.stdout.write(f"{each.name} on {each.machine}: {alarm}\n")
    if bad or not outcomes:
        sys.exit("not proved")
    if not options.entry:
        STAMP.write_text(f"{state}\n")
        tables.keep("proof", [_summary(outcomes)])


def _summary(outcomes: Sequence[Outcome]) -> Table:
    """Statements of each driver's functions: the fewest that were reached on a machine,
    and how many there are.
    """
    found: dict[str, tuple[int, int]] = {}
    for each in outcomes:
        reached, out_of = map(int, each.reached.split("/"))
        before = found.setdefault(each.name, (reached, out_of))
        if out_of - reached > before[1] - before[0]:
            found[each.name] = reached, out_of
    sums: dict[str, tuple[int, int]] = {}
    for name, (reached, out_of) in found.items():
        driver = name.partition(".")[0]
        so_far = sums.get(driver, (0, 0))
        sums[driver] = so_far[0] + reached, so_far[1] + out_of
    columns = {"driver": "", "statements reached": ",d", "of": ",d"}
    return Table("reached", columns, [(f"`{name}.c`", *sums[name]) for name in sums])


def _run(wanted: str | None) -> Iterator[Outcome]:
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        begun = [
            pool.submit(prove, proof, function, machine)
            for proof in PROOFS
            for function in proof.functions
            for machine in proof.machines
            if wanted in (None, f"{proof.driver}.{function}")
        ]
        for each in begun:
            yield each.result()


def prove(proof: Proof, function: str, machine: str) -> Outcome:
    """Runs Eva on one function."""
    begin = time.monotonic()
    words = [FRAMA_C, *COMMON, *proof.options]
    words += ["-machdep", machine, "-main", function, *proof.sources]
    try:
        done = subprocess.run(
            words,
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=SECONDS_MAX,
            check=False,
        )
        text, code = done.stdout, done.returncode
    except subprocess.TimeoutExpired:
        text, code = "", -1
    return Outcome(
        f"{proof.driver}.{function}",
        machine,
        list(_alarms(text, code)),
        _reached(text),
        time.monotonic() - begin,
    )


def _alarms(text: str, code: int) -> Iterator[str]:
    lines = text.splitlines()
    for at, line in enumerate(lines):
        if (found := _ALARM.match(line)) is not None:
            more = found["what"] or (
                lines[at + 1].strip() if at + 1 < len(lines) else ""
            )
            yield f"{found['place']} {more}"
        elif _FAULT.search(line) is not None:
            yield f"{line} {lines[at + 1].strip() if at + 1 < len(lines) else ''}"
    if code != 0:
        yield f"Frama-C ended with {code}"
    elif _reached(text) == "?":
        yield "Eva reached nothing"


def _reached(text: str) -> str:
    """How many statements of all functions the analysis reached, and their number."""
    found = _REACHED.search(text)
    return f"{found[1]}/{found[2]}" if found else "?"


def _state() -> str:
    """The digest of everything that the proofs depend on, with headers and options."""
    kinds = ("*.c", "*.h")
    paths = {
        Path(__file__),
        *(p for kind in kinds for p in (ROOT / "firmware/core").rglob(kind)),
        *(p for kind in kinds for p in (ROOT / DRIVERS).glob(kind)),
        *(p for kind in kinds for p in (ROOT / "protocol" / "library").glob(kind)),
    }
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(f"{path.relative_to(ROOT)}\n".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _known() -> str:
    return STAMP.read_text().strip() if STAMP.exists() else ""


if __name__ == "__main__":
    main()
