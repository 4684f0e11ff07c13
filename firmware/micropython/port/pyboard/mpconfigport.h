// SPDX-License-Identifier: MIT
// MicroPython on the STM32F405 of a pyboard, as far as a probe needs it.
#include "../config.h"

#define MICROPY_EMIT_THUMB (1)
#define MICROPY_EMIT_INLINE_THUMB (0)
// Bit 0 of an address says that its code is Thumb's.
#define MICROPY_MAKE_POINTER_CALLABLE(code) ((void *)((uint32_t)(code) | 1))
#define MICROPY_READER_VFS (1)  // rom.c has its function
#define MICROPY_PY_SYS_PATH (1)
#define MICROPY_HW_BOARD_NAME "virtual pyboard"
#define MICROPY_HW_MCU_NAME "STM32F405RG"
#define MICROPY_PY_SYS_PLATFORM "pyboard"
// An exception can be raised where there is no heap left, or in an interrupt.
#define MICROPY_ENABLE_EMERGENCY_EXCEPTION_BUF (1)
#define MICROPY_EMERGENCY_EXCEPTION_BUF_SIZE (128)
// Interrupts schedule functions.
#define MICROPY_BEGIN_ATOMIC_SECTION() pyboard_mask()
#define MICROPY_END_ATOMIC_SECTION(state) pyboard_unmask(state)
uint32_t pyboard_mask(void);
void pyboard_unmask(uint32_t state);
