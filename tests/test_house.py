# SPDX-License-Identifier: MIT
"""The rules of the house that no compiler knows: who may include whom, what the
portable C may use, and that it compiles without a warning wherever it must run."""

from __future__ import annotations

import ast
import functools
import itertools
import re
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import images
import native
from bits.processors import PROCESSORS, command
from programs import ran

pytestmark = pytest.mark.sampled(5)  # `make check` runs them all

ROOT = Path(__file__).resolve().parent.parent
FIRMWARE = ROOT / "firmware"
CORE = FIRMWARE / "core"
SIM = ROOT / "sim"
CHIPS = SIM / "chips"

STANDARD = {"stdbool.h", "stddef.h", "stdint.h", "string.h"}
FOLDERS = (
    *("benchmarks", "firmware", "hardware", "host", "protocol", "sim", "tests"),
    "tools",
)
SOURCES = ("*.c", "*.h", "*.ld", "*.py", "*.pyi", "*.S", "*.sh")

# Byte order and register fields, not numbers of a Q format, are shifted here.
BYTE_SHUFFLERS = {
    *("frame.c", "logbook.c", "messages.c", "mpu9250.c", "sdcard.c", "settings.c"),
    "crc32.c",
}

# How a wait is called, and how its limit; what a file without either does not say.
CLOCK = re.compile(r"sleep|monotonic|timeout|\.(wait|join|communicate)\(\d")
WAITS, LIMITS = (".wait", ".join", ".communicate"), {"timeout", "timeout_s"}

COMPILERS = ("gcc", "avr-gcc", "arm-none-eabi-gcc")
# Names for arithmetic on float and double: libgcc's (sf, df), then those of the ARM
# run-time ABI (IHI0043, 4.1.2), whose integer division must not be taken for one.
FLOAT_HELPER = re.compile(
    r"__(add|sub|mul|div|neg|cmp|eq|ne|lt|le|gt|ge|unord|fix|float|extend|trunc)"
    r"\w*[sd]f\w*"
    r"|__aeabi_([fd](add|r?sub|mul|div|neg|cmp\w*|2\w+)|c[fd]\w+|u?[il]2[fd])"
)


def files(*folders: Path, kinds: tuple[str, ...] = SOURCES) -> list[Path]:
    return sorted(
        path
        for folder in folders
        for kind in kinds
        for path in folder.rglob(kind)
        if "__pycache__" not in path.parts
    )


def includes(path: Path) -> list[tuple[str, str]]:
    """Return each include of a file as its opening, `<` or `"`, and its name."""
    found = re.findall(r'^\s*#\s*include\s*([<"])([^>"]+)', path.read_text(), re.M)
    return [(opening, name) for opening, name in found]


def identified(path: Path) -> str:
    return str(path.relative_to(ROOT))


def none_of(offenders):
    """Fail with a line for each of them."""
    lines = [str(each) for each in offenders]
    assert not lines, "\n".join(lines)


CORE_FILES = files(CORE, kinds=("*.c", "*.h"))
CORE_SOURCES = files(CORE, kinds=("*.c",))


def test_core_includes_core_and_four_standard_headers_only():
    none_of(
        f"{identified(path)}: {name}"
        for path in CORE_FILES
        for opening, name in includes(path)
        if not (
            name in STANDARD
            if opening == "<"
            else name.startswith("core/") and (FIRMWARE / name).is_file()
        )
    )


# Each room of core/ may use those before it.
ROOMS = ("math", "wire", "drivers", "fusion", "storage", "params", "probe")


def test_a_room_of_the_core_uses_those_before_it_only():
    none_of(
        f"{identified(path)}: {name}"
        for path in CORE_FILES
        for opening, name in includes(path)
        if opening == '"'
        and name.split("/")[1] not in ROOMS[: ROOMS.index(path.parent.name) + 1]
    )


def included(path):
    """Files of ours that a C file includes, wherever the compiler would find them."""
    folders = (path.parent, FIRMWARE, SIM, CHIPS)
    for opening, name in includes(path):
        found = [folder / name for folder in folders if (folder / name).is_file()]
        if opening == '"' and found:
            yield found[0].resolve()


def imported(path):
    """Modules of ours that a Python module loads when it is loaded itself."""
    package = ROOT / "host" / "imud"
    line = re.compile(r"^from imud\.([\w.]+) import (\([^)]*\)|.*)", re.M)
    for module, names in line.findall(path.read_text()):
        room = package.joinpath(*module.split("."))
        for name in re.findall(r"\w+", names):
            file = room / f"{name}.py"
            yield file if file.is_file() else room.with_suffix(".py")


