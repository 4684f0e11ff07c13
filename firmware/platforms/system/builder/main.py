# SPDX-License-Identifier: MIT
"""PlatformIO's build script for the platform `system`: the board manifest's
`build.mcu` picks one of the cross compilers on PATH."""

import shutil
import sys

from SCons.Script import (
    COMMAND_LINE_TARGETS,
    AlwaysBuild,
    Builder,
    Default,
    DefaultEnvironment,
)

env = DefaultEnvironment()
mcu = env.BoardConfig().get("build.mcu")

if not mcu.startswith("at"):
    sys.stderr.write(f"Error: the platform `system` knows no compiler for {mcu}\n")
    env.Exit(1)

if not shutil.which("avr-gcc", path=env["ENV"]["PATH"]):
    sys.stderr.write(
        "Error: avr-gcc is not on PATH; Debian: apt-get install gcc-avr avr-libc\n"
    )
    env.Exit(1)

machine = [f"-mmcu={mcu}"]

env.Replace(
    AR="avr-gcc-ar",
    AS="avr-as",
    CC="avr-gcc",
    CXX="avr-g++",
    GDB="avr-gdb",
    OBJCOPY="avr-objcopy",
    RANLIB="avr-gcc-ranlib",
    SIZETOOL="avr-size",
    ARFLAGS=["rc"],
    SIZEPROGREGEXP=r"^(?:\.text|\.data)\s+(\d+).*",
    SIZEDATAREGEXP=r"^(?:\.data|\.bss|\.noinit)\s+(\d+).*",
    SIZECHECKCMD="$SIZETOOL -A -d $SOURCES",
    SIZEPRINTCMD="$SIZETOOL -B -d $SOURCES",
    PROGNAME="firmware",
    PROGSUFFIX=".elf",
)
env.Append(
    ASFLAGS=machine,
    ASPPFLAGS=["-x", "assembler-with-cpp"],
    CCFLAGS=machine,
    CPPDEFINES=[("F_CPU", "$BOARD_F_CPU")],
    # The linker turns calls and jumps that reach into their short forms.
    LINKFLAGS=[*machine, "-Wl,--gc-sections", "-mrelax"],
    BUILDERS={
        "ElfToHex": Builder(
            action=env.VerboseAction(
                "$OBJCOPY -O ihex -R .eeprom $SOURCES $TARGET", "Building $TARGET"
            ),
            suffix=".hex",
        )
    },
)

is_built = "nobuild" in COMMAND_LINE_TARGETS
elf = "$PROGPATH" if is_built else env.BuildProgram()
image = env.ElfToHex("$BUILD_DIR/${PROGNAME}", elf)
if not is_built:
    env.Depends(image, "checkprogsize")

AlwaysBuild(env.Alias("nobuild", image))
env.AddPlatformTarget(
    "size",
    elf,
    env.VerboseAction("$SIZEPRINTCMD", "Calculating size $SOURCE"),
    "Program Size",
    "Print the program's size",
)
env.Replace(
    UPLOADCMD="avrdude -p $BOARD_MCU -c arduino -b $UPLOAD_SPEED -P $UPLOAD_PORT "
    "-D -U flash:w:${SOURCES[0]}:i"
)
env.AddPlatformTarget(
    "upload",
    image,
    [
        env.VerboseAction(env.AutodetectUploadPort, "Looking for upload port..."),
        env.VerboseAction("$UPLOADCMD", "Uploading $SOURCE"),
    ],
    "Upload",
)

Default([env.Alias("buildprog", image)])
