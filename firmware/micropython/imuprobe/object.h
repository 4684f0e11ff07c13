// SPDX-License-Identifier: MIT
// The object `Probe` of the module imuprobe: the probe of core/ with all that it needs,
// and what core/ asks of a board, answered by MicroPython objects.
#ifndef IMUPROBE_OBJECT_H
#define IMUPROBE_OBJECT_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/adafruit_4517.h"
#include "core/drivers/lsm9ds0.h"
#include "core/drivers/mpu9250.h"
#include "core/probe/acquisition.h"
#include "core/probe/probe.h"
#include "core/storage/memory.h"
#include "py/objarray.h"

// Frames on their way to the wire.
typedef uint16_t ring_index;
struct imuprobe_ring {
    uint8_t *bytes;
    ring_index size, head, tail;
};

// Data-ready edges, counted and stamped by the pin's interrupt, which reads and writes
// nothing else of the object.
struct imuprobe_edges {
    volatile uint32_t count;
    volatile uint32_t stamp_us;  // of the last one
    uint32_t taken;              // of them, those that are done with
    uint16_t missed;             // before the next reading
};

struct imuprobe {
    mp_obj_base_t base;
    struct probe probe;
    struct probe_port port;
    struct outlet wire;
    struct memory memory;
    uint8_t cells[MEMORY_SIZE];
    struct imuprobe_ring ring;
    mp_obj_t storage;  // has save(buffer); None: settings last until power goes
    // An exception of an object that was called from within core/, raised at the end.
    mp_obj_t raised;
    uint32_t stepped_us;
    char firmware[sizeof((struct message_hello *)0)->firmware];
    uint8_t id[8];
    uint8_t board, reset_cause, cycles_per_us;
    uint16_t supply_mv, receive_lost, battery_mv;
    bool is_battery_low;

    // The sensor, where core/ has its driver.
    struct acquisition acquisition;
    struct acquisition_port acquisition_port;
    struct sensor_driver driver;
    union {
        struct lsm9ds0 lsm9ds0;
        struct mpu9250 mpu9250;
        struct joined joined;
    } chip;
    struct bus_device bus;
    mp_obj_t i2c;           // machine.I2C or SoftI2C
    mp_obj_t ready;         // its data-ready pin
    mp_obj_t recover;       // function that frees the bus; None: there is none
    mp_obj_array_t buffer;  // a bytearray that is laid over what I2C moves
    struct imuprobe_edges edges;
    struct bus_burst bursts[SENSOR_BURSTS_MAX];  // that make a sample
    uint8_t bursts_count;
    bool is_sampling;
    bool is_stale;      // the time of what the sensor holds is unknown
    uint32_t read_us;   // when the last reading was complete
    uint32_t stale_us;  // a reading that begins so long after its edge may be another's

    // The sensor, where its samples come from MicroPython.
    struct sensor_identity identity;
};

// The object that core/ works for, as it calls without a context; NULL: for none.
extern struct imuprobe *imuprobe_current;

// Fills in the ports, with a ring of `room` bytes; allocates it.
void imuprobe_ports_init(struct imuprobe *self, uint16_t room);
// Has the probe tell its battery from now on.
void imuprobe_use_battery(struct imuprobe *self);
// Chooses the driver, with all of its struct zeroed but a configuration. An address of
// 0 is the usual one.
void imuprobe_use_lsm9ds0(struct imuprobe *self, uint8_t gyr_address,
                          uint8_t xm_address, bool is_fast);
void imuprobe_use_mpu9250(struct imuprobe *self);
void imuprobe_use_lsm6dsox(struct imuprobe *self);  // with its LIS3MDL

// Calls a method, whose name, object and arguments are `call`; NULL where it raised an
// exception: *error is the number of an OSError, and of another exception 0, which is
// kept in `raised`.
mp_obj_t imuprobe_call(struct imuprobe *self, size_t count, mp_obj_t *call, int *error);

#endif
