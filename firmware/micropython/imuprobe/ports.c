// SPDX-License-Identifier: MIT
// The board functions of core/, provided by MicroPython objects; see object.h.
#include <string.h>

#include "object.h"
#include "py/binary.h"
#include "py/mperrno.h"
#include "seam.h"

#include "generic/ring.h"

struct imuprobe *imuprobe_current;

enum { CALL_MAX = 5 };  // method, object, three arguments

// An exception must not leave core/ with its work half done.
mp_obj_t imuprobe_call(struct imuprobe *self, size_t count, mp_obj_t *call,
                       int *error) {
    nlr_buf_t nlr;
    if (nlr_push(&nlr) == 0) {
        const mp_obj_t result = mp_call_method_n_kw(count, 0, call);
        nlr_pop();
        return result;
    }
    const mp_obj_t raised = MP_OBJ_FROM_PTR(nlr.ret_val);
    *error = 0;
    if (mp_obj_exception_match(raised, MP_OBJ_FROM_PTR(&mp_type_OSError))) {
        const mp_obj_t number = mp_obj_exception_get_value(raised);
        *error = mp_obj_is_small_int(number) ? MP_OBJ_SMALL_INT_VALUE(number) : MP_EIO;
        return MP_OBJ_NULL;
    }
    self->raised = raised;
    return MP_OBJ_NULL;
}

// The wire

static bool put(const uint8_t *bytes, uint8_t length) {
    struct imuprobe_ring *ring = &imuprobe_current->ring;
    if (length > ring_room(ring->size, ring->head, ring->tail)) {
        return false;
    }
    ring->head = ring_write(ring->bytes, ring->size, ring->head, bytes, length);
    return true;
}

// Memory

// A bank counts from the write of its first byte on (core/storage/bank.h): all bytes
// are then saved at once, before core/ reads that byte back.
static bool opens_a_bank(uint16_t offset) {
    return offset == MEMORY_SETTINGS ||
           offset == MEMORY_SETTINGS + MEMORY_SETTINGS_BANK ||
           offset == MEMORY_PARAMS || offset == MEMORY_PARAMS + MEMORY_PARAMS_BANK;
}

static bool save(struct imuprobe *self) {
    if (self->storage == mp_const_none) {
        return true;
    }
    mp_obj_t call[CALL_MAX];
    mp_load_method(self->storage, MP_QSTR_save, call);
    self->buffer.items = self->cells;
    self->buffer.len = sizeof self->cells;
    call[2] = MP_OBJ_FROM_PTR(&self->buffer);
    int error;
    return imuprobe_call(self, 1, call, &error) != MP_OBJ_NULL;
}

static uint8_t memory_get(void *port, uint16_t offset) {
    const struct imuprobe *self = port;
    return self->cells[offset];
}

// A byte that is not kept is read back as before: core/ tries again, then tells it.
static void memory_set(void *port, uint16_t offset, uint8_t value) {
    struct imuprobe *self = port;
    const uint8_t before = self->cells[offset];
    self->cells[offset] = value;
    if (opens_a_bank(offset) && !save(self)) {
        self->cells[offset] = before;
    }
}

static bool memory_is_ready(void *port) {
    (void)port;
    return true;
}

// Who the probe is

static void describe(struct message_hello *out) {
    const struct imuprobe *self = imuprobe_current;
    memcpy(out->firmware, self->firmware, sizeof out->firmware);
    out->board = self->board;
    out->reset_cause = self->reset_cause;
}

static void measure(struct message_status *out) {
    const struct imuprobe *self = imuprobe_current;
    out->supply = self->supply_mv > 0 ? self->supply_mv : STATUS_SUPPLY_NULL;
    out->stack_free = STATUS_STACK_FREE_NULL;
    out->samples_ready =
        self->edges.count + acquisition_polled_edges(&self->acquisition);
    out->receive_lost = self->receive_lost;
}

static void describe_equipment(struct message_equipment *out) {
    const struct imuprobe *self = imuprobe_current;
    out->battery = self->battery_mv;
    out->power = self->is_battery_low ? POWER_LOW : 0;
}

void imuprobe_use_battery(struct imuprobe *self) {
    probe_equip(&self->probe, NULL, describe_equipment);
}

static bool unique_id(uint8_t id[8]) {
    memcpy(id, imuprobe_current->id, sizeof imuprobe_current->id);
    return true;
}

// The bus

// What ports raise: ENODEV or EIO where no device answers, ETIMEDOUT. Its number is
// MicroPython's and Linux's, or newlib's as on an ESP32; a .mpy does not know which.
enum { OWN_ETIMEDOUT = 110, NEWLIB_ETIMEDOUT = 116 };

static enum bus_result transfer(struct imuprobe *self, qstr method, uint8_t address,
                                uint8_t reg, uint8_t *data, uint8_t length) {
    mp_obj_t call[CALL_MAX];
    mp_load_method(self->i2c, method, call);
    self->buffer.items = data;
    self->buffer.len = length;
    call[2] = MP_OBJ_NEW_SMALL_INT(address);
    call[3] = MP_OBJ_NEW_SMALL_INT(reg);
    call[4] = MP_OBJ_FROM_PTR(&self->buffer);
    int error;
    if (imuprobe_call(self, 3, call, &error) != MP_OBJ_NULL) {
        return BUS_OK;
    }
    const bool is_late = error == OWN_ETIMEDOUT || error == NEWLIB_ETIMEDOUT;
    return error == 0 || is_late ? BUS_TIMEOUT : BUS_NACK;
}

static enum bus_result read_registers(void *port, uint8_t address, uint8_t reg,
                                      uint8_t *data, uint8_t length) {
    return transfer(port, MP_QSTR_readfrom_mem_into, address, reg, data, length);
}

