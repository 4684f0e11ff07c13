// SPDX-License-Identifier: MIT
// The module imuprobe: the probe of core/ as one MicroPython object. Samples, button
// and received bytes in, bytes of frames out. docs/micropython.md explains its methods.
#include <string.h>

#include "core/drivers/delays.h"
#include "core/probe/commands.h"
#include "generic/identity.h"
#include "object.h"
#include "py/mperrno.h"
#include "py/stream.h"
#include "seam.h"

enum {
    STEP_US = 5000,      // of the button, the periodic messages and the LED
    ROOM_MIN = 256,      // of the ring: two of the longest frames
    RECEIVED_MAX = 128,  // bytes taken from a stream in one call
};

// Every method that calls core/ does so between these two, and raises no exception
// there.
static struct imuprobe *enter(mp_obj_t object) {
    if (imuprobe_current != NULL) {
        mp_raise_msg(&mp_type_RuntimeError, MP_ERROR_TEXT("called from its own call"));
    }
    imuprobe_current = MP_OBJ_TO_PTR(object);
    return imuprobe_current;
}

static void leave(struct imuprobe *self) {
    imuprobe_current = NULL;
    const mp_obj_t raised = self->raised;
    if (raised != MP_OBJ_NULL) {
        self->raised = MP_OBJ_NULL;
        nlr_raise(raised);
    }
}

// A time argument, modulo 2^32, or the port's clock, which is the device's.
static uint32_t time_of(size_t count, const mp_obj_t *args, size_t at) {
    return count > at ? (uint32_t)mp_obj_get_int_truncated(args[at])
                      : (uint32_t)mp_hal_ticks_us();
}

static uint16_t small(mp_int_t value) {
    if (value < 0 || value > UINT16_MAX) {
        mp_raise_ValueError(MP_ERROR_TEXT("not from 0 to 65535"));
    }
    return (uint16_t)value;
}

// The object

static void take_firmware(struct imuprobe *self, mp_obj_t text) {
    size_t length;
    const char *bytes = mp_obj_str_get_data(text, &length);
    memcpy(self->firmware, bytes,
           length < sizeof self->firmware ? length : sizeof self->firmware);
}

// As the firmware in C: a board keeps its id when it changes between the two.
static void take_id(struct imuprobe *self, mp_obj_t object) {
    mp_buffer_info_t id;
    mp_get_buffer_raise(object, &id, MP_BUFFER_READ);
    if (id.len > UINT8_MAX) {
        mp_raise_ValueError(MP_ERROR_TEXT("an id has 255 bytes at most"));
    }
    identity_fold(id.buf, (uint8_t)id.len, self->id);
}

// Fills memory from storage.load(buffer), which leaves it alone where it has nothing.
static void load(struct imuprobe *self) {
    memset(self->cells, 0xFF, sizeof self->cells);
    if (self->storage == mp_const_none) {
        return;
    }
    mp_obj_t call[3];
    mp_load_method(self->storage, MP_QSTR_save, call);  // it must be there, too
    mp_load_method(self->storage, MP_QSTR_load, call);
    self->buffer.items = self->cells;
    self->buffer.len = sizeof self->cells;
    call[2] = MP_OBJ_FROM_PTR(&self->buffer);
    (void)mp_call_method_n_kw(1, 0, call);
}

