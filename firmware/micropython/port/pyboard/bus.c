// SPDX-License-Identifier: MIT
// machine.I2C: bus 1, on X9 and X10. A read sleeps between its bytes.
#include <string.h>

#include "clock.h"
#include "cpu.h"
#include "generic/bus_recovery.h"
#include "gpio.h"
#include "i2c.h"
#include "objects.h"
#include "pins.h"
#include "py/mperrno.h"
#include "py/runtime.h"

#include "board.h"

enum {
    BUS = 1,
    OPEN_DRAIN = 1,
    READ_US_MAX = 4500,  // as firmware/stm32/sampling.c has it
    IDLE_EVENTS_MAX = 1000,
    WRITE_MAX = 32,
};

struct i2c_object {
    mp_obj_base_t base;
};

static volatile bool is_over;
static volatile uint16_t idle_events;

// Events that bring nothing come again and again while a device holds the clock.
void bus_event(void) {
    switch (i2c_step()) {
    case I2C_WAITS:
        idle_events++;
        if (idle_events < IDLE_EVENTS_MAX) {
            return;
        }
        break;
    case I2C_MOVED:
        idle_events = 0;
        return;
    default:
        break;
    }
    is_over = true;
}

static void open_pin(uint8_t pin) {
    GPIOB->otyper |= (uint32_t)OPEN_DRAIN << pin;
    GPIOB->afr[pin / 8] = (GPIOB->afr[pin / 8] & ~(UINT32_C(0xF) << (4 * (pin % 8)))) |
                          (uint32_t)ALTERNATE_I2C1 << (4 * (pin % 8));
    gpio_set_pull(GPIOB, pin, GPIO_NO_PULL);
    gpio_set_mode(GPIOB, pin, GPIO_ALTERNATE);
}

static void open_bus(void) {
    open_pin(PIN_SCL);
    open_pin(PIN_SDA);
    i2c_init();
    irq_enable(IRQ_I2C1_EVENT, PRIORITY_SAMPLING);
    irq_enable(IRQ_I2C1_ERROR, PRIORITY_SAMPLING);
}

// I2C(1, freq=400000): the only bus, at its only rate.
static mp_obj_t make_new(const mp_obj_type_t *type, size_t n_args, size_t n_kw,
                         const mp_obj_t *args) {
    mp_arg_check_num(n_args, n_kw, 1, MP_OBJ_FUN_ARGS_MAX, true);
    if (mp_obj_get_int(args[0]) != BUS) {
        mp_raise_ValueError(MP_ERROR_TEXT("this board has I2C(1)"));
    }
    open_bus();
    return MP_OBJ_FROM_PTR(mp_obj_malloc(struct i2c_object, type));
}

static mp_obj_t init(size_t n_args, const mp_obj_t *args, mp_map_t *kw) {
    (void)n_args;
    (void)args;
    (void)kw;
    open_bus();
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_KW(init_obj, 1, init);

static enum bus_result read_asleep(const struct bus_burst *burst, uint8_t *bytes) {
    is_over = false;
    idle_events = 0;
    const uint32_t begun_us = clock_us();
    if (!i2c_read(burst, 1, bytes)) {
        return i2c_abort();
    }
    const uint32_t primask = cpu_mask();
    while (!is_over && clock_us() - begun_us < READ_US_MAX) {
        cpu_sleep();
    }
    cpu_unmask(primask);
    return !is_over || idle_events == IDLE_EVENTS_MAX ? i2c_abort() : i2c_result();
}

static mp_obj_t check(enum bus_result result) {
    switch (result) {
    case BUS_OK:
        return mp_const_none;
    case BUS_NACK:
        mp_raise_OSError(MP_ENODEV);
    case BUS_TIMEOUT:
        mp_raise_OSError(MP_ETIMEDOUT);
    default:
        mp_raise_OSError(MP_EIO);
    }
}

// readfrom_mem_into(address, register, buffer)
static mp_obj_t read_into(size_t n_args, const mp_obj_t *args) {
    (void)n_args;
    mp_buffer_info_t bytes;
    mp_get_buffer_raise(args[3], &bytes, MP_BUFFER_WRITE);
    if (bytes.len == 0 || bytes.len > UINT8_MAX) {
        mp_raise_ValueError(MP_ERROR_TEXT("1 to 255 bytes"));
    }
    const struct bus_burst burst = {(uint8_t)mp_obj_get_int(args[1]),
                                    (uint8_t)mp_obj_get_int(args[2]),
                                    (uint8_t)bytes.len};
    return check(read_asleep(&burst, bytes.buf));
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(read_into_obj, 4, 4, read_into);

// readfrom_mem(address, register, length)
static mp_obj_t read_new(size_t n_args, const mp_obj_t *args) {
    vstr_t bytes;
    vstr_init_len(&bytes, (size_t)mp_obj_get_int(args[3]));
    const mp_obj_t into[] = {args[0], args[1], args[2],
                             mp_obj_new_bytearray_by_ref(bytes.len, bytes.buf)};
    (void)read_into(n_args, into);
    return mp_obj_new_bytes_from_vstr(&bytes);
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(read_new_obj, 4, 4, read_new);

// writeto_mem(address, register, buffer)
static mp_obj_t write(size_t n_args, const mp_obj_t *args) {
    (void)n_args;
    mp_buffer_info_t bytes;
    mp_get_buffer_raise(args[3], &bytes, MP_BUFFER_READ);
    if (bytes.len > WRITE_MAX) {
        mp_raise_ValueError(MP_ERROR_TEXT("32 bytes at most"));
    }
    return check(board_bus.write(board_bus.port, (uint8_t)mp_obj_get_int(args[1]),
                                 (uint8_t)mp_obj_get_int(args[2]), bytes.buf,
                                 (uint8_t)bytes.len));
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(write_obj, 4, 4, write);

static const mp_rom_map_elem_t table[] = {
    {MP_ROM_QSTR(MP_QSTR_init), MP_ROM_PTR(&init_obj)},
    {MP_ROM_QSTR(MP_QSTR_readfrom_mem_into), MP_ROM_PTR(&read_into_obj)},
    {MP_ROM_QSTR(MP_QSTR_readfrom_mem), MP_ROM_PTR(&read_new_obj)},
    {MP_ROM_QSTR(MP_QSTR_writeto_mem), MP_ROM_PTR(&write_obj)},
};
static MP_DEFINE_CONST_DICT(dict, table);

MP_DEFINE_CONST_OBJ_TYPE(pyboard_i2c_type, MP_QSTR_I2C, MP_TYPE_FLAG_NONE, make_new,
                         make_new, locals_dict, &dict);
