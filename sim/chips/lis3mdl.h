// SPDX-License-Identifier: MIT
// A model of the LIS3MDL, byte by byte on I2C, written from its maker's documents. The
// virtual boards and the driver's tests use it; it depends on no emulator and no
// driver.
//
// Documents: DS = LIS3MDL data sheet, DocID024204 rev 4, as others quote its tables; AN
// = ST's application note AN4602 rev 1, likewise; AD = Adafruit's library
// Adafruit_LIS3MDL; LX = Linux, drivers/iio/magnetometer/st_magn_core.c; AN3308
// (LIS3DH) has more about status and data-ready of the same block. "Memory" beside a
// number: DS, not at hand.
//
// The model asks for the field in its own axes.
//
// Open points of the documents, and the model's choice:
// - A measurement is the mean over as long as it takes (1 / FAST_ODR's rate), and data
//   are ready at its end.
// - From power-up until registers answer: 10 ms. SOFT_RST takes soft_reset_ns.
// - The flags of an axis go as its high byte is read, ZYXDA and ZYXOR as the last one
//   was; a sample behind a word that BDU holds shows, and is flagged, once both halves
//   have been read.
// - Beyond its full scale an output goes on to the ends of 16 bits.
// - Temperature is measured with the field, in steps of 1/8 degC.
//
// Not modelled: noise and offsets, which the motion has (`imud sim --module`), and what
// no firmware here uses: FAST_ODR, low power, single measurements, REBOOT, offset
// registers, big-endian data, FAST_READ, interrupts by threshold (INT), SPI. Turning
// one on is reported (sensor_chip_complaint), like a use that the data sheet forbids.
#ifndef SIM_CHIPS_LIS3MDL_H
#define SIM_CHIPS_LIS3MDL_H

#include <stdbool.h>
#include <stdint.h>

#include "sensor_chip.h"

struct lis3mdl_chip_config {
    struct sensor_chip_config sensor;
    double rate_error_ppm;   // of its clock; positive is fast
    uint64_t soft_reset_ns;  // how long SOFT_RST takes
    uint8_t who_am_i;        // 0x3D
    bool sa1;                // level of the pin: address 0x1C or 0x1E
    double self_test_ut[3];  // response of each axis
};

// A plain LIS3MDL: no rate error, 25 degC, SA1 low.
struct lis3mdl_chip_config lis3mdl_chip_defaults(void);

// A chip whose power comes at time 0; its pin is DRDY. Null where memory is out. The
// byte after an address is the sub-address: bit 7 has it move on with each byte. Its
// die is number 1. CHIP_FAULT_NO_MAG: it answers no more.
struct sensor_chip *lis3mdl_chip_new(const struct lis3mdl_chip_config *config);

#endif