static mp_obj_t make_new(const mp_obj_type_t *type, size_t n_args, size_t n_kw,
                         const mp_obj_t *all_args) {
    enum {
        ARG_STORAGE,
        ARG_ID,
        ARG_FIRMWARE,
        ARG_BOARD,
        ARG_RESET_CAUSE,
        ARG_MHZ,
        ARG_ROOM,
        ARG_TIME
    };
    const mp_arg_t allowed[] = {
        {MP_QSTR_storage, MP_ARG_OBJ, {.u_obj = mp_const_none}},
        {MP_QSTR_id, MP_ARG_REQUIRED | MP_ARG_KW_ONLY | MP_ARG_OBJ, {0}},
        {MP_QSTR_firmware, MP_ARG_REQUIRED | MP_ARG_KW_ONLY | MP_ARG_OBJ, {0}},
        {MP_QSTR_board, MP_ARG_KW_ONLY | MP_ARG_INT, {.u_int = BOARD_MICROPYTHON}},
        {MP_QSTR_reset_cause, MP_ARG_KW_ONLY | MP_ARG_INT, {.u_int = 0}},
        {MP_QSTR_mhz, MP_ARG_KW_ONLY | MP_ARG_INT, {.u_int = 1}},
        {MP_QSTR_room, MP_ARG_KW_ONLY | MP_ARG_INT, {.u_int = 4096}},
        {MP_QSTR_time_us, MP_ARG_KW_ONLY | MP_ARG_OBJ, {.u_obj = mp_const_none}},
    };
    mp_arg_val_t args[MP_ARRAY_SIZE(allowed)];
    mp_arg_parse_all_kw_array(n_args, n_kw, all_args, MP_ARRAY_SIZE(allowed), allowed,
                              args);
    struct imuprobe *self = mp_obj_malloc(struct imuprobe, type);
    memset((uint8_t *)self + sizeof self->base, 0, sizeof *self - sizeof self->base);
    const uint16_t room = small(args[ARG_ROOM].u_int);
    imuprobe_ports_init(self, room > ROOM_MIN ? room : ROOM_MIN);
    self->storage = args[ARG_STORAGE].u_obj;
    self->recover = self->i2c = self->ready = mp_const_none;
    take_id(self, args[ARG_ID].u_obj);
    take_firmware(self, args[ARG_FIRMWARE].u_obj);
    self->board = (uint8_t)args[ARG_BOARD].u_int;
    self->reset_cause = (uint8_t)args[ARG_RESET_CAUSE].u_int;
    self->cycles_per_us = (uint8_t)args[ARG_MHZ].u_int;
    load(self);
    const bool is_told = args[ARG_TIME].u_obj != mp_const_none;
    self->stepped_us = time_of(is_told ? 1 : 0, &args[ARG_TIME].u_obj, 0);
    const mp_obj_t object = MP_OBJ_FROM_PTR(self);
    (void)enter(object);
    probe_begin(&self->probe, &self->port, self->stepped_us);
    leave(self);
    return object;
}

// Its sensor

