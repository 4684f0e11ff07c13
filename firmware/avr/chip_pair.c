// SPDX-License-Identifier: MIT
// The sensor of this board, in the image nano_lsm6dsox: a module of two chips.
#include "../board.h"
#include "parts.h"

// Zeroed, or all of it would be copied from flash.
struct joined chip_pair;

void chip_pair_begin(void *state) {
    chip_pair.config = &adafruit_4517;
    joined_begin(state);
}

const IN_FLASH struct sensor_driver board_sensor =
    JOINED_DRIVER(&chip_pair, chip_pair_begin);
