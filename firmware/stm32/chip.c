// SPDX-License-Identifier: MIT
// The sensor of this board: an LSM9DS0 with both address pins high.
#include "chip.h"

#include "../board.h"
#include "core/drivers/lsm9ds0.h"

#ifndef CHIP_IS_FAST
#define CHIP_IS_FAST false  // 380 samples a second; true: 760
#endif

static struct lsm9ds0 chip = {
    .config = {.gyr_address = LSM9DS0_GYR_ADDRESS,
               .xm_address = LSM9DS0_XM_ADDRESS,
               .is_fast = CHIP_IS_FAST},
};
const IN_FLASH struct sensor_driver board_sensor = LSM9DS0_DRIVER(&chip);

bool chip_power_down(void) {
    return lsm9ds0_power_down(&chip, &board_bus);
}
