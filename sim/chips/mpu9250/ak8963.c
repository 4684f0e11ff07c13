// SPDX-License-Identifier: MIT
// The AK8963: its modes, its measurements and its registers.
#include "chip.h"

#include <math.h>
#include <string.h>

// AK 8.2.
enum {
    AK_WIA = 0x00,
    AK_INFO = 0x01,
    AK_ST1 = 0x02,
    AK_HXL = 0x03,
    AK_HZH = 0x08,
    AK_ST2 = 0x09,
    AK_CNTL1 = 0x0A,
    AK_CNTL2 = 0x0B,
    AK_ASTC = 0x0C,
    AK_I2CDIS = 0x0F,
    AK_ASAX = 0x10,
    AK_ASAZ = 0x12,
    AK_DRDY = 1 << 0,
    AK_DOR = 1 << 1,
    AK_HOFL = 1 << 3,
    AK_BITM = 1 << 4,
    AK_MODE = 0x0F,
    AK_16_BIT = 1 << 4,
    AK_SRST = 1 << 0,
    AK_SELF = 1 << 6,
};
enum ak_mode {
    AK_POWER_DOWN = 0,
    AK_CONTINUOUS_100_HZ = 6,
    AK_SELF_TEST = 8,
    AK_FUSE_ROM = 15,
};

#define AK_MEASURE_NS (7200 * US)  // AK 5.3.1: TSM, typical
#define AK_WAIT_NS (100 * US)      // AK 6.3: Twat after power-down
#define AK_OVERFLOW_UT 4912.0      // AK 6.4.3.6: |X| + |Y| + |Z|
#define AK_LSB_UT 0.15             // AK 8.3.4: of 16 bits

void mpu9250_chip_reset_ak8963(struct mpu9250_chip *chip) {
    struct ak8963 *ak = &chip->ak;
    memset(ak, 0, sizeof *ak);
    ak->reg[AK_WIA] = 0x48;   // AK 8.3.1
    ak->reg[AK_INFO] = 0x9A;  // AK 8.3.2 leaves it open; what parts of this kind answer
    memcpy(&ak->reg[AK_ASAX], chip->config.mag_adjust, sizeof chip->config.mag_adjust);
    ak->measured_ns = NEVER;
    ak->powered_down_ns = chip->base.wire.now_ns;
}

// The period of the continuous mode, AK 6.4.3.
static double ak_period_ns(const struct mpu9250_chip *chip) {
    return 1e9 / (100.0 * (1.0 + chip->config.mag_rate_error_ppm * 1e-6));
}

static void ak_begin_measurement(struct mpu9250_chip *chip) {
    struct ak8963 *ak = &chip->ak;
    const double start = (double)ak->count * ak_period_ns(chip);
    ak->count++;
    ak->measured_ns = ak->started_ns + (uint64_t)llround(start) + AK_MEASURE_NS;
}

// The field at the middle of the measurement, uT, in the AK8963's own axes.
static void ak_sense(struct mpu9250_chip *chip, double own_ut[3]) {
    const uint8_t mode = chip->ak.reg[AK_CNTL1] & AK_MODE;
    const int64_t at_ns = (int64_t)(chip->ak.measured_ns - AK_MEASURE_NS / 2);
    double field[3];
    chip_motion_mean(&chip->base.motion, CHIP_MAG, at_ns, at_ns, field);
    own_ut[0] = field[1];  // PS 9.1
    own_ut[1] = field[0];
    own_ut[2] = -field[2];
    if (mode == AK_SELF_TEST && (chip->ak.reg[AK_ASTC] & AK_SELF) != 0) {
        // AK 9.4.4: the judgment in 16 bits is -200..200, -200..200, -3200..-800 after
        // adjustment. The internal coil is far stronger than the field outside.
        own_ut[0] = 40.0 * AK_LSB_UT;
        own_ut[1] = -60.0 * AK_LSB_UT;
        own_ut[2] = -1900.0 * AK_LSB_UT;
    }
}

// Writes the data registers and ST2.
static void ak_publish(struct mpu9250_chip *chip, const double own_ut[3]) {
    const double limit = 32760.0;  // AK 8.3.4
    double sum = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        // AK 8.3.11: Hadj = H * ((ASA - 128) * 0.5 / 128 + 1)
        const double adjust = (chip->config.mag_adjust[axis] - 128) * 0.5 / 128.0 + 1.0;
        int16_t counts =
            chip_motion_to_counts(own_ut[axis] / AK_LSB_UT / adjust, limit);
        if (counts < -limit) {
            counts = (int16_t)-limit;
        }
        uint8_t *data = &chip->ak.reg[AK_HXL + 2 * axis];
        data[0] = (uint8_t)((uint16_t)counts & 0xFF);
        data[1] = (uint8_t)((uint16_t)counts >> 8);
        sum += fabs(own_ut[axis]);
    }
    chip->ak.reg[AK_ST2] = (uint8_t)((sum >= AK_OVERFLOW_UT ? AK_HOFL : 0) | AK_BITM);
}

