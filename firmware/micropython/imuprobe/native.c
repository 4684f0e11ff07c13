// SPDX-License-Identifier: MIT
// The functions of seam.h, and of libc those that the compiler may call.
#include <string.h>

#include "seam.h"

// A .mpy can't have static variables (mpy_ld.py).
mp_obj_t native_os_error, native_issubclass, native_ticks;
volatile uint32_t native_told_us;

void native_begin(void) {
    const mp_obj_t time =
        mp_import_name(MP_QSTR_time, mp_const_none, MP_OBJ_NEW_SMALL_INT(0));
    native_ticks = mp_load_attr(time, MP_QSTR_ticks_us);
    native_issubclass = mp_load_global(MP_QSTR_issubclass);
    native_os_error = mp_load_global(MP_QSTR_OSError);
}

enum { TICKS = (1 << 30) - 1 };  // the clock's highest, on a board

// It keeps one word alone, and reads it first: a pin's interrupt, which asks too, may
// come anywhere, and so this time is never before the kept one. It has to be asked
// within 17 minutes.
uint32_t native_ticks_us(void) {
    const uint32_t earlier_us = native_told_us;
    const mp_obj_t ticks = mp_call_function_n_kw(native_ticks, 0, 0, NULL);
    const uint32_t since = (uint32_t)MP_OBJ_SMALL_INT_VALUE(ticks) - earlier_us;
    const uint32_t now_us = earlier_us + (since & TICKS);
    native_told_us = now_us;
    return now_us;
}

bool native_is_subclass(const mp_obj_type_t *type, mp_obj_t of) {
    const mp_obj_t both[] = {MP_OBJ_FROM_PTR(type), of};
    return mp_call_function_n_kw(native_issubclass, 2, 0, both) == mp_const_true;
}

mp_obj_t native_errno(mp_obj_t raised) {
    mp_obj_t found[2] = {MP_OBJ_NULL, MP_OBJ_NULL};
    mp_load_method_maybe(raised, MP_QSTR_errno, found);
    return found[0] == MP_OBJ_NULL ? mp_const_none : found[0];
}

// Its second argument is the function.
#if defined(__x86_64__)
#define JUMP "jmp *%rsi"
#elif defined(__thumb__)
#define JUMP "bx r1"
#else
#define JUMP "jr a1"
#endif
__attribute__((naked)) unsigned native_push(nlr_buf_t *buffer,
                                            unsigned (*push)(nlr_buf_t *)) {
    (void)buffer;
    (void)push;
    __asm__ volatile(JUMP);
}

void *memcpy(void *restrict to, const void *restrict from, size_t length) {
    return mp_fun_table.memmove_(to, from, length);
}

void *memmove(void *to, const void *from, size_t length) {
    return mp_fun_table.memmove_(to, from, length);
}

void *memset(void *to, int value, size_t length) {
    return mp_fun_table.memset_(to, value, length);
}

int memcmp(const void *one, const void *other, size_t length) {
    const uint8_t *left = one;
    const uint8_t *right = other;
    for (size_t i = 0; i < length; i++) {
        if (left[i] != right[i]) {
            return left[i] - right[i];
        }
    }
    return 0;
}
