// SPDX-License-Identifier: MIT
// Shared by the files of the LSM9DS0's driver.
//
//   lsm9ds0_setup.c  set-up and self-test; looks after the chip
//   lsm9ds0.c        bursts to samples; neither calls the other
//
// Document: DS = LSM9DS0 data sheet, DocID024763 rev 2 (registers by name, chapter 8).
#ifndef LSM9DS0_PRIVATE_H
#define LSM9DS0_PRIVATE_H

#include "core/drivers/lsm9ds0.h"

enum {
    LSM9DS0_DATA_READY = 0x0F,  // STATUS_REG_G, _A, _M: each axis, and all

    LSM9DS0_AXES_BYTES = 7,         // a status, three axes
    LSM9DS0_TEMPERATURE_BYTES = 2,  // before the magnetometer's
};

// Two bytes, the lower one first.
static inline int16_t lsm9ds0_word(const uint8_t *bytes) {
    return (int16_t)(uint16_t)(bytes[1] * 256u + bytes[0]);
}

#endif