void mpu9250_chip_end_measurement(struct mpu9250_chip *chip) {
    struct ak8963 *ak = &chip->ak;
    const uint8_t mode = ak->reg[AK_CNTL1] & AK_MODE;
    double own_ut[3];
    ak_sense(chip, own_ut);
    if (sensor_chip_suffers(&chip->base, CHIP_FAULT_MAG_IDLE, 0)) {
        ak_begin_measurement(chip);
        return;
    }
    if (ak->is_reading) {
        ak->reg[AK_ST1] |= AK_DOR;  // AK 6.4.3.4: protected data stay, this one is lost
    } else {
        if (ak->reg[AK_ST1] & AK_DRDY) {
            ak->reg[AK_ST1] |= AK_DOR;
        }
        if (!sensor_chip_suffers(&chip->base, CHIP_FAULT_FROZEN, 0)) {
            ak_publish(chip, own_ut);
        }
        ak->reg[AK_ST1] |= AK_DRDY;
    }
    if (mode == AK_CONTINUOUS_100_HZ) {
        ak_begin_measurement(chip);
    } else {
        // AK 6.4.2: self-test falls back to power-down.
        ak->reg[AK_CNTL1] &= (uint8_t)~AK_MODE;
        ak->powered_down_ns = ak->measured_ns;
        ak->measured_ns = NEVER;
    }
}

static void ak_set_mode(struct mpu9250_chip *chip, uint8_t value) {
    struct ak8963 *ak = &chip->ak;
    const uint8_t old = ak->reg[AK_CNTL1] & AK_MODE;
    const uint8_t mode = value & AK_MODE;
    const bool is_measuring = mode == AK_CONTINUOUS_100_HZ || mode == AK_SELF_TEST;
    const bool is_known = mode == AK_POWER_DOWN || mode == AK_FUSE_ROM ||
                          (is_measuring && (value & AK_16_BIT));
    if (!is_known) {
        sensor_chip_complain_of(&chip->base, "AK8963",
                                "a mode that is prohibited or not modelled");
        return;
    }
    // AK 6.3: from one mode to another only through power-down, and 100 us in it.
    if (mode != AK_POWER_DOWN && old != AK_POWER_DOWN && old != mode) {
        sensor_chip_complain_of(&chip->base, "AK8963",
                                "mode changed without power-down between");
        return;
    }
    if (mode != AK_POWER_DOWN && old == AK_POWER_DOWN &&
        chip->base.wire.now_ns - ak->powered_down_ns < AK_WAIT_NS) {
        sensor_chip_complain_of(&chip->base, "AK8963",
                                "mode set within 100 us of power-down");
        return;
    }
    ak->reg[AK_CNTL1] = value & (AK_MODE | AK_16_BIT);
    ak->measured_ns = NEVER;
    if (mode == AK_POWER_DOWN) {
        if (old != AK_POWER_DOWN) {
            ak->powered_down_ns = chip->base.wire.now_ns;
        }
    } else if (is_measuring) {
        ak->started_ns = chip->base.wire.now_ns;
        ak->count = 0;
        ak_begin_measurement(chip);
    }
}

// AK 7.2.3: two rings of addresses.
static void ak_step(struct ak8963 *ak) {
    if (ak->pointer == AK_ASTC) {
        ak->pointer = AK_WIA;
    } else if (ak->pointer == AK_ASAZ) {
        ak->pointer = AK_ASAX;
    } else {
        ak->pointer++;
    }
}

void mpu9250_chip_write_ak8963(struct mpu9250_chip *chip, uint8_t value) {
    struct ak8963 *ak = &chip->ak;
    switch (ak->pointer) {
    case AK_CNTL1:
        ak_set_mode(chip, value);
        break;
    case AK_CNTL2:
        if (value & AK_SRST) {  // AK 8.3.8
            const uint8_t pointer = ak->pointer;
            mpu9250_chip_reset_ak8963(chip);
            ak->pointer = pointer;
        }
        break;
    case AK_ASTC:
        ak->reg[AK_ASTC] = value & AK_SELF;  // AK 8.3.9: other bits must be 0
        break;
    case AK_I2CDIS:
        sensor_chip_complain_of(&chip->base, "AK8963", "I2CDIS written");
        break;
    default:
        sensor_chip_complain_of(&chip->base, "AK8963",
                                "a read-only or reserved register written");
        break;
    }
    ak_step(ak);
}

uint8_t mpu9250_chip_read_ak8963(struct mpu9250_chip *chip) {
    struct ak8963 *ak = &chip->ak;
    const uint8_t at = ak->pointer;
    uint8_t value = at < AK_COUNT ? ak->reg[at] : 0;
    if (at >= AK_ASAX && at <= AK_ASAZ &&
        (ak->reg[AK_CNTL1] & AK_MODE) != AK_FUSE_ROM) {
        sensor_chip_complain_of(&chip->base, "AK8963",
                                "ASA read outside fuse ROM mode");
        value = 0;  // AK 8.3.11: readable in fuse ROM access mode only
    }
    if (at >= AK_HXL && at <= AK_ST2) {
        // AK 8.3.3, 6.4.3.2: reading data or ST2 clears both; ST2 ends the reading.
        ak->reg[AK_ST1] &= (uint8_t) ~(AK_DRDY | AK_DOR);
        ak->is_reading = at != AK_ST2;
    }
    ak_step(ak);
    return value;
}
