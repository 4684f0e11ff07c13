// SPDX-License-Identifier: MIT
// The sensor of this board, in the image nano_lsm6dsox: a module of two chips.
#include "../board.h"
#include "core/drivers/adafruit_4517.h"

// Zeroed, or all of it would be copied from flash.
static struct joined module;

static void begin(void *state) {
    module.config = &adafruit_4517;
    joined_begin(state);
}

const IN_FLASH struct sensor_driver board_sensor = JOINED_DRIVER(&module, begin);
