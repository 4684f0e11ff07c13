// SPDX-License-Identifier: MIT
// The module chips: the modelled sensors of sim/chips as MicroPython objects, each of
// them machine.I2C and data-ready Pin in one. Time continues by their transfers and by
// chips.wait(), and is the port's clock (the linker's --wrap).
#include "lsm9ds0.h"
#include "mpu9250.h"

#include <string.h>

#include "py/mperrno.h"
#include "py/runtime.h"

enum { NS_PER_US = 1000 };

struct chip {
    mp_obj_base_t base;
    struct sensor_chip *sensor;
};

static uint64_t now_ns;

mp_uint_t __wrap_mp_hal_ticks_us(void);
mp_uint_t __wrap_mp_hal_ticks_us(void) {
    return now_ns / NS_PER_US;
}

static struct i2c_slave *wire_of(const struct chip *self) {
    return sensor_chip_wire(self->sensor);
}

// Chip(name): "mpu9250" or "lsm9ds0".
static mp_obj_t make_new(const mp_obj_type_t *type, size_t n_args, size_t n_kw,
                         const mp_obj_t *args) {
    mp_arg_check_num(n_args, n_kw, 1, 1, false);
    struct chip *self = mp_obj_malloc(struct chip, type);
    if (strcmp(mp_obj_str_get_str(args[0]), "mpu9250") == 0) {
        const struct mpu9250_chip_config config = mpu9250_chip_defaults();
        self->sensor = mpu9250_chip_new(&config);
    } else {
        const struct lsm9ds0_chip_config config = lsm9ds0_chip_defaults();
        self->sensor = lsm9ds0_chip_new(&config);
    }
    now_ns = now_ns > 0 ? now_ns : NS_PER_US;
    return MP_OBJ_FROM_PTR(self);
}

static void take_three(mp_obj_t object, double out[3]) {
    mp_obj_t *items;
    mp_obj_get_array_fixed_n(object, 3, &items);
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = (double)mp_obj_get_float(items[axis]);
    }
}

// hold(rad_s, m_s2, ut): the motion from now on, three numbers each.
static mp_obj_t hold(size_t n_args, const mp_obj_t *args) {
    (void)n_args;
    const struct chip *self = MP_OBJ_TO_PTR(args[0]);
    double gyr[3];
    double acc[3];
    double mag[3];
    take_three(args[1], gyr);
    take_three(args[2], acc);
    take_three(args[3], mag);
    sensor_chip_hold(self->sensor, gyr, acc, mag);
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(hold_obj, 4, 4, hold);

static void check(int result) {
    if (result != 0) {
        mp_raise_OSError(result == -1 ? MP_ENODEV : MP_EIO);
    }
}

static mp_obj_t read_into(size_t n_args, const mp_obj_t *args) {
    (void)n_args;
    mp_buffer_info_t bytes;
    mp_get_buffer_raise(args[3], &bytes, MP_BUFFER_WRITE);
    check(i2c_slave_read_registers(
        wire_of(MP_OBJ_TO_PTR(args[0])), &now_ns, (uint8_t)mp_obj_get_int(args[1]),
        (uint8_t)mp_obj_get_int(args[2]), bytes.buf, (uint8_t)bytes.len));
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(read_into_obj, 4, 4, read_into);

static mp_obj_t read_new(size_t n_args, const mp_obj_t *args) {
    vstr_t bytes;
    vstr_init_len(&bytes, (size_t)mp_obj_get_int(args[3]));
    const mp_obj_t into[] = {args[0], args[1], args[2],
                             mp_obj_new_bytearray_by_ref(bytes.len, bytes.buf)};
    (void)read_into(n_args, into);
    return mp_obj_new_bytes_from_vstr(&bytes);
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(read_new_obj, 4, 4, read_new);

static mp_obj_t write_from(size_t n_args, const mp_obj_t *args) {
    (void)n_args;
    mp_buffer_info_t bytes;
    mp_get_buffer_raise(args[3], &bytes, MP_BUFFER_READ);
    check(i2c_slave_write_registers(
        wire_of(MP_OBJ_TO_PTR(args[0])), &now_ns, (uint8_t)mp_obj_get_int(args[1]),
        (uint8_t)mp_obj_get_int(args[2]), bytes.buf, (uint8_t)bytes.len));
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(write_obj, 4, 4, write_from);

// value(): the level of its data-ready pin.
static mp_obj_t value(mp_obj_t object) {
    const struct chip *self = MP_OBJ_TO_PTR(object);
    sensor_chip_advance(self->sensor, now_ns);
    // INT, or DRDY_G.
    return mp_obj_new_bool(sensor_chip_pin_is_high(self->sensor, 0));
}
static MP_DEFINE_CONST_FUN_OBJ_1(value_obj, value);

// complaint(): the first thing done against the data sheet, or None.
static mp_obj_t complaint(mp_obj_t object) {
    const struct chip *self = MP_OBJ_TO_PTR(object);
    const char *said = sensor_chip_complaint(self->sensor);
    return said == NULL ? mp_const_none : mp_obj_new_str(said, strlen(said));
}
static MP_DEFINE_CONST_FUN_OBJ_1(complaint_obj, complaint);

static const mp_rom_map_elem_t chip_table[] = {
    {MP_ROM_QSTR(MP_QSTR_hold), MP_ROM_PTR(&hold_obj)},
    {MP_ROM_QSTR(MP_QSTR_readfrom_mem_into), MP_ROM_PTR(&read_into_obj)},
    {MP_ROM_QSTR(MP_QSTR_readfrom_mem), MP_ROM_PTR(&read_new_obj)},
    {MP_ROM_QSTR(MP_QSTR_writeto_mem), MP_ROM_PTR(&write_obj)},
    {MP_ROM_QSTR(MP_QSTR_value), MP_ROM_PTR(&value_obj)},
    {MP_ROM_QSTR(MP_QSTR_complaint), MP_ROM_PTR(&complaint_obj)},
};
static MP_DEFINE_CONST_DICT(chip_dict, chip_table);

static MP_DEFINE_CONST_OBJ_TYPE(chip_type, MP_QSTR_Chip, MP_TYPE_FLAG_NONE, make_new,
                                make_new, locals_dict, &chip_dict);

// wait(us): time goes by.
static mp_obj_t chips_wait(mp_obj_t us) {
    now_ns += (uint64_t)mp_obj_get_int(us) * NS_PER_US;
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_1(chips_wait_obj, chips_wait);

static const mp_rom_map_elem_t table[] = {
    {MP_ROM_QSTR(MP_QSTR___name__), MP_ROM_QSTR(MP_QSTR_chips)},
    {MP_ROM_QSTR(MP_QSTR_Chip), MP_ROM_PTR(&chip_type)},
    {MP_ROM_QSTR(MP_QSTR_wait), MP_ROM_PTR(&chips_wait_obj)},
};
static MP_DEFINE_CONST_DICT(globals, table);

const mp_obj_module_t chips_module = {
    .base = {&mp_type_module},
    .globals = (mp_obj_dict_t *)&globals,
};
MP_REGISTER_MODULE(MP_QSTR_chips, chips_module);
