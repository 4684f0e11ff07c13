// SPDX-License-Identifier: MIT
// MicroPython as the module reaches it: in an image by the port's headers, in a native
// .mpy by the table of functions that MicroPython gives such a file.
#ifndef IMUPROBE_SEAM_H
#define IMUPROBE_SEAM_H

#if !defined(IMUPROBE_MPY)

#include "py/mphal.h"
#include "py/runtime.h"

#else

#include "py/dynruntime.h"

// The rest of this is what the table lacks, made of what it has by native.c.

// To be called first.
void native_begin(void);

// As the port's clock, modulo 2^32: that of Python wraps at 2^30.
uint32_t native_ticks_us(void);
#define mp_hal_ticks_us native_ticks_us

extern mp_obj_t native_os_error;
#define mp_type_OSError (*(mp_obj_type_t *)MP_OBJ_TO_PTR(native_os_error))
bool native_is_subclass(const mp_obj_type_t *type, mp_obj_t of);
#define mp_obj_exception_match(raised, type)                                           \
    native_is_subclass(mp_obj_get_type(raised), (type))
mp_obj_t native_errno(mp_obj_t raised);  // None: it has none
#define mp_obj_exception_get_value native_errno
#define mp_call_method_n_kw mp_fun_table.call_method_n_kw

// A call by a pointer can't say that it returns twice: this jumps to `push`.
unsigned native_push(nlr_buf_t *buffer, unsigned (*push)(nlr_buf_t *))
    __attribute__((returns_twice));
#define nlr_push(buffer) native_push((buffer), mp_fun_table.nlr_push)
#define nlr_pop mp_fun_table.nlr_pop

#define MP_ROM_QSTR MP_OBJ_NEW_QSTR

#endif
#endif
