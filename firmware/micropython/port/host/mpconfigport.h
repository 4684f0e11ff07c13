// SPDX-License-Identifier: MIT
// MicroPython on this machine, for tests of the module imuprobe.
#include <stddef.h>

#include "../config.h"

#define MICROPY_EMIT_X64 (1)
// Machine code needs memory that may be executed.
#define MP_PLAT_ALLOC_EXEC(least, bytes, size) host_alloc_exec(least, bytes, size)
#define MP_PLAT_FREE_EXEC(bytes, size) host_free_exec(bytes, size)
void host_alloc_exec(size_t least, void **bytes, size_t *size);
void host_free_exec(void *bytes, size_t size);

#define MICROPY_READER_POSIX (1)
#define MICROPY_PY_SYS_ARGV (1)
#define MICROPY_PY_SYS_PATH (1)
#define MICROPY_HW_BOARD_NAME "host"
#define MICROPY_HW_MCU_NAME "this machine"
#define MICROPY_PY_SYS_PLATFORM "host"