def cycle(paths, uses):
    """Files of which each uses the next and the last one the first; empty: none."""
    done = set()

    def walk(path, way):
        if path in way:
            return way[way.index(path) :]
        if path in done or not path.is_file():
            return []
        for other in uses(path):
            if found := walk(other, [*way, path]):
                return found
        done.add(path)
        return []

    return next(filter(None, (walk(path, []) for path in paths)), [])


# What each room of sim/ may use beside itself. Neither board knows the other, and what
# they share knows neither. The machine of the F405 does not know its program.
SIM_ROOMS = {
    "chips": (),
    "run": ("chips",),
    "selftest": (),
    "nano": ("chips", "run", "selftest"),
    "f405": ("chips", "run"),
    "f405/board": ("chips", "run", "f405"),
    "pico": ("chips", "run"),
}


def room_of(file: Path, sim: Path) -> str | None:
    place = f"{file.parent.relative_to(sim)}/" if file.is_relative_to(sim) else ""
    found = [room for room in SIM_ROOMS if place.startswith(f"{room}/")]
    return max(found, key=len, default=None)


def misplaced(path: Path, sim: Path) -> list[str]:
    """Includes of a file in sim/ that its room may not use."""
    room = room_of(path, sim)
    usable = (room, *SIM_ROOMS[room]) if room else ()
    found = []
    for name in (name for opening, name in includes(path) if opening == '"'):
        # Looked for beside the file first.
        files = [base / name for base in (path.parent, sim) if (base / name).is_file()]
        if not files or room_of(files[0].resolve(), sim) not in usable:
            found.append(f"{path.relative_to(sim)}: {name}")
    return found


def test_a_room_of_the_emulators_uses_its_own_and_those_that_it_may_only():
    paths = files(SIM, kinds=("*.c", "*.h"))
    assert {path.relative_to(SIM).parts[0] for path in paths} <= {*SIM_ROOMS}
    found = [line for path in paths for line in misplaced(path, SIM)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("path", "name", "is_seen"),
    [
        ("run/events.c", "nano/machine.h", True),
        ("chips/lsm9ds0/chip.h", "../../run/motion.h", True),
        ("nano/nano.c", "f405/f405.h", True),
        ("f405/core/thumb.c", "nano/machine.h", True),
        ("f405/core/thumb.c", "f405/board/board.h", True),
        ("nano/nano.c", "core/fusion/fuse.h", True),
        ("f405/board/card.c", "f405/f405.h", False),
        ("nano/nano.c", "run/motion.h", False),
    ],
)
def test_an_include_of_the_wrong_room_is_seen(path, name, is_seen, tmp_path):
    sim = tmp_path.resolve() / "sim"
    planted = sim / path
    there = ("run/motion.h", "nano/machine.h", "f405/f405.h", "f405/board/board.h")
    for file in (path, *there):
        (sim / file).parent.mkdir(parents=True, exist_ok=True)
        (sim / file).touch()
    planted.write_text(f'#include "{name}"\n')
    assert misplaced(planted, sim) == ([f"{path}: {name}"] if is_seen else [])


def test_no_includes_go_round_in_a_circle():
    paths = files(FIRMWARE, SIM, kinds=("*.c", "*.h"))
    assert [path.name for path in cycle(paths, included)] == []


def test_no_imports_go_round_in_a_circle():
    paths = files(ROOT / "host" / "imud", kinds=("*.py",))
    assert [path.name for path in cycle(paths, imported)] == []


def test_a_circle_is_seen(tmp_path):
    for one, other in (("a", "b"), ("b", "c"), ("c", "a"), ("d", "a")):
        (tmp_path / f"{one}.h").write_text(f'#include "{other}.h"\n')
    found = cycle([tmp_path.resolve() / "d.h"], included)
    assert [path.name for path in found] == ["a.h", "b.h", "c.h"]


@functools.cache
def global_symbols(path):
    """Names that a C file defines for others, and those that it wants of them."""
    (made,) = native.objects([path])
    done = ran("nm", made, check=True)
    found = re.findall(r"([A-Z]) (\w+)$", done.stdout, re.M)
    wanted = {name for kind, name in found if kind == "U"}
    return {name for _, name in found} - wanted, wanted


def calls(paths):
    """From each C file to those of the others whose functions or tables it uses."""
    home = {name: path for path in paths for name in global_symbols(path)[0]}
    return {
        path: {home[name] for name in global_symbols(path)[1] if name in home}
        for path in paths
    }


def test_no_calls_in_the_core_go_round_in_a_circle():
    # The filter's stages are one thing in several files.
    paths = files(CORE, kinds=("*.c",))
    found = calls(paths)
    assert [path.name for path in cycle(paths, found.get)] == []


