// SPDX-License-Identifier: MIT
// The model's life, its time and its place on the wire.
#include "chip.h"

#include <string.h>

bool mpu9250_chip_has_ak8963(const struct mpu9250_chip *chip) {
    return chip->config.has_ak8963 &&
           !sensor_chip_suffers(&chip->base, CHIP_FAULT_NO_MAG, 0);
}

void mpu9250_chip_reset(struct mpu9250_chip *chip) {
    const struct mpu9250_chip_config *config = &chip->config;
    mpu9250_chip_cut_aux(chip);
    memset(chip->reg, 0, sizeof chip->reg);
    memset(chip->inner, 0, sizeof chip->inner);
    memset(&chip->aux, 0, sizeof chip->aux);
    memcpy(&chip->reg[REG_SELF_TEST_X_GYRO], config->gyr_self_test, 3);
    memcpy(&chip->reg[REG_SELF_TEST_X_ACCEL], config->acc_self_test, 3);
    chip->reg[REG_PWR_MGMT_1] = 0x01;  // RM 3, the note under table 1
    chip->reg[REG_WHO_AM_I] = config->who_am_i;
    chip->aux.slave = AUX_NONE;
    chip->aux.byte_ns = NEVER;
    chip->base.wire.answers_ns = chip->base.wire.now_ns + chip->base.config.startup_ns;
    chip->awake_ns = chip->base.wire.now_ns;
    chip->is_asleep = false;
    chip->int_level = false;
    chip->int_end_ns = NEVER;
    chip->waits_for_aux = false;
    i2c_slave_release(&chip->base.wire);
    mpu9250_chip_restart_clock(chip);
}

// The wire

static uint8_t find_die(void *self, uint8_t address) {
    const struct mpu9250_chip *chip = self;
    if (address == (chip->config.ad0 ? 0x69 : 0x68)) {
        return MPU9250_CHIP_MPU;
    }
    return address == AK_ADDRESS && mpu9250_chip_is_bypass(chip) &&
                   mpu9250_chip_has_ak8963(chip)
               ? MPU9250_CHIP_AK8963
               : I2C_SLAVE_NOBODY;
}

// RM 4.19, 4.33.
bool mpu9250_chip_is_bypass(const struct mpu9250_chip *chip) {
    return (chip->reg[REG_INT_PIN_CFG] & INT_BYPASS_EN) != 0 &&
           (chip->reg[REG_USER_CTRL] & USER_I2C_MST_EN) == 0;
}

static bool holds_sda(void *self) {
    const struct mpu9250_chip *chip = self;
    return chip->aux_bus.is_held && mpu9250_chip_is_bypass(chip);
}

static void clock_scl(void *self) {
    struct mpu9250_chip *chip = self;
    if (holds_sda(chip) && chip->aux_bus.clocks > 0) {
        chip->aux_bus.clocks--;
        chip->aux_bus.is_held = chip->aux_bus.clocks > 0;
    }
}

static void set_pointer(void *self, uint8_t die, uint8_t byte) {
    struct mpu9250_chip *chip = self;
    if (die == MPU9250_CHIP_MPU) {
        chip->pointer = byte & (REG_COUNT - 1);
    } else {
        chip->ak.pointer = byte;
    }
}

static void write_byte(void *chip, uint8_t die, uint8_t byte) {
    if (die == MPU9250_CHIP_MPU) {
        mpu9250_chip_write_register(chip, byte);
    } else {
        mpu9250_chip_write_ak8963(chip, byte);
    }
}

static uint8_t read_byte(void *chip, uint8_t die) {
    return die == MPU9250_CHIP_MPU ? mpu9250_chip_read_register(chip)
                                   : mpu9250_chip_read_ak8963(chip);
}

static void show(void *chip) {
    mpu9250_chip_show(chip);
}

// Life

static void power_up(void *self) {
    struct mpu9250_chip *chip = self;
    chip->pointer = 0;
    mpu9250_chip_reset_ak8963(chip);
    mpu9250_chip_reset(chip);
    chip->aux_bus = (struct aux_bus){0};
}

// Time

static uint64_t next_event(const void *self) {
    const struct mpu9250_chip *chip = self;
    uint64_t next = chip->tick_ns;
    if (chip->aux.byte_ns < next) {
        next = chip->aux.byte_ns;
    }
    if (chip->ak.measured_ns < next) {
        next = chip->ak.measured_ns;
    }
    if (chip->int_end_ns < next) {
        next = chip->int_end_ns;
    }
    return next;
}

static void suffer(void *self, const struct chip_fault *fault) {
    struct mpu9250_chip *chip = self;
    if (fault->kind == CHIP_FAULT_MAG_HUNG) {
        chip->aux_bus = (struct aux_bus){true, fault->clocks};
    } else {
        chip->reg[fault->reg & (REG_COUNT - 1)] = fault->value;
        mpu9250_chip_set_next_tick(chip);
    }
}

static void do_events(void *self) {
    struct mpu9250_chip *chip = self;
    const uint64_t now = chip->base.wire.now_ns;
    if (chip->int_end_ns == now) {
        chip->int_end_ns = NEVER;
        chip->int_level = false;
    } else if (chip->ak.measured_ns == now) {
        mpu9250_chip_end_measurement(chip);
    } else if (chip->aux.byte_ns == now) {
        mpu9250_chip_move_aux_byte(chip);
    } else {
        mpu9250_chip_take_sample(chip);
    }
}

// INT.
static bool pin_is_high(const void *self, unsigned pin) {
    const struct mpu9250_chip *chip = self;
    (void)pin;
    const bool is_active_low = (chip->reg[REG_INT_PIN_CFG] & INT_ACTL) != 0;
    return chip->int_level != is_active_low;
}

static uint8_t peek(const void *self, uint8_t die, uint8_t reg) {
    const struct mpu9250_chip *chip = self;
    if (die == MPU9250_CHIP_AK8963) {
        return reg < AK_COUNT ? chip->ak.reg[reg] : 0;
    }
    const uint8_t at = reg & (REG_COUNT - 1);
    return at >= REG_ACCEL_XOUT_H && at <= REG_EXT_SENS_DATA_23 ? chip->inner[at]
                                                                : chip->reg[at];
}

// Of gyroscope and accelerometer.
static uint64_t samples(const void *self, enum chip_quantity quantity) {
    return quantity == CHIP_MAG ? 0 : ((const struct mpu9250_chip *)self)->samples;
}

static const struct sensor_model model = {
    .name = "MPU-9250",
    .wire = {.find_die = find_die,
             .set_pointer = set_pointer,
             .write = write_byte,
             .read = read_byte,
             .idle = show,
             .holds_sda = holds_sda,
             .clock = clock_scl},
    .power_up = power_up,
    .next_event = next_event,
    .do_events = do_events,
    .suffer = suffer,
    .pin_is_high = pin_is_high,
    .peek = peek,
    .samples = samples,
};

struct mpu9250_chip_config mpu9250_chip_defaults(void) {
    return (struct mpu9250_chip_config){
        .sensor = {.temperature_c = 25.0, .startup_ns = 100 * MS},
        .who_am_i = 0x71,
        .has_ak8963 = true,
        .mag_adjust = {176, 178, 166},
        // Responses of 145, 154 and 137 deg/s and of 0.42, 0.45 and 0.52 g.
        .gyr_self_test = {200, 206, 194},
        .acc_self_test = {98, 105, 120},
    };
}

struct sensor_chip *mpu9250_chip_new(const struct mpu9250_chip_config *config) {
    return sensor_chip_new(&model, sizeof(struct mpu9250_chip), config, sizeof *config);
}