// attach(kind, i2c, ready, recover=None, *, gyr=0x6B, xm=0x1D, fast=False): core's own
// driver, over an I2C object and a data-ready pin whose interrupt calls edge(); with
// None in its place the sensor is asked.
static mp_obj_t attach(size_t n_args, const mp_obj_t *all_args, mp_map_t *kw) {
    enum { ARG_KIND, ARG_I2C, ARG_READY, ARG_RECOVER, ARG_GYR, ARG_XM, ARG_FAST };
    const mp_arg_t allowed[] = {
        {MP_QSTR_kind, MP_ARG_REQUIRED | MP_ARG_INT, {0}},
        {MP_QSTR_i2c, MP_ARG_REQUIRED | MP_ARG_OBJ, {0}},
        {MP_QSTR_ready, MP_ARG_REQUIRED | MP_ARG_OBJ, {0}},
        {MP_QSTR_recover, MP_ARG_OBJ, {.u_obj = mp_const_none}},
        {MP_QSTR_gyr, MP_ARG_KW_ONLY | MP_ARG_INT, {.u_int = 0}},
        {MP_QSTR_xm, MP_ARG_KW_ONLY | MP_ARG_INT, {.u_int = 0}},
        {MP_QSTR_fast, MP_ARG_KW_ONLY | MP_ARG_BOOL, {.u_bool = false}},
    };
    mp_arg_val_t args[MP_ARRAY_SIZE(allowed)];
    mp_arg_parse_all(n_args - 1, all_args + 1, kw, MP_ARRAY_SIZE(allowed), allowed,
                     args);
    // Each method that is called from within core/ must be there.
    mp_obj_t call[2];
    mp_load_method(args[ARG_I2C].u_obj, MP_QSTR_readfrom_mem_into, call);
    mp_load_method(args[ARG_I2C].u_obj, MP_QSTR_writeto_mem, call);
    if (args[ARG_READY].u_obj != mp_const_none) {
        mp_load_method(args[ARG_READY].u_obj, MP_QSTR_value, call);
    }
    const mp_int_t kind = args[ARG_KIND].u_int;
    if (kind != SENSOR_LSM9DS0 && kind != SENSOR_MPU9250 && kind != SENSOR_LSM6DSOX) {
        mp_raise_ValueError(MP_ERROR_TEXT("core has no driver for this sensor"));
    }
    struct imuprobe *self = enter(all_args[0]);
    self->i2c = args[ARG_I2C].u_obj;
    self->ready = args[ARG_READY].u_obj;
    self->recover = args[ARG_RECOVER].u_obj;
    if (kind == SENSOR_MPU9250) {
        imuprobe_use_mpu9250(self);
    } else if (kind == SENSOR_LSM6DSOX) {
        imuprobe_use_lsm6dsox(self);
    } else {
        imuprobe_use_lsm9ds0(self, (uint8_t)args[ARG_GYR].u_int,
                             (uint8_t)args[ARG_XM].u_int, args[ARG_FAST].u_bool);
    }
    acquisition_begin(&self->acquisition, &self->acquisition_port, &self->probe);
    leave(self);
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_KW(attach_obj, 4, attach);

// edge(pin): for Pin.irq, as a hard interrupt where the port has them.
static mp_obj_t edge(mp_obj_t object, mp_obj_t pin) {
    (void)pin;
    struct imuprobe_edges *edges = &((struct imuprobe *)MP_OBJ_TO_PTR(object))->edges;
    edges->stamp_us = (uint32_t)mp_hal_ticks_us();
    edges->count = edges->count + 1;
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_2(edge_obj, edge);

static void end_of_work(struct imuprobe *self, uint32_t begun_us) {
    const uint32_t worked_us = (uint32_t)mp_hal_ticks_us() - begun_us;
    probe_worked(&self->probe, worked_us * self->cycles_per_us);
}

// While a sensor without the wire is asked, the next sample comes soon: no turn of the
// main loop, in Python, is as short as the questions must be apart.
enum { ASKING_US = 1500, ASKING_TRIES = 2000 };

static bool step_sensor(struct imuprobe *self) {
    const uint32_t begun_us = (uint32_t)mp_hal_ticks_us();
    uint32_t now_us = begun_us;
    for (unsigned tries = 0; tries < ASKING_TRIES; tries++) {
        if (acquisition_step(&self->acquisition, now_us)) {
            if (self->acquisition.is_polled) {
                self->read_us = now_us;
            }
            return true;
        }
        now_us = (uint32_t)mp_hal_ticks_us();
        if (!acquisition_is_due(&self->acquisition, now_us) ||
            now_us - begun_us > ASKING_US) {
            break;
        }
    }
    return false;
}

// acquire(): one step of the attached sensor: of its set-up, or the next sample. True
// where there was a sample.
static mp_obj_t acquire(mp_obj_t object) {
    struct imuprobe *self = enter(object);
    bool worked = false;
    if (self->i2c != mp_const_none) {
        worked = step_sensor(self);
        if (worked) {
            end_of_work(self, self->read_us);
        }
    }
    leave(self);
    return mp_obj_new_bool(worked);
}
static MP_DEFINE_CONST_FUN_OBJ_1(acquire_obj, acquire);

// sensor(kind, rate_hz, acc_lsb, gyr_lsb, mag_lsb, who_am_i=0[, time_us]): a sensor
// whose samples come by sample(). What one count is: 1e-9 m/s2, 1e-9 rad/s, 1e-6 uT.
// Its low-pass delays what it measures as core's driver of that chip has it, which a
// host knows by the kind and by who_am_i; 0: not known, no delay.
static mp_obj_t sensor(size_t n_args, const mp_obj_t *args) {
    const mp_int_t who_am_i = n_args > 6 ? mp_obj_get_int(args[6]) : 0;
    if (who_am_i < 0 || who_am_i > UINT8_MAX) {
        mp_raise_ValueError(MP_ERROR_TEXT("who_am_i is a byte"));
    }
    struct sensor_identity identity = {
        .kind = (uint8_t)mp_obj_get_int(args[1]),
        .who_am_i = {(uint8_t)who_am_i},
        .rate_hz = small(mp_obj_get_int(args[2])),
        .acc_lsb_nm_s2 = (uint32_t)mp_obj_get_int(args[3]),
        .gyr_lsb_nrad_s = (uint32_t)mp_obj_get_int(args[4]),
        .mag_lsb_pt = (uint32_t)mp_obj_get_int(args[5]),
    };
    if (who_am_i != 0) {
        (void)delays_of_kind(&identity);
    }
    if (identity.rate_hz == 0) {
        mp_raise_ValueError(MP_ERROR_TEXT("rate_hz is 0"));
    }
    const uint32_t now_us = time_of(n_args, args, 7);
    struct imuprobe *self = enter(args[0]);
    self->identity = identity;
    probe_sensor_ready(&self->probe, &self->identity, now_us);
    leave(self);
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(sensor_obj, 6, 8, sensor);

// As a raw message has it: a field without a reading is null in all axes.
static void take_sample(const struct message_raw *raw, uint32_t time_us,
                        struct sample *out) {
    memcpy(&out->acc, raw->acc, sizeof out->acc);
    memcpy(&out->gyr, raw->gyr, sizeof out->gyr);
    memcpy(&out->mag, raw->mag, sizeof out->mag);
    out->time_us = time_us;
    out->temperature_cdeg = raw->temperature;
    out->has_mag = raw->mag[0] != RAW_MAG_NULL;
    out->mag_overflow = (raw->sample_flags & SAMPLE_MAG_OVERFLOW) != 0;
    out->acc_clipped = (raw->sample_flags & SAMPLE_ACC_CLIPPED) != 0;
    out->gyr_clipped = (raw->sample_flags & SAMPLE_GYR_CLIPPED) != 0;
    out->has_gap = (raw->sample_flags & SAMPLE_GAP) != 0;
    if (!out->has_mag) {
        out->mag = (struct counts){0};
    }
}

enum { VALUES = 11 };  // of a sample: three each of acc, gyr, mag; temperature; flags

// sample(values[, time_us]): an array('h') with the fields of a raw message.
static mp_obj_t sample(size_t n_args, const mp_obj_t *args) {
    mp_buffer_info_t values;
    mp_get_buffer_raise(args[1], &values, MP_BUFFER_READ);
    if (values.len != VALUES * sizeof(int16_t)) {
        mp_raise_ValueError(MP_ERROR_TEXT("a sample is an array('h') of 11"));
    }
    const uint32_t begun_us = (uint32_t)mp_hal_ticks_us();
    const uint32_t time_us = time_of(n_args, args, 2);
    const int16_t *value = values.buf;
    struct message_raw raw = {.temperature = value[9],
                              .sample_flags = (uint8_t)value[10]};
    memcpy(raw.acc, value, sizeof raw.acc);
    memcpy(raw.gyr, value + 3, sizeof raw.gyr);
    memcpy(raw.mag, value + 6, sizeof raw.mag);
    struct sample taken;
    take_sample(&raw, time_us, &taken);
    struct imuprobe *self = enter(args[0]);
    const bool is_ready = self->probe.identity != NULL;
    if (is_ready) {
        self->edges.count++;
        probe_sample(&self->probe, &taken);
        end_of_work(self, begun_us);
    }
    leave(self);
    return mp_obj_new_bool(is_ready);
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(sample_obj, 2, 3, sample);

// The wire

// The bytes that are there, without waiting. Each is looked for before it is read:
// ports wait for all that they are asked for.
static size_t read_waiting(mp_obj_t stream, uint8_t *bytes, size_t size) {
    const mp_stream_p_t *calls =
        mp_get_stream_raise(stream, MP_STREAM_OP_READ | MP_STREAM_OP_IOCTL);
    size_t length = 0;
    while (length < size) {
        int error;
        const mp_uint_t ready =
            calls->ioctl(stream, MP_STREAM_POLL, MP_STREAM_POLL_RD, &error);
        if (ready == MP_STREAM_ERROR || (ready & MP_STREAM_POLL_RD) == 0 ||
            calls->read(stream, bytes + length, 1, &error) != 1) {
            break;
        }
        length++;
    }
    return length;
}

static void hear(struct imuprobe *self, const uint8_t *bytes, size_t length,
                 uint32_t now_us) {
    for (size_t i = 0; i < length; i++) {
        commands_receive(&self->probe, bytes[i], now_us);
    }
}

// receive(source[, time_us]): received bytes, or a stream that has them.
static mp_obj_t receive(size_t n_args, const mp_obj_t *args) {
    uint8_t waiting[RECEIVED_MAX];
    mp_buffer_info_t buffer;
    if (!mp_get_buffer(args[1], &buffer, MP_BUFFER_READ)) {
        buffer.buf = waiting;
        buffer.len = read_waiting(args[1], waiting, sizeof waiting);
    }
    if (buffer.len > 0) {
        const uint32_t now_us = time_of(n_args, args, 2);
        struct imuprobe *self = enter(args[0]);
        hear(self, buffer.buf, buffer.len, now_us);
        leave(self);
    }
    return MP_OBJ_NEW_SMALL_INT(buffer.len);
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(receive_obj, 2, 3, receive);

static uint16_t waiting_of(const struct imuprobe_ring *ring) {
    return (uint16_t)(ring->head - ring->tail +
                      (ring->head >= ring->tail ? 0 : ring->size));
}

// send(stream[, most]): writes what waits, `most` bytes at a time, as far as the stream
// takes it. Returns how many bytes wait still.
static mp_obj_t send(size_t n_args, const mp_obj_t *args) {
    struct imuprobe_ring *ring = &((struct imuprobe *)MP_OBJ_TO_PTR(args[0]))->ring;
    size_t left = n_args > 2 ? small(mp_obj_get_int(args[2])) : ring->size;
    const mp_stream_p_t *calls = mp_get_stream_raise(args[1], MP_STREAM_OP_WRITE);
    while (ring->head != ring->tail && left > 0) {
        size_t piece = (ring->head > ring->tail ? ring->head : ring->size) - ring->tail;
        piece = piece < left ? piece : left;
        int error;
        const mp_uint_t done =
            calls->write(args[1], ring->bytes + ring->tail, piece, &error);
        if (done == MP_STREAM_ERROR || done == 0) {
            break;
        }
        ring->tail = (ring_index)((ring->tail + done) % ring->size);
        left -= done;
    }
    return MP_OBJ_NEW_SMALL_INT(waiting_of(ring));
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(send_obj, 2, 3, send);

// take(buffer): moves waiting bytes into a bytearray; returns how many.
static mp_obj_t take(mp_obj_t object, mp_obj_t target) {
    struct imuprobe_ring *ring = &((struct imuprobe *)MP_OBJ_TO_PTR(object))->ring;
    mp_buffer_info_t out;
    mp_get_buffer_raise(target, &out, MP_BUFFER_WRITE);
    size_t length = 0;
    while (length < out.len && ring->head != ring->tail) {
        ((uint8_t *)out.buf)[length++] = ring->bytes[ring->tail];
        ring->tail = (ring_index)((ring->tail + 1) % ring->size);
    }
    return MP_OBJ_NEW_SMALL_INT(length);
}
static MP_DEFINE_CONST_FUN_OBJ_2(take_obj, take);

// Its steps

// step(is_button_down[, time_us]): every 5 ms the button, the periodic messages and the
// settings; call it as often as you like. Returns what the LED shows.
static mp_obj_t step(size_t n_args, const mp_obj_t *args) {
    const bool is_down = mp_obj_is_true(args[1]);
    const uint32_t now_us = time_of(n_args, args, 2);
    struct imuprobe *self = enter(args[0]);
    if (now_us - self->stepped_us >= STEP_US) {
        self->stepped_us = now_us;
        probe_step(&self->probe, is_down, now_us);
    }
    const bool is_lit = probe_led(&self->probe, now_us);
    leave(self);
    return mp_obj_new_bool(is_lit);
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(step_obj, 2, 3, step);

// tell(event, cause, detail[, time_us]): numbers of the protocol's enums.
static mp_obj_t tell(size_t n_args, const mp_obj_t *args) {
    const enum event event = (enum event)mp_obj_get_int(args[1]);
    const enum cause cause = (enum cause)mp_obj_get_int(args[2]);
    const int32_t detail = (int32_t)mp_obj_get_int_truncated(args[3]);
    const uint32_t now_us = time_of(n_args, args, 4);
    struct imuprobe *self = enter(args[0]);
    probe_tell(&self->probe, event, cause, detail, now_us);
    leave(self);
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_VAR_BETWEEN(tell_obj, 4, 5, tell);

// supply(mv): told once a second, in `status`; 0: not known.
static mp_obj_t supply(mp_obj_t object, mp_obj_t mv) {
    ((struct imuprobe *)MP_OBJ_TO_PTR(object))->supply_mv = small(mp_obj_get_int(mv));
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_2(supply_obj, supply);

// battery(mv, is_low): told once a second, in `equipment`; 65535: not known.
static mp_obj_t battery(mp_obj_t object, mp_obj_t mv, mp_obj_t is_low) {
    struct imuprobe *self = MP_OBJ_TO_PTR(object);
    self->battery_mv = small(mp_obj_get_int(mv));
    self->is_battery_low = mp_obj_is_true(is_low);
    imuprobe_use_battery(self);
    return mp_const_none;
}
static MP_DEFINE_CONST_FUN_OBJ_3(battery_obj, battery);

// wants_reset(): a host asked for it.
static mp_obj_t wants_reset(mp_obj_t object) {
    const struct imuprobe *self = MP_OBJ_TO_PTR(object);
    return mp_obj_new_bool(self->probe.wants_reset);
}
static MP_DEFINE_CONST_FUN_OBJ_1(wants_reset_obj, wants_reset);

// clang-format off
#define METHODS                                                      \
    {MP_ROM_QSTR(MP_QSTR_attach), MP_ROM_PTR(&attach_obj)},          \
    {MP_ROM_QSTR(MP_QSTR_edge), MP_ROM_PTR(&edge_obj)},              \
    {MP_ROM_QSTR(MP_QSTR_acquire), MP_ROM_PTR(&acquire_obj)},        \
    {MP_ROM_QSTR(MP_QSTR_sensor), MP_ROM_PTR(&sensor_obj)},          \
    {MP_ROM_QSTR(MP_QSTR_sample), MP_ROM_PTR(&sample_obj)},          \
    {MP_ROM_QSTR(MP_QSTR_receive), MP_ROM_PTR(&receive_obj)},        \
    {MP_ROM_QSTR(MP_QSTR_send), MP_ROM_PTR(&send_obj)},              \
    {MP_ROM_QSTR(MP_QSTR_take), MP_ROM_PTR(&take_obj)},              \
    {MP_ROM_QSTR(MP_QSTR_step), MP_ROM_PTR(&step_obj)},              \
    {MP_ROM_QSTR(MP_QSTR_tell), MP_ROM_PTR(&tell_obj)},              \
    {MP_ROM_QSTR(MP_QSTR_supply), MP_ROM_PTR(&supply_obj)},          \
    {MP_ROM_QSTR(MP_QSTR_battery), MP_ROM_PTR(&battery_obj)},        \
    {MP_ROM_QSTR(MP_QSTR_wants_reset), MP_ROM_PTR(&wants_reset_obj)}
// clang-format on

#if defined(IMUPROBE_MPY)

// A .mpy can't have static variables (mpy_ld.py).
mp_obj_full_type_t probe_type;
mp_map_elem_t probe_table[13];
static MP_DEFINE_CONST_DICT(probe_dict, probe_table);

mp_obj_t mpy_init(mp_obj_fun_bc_t *self, size_t n_args, size_t n_kw, mp_obj_t *args) {
    (void)n_args;
    (void)n_kw;
    (void)args;
    MP_DYNRUNTIME_INIT_ENTRY
    native_begin();
    const mp_rom_map_elem_t methods[] = {METHODS};
    _Static_assert(sizeof methods == sizeof probe_table, "a row for each method");
    memcpy(probe_table, methods, sizeof methods);
    probe_type.base.type = &mp_type_type;
    probe_type.flags = MP_TYPE_FLAG_NONE;
    probe_type.name = MP_QSTR_Probe;
    MP_OBJ_TYPE_SET_SLOT(&probe_type, make_new, make_new, 0);
    MP_OBJ_TYPE_SET_SLOT(&probe_type, locals_dict, (void *)&probe_dict, 1);
    mp_store_global(MP_QSTR_Probe, MP_OBJ_FROM_PTR(&probe_type));
    mp_store_global(MP_QSTR_LSM6DSOX, MP_OBJ_NEW_SMALL_INT(SENSOR_LSM6DSOX));
    mp_store_global(MP_QSTR_LSM9DS0, MP_OBJ_NEW_SMALL_INT(SENSOR_LSM9DS0));
    mp_store_global(MP_QSTR_MPU9250, MP_OBJ_NEW_SMALL_INT(SENSOR_MPU9250));
    MP_DYNRUNTIME_INIT_EXIT
}

#else

static const mp_rom_map_elem_t probe_table[] = {METHODS};
static MP_DEFINE_CONST_DICT(probe_dict, probe_table);

static MP_DEFINE_CONST_OBJ_TYPE(probe_type, MP_QSTR_Probe, MP_TYPE_FLAG_NONE, make_new,
                                make_new, locals_dict, &probe_dict);

static const mp_rom_map_elem_t module_table[] = {
    {MP_ROM_QSTR(MP_QSTR___name__), MP_ROM_QSTR(MP_QSTR_imuprobe)},
    {MP_ROM_QSTR(MP_QSTR_Probe), MP_ROM_PTR(&probe_type)},
    {MP_ROM_QSTR(MP_QSTR_LSM6DSOX), MP_ROM_INT(SENSOR_LSM6DSOX)},
    {MP_ROM_QSTR(MP_QSTR_LSM9DS0), MP_ROM_INT(SENSOR_LSM9DS0)},
    {MP_ROM_QSTR(MP_QSTR_MPU9250), MP_ROM_INT(SENSOR_MPU9250)},
};
static MP_DEFINE_CONST_DICT(module_dict, module_table);

const mp_obj_module_t imuprobe_module = {
    .base = {&mp_type_module},
    .globals = (mp_obj_dict_t *)&module_dict,
};
MP_REGISTER_MODULE(MP_QSTR_imuprobe, imuprobe_module);

#endif