def test_calls_of_the_probe_go_down_the_lines_of_its_header():
    header = (CORE / "probe" / "probe.h").read_text()
    lines = re.findall(r"^//     ([a-z_, ]+?)  ", header, re.M)
    floor = {name: i for i, line in enumerate(lines) for name in line.split(", ")}
    found = calls(files(CORE / "probe", kinds=("*.c",)))
    assert {path.stem for path in found} == set(floor)
    for path, others in found.items():
        for other in others:
            assert floor[path.stem] < floor[other.stem], f"{path.stem}: {other.stem}"


def test_a_function_of_the_probe_is_in_the_file_that_its_name_says():
    for path in files(CORE / "probe", kinds=("*.c",)):
        assert not [name for name in global_symbols(path)[0] if path.stem not in name]


def test_calls_in_a_circle_are_seen(tmp_path):
    for one, other in (("a", "b"), ("b", "c"), ("c", "a"), ("d", "a")):
        code = f"void {other}(void);\nvoid {one}(void) {{ {other}(); }}\n"
        (tmp_path / f"{one}.c").write_text(code)
    found = calls(files(tmp_path, kinds=("*.c",)))
    ring = cycle([tmp_path / "d.c"], found.get)
    assert [path.name for path in ring] == ["a.c", "b.c", "c.c"]


def test_what_boards_share_knows_none_of_them():
    for path in files(FIRMWARE / "generic", kinds=("*.c", "*.h")):
        for opening, name in includes(path):
            if opening == "<":
                assert name in STANDARD
            else:
                assert name.startswith(("core/", "generic/")), f"{path.name}: {name}"


@pytest.mark.parametrize(
    ("one", "other"), [*itertools.permutations(("avr", "stm32", "rp2040"), 2)]
)
def test_no_board_sees_another(one, other):
    for path in files(FIRMWARE / one):
        assert not re.search(rf"include.*\b{other}\b", path.read_text()), path


def test_nothing_but_boards_and_their_emulators_knows_a_chip():
    knowing = ("avr/", "util/", "cmsis", "stm32f4")
    for path in files(CORE, FIRMWARE / "main.c", FIRMWARE / "board.h"):
        assert not [name for _, name in includes(path) if name.startswith(knowing)]


def test_chip_models_never_include_the_firmware():
    paths = files(CHIPS, kinds=("*.c", "*.h"))
    assert paths, "no chip model was found"
    for path in paths:
        for opening, name in includes(path):
            if opening == '"':
                # A quoted name is looked for beside the file first.
                assert (path.parent / name).is_file(), f"{path.name}: {name}"


def test_emulators_under_the_gpl_stay_in_sim():
    used = re.compile(
        r'#\s*include\s*[<"](simavr|unicorn)|^\s*(import|from) unicorn'
        r"|-l(simavr|unicorn)",
        re.M,
    )
    none_of(
        identified(path)
        for path in files(*(ROOT / f for f in FOLDERS if f != "sim"))
        if path not in {Path(__file__), ROOT / "tools" / "needs.py"}
        and used.search(path.read_text())
    )


def test_a_source_file_opens_with_its_licence():
    none_of(
        identified(path)
        for path in files(*(ROOT / f for f in FOLDERS))
        if "SPDX-License-Identifier: MIT"
        not in "".join(path.read_text().splitlines()[:2])  # the second after a #!
    )


def test_no_file_holds_an_open_end_or_a_place_of_its_own():
    words = ("TO" + "DO", "FIX" + "ME", "XX" + "X", "HA" + "CK")
    places = ["/home/", "/ro" + "ot/"]
    # A clone in the folder of temporary files is in nobody's place.
    if len(ROOT.parts) > 2 and ROOT.parent != Path(tempfile.gettempdir()):
        places.append(f"{ROOT.parent}/")
    kinds = (*SOURCES, "*.md", "*.toml", "*.ini", "*.json", "Makefile")
    for path in files(*(ROOT / f for f in (*FOLDERS, "docs")), kinds=kinds):
        text = path.read_text()
        found = [w for w in words if w in text and re.search(rf"\b{w}\b", text)]
        found += [p for p in places if p in text and re.search(rf"{p}\w", text)]
        assert not found, f"{identified(path)}: {found[0]}"


def test_numbers_are_shifted_in_fixed_alone():
    none_of(
        identified(path)
        for path in CORE_SOURCES
        if path.name not in BYTE_SHUFFLERS
        and not path.name.startswith("fixed")
        and re.search(r"<<|>>", re.sub(r"//.*|/\*.*?\*/", "", path.read_text()))
    )


