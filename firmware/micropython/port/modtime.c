// SPDX-License-Identifier: MIT
// The module time: the functions of MicroPython's that the package uses.
#include "py/mphal.h"
#include "py/runtime.h"
#include "py/smallint.h"

// Ticks are small integers, which wrap.
#define PERIOD ((mp_uint_t)MP_SMALL_INT_POSITIVE_MASK + 1)

static mp_obj_t small(mp_uint_t ticks) {
    return MP_OBJ_NEW_SMALL_INT(ticks & (PERIOD - 1));
}

static mp_obj_t ticks_us(void) {
    return small(mp_hal_ticks_us());
}
static MP_DEFINE_CONST_FUN_OBJ_0(ticks_us_obj, ticks_us);

static mp_obj_t ticks_ms(void) {
    return small(mp_hal_ticks_ms());
}
static MP_DEFINE_CONST_FUN_OBJ_0(ticks_ms_obj, ticks_ms);

static mp_obj_t ticks_add(mp_obj_t ticks, mp_obj_t delta) {
    return small((mp_uint_t)mp_obj_get_int(ticks) + (mp_uint_t)mp_obj_get_int(delta));
}
static MP_DEFINE_CONST_FUN_OBJ_2(ticks_add_obj, ticks_add);

// From minus half a period on, below half of one.
static mp_obj_t ticks_diff(mp_obj_t end, mp_obj_t start) {
    const mp_uint_t half = PERIOD / 2;
    const mp_uint_t moved =
        (mp_uint_t)MP_OBJ_SMALL_INT_VALUE(end) - MP_OBJ_SMALL_INT_VALUE(start) + half;
    return MP_OBJ_NEW_SMALL_INT((mp_int_t)(moved & (PERIOD - 1)) - (mp_int_t)half);
}
static MP_DEFINE_CONST_FUN_OBJ_2(ticks_diff_obj, ticks_diff);

static mp_obj_t sleep_ms(mp_obj_t ms) {
    mp_hal_delay_ms((mp_uint_t)mp_obj_get_int(ms));
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_1(sleep_ms_obj, sleep_ms);

static mp_obj_t sleep_us(mp_obj_t us) {
    mp_hal_delay_us((mp_uint_t)mp_obj_get_int(us));
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_1(sleep_us_obj, sleep_us);

static const mp_rom_map_elem_t table[] = {
    {MP_ROM_QSTR(MP_QSTR___name__), MP_ROM_QSTR(MP_QSTR_time)},
    {MP_ROM_QSTR(MP_QSTR_ticks_us), MP_ROM_PTR(&ticks_us_obj)},
    {MP_ROM_QSTR(MP_QSTR_ticks_ms), MP_ROM_PTR(&ticks_ms_obj)},
    {MP_ROM_QSTR(MP_QSTR_ticks_add), MP_ROM_PTR(&ticks_add_obj)},
    {MP_ROM_QSTR(MP_QSTR_ticks_diff), MP_ROM_PTR(&ticks_diff_obj)},
    {MP_ROM_QSTR(MP_QSTR_sleep_ms), MP_ROM_PTR(&sleep_ms_obj)},
    {MP_ROM_QSTR(MP_QSTR_sleep_us), MP_ROM_PTR(&sleep_us_obj)},
};
static MP_DEFINE_CONST_DICT(globals, table);

const mp_obj_module_t time_module = {
    .base = {&mp_type_module},
    .globals = (mp_obj_dict_t *)&globals,
};
MP_REGISTER_MODULE(MP_QSTR_time, time_module);
