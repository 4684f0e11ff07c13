// SPDX-License-Identifier: MIT
// The bus during set-up, one transfer at a time, and how it is freed.
#include "i2c.h"

#include <string.h>

#include "../board.h"
#include "generic/bus_recovery.h"
#include "hardware/gpio.h"
#include "pico/time.h"
#include "pins.h"

enum {
    BUS_HZ = 400000,
    // BUS_BURST_MAX bytes take 0.7 ms; a sensor may hold the clock for some of it. Both
    // together stay below the 5 ms of board.h.
    ASK_US_MAX = 1500,
    MOVE_US_MAX = 3000,
};

static bool is_held(void) {
    return !gpio_get(PIN_SCL) || !gpio_get(PIN_SDA);
}

// The SDK has no word for a line that is held.
static enum bus_result result_of(int moved, int wanted) {
    if (moved == wanted) {
        return BUS_OK;
    }
    if (is_held()) {
        return BUS_STUCK;
    }
    return moved == PICO_ERROR_TIMEOUT ? BUS_TIMEOUT : BUS_NACK;
}

// False where a line is held. The SDK takes TX_EMPTY for the end of a transmission.
// With the threshold of sampling.c that comes too soon: it would switch the bus off
// over a byte that has not left.
static bool prepare(void) {
    SENSOR_BUS->hw->tx_tl = 0;
    return !is_held();
}

static enum bus_result read(void *port, uint8_t address, uint8_t reg, uint8_t *data,
                            uint8_t length) {
    (void)port;
    if (!prepare()) {
        return BUS_STUCK;
    }
    const int asked =
        i2c_write_timeout_us(SENSOR_BUS, address, &reg, 1, true, ASK_US_MAX);
    if (asked != 1) {
        return result_of(asked, 1);
    }
    const int moved =
        i2c_read_timeout_us(SENSOR_BUS, address, data, length, false, MOVE_US_MAX);
    return result_of(moved, length);
}

static enum bus_result write(void *port, uint8_t address, uint8_t reg,
                             const uint8_t *data, uint8_t length) {
    (void)port;
    if (!prepare()) {
        return BUS_STUCK;
    }
    uint8_t bytes[1 + BUS_BURST_MAX] = {reg};
    memcpy(bytes + 1, data, length);
    const int moved = i2c_write_timeout_us(SENSOR_BUS, address, bytes, 1u + length,
                                           false, MOVE_US_MAX);
    return result_of(moved, 1 + length);
}

const struct bus_device board_bus = {read, write, 0};

// An output can only be low here; high is the pull-up's.
static void set_line(uint pin, bool is_pulled) {
    gpio_set_dir(pin, is_pulled ? GPIO_OUT : GPIO_IN);
}

uint8_t bus_lines(uint8_t pulled) {
    set_line(PIN_SCL, (pulled & BUS_SCL) != 0);
    set_line(PIN_SDA, (pulled & BUS_SDA) != 0);
    busy_wait_us_32(BUS_HALF_CLOCK_US);
    return (uint8_t)((gpio_get(PIN_SCL) ? BUS_SCL : 0) |
                     (gpio_get(PIN_SDA) ? BUS_SDA : 0));
}

enum bus_result board_bus_recover(void) {
    static const uint pins[] = {PIN_SDA, PIN_SCL};
    for (uint8_t i = 0; i < 2; i++) {
        gpio_init(pins[i]);  // an input, low once it is an output
        gpio_pull_up(pins[i]);
    }
    const enum bus_result result = bus_recovery_run();
    (void)i2c_init(SENSOR_BUS, BUS_HZ);  // from its reset: nothing of before is left
    for (uint8_t i = 0; i < 2; i++) {
        gpio_set_function(pins[i], GPIO_FUNC_I2C);
    }
    return result;
}
