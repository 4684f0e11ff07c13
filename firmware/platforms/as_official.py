# SPDX-License-Identifier: MIT
"""Adds to the platform `system` what PlatformIO's own platform for the AVR adds to a
project without a framework, so that its flags are tried where it cannot be had.

Which those are: platformio/platform-atmelavr, builder/frameworks/_bare.py. What both
add is left out, and what concerns C++."""

from typing import Any

Import("env")  # type: ignore[name-defined]  # noqa: F821  SCons puts it there
env: Any = globals()["env"]

CC_FLAGS = ["-Os", "-Wall", "-ffunction-sections", "-fdata-sections", "-flto"]

env.Append(
    CFLAGS=["-std=gnu11", "-fno-fat-lto-objects"],
    CCFLAGS=CC_FLAGS,
    ASFLAGS=CC_FLAGS,
    LINKFLAGS=["-Os", "-flto", "-fuse-linker-plugin"],
    LIBS=["m"],
)