static enum bus_result write_registers(void *port, uint8_t address, uint8_t reg,
                                       const uint8_t *data, uint8_t length) {
    uint8_t copy[BUS_BURST_MAX];
    memcpy(copy, data, length);
    return transfer(port, MP_QSTR_writeto_mem, address, reg, copy, length);
}

static enum bus_result recover_bus(void) {
    struct imuprobe *self = imuprobe_current;
    if (self->recover == mp_const_none) {
        return BUS_OK;
    }
    mp_obj_t call[2] = {self->recover, MP_OBJ_NULL};
    int error;
    const mp_obj_t freed = imuprobe_call(self, 0, call, &error);
    return freed == mp_const_true ? BUS_OK : BUS_STUCK;
}

// Samples

static bool line_is_high(struct imuprobe *self) {
    if (self->ready == mp_const_none) {
        return false;
    }
    mp_obj_t call[CALL_MAX];
    mp_load_method(self->ready, MP_QSTR_value, call);
    int error;
    const mp_obj_t level = imuprobe_call(self, 0, call, &error);
    return level != MP_OBJ_NULL && mp_obj_is_true(level);
}

static void start_sampling(const struct bus_burst *bursts, uint8_t count) {
    struct imuprobe *self = imuprobe_current;
    memcpy(self->bursts, bursts, count * sizeof *bursts);
    self->bursts_count = count;
    // Three quarters of a period: the bursts' beginning fits into the rest.
    self->stale_us = UINT32_C(750000) / self->driver.identity->rate_hz;
    self->edges.taken = self->edges.count;
    self->is_sampling = true;
    // The age of a reading that already waits is unknown.
    self->is_stale = line_is_high(self);
}

static void stop_sampling(void) {
    imuprobe_current->is_sampling = false;
}

static enum bus_result read_bursts(struct imuprobe *self, uint8_t *bytes) {
    for (uint8_t i = 0; i < self->bursts_count; i++) {
        const struct bus_burst *burst = &self->bursts[i];
        const enum bus_result result =
            read_registers(self, burst->address, burst->reg, bytes, burst->length);
        if (result != BUS_OK) {
            return result;
        }
        bytes += burst->length;
    }
    return BUS_OK;
}

// Count and time of the last edge belong together: another edge may come while they are
// read.
static uint32_t last_edge(const struct imuprobe_edges *edges, uint32_t *stamp_us) {
    uint32_t count;
    do {
        count = edges->count;
        *stamp_us = edges->stamp_us;
    } while (count != edges->count);
    return count;
}

static enum reading_result take_reading(struct reading *out) {
    struct imuprobe *self = imuprobe_current;
    struct imuprobe_edges *edges = &self->edges;
    const uint32_t count = last_edge(edges, &out->time_us);
    const uint32_t waiting = count - edges->taken;
    if (!self->is_sampling || (waiting == 0 && !self->is_stale)) {
        return READING_NONE;
    }
    const bool is_late = (uint32_t)mp_hal_ticks_us() - out->time_us > self->stale_us;
    const bool is_stale = self->is_stale || is_late;
    const enum bus_result result = read_bursts(self, out->bytes);
    self->read_us = (uint32_t)mp_hal_ticks_us();
    self->is_stale = false;
    edges->taken = count;
    if (result != BUS_OK) {
        return (enum reading_result)result;
    }
    if (is_stale) {
        edges->missed = (uint16_t)(edges->missed + waiting);
        return READING_NONE;
    }
    out->missed = (uint16_t)(edges->missed + waiting - 1);
    edges->missed = 0;
    return READING_OK;
}

static uint32_t time_us(void) {
    return (uint32_t)mp_hal_ticks_us();
}

void imuprobe_use_lsm9ds0(struct imuprobe *self, uint8_t gyr_address,
                          uint8_t xm_address, bool is_fast) {
    self->chip.lsm9ds0 = (struct lsm9ds0){
        .config = {.gyr_address = gyr_address != 0 ? gyr_address : LSM9DS0_GYR_ADDRESS,
                   .xm_address = xm_address != 0 ? xm_address : LSM9DS0_XM_ADDRESS,
                   .is_fast = is_fast},
    };
    const struct sensor_driver driver = LSM9DS0_DRIVER(&self->chip.lsm9ds0);
    self->driver = driver;
}

void imuprobe_use_mpu9250(struct imuprobe *self) {
    self->chip.mpu9250 = (struct mpu9250){0};
    const struct sensor_driver driver = MPU9250_DRIVER(&self->chip.mpu9250);
    self->driver = driver;
}

void imuprobe_use_lsm6dsox(struct imuprobe *self) {
    self->chip.joined = (struct joined){.config = &lsm6dsv16x_lis3mdl};
    const struct sensor_driver driver = JOINED_DRIVER(&self->chip.joined, joined_begin);
    self->driver = driver;
}

void imuprobe_ports_init(struct imuprobe *self, uint16_t room) {
    self->ring.bytes = m_new(uint8_t, room);
    self->ring.size = room;
    self->buffer.base.type = &mp_type_bytearray;
    self->buffer.typecode = BYTEARRAY_TYPECODE;
    self->wire.put = put;
    self->memory = (struct memory){memory_get, memory_set, memory_is_ready, self};
    self->bus = (struct bus_device){read_registers, write_registers, self};
    self->port = (struct probe_port){
        .wire = &self->wire,
        .memory = &self->memory,
        .describe = describe,
        .measure = measure,
        .unique_id = unique_id,
    };
    self->acquisition_port = (struct acquisition_port){
        .sensor = &self->driver,
        .bus = &self->bus,
        .recover_bus = recover_bus,
        .start_sampling = start_sampling,
        .stop_sampling = stop_sampling,
        .take_reading = take_reading,
        .time_us = time_us,
    };
}