def test_a_sized_constant_is_one_number():
    # INT32_C(A / B) pastes its suffix to B alone: A stays an int of 16 bits on the AVR.
    sized = re.compile(r"\bU?INT(?:8|16|32|64)_C\((?![0-9]\w*\))[^)]*\)")
    for path in files(FIRMWARE, kinds=("*.c", "*.h")):
        assert not sized.findall(path.read_text()), identified(path)


def wall_clock(path: Path) -> Iterator[int]:
    """Lines bound to the machine's clock: a sleep outside of a loop with a condition, a
    comparison with the time, a limit in figures."""
    tree = ast.parse(path.read_text())
    loops = (each for each in ast.walk(tree) if isinstance(each, ast.While))
    looped = {id(node) for loop in loops for node in ast.walk(loop)}
    compared = (each for each in ast.walk(tree) if isinstance(each, ast.Compare))
    timed = {id(node) for each in compared for node in ast.walk(each)}
    for call in (each for each in ast.walk(tree) if isinstance(each, ast.Call)):
        name = ast.unparse(call.func)
        limits = [each.value for each in call.keywords if each.arg in LIMITS]
        if name.endswith(WAITS) and "chips" not in path.parts:  # with their own time
            limits += call.args
        is_waiting = any(
            isinstance(each, ast.Constant) and each.value for each in limits
        )
        is_waiting |= name in ("time.sleep", "asyncio.sleep")
        is_compared = name == "time.monotonic" and id(call) in timed
        if (is_waiting and id(call) not in looped) or is_compared:
            yield call.lineno


def test_a_clock_on_the_wall_has_its_reason_on_the_line():
    none_of(
        f"{identified(path)}:{number}"
        for path in files(ROOT / "tests", kinds=("*.py",))
        if CLOCK.search(path.read_text())
        for number in wall_clock(path)
        if "  # " not in path.read_text().splitlines()[number - 1]
    )


@functools.cache
def flags_of(compiler):
    """As for the images, so that programs of other tests share the objects; without
    their defines, because the image of a board has a part of the core.
    """
    processor = {"avr-gcc": "atmega328p", "arm-none-eabi-gcc": "cortex_m4"}
    if compiler in processor:
        words = command(PROCESSORS[processor[compiler]])
        return [word for word in words if not str(word).startswith("-D")]
    # Without -fno-pie constants that hold addresses would be written at load time.
    flags = ("-std=gnu11", "-O2", "-fno-pie", "-Wvla")
    return [compiler, *flags, *native.WARNINGS, "-I", FIRMWARE]


@pytest.mark.parametrize("path", CORE_SOURCES, ids=identified)
@pytest.mark.parametrize("compiler", COMPILERS)
def test_core_compiles_without_a_warning_and_without_floats(compiler, path):
    made = images.compiled(flags_of(compiler), path)
    prefix = compiler.removesuffix("gcc")
    symbols = ran(f"{prefix}nm", made, check=True).stdout
    wanted = re.findall(r" U (\w+)", symbols)
    assert not [name for name in wanted if FLOAT_HELPER.fullmatch(name)]
    assert not {"malloc", "calloc", "realloc", "free"} & set(wanted)
    # State is in structs that the caller owns: nothing writable, nothing zeroed. On the
    # AVR constants live in RAM too, so it cannot tell.
    if compiler != "avr-gcc":
        assert not re.findall(r" [bBdDC] (\w+)", symbols)


@pytest.mark.parametrize(
    "symbol", ["__mulsidi3", "__udivmodsi4", "__aeabi_idiv", "__aeabi_uldivmod"]
)
def test_the_float_check_lets_integers_pass(symbol):
    assert not FLOAT_HELPER.fullmatch(symbol)


@pytest.mark.parametrize(
    ("code", "symbol"),
    [
        ("float f(float a, float b) { return a * b; }", "__mulsf3"),
        ("double f(long a) { return (double)a; }", "__floatsisf"),
        ("long f(float a) { return (long)a; }", "__fixsfsi"),
        ("int f(float a, float b) { return a < b; }", "__ltsf2"),
    ],
)
def test_the_float_check_sees_a_planted_float(code, symbol, tmp_path):
    planted = tmp_path / "planted.c"
    planted.write_text(code)
    made = tmp_path / "planted.o"
    subprocess.run(
        ["avr-gcc", "-mmcu=atmega328p", "-Os", "-c", planted, "-o", made], check=True
    )
    symbols = ran("avr-nm", "-u", made, check=True).stdout.split()
    assert symbol in symbols
    assert FLOAT_HELPER.fullmatch(symbol)
