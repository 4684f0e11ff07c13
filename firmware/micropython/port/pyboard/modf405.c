// SPDX-License-Identifier: MIT
// The module f405, what firmware/stm32 has and machine has not: a storage for the
// probe's settings without a file system, in the journal that the C firmware reads,
// too; and the supply.
#include "py/mperrno.h"
#include "py/runtime.h"

#include "board.h"

static void get_cells(mp_obj_t object, mp_buffer_info_t *cells, mp_uint_t flags) {
    mp_get_buffer_raise(object, cells, flags);
    if (cells->len != MEMORY_SIZE) {
        mp_raise_ValueError(MP_ERROR_TEXT("settings are 1024 bytes"));
    }
}

static mp_obj_t f405_load(mp_obj_t object) {
    mp_buffer_info_t cells;
    get_cells(object, &cells, MP_BUFFER_WRITE);
    for (uint16_t offset = 0; offset < MEMORY_SIZE; offset++) {
        ((uint8_t *)cells.buf)[offset] = memory_read(&board_memory, offset);
    }
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_1(f405_load_obj, f405_load);

// From the end on: what makes a bank count is its first byte.
static mp_obj_t f405_save(mp_obj_t object) {
    mp_buffer_info_t cells;
    get_cells(object, &cells, MP_BUFFER_READ);
    const uint8_t *bytes = cells.buf;
    for (uint16_t offset = MEMORY_SIZE; offset-- > 0;) {
        if (memory_read(&board_memory, offset) != bytes[offset]) {
            board_memory.write(board_memory.port, offset, bytes[offset]);
        }
        if (memory_read(&board_memory, offset) != bytes[offset]) {
            mp_raise_OSError(MP_EIO);
        }
    }
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_1(f405_save_obj, f405_save);

// supply_mv(): 0 where it can't be known.
static mp_obj_t f405_supply_mv(void) {
    return MP_OBJ_NEW_SMALL_INT(board_supply_mv());
}
static MP_DEFINE_CONST_FUN_OBJ_0(f405_supply_mv_obj, f405_supply_mv);

static const mp_rom_map_elem_t table[] = {
    {MP_ROM_QSTR(MP_QSTR___name__), MP_ROM_QSTR(MP_QSTR_f405)},
    {MP_ROM_QSTR(MP_QSTR_load), MP_ROM_PTR(&f405_load_obj)},
    {MP_ROM_QSTR(MP_QSTR_save), MP_ROM_PTR(&f405_save_obj)},
    {MP_ROM_QSTR(MP_QSTR_supply_mv), MP_ROM_PTR(&f405_supply_mv_obj)},
};
static MP_DEFINE_CONST_DICT(globals, table);

const mp_obj_module_t f405_module = {
    .base = {&mp_type_module},
    .globals = (mp_obj_dict_t *)&globals,
};
MP_REGISTER_MODULE(MP_QSTR_f405, f405_module);
