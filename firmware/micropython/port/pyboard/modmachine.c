// SPDX-License-Identifier: MIT
// The module machine: Pin, I2C, UART, ADC, WDT, and functions of the whole board.
#include "clock.h"
#include "cpu.h"
#include "gpio.h"
#include "idle.h"
#include "objects.h"
#include "pins.h"
#include "py/runtime.h"
#include "reset.h"

#include "board.h"

// idle(): sleeps until an interrupt has brought work, 1 ms at most.
static mp_obj_t machine_idle(void) {
    board_idle();
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_0(machine_idle_obj, machine_idle);

static mp_obj_t machine_reset(void) {
    board_reset();
}
static MP_DEFINE_CONST_FUN_OBJ_0(machine_reset_obj, machine_reset);

// reset_cause(): flags of the protocol's reset_cause.
static mp_obj_t machine_reset_cause(void) {
    return MP_OBJ_NEW_SMALL_INT(board_reset_cause());
}
static MP_DEFINE_CONST_FUN_OBJ_0(machine_reset_cause_obj, machine_reset_cause);

static mp_obj_t machine_unique_id(void) {
    enum { ID_BYTES = 12 };
    uint8_t id[ID_BYTES];
    for (uint8_t i = 0; i < ID_BYTES; i++) {
        id[i] = (uint8_t)(UNIQUE_ID[i / 4] >> (8 * (i % 4)));
    }
    return mp_obj_new_bytes(id, sizeof id);
}
static MP_DEFINE_CONST_FUN_OBJ_0(machine_unique_id_obj, machine_unique_id);

static mp_obj_t machine_freq(void) {
    return MP_OBJ_NEW_SMALL_INT(F_CPU);
}
static MP_DEFINE_CONST_FUN_OBJ_0(machine_freq_obj, machine_freq);

// WDT(timeout=...): its time is the board's, 200 ms.
static mp_obj_t wdt_make_new(const mp_obj_type_t *type, size_t n_args, size_t n_kw,
                             const mp_obj_t *args);
static mp_obj_t wdt_feed(mp_obj_t object) {
    (void)object;
    board_watchdog_kick();
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_1(wdt_feed_obj, wdt_feed);

static const mp_rom_map_elem_t wdt_table[] = {
    {MP_ROM_QSTR(MP_QSTR_feed), MP_ROM_PTR(&wdt_feed_obj)},
};
static MP_DEFINE_CONST_DICT(wdt_dict, wdt_table);

static MP_DEFINE_CONST_OBJ_TYPE(wdt_type, MP_QSTR_WDT, MP_TYPE_FLAG_NONE, make_new,
                                wdt_make_new, locals_dict, &wdt_dict);
static const mp_obj_base_t wdt = {&wdt_type};

static mp_obj_t wdt_make_new(const mp_obj_type_t *type, size_t n_args, size_t n_kw,
                             const mp_obj_t *args) {
    (void)type;
    (void)args;
    mp_arg_check_num(n_args, n_kw, 0, 2, true);
    reset_watch();
    return MP_OBJ_FROM_PTR(&wdt);
}

static const mp_rom_map_elem_t table[] = {
    {MP_ROM_QSTR(MP_QSTR___name__), MP_ROM_QSTR(MP_QSTR_machine)},
    {MP_ROM_QSTR(MP_QSTR_idle), MP_ROM_PTR(&machine_idle_obj)},
    {MP_ROM_QSTR(MP_QSTR_reset), MP_ROM_PTR(&machine_reset_obj)},
    {MP_ROM_QSTR(MP_QSTR_reset_cause), MP_ROM_PTR(&machine_reset_cause_obj)},
    {MP_ROM_QSTR(MP_QSTR_unique_id), MP_ROM_PTR(&machine_unique_id_obj)},
    {MP_ROM_QSTR(MP_QSTR_freq), MP_ROM_PTR(&machine_freq_obj)},
    {MP_ROM_QSTR(MP_QSTR_PWRON_RESET), MP_ROM_INT(RESET_CAUSE_POWER_ON)},
    {MP_ROM_QSTR(MP_QSTR_HARD_RESET), MP_ROM_INT(RESET_CAUSE_EXTERNAL)},
    {MP_ROM_QSTR(MP_QSTR_BROWN_OUT_RESET), MP_ROM_INT(RESET_CAUSE_BROWN_OUT)},
    {MP_ROM_QSTR(MP_QSTR_WDT_RESET), MP_ROM_INT(RESET_CAUSE_WATCHDOG)},
    {MP_ROM_QSTR(MP_QSTR_SOFT_RESET), MP_ROM_INT(RESET_CAUSE_SOFTWARE)},
    {MP_ROM_QSTR(MP_QSTR_Pin), MP_ROM_PTR(&pyboard_pin_type)},
    {MP_ROM_QSTR(MP_QSTR_I2C), MP_ROM_PTR(&pyboard_i2c_type)},
    {MP_ROM_QSTR(MP_QSTR_UART), MP_ROM_PTR(&pyboard_uart_type)},
    {MP_ROM_QSTR(MP_QSTR_ADC), MP_ROM_PTR(&pyboard_adc_type)},
    {MP_ROM_QSTR(MP_QSTR_WDT), MP_ROM_PTR(&wdt_type)},
};
static MP_DEFINE_CONST_DICT(globals, table);

const mp_obj_module_t machine_module = {
    .base = {&mp_type_module},
    .globals = (mp_obj_dict_t *)&globals,
};
MP_REGISTER_MODULE(MP_QSTR_machine, machine_module);
