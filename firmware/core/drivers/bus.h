// SPDX-License-Identifier: MIT
// The seam between a driver and whatever carries its registers: a board's I2C, an
// emulated chip, a test that pulls the wire.
#ifndef BUS_H
#define BUS_H

#include <stdint.h>

#include "core/math/in_flash.h"

#define MUST_CHECK __attribute__((warn_unused_result))

enum bus_result {
    BUS_OK = 0,
    BUS_NACK = -1,     // no answer at that address, or a refused byte
    BUS_TIMEOUT = -2,  // the bounded wait ran out
    BUS_STUCK = -3,    // SDA or SCL is held low
};

// Both move `length` bytes from consecutive registers on, in one transaction, and
// return within 5 ms whatever the wire does.
struct bus_device {
    enum bus_result (*read)(void *port, uint8_t address, uint8_t reg, uint8_t *data,
                            uint8_t length);
    enum bus_result (*write)(void *port, uint8_t address, uint8_t reg,
                             const uint8_t *data, uint8_t length);
    void *port;
};

// One read of consecutive registers.
struct bus_burst {
    uint8_t address;
    uint8_t reg;
    uint8_t length;
};

enum { BUS_BURST_MAX = 24 };  // bytes of all that make one sample

#endif
