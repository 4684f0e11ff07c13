// SPDX-License-Identifier: MIT
// The sensor of this board: an MPU-9250 with its address pin low.
#include "../board.h"
#include "core/drivers/mpu9250.h"

struct mpu9250 board_chip;
const IN_FLASH struct sensor_driver board_sensor = MPU9250_DRIVER(&board_chip);
