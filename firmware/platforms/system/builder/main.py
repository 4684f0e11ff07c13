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
board = env.BoardConfig()
mcu = board.get("build.mcu")

# By the mcu's first letters: the compiler's prefix, what Debian calls it, its flags for
# the processor, and the linker's own.
TOOLCHAINS = {
    "at": ("avr-", "gcc-avr avr-libc", [f"-mmcu={mcu}"], []),
    # Nothing is linked that is not ours: no C library, and no float or division of 64
    # bits out of libgcc.
    "stm32": (
        "arm-none-eabi-",
        "gcc-arm-none-eabi",
        ["-mthumb", f"-mcpu={board.get('build.cpu', '')}"],
        ["-nostdlib", "-Wl,--fatal-warnings"],
    ),
}
known = [name for name in TOOLCHAINS if mcu.startswith(name)]
if not known:
    sys.stderr.write(f"Error: the platform `system` knows no compiler for {mcu}\n")
    env.Exit(1)
prefix, packages, machine, link_flags = TOOLCHAINS[known[0]]

if not shutil.which(f"{prefix}gcc", path=env["ENV"]["PATH"]):
    sys.stderr.write(
        f"Error: {prefix}gcc is not on PATH; Debian: apt-get install {packages}\n"
    )
    env.Exit(1)

env.Replace(
    AR=f"{prefix}gcc-ar",
    AS=f"{prefix}as",
    CC=f"{prefix}gcc",
    CXX=f"{prefix}g++",
    GDB=f"{prefix}gdb",
    OBJCOPY=f"{prefix}objcopy",
    RANLIB=f"{prefix}gcc-ranlib",
    SIZETOOL=f"{prefix}size",
    ARFLAGS=["rc"],
    SIZEPROGREGEXP=r"^(?:\.text|\.data)\s+(\d+).*",
    SIZEDATAREGEXP=r"^(?:\.data|\.bss|\.noinit|\.stack)\s+(\d+).*",
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
    LINKFLAGS=[
        *(*machine, "-Wl,--gc-sections", *link_flags),
        "-Wl,-Map=$BUILD_DIR/${PROGNAME}.map",
    ],
    BUILDERS={
        "ElfToHex": Builder(
            action=env.VerboseAction(
                "$OBJCOPY -O ihex -R .eeprom $SOURCES $TARGET", "Building $TARGET"
            ),
            suffix=".hex",
        ),
        "ElfToBin": Builder(
            action=env.VerboseAction(
                "$OBJCOPY -O binary $SOURCES $TARGET", "Building $TARGET"
            ),
            suffix=".bin",
        ),
    },
)

is_built = "nobuild" in COMMAND_LINE_TARGETS
elf = "$PROGPATH" if is_built else env.BuildProgram()
images = [env.ElfToHex("$BUILD_DIR/${PROGNAME}", elf)]
if prefix == "arm-none-eabi-":
    images.append(env.ElfToBin("$BUILD_DIR/${PROGNAME}", elf))
if not is_built:
    env.Depends(images, "checkprogsize")

AlwaysBuild(env.Alias("nobuild", images))
env.AddPlatformTarget(
    "size",
    elf,
    env.VerboseAction("$SIZEPRINTCMD", "Calculating size $SOURCE"),
    "Program Size",
    "Print the program's size",
)
UPLOADS = {
    # Of a Mega's bootloader: STK500v2, and a reset by DTR.
    "wiring": (
        "avrdude -p $BOARD_MCU -c wiring -b $UPLOAD_SPEED -P $UPLOAD_PORT "
        "-D -U flash:w:${SOURCES[0]}:i",
        True,
    ),
    "arduino": (
        "avrdude -p $BOARD_MCU -c arduino -b $UPLOAD_SPEED -P $UPLOAD_PORT "
        "-D -U flash:w:${SOURCES[0]}:i",
        True,
    ),
    "dfu": ("dfu-util -a 0 -s 0x08000000:leave -D ${SOURCES[1]}", False),
    "stlink": ("st-flash --reset --format ihex write ${SOURCES[0]}", False),
    "serial": ("stm32flash -w ${SOURCES[0]} -v -g 0x0 $UPLOAD_PORT", True),
}
protocol = env.subst("$UPLOAD_PROTOCOL")
if protocol not in UPLOADS:
    sys.stderr.write(f"Error: upload_protocol is one of {', '.join(UPLOADS)}\n")
    env.Exit(1)
command, needs_port = UPLOADS[protocol]
env.Replace(UPLOADCMD=command)
env.AddPlatformTarget(
    "upload",
    images,
    [
        *(
            [env.VerboseAction(env.AutodetectUploadPort, "Looking for upload port...")]
            if needs_port
            else []
        ),
        env.VerboseAction("$UPLOADCMD", "Uploading $SOURCE"),
    ],
    "Upload",
)

Default([env.Alias("buildprog", images)])
