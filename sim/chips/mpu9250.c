// SPDX-License-Identifier: MIT
// The MPU-9250 and AK8963 as a register file, two clocks and a wire. See the header for
// the documents that RM, PS, ST and AK stand for.
#include "mpu9250.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NEVER UINT64_MAX
#define MS UINT64_C(1000000)  // in nanoseconds
#define US UINT64_C(1000)
#define STANDARD_GRAVITY 9.80665  // m/s2
#define RAD_PER_DEG 0.017453292519943295

// RM 3, table 1.
enum {
    REG_SELF_TEST_X_GYRO = 0,
    REG_SELF_TEST_X_ACCEL = 13,
    REG_XG_OFFSET_H = 19,
    REG_ZG_OFFSET_L = 24,
    REG_SMPLRT_DIV = 25,
    REG_CONFIG = 26,
    REG_GYRO_CONFIG = 27,
    REG_ACCEL_CONFIG = 28,
    REG_ACCEL_CONFIG_2 = 29,
    REG_FIFO_EN = 35,
    REG_I2C_MST_CTRL = 36,
    REG_I2C_SLV0_ADDR = 37,
    REG_I2C_SLV4_ADDR = 49,
    REG_I2C_SLV4_REG = 50,
    REG_I2C_SLV4_DO = 51,
    REG_I2C_SLV4_CTRL = 52,
    REG_I2C_SLV4_DI = 53,
    REG_I2C_MST_STATUS = 54,
    REG_INT_PIN_CFG = 55,
    REG_INT_ENABLE = 56,
    REG_INT_STATUS = 58,
    REG_ACCEL_XOUT_H = 59,
    REG_TEMP_OUT_H = 65,
    REG_GYRO_XOUT_H = 67,
    REG_EXT_SENS_DATA_00 = 73,
    REG_EXT_SENS_DATA_23 = 96,
    REG_I2C_SLV0_DO = 99,
    REG_I2C_SLV3_DO = 102,
    REG_I2C_MST_DELAY_CTRL = 103,
    REG_SIGNAL_PATH_RESET = 104,
    REG_USER_CTRL = 106,
    REG_PWR_MGMT_1 = 107,
    REG_PWR_MGMT_2 = 108,
    REG_FIFO_COUNTH = 114,
    REG_FIFO_R_W = 116,
    REG_WHO_AM_I = 117,
    REG_XA_OFFSET_H = 119,
    REG_ZA_OFFSET_L = 126,
    REG_COUNT = 128,
};

enum {
    // RM 4.12, 4.13, 4.17, 4.30
    MST_WAIT_FOR_ES = 1 << 6,
    MST_CLOCK = 0x0F,
    SLV_READ = 1 << 7,
    SLV_EN = 1 << 7,
    SLV_BYTE_SW = 1 << 6,
    SLV_REG_DIS = 1 << 5,
    SLV_GRP = 1 << 4,
    SLV_LENG = 0x0F,
    SLV4_DELAY = 0x1F,
    DELAY_ES_SHADOW = 1 << 7,
    // RM 4.18
    STATUS_SLV4_DONE = 1 << 6,
    STATUS_SLV4_NACK = 1 << 4,
    // RM 4.19, 4.21
    INT_ACTL = 1 << 7,
    INT_LATCH = 1 << 5,
    INT_ANYRD_2CLEAR = 1 << 4,
    INT_BYPASS_EN = 1 << 1,
    INT_RAW_RDY = 1 << 0,
    // RM 4.33 to 4.35
    USER_I2C_MST_EN = 1 << 5,
    USER_I2C_MST_RST = 1 << 1,
    USER_SIG_COND_RST = 1 << 0,
    PWR_H_RESET = 1 << 7,
    PWR_SLEEP = 1 << 6,
    PWR_CYCLE = 1 << 5,
    PWR_GYRO_STANDBY = 1 << 4,
    PWR_CLKSEL = 0x07,
    CLKSEL_STOPPED = 7,
    // RM 4.6, 4.8: the self-test bits and the ranges of both sensors, and FCHOICE
    SELF_TEST_X = 1 << 7,
    RANGE_SHIFT = 3,
    GYRO_FCHOICE_B = 0x03,
    ACCEL_FCHOICE_B = 1 << 3,
    DLPF = 0x07,
};

// AK 8.2.
enum {
    AK_ADDRESS = 0x0C,
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
    AK_COUNT = 0x14,
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
    AK_SINGLE = 1,
    AK_CONTINUOUS_8_HZ = 2,
    AK_EXTERNAL_TRIGGER = 4,
    AK_CONTINUOUS_100_HZ = 6,
    AK_SELF_TEST = 8,
    AK_FUSE_ROM = 15,
};

#define AK_MEASURE_NS (7200 * US)  // AK 5.3.1: TSM, typical
#define AK_WAIT_NS (100 * US)      // AK 6.3: Twat after power-down
#define AK_OVERFLOW_UT 4912.0      // AK 6.4.3.6: |X| + |Y| + |Z|
#define AK_LSB_16_UT 0.15          // AK 8.3.4
#define AK_LSB_14_UT 0.6

#define GYRO_START_NS (35 * MS)   // PS 3.1: start-up from sleep, typical
#define ACCEL_START_NS (20 * MS)  // PS 3.2: from sleep
#define INT_PULSE_NS (50 * US)    // PS 3.4.2: tINT
#define BIT_NS 2500               // one bit at 400 kHz

struct ak8963 {
    uint8_t reg[AK_COUNT];
    uint8_t pointer;
    bool is_reading;       // between the first data byte and ST2: data are protected
    uint64_t measured_ns;  // when the measurement under way ends; NEVER for none
    uint64_t started_ns;   // when the first of a continuous run started
    uint64_t count;        // of measurements started since
    uint64_t powered_down_ns;  // when power-down mode was entered
};

// One transaction of the chip's own I2C master, a byte at a time (RM 4.13 to 4.17).
struct aux {
    uint8_t slave;  // 0 to 4 under way, 5 for none
    uint8_t at;     // bytes moved
    uint8_t length;
    uint8_t base;  // index in EXT_SENS_DATA of the first
    bool is_refused;
    uint64_t byte_ns;     // when the next byte is through
    uint8_t held[24];     // what waits for the shadow (RM 4.30, DELAY_ES_SHADOW)
    uint8_t reserved[4];  // bytes of EXT_SENS_DATA that each slave has been given
    uint8_t delay_count;
};

enum target { TARGET_NONE, TARGET_MPU, TARGET_AK };

struct mpu9250_chip {
    struct mpu9250_chip_config config;
    double held[3][3];  // motion by mpu9250_chip_quantity
    struct mpu9250_chip_fault faults[MPU9250_CHIP_FAULTS_MAX];
    unsigned fault_count;
    unsigned held_clocks[MPU9250_CHIP_FAULTS_MAX];   // SCL pulses seen while it holds
    uint64_t held_from_ns[MPU9250_CHIP_FAULTS_MAX];  // NEVER: has not held yet
    bool is_spent[MPU9250_CHIP_FAULTS_MAX];
    bool is_clocked_out[MPU9250_CHIP_FAULTS_MAX];
    const char *complaint;

    uint64_t now_ns;
    uint8_t reg[REG_COUNT];
    // Registers 59 to 96 as the sensors fill them; what the host sees follows while the
    // wire is idle, so that a burst is of one instant (RM 4.22, 4.24).
    uint8_t inner[REG_COUNT];
    uint64_t answers_ns;  // registers answer from here on
    uint64_t awake_ns;    // the sensors run since
    bool is_asleep;
    uint64_t epoch_ns;  // sample number n falls at epoch + n periods
    uint64_t tick;      // number of the next sample
    uint64_t tick_ns;
    uint64_t samples;
    bool int_level;  // asserted, before ACTL
    uint64_t int_end_ns;
    bool waits_for_aux;

    enum target target;
    bool is_transfer;  // between START and STOP
    bool is_read;
    uint8_t pointer;
    uint64_t byte;  // of this transaction, the address is 0
    bool has_pointer;
    uint64_t transactions;

    struct aux aux;
    struct ak8963 ak;
};

static void complain(struct mpu9250_chip *chip, const char *what) {
    if (chip->complaint == NULL) {
        chip->complaint = what;
    }
}

// Faults

static bool fault_is_active(const struct mpu9250_chip *chip, unsigned i) {
    const struct mpu9250_chip_fault *fault = &chip->faults[i];
    if (fault->transactions > 0) {
        return chip->is_transfer && chip->transactions >= fault->first &&
               chip->transactions - fault->first < fault->transactions;
    }
    return chip->now_ns >= fault->from_ns &&
           (fault->for_ns == 0 || chip->now_ns - fault->from_ns < fault->for_ns);
}

static const struct mpu9250_chip_fault *find_fault(const struct mpu9250_chip *chip,
                                                   enum mpu9250_chip_fault_kind kind) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        if (chip->faults[i].kind == kind && fault_is_active(chip, i)) {
            return &chip->faults[i];
        }
    }
    return NULL;
}

// Whether the byte on its way is refused.
static bool is_nacked(const struct mpu9250_chip *chip) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        if (chip->faults[i].kind == MPU9250_CHIP_NACK && fault_is_active(chip, i) &&
            chip->faults[i].at_byte == chip->byte) {
            return true;
        }
    }
    return false;
}

static bool holds(struct mpu9250_chip *chip, unsigned i) {
    const struct mpu9250_chip_fault *fault = &chip->faults[i];
    if (fault->kind != MPU9250_CHIP_STUCK_SDA || chip->is_spent[i]) {
        return false;
    }
    if (chip->held_from_ns[i] == NEVER) {
        const bool in_place = fault->transactions == 0 || chip->byte >= fault->at_byte;
        if (!fault_is_active(chip, i) || !in_place) {
            return false;
        }
        chip->held_from_ns[i] =
            fault->transactions == 0 ? fault->from_ns : chip->now_ns;
    }
    const bool timed_out =
        fault->for_ns > 0 && chip->now_ns - chip->held_from_ns[i] >= fault->for_ns;
    if (timed_out || chip->is_clocked_out[i]) {
        chip->is_spent[i] = true;
        return false;
    }
    return true;
}

static bool is_sda_held(struct mpu9250_chip *chip) {
    bool held = false;
    for (unsigned i = 0; i < chip->fault_count; i++) {
        held = holds(chip, i) || held;
    }
    return held;
}

static bool has_ak8963(const struct mpu9250_chip *chip) {
    return chip->config.has_ak8963 && find_fault(chip, MPU9250_CHIP_NO_AK8963) == NULL;
}

// Motion

static void mean_motion(struct mpu9250_chip *chip, enum mpu9250_chip_quantity quantity,
                        int64_t from_ns, int64_t to_ns, double mean[3]) {
    if (chip->config.motion != NULL) {
        chip->config.motion(chip->config.context, quantity, from_ns, to_ns, mean);
    } else {
        memcpy(mean, chip->held[quantity], sizeof chip->held[quantity]);
    }
}

// Nearest count, saturating (PS 3.1, 3.2: 16 bits two's complement).
static int16_t to_counts(double value, double limit) {
    const double counts = rint(value);
    if (counts > limit) {
        return (int16_t)limit;
    }
    if (counts < -limit - 1.0) {
        return (int16_t)(-limit - 1.0);
    }
    return (int16_t)counts;
}

static void put_big_endian(uint8_t *at, int16_t value) {
    at[0] = (uint8_t)((uint16_t)value >> 8);
    at[1] = (uint8_t)((uint16_t)value & 0xFF);
}

static int16_t get_big_endian(const uint8_t *at) {
    return (int16_t)(uint16_t)((at[0] << 8) | at[1]);
}

// AK8963

static void ak_reset(struct ak8963 *ak, const struct mpu9250_chip_config *config,
                     uint64_t now_ns) {
    memset(ak, 0, sizeof *ak);
    ak->reg[AK_WIA] = 0x48;   // AK 8.3.1
    ak->reg[AK_INFO] = 0x9A;  // AK 8.3.2 leaves it open; what parts of this kind answer
    memcpy(&ak->reg[AK_ASAX], config->mag_adjust, sizeof config->mag_adjust);
    ak->measured_ns = NEVER;
    ak->powered_down_ns = now_ns;
}

// The period of the continuous modes, AK 6.4.3.
static double ak_period_ns(const struct mpu9250_chip *chip) {
    const double hz =
        (chip->ak.reg[AK_CNTL1] & AK_MODE) == AK_CONTINUOUS_8_HZ ? 8.0 : 100.0;
    return 1e9 / (hz * (1.0 + chip->config.mag_rate_error_ppm * 1e-6));
}

static void ak_begin_measurement(struct mpu9250_chip *chip) {
    struct ak8963 *ak = &chip->ak;
    const double start = (double)ak->count * ak_period_ns(chip);
    ak->count++;
    ak->measured_ns = ak->started_ns + (uint64_t)llround(start) + AK_MEASURE_NS;
}

static void ak_end_measurement(struct mpu9250_chip *chip) {
    struct ak8963 *ak = &chip->ak;
    const uint8_t mode = ak->reg[AK_CNTL1] & AK_MODE;
    const bool is_16_bit = (ak->reg[AK_CNTL1] & AK_16_BIT) != 0;
    // The field in the middle of the measurement.
    const int64_t at_ns = (int64_t)(ak->measured_ns - AK_MEASURE_NS / 2);
    double field[3];
    mean_motion(chip, MPU9250_CHIP_MAG, at_ns, at_ns, field);
    double own[3] = {field[1], field[0], -field[2]};  // PS 9.1
    if (mode == AK_SELF_TEST && (ak->reg[AK_ASTC] & AK_SELF) != 0) {
        // AK 9.4.4: the judgment in 16 bits is -200..200, -200..200, -3200..-800 after
        // adjustment. The internal coil is far stronger than the field outside.
        own[0] = 40.0 * AK_LSB_16_UT;
        own[1] = -60.0 * AK_LSB_16_UT;
        own[2] = -1900.0 * AK_LSB_16_UT;
    }
    uint8_t data[6];
    const double lsb = is_16_bit ? AK_LSB_16_UT : AK_LSB_14_UT;
    const double limit = is_16_bit ? 32760.0 : 8190.0;  // AK 8.3.4
    double sum = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        // AK 8.3.11: Hadj = H * ((ASA - 128) * 0.5 / 128 + 1)
        const double adjust = (chip->config.mag_adjust[axis] - 128) * 0.5 / 128.0 + 1.0;
        int16_t counts = to_counts(own[axis] / lsb / adjust, limit);
        if (counts < -limit) {
            counts = (int16_t)-limit;
        }
        data[2 * axis] = (uint8_t)((uint16_t)counts & 0xFF);
        data[2 * axis + 1] = (uint8_t)((uint16_t)counts >> 8);
        sum += fabs(own[axis]);
    }
    if (ak->is_reading) {
        ak->reg[AK_ST1] |= AK_DOR;  // AK 6.4.3.4: protected data stay, this one is lost
    } else {
        if (ak->reg[AK_ST1] & AK_DRDY) {
            ak->reg[AK_ST1] |= AK_DOR;
        }
        if (find_fault(chip, MPU9250_CHIP_FROZEN) == NULL) {
            memcpy(&ak->reg[AK_HXL], data, sizeof data);
            ak->reg[AK_ST2] = (uint8_t)((sum >= AK_OVERFLOW_UT ? AK_HOFL : 0) |
                                        (is_16_bit ? AK_BITM : 0));
        }
        ak->reg[AK_ST1] |= AK_DRDY;
    }
    if (mode == AK_CONTINUOUS_8_HZ || mode == AK_CONTINUOUS_100_HZ) {
        ak_begin_measurement(chip);
    } else {
        // AK 6.4.2: single and self-test fall back to power-down.
        ak->reg[AK_CNTL1] &= (uint8_t)~AK_MODE;
        ak->powered_down_ns = ak->measured_ns;
        ak->measured_ns = NEVER;
    }
}

static void ak_set_mode(struct mpu9250_chip *chip, uint8_t value) {
    struct ak8963 *ak = &chip->ak;
    const uint8_t old = ak->reg[AK_CNTL1] & AK_MODE;
    const uint8_t mode = value & AK_MODE;
    const bool is_continuous =
        mode == AK_CONTINUOUS_8_HZ || mode == AK_CONTINUOUS_100_HZ;
    const bool is_known = is_continuous || mode == AK_POWER_DOWN || mode == AK_SINGLE ||
                          mode == AK_SELF_TEST || mode == AK_FUSE_ROM;
    if (!is_known) {
        complain(chip, "AK8963: a mode that is prohibited or not modelled");
        return;
    }
    // AK 6.3: from one mode to another only through power-down, and 100 us in it.
    if (mode != AK_POWER_DOWN && old != AK_POWER_DOWN && old != mode) {
        complain(chip, "AK8963: mode changed without power-down between");
        return;
    }
    if (mode != AK_POWER_DOWN && old == AK_POWER_DOWN &&
        chip->now_ns - ak->powered_down_ns < AK_WAIT_NS) {
        complain(chip, "AK8963: mode set within 100 us of power-down");
        return;
    }
    ak->reg[AK_CNTL1] = value & (AK_MODE | AK_16_BIT);
    ak->measured_ns = NEVER;
    if (mode == AK_POWER_DOWN) {
        if (old != AK_POWER_DOWN) {
            ak->powered_down_ns = chip->now_ns;
        }
    } else if (mode != AK_FUSE_ROM) {
        ak->started_ns = chip->now_ns;
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

static void ak_write(struct mpu9250_chip *chip, uint8_t value) {
    struct ak8963 *ak = &chip->ak;
    switch (ak->pointer) {
    case AK_CNTL1:
        ak_set_mode(chip, value);
        break;
    case AK_CNTL2:
        if (value & AK_SRST) {  // AK 8.3.8
            const uint8_t pointer = ak->pointer;
            ak_reset(ak, &chip->config, chip->now_ns);
            ak->pointer = pointer;
        }
        break;
    case AK_ASTC:
        ak->reg[AK_ASTC] = value & AK_SELF;  // AK 8.3.9: other bits must be 0
        break;
    case AK_I2CDIS:
        complain(chip, "AK8963: I2CDIS written");
        break;
    default:
        complain(chip, "AK8963: a read-only or reserved register written");
        break;
    }
    ak_step(ak);
}

static uint8_t ak_read(struct mpu9250_chip *chip) {
    struct ak8963 *ak = &chip->ak;
    const uint8_t at = ak->pointer;
    uint8_t value = at < AK_COUNT ? ak->reg[at] : 0;
    if (at >= AK_ASAX && at <= AK_ASAZ &&
        (ak->reg[AK_CNTL1] & AK_MODE) != AK_FUSE_ROM) {
        complain(chip, "AK8963: ASA read outside fuse ROM mode");
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

// The sample clock

// RM 4.4, 4.6: 32 kHz, 8 kHz, or 1 kHz divided.
static double sample_period_ns(const struct mpu9250_chip *chip) {
    const uint8_t fchoice_b = chip->reg[REG_GYRO_CONFIG] & GYRO_FCHOICE_B;
    const uint8_t dlpf = chip->reg[REG_CONFIG] & DLPF;
    double hz = 0.0;
    if (fchoice_b != 0) {
        hz = 32000.0;
    } else if (dlpf == 0 || dlpf == 7) {
        hz = 8000.0;
    } else {
        hz = 1000.0 / (1.0 + chip->reg[REG_SMPLRT_DIV]);
    }
    return 1e9 / (hz * (1.0 + chip->config.rate_error_ppm * 1e-6));
}

static void set_next_tick(struct mpu9250_chip *chip) {
    const uint8_t power = chip->reg[REG_PWR_MGMT_1];
    if (chip->is_asleep || (power & PWR_CLKSEL) == CLKSEL_STOPPED) {
        chip->tick_ns = NEVER;
        return;
    }
    const double at = (double)chip->tick * sample_period_ns(chip);
    chip->tick_ns = chip->epoch_ns + (uint64_t)llround(at);
}

static void restart_clock(struct mpu9250_chip *chip) {
    chip->epoch_ns = chip->now_ns;
    chip->tick = 1;
    set_next_tick(chip);
}

// A setting of a digital low-pass: its -3 dB bandwidth and the delay it brings.
struct lowpass_setting {
    double bandwidth_hz;
    double delay_ms;
};

// RM 4.6: the gyroscope's, by FCHOICE_B and DLPF_CFG.
static struct lowpass_setting gyro_lowpass(const struct mpu9250_chip *chip) {
    static const struct lowpass_setting dlpf[8] = {
        {250, 0.97}, {184, 2.9},  {92, 3.9},  {41, 5.9},
        {20, 9.9},   {10, 17.85}, {5, 33.48}, {3600, 0.17}};
    const uint8_t fchoice_b = chip->reg[REG_GYRO_CONFIG] & GYRO_FCHOICE_B;
    if (fchoice_b & 1) {
        return (struct lowpass_setting){8800, 0.064};  // FCHOICE x0
    }
    if (fchoice_b == 2) {
        return (struct lowpass_setting){3600, 0.11};  // FCHOICE 01
    }
    return dlpf[chip->reg[REG_CONFIG] & DLPF];
}

// RM 4.8, rev 1.6: the accelerometer's, by ACCEL_FCHOICE_B and A_DLPF_CFG.
static struct lowpass_setting accel_lowpass(const struct mpu9250_chip *chip) {
    static const struct lowpass_setting dlpf[8] = {
        {218.1, 1.88}, {218.1, 1.88}, {99, 2.88},    {44.8, 4.88},
        {21.2, 8.87},  {10.2, 16.83}, {5.05, 32.48}, {420, 1.38}};
    const uint8_t config = chip->reg[REG_ACCEL_CONFIG_2];
    return config & ACCEL_FCHOICE_B ? (struct lowpass_setting){1046, 0.503}
                                    : dlpf[config & DLPF];
}

// What the registers of a die would hold now. A moving average over w has its -3 dB
// point at 0.443 / w; it is centred on the delay, later where it would see the future.
// Motion recorded behind such a low-pass is only brought to the sample rate.
static void low_passed(struct mpu9250_chip *chip, enum mpu9250_chip_quantity quantity,
                       struct lowpass_setting setting, double mean[3]) {
    const int64_t now = (int64_t)chip->now_ns;
    if (chip->config.is_recorded) {
        const int64_t half = (int64_t)llround(0.5 * sample_period_ns(chip));
        mean_motion(chip, quantity, now - half, now + half, mean);
        return;
    }
    const int64_t half = (int64_t)llround(0.5 * 0.443e9 / setting.bandwidth_hz);
    int64_t delay = (int64_t)llround(setting.delay_ms * 1e6);
    if (delay < half) {
        delay = half;
    }
    mean_motion(chip, quantity, now - delay - half, now - delay + half, mean);
}

// ST 3.2: factory trim in counts at the smallest range.
static double self_test_counts(uint8_t code) {
    return code == 0 ? 0.0 : 2620.0 * pow(1.01, code - 1.0);
}

static void sample_gyro(struct mpu9250_chip *chip) {
    const uint8_t config = chip->reg[REG_GYRO_CONFIG];
    const int range = (config >> RANGE_SHIFT) & 3;
    // RM 4.3: 2^16 counts over 500 deg/s at FS_SEL 0.
    const double counts_per_rad_s = 65536.0 / 500.0 / RAD_PER_DEG / (1 << range);
    double mean[3];
    low_passed(chip, MPU9250_CHIP_GYR, gyro_lowpass(chip), mean);
    const double response =
        find_fault(chip, MPU9250_CHIP_GYR_SELF_TEST) != NULL ? 0.1 : 1.0;
    for (int axis = 0; axis < 3; axis++) {
        double counts = mean[axis] * counts_per_rad_s;
        // RM 4.3: OffsetLSB = X_OFFS_USR * 4 / 2^FS_SEL
        counts +=
            get_big_endian(&chip->reg[REG_XG_OFFSET_H + 2 * axis]) * 4.0 / (1 << range);
        if (config & (SELF_TEST_X >> axis)) {
            const uint8_t code = chip->config.gyr_self_test[axis];
            counts += response * self_test_counts(code) / (1 << range);
        }
        const bool is_off = (chip->reg[REG_PWR_MGMT_2] & (4 >> axis)) != 0 ||
                            (chip->reg[REG_PWR_MGMT_1] & PWR_GYRO_STANDBY) != 0 ||
                            chip->now_ns - chip->awake_ns < GYRO_START_NS;
        put_big_endian(&chip->inner[REG_GYRO_XOUT_H + 2 * axis],
                       to_counts(is_off ? 0.0 : counts, 32767.0));
    }
}

static void sample_accel(struct mpu9250_chip *chip) {
    const uint8_t config = chip->reg[REG_ACCEL_CONFIG];
    const int range = (config >> RANGE_SHIFT) & 3;
    const double counts_per_m_s2 = 16384.0 / STANDARD_GRAVITY / (1 << range);  // PS 3.2
    double mean[3];
    low_passed(chip, MPU9250_CHIP_ACC, accel_lowpass(chip), mean);
    const double response =
        find_fault(chip, MPU9250_CHIP_ACC_SELF_TEST) != NULL ? 0.1 : 1.0;
    for (int axis = 0; axis < 3; axis++) {
        double counts = mean[axis] * counts_per_m_s2;
        // RM 4.39: 15 bits, steps of 0.98 mg, the lowest bit of the pair is reserved.
        const int offset = get_big_endian(&chip->reg[REG_XA_OFFSET_H + 3 * axis]) >> 1;
        counts += offset * 0.98e-3 * 16384.0 / (1 << range);
        if (config & (SELF_TEST_X >> axis)) {
            const uint8_t code = chip->config.acc_self_test[axis];
            counts += response * self_test_counts(code) / (1 << range);
        }
        const bool is_off = (chip->reg[REG_PWR_MGMT_2] & (0x20 >> axis)) != 0 ||
                            chip->now_ns - chip->awake_ns < ACCEL_START_NS;
        put_big_endian(&chip->inner[REG_ACCEL_XOUT_H + 2 * axis],
                       to_counts(is_off ? 0.0 : counts, 32767.0));
    }
}

// What the host sees follows, unless a transaction is under way.
static void show(struct mpu9250_chip *chip) {
    if (!chip->is_transfer) {
        memcpy(&chip->reg[REG_ACCEL_XOUT_H], &chip->inner[REG_ACCEL_XOUT_H],
               REG_EXT_SENS_DATA_23 - REG_ACCEL_XOUT_H + 1);
    }
}

static void signal_data_ready(struct mpu9250_chip *chip) {
    chip->reg[REG_INT_STATUS] |= INT_RAW_RDY;
    if (chip->reg[REG_INT_ENABLE] & INT_RAW_RDY) {
        chip->int_level = true;
        const bool is_latched = (chip->reg[REG_INT_PIN_CFG] & INT_LATCH) != 0;
        chip->int_end_ns = is_latched ? NEVER : chip->now_ns + INT_PULSE_NS;
    }
}

// The chip's own I2C master

// RM 4.12: 8 MHz over 23..31 for 0..8, over 16..22 for 9..15.
static uint64_t aux_bits_ns(const struct mpu9250_chip *chip, unsigned bits) {
    const unsigned choice = chip->reg[REG_I2C_MST_CTRL] & MST_CLOCK;
    const unsigned divider = choice < 9 ? 23 + choice : 7 + choice;
    return (uint64_t)bits * divider * 125;
}

static uint8_t aux_control(const struct mpu9250_chip *chip, unsigned slave) {
    return chip->reg[REG_I2C_SLV0_ADDR + 3 * slave + 2];
}

// RM 4.25: space goes in the order of the slaves, and a slave that is disabled keeps
// its space until all are, or the master is reset.
static void aux_allocate(struct mpu9250_chip *chip) {
    bool any = false;
    for (unsigned slave = 0; slave < 4; slave++) {
        any = any || (aux_control(chip, slave) & SLV_EN) != 0;
    }
    for (unsigned slave = 0; slave < 4; slave++) {
        const uint8_t control = aux_control(chip, slave);
        const bool reads = (chip->reg[REG_I2C_SLV0_ADDR + 3 * slave] & SLV_READ) != 0;
        if (!any) {
            chip->aux.reserved[slave] = 0;
        } else if ((control & SLV_EN) && reads) {
            chip->aux.reserved[slave] = control & SLV_LENG;
        }
    }
}

static void aux_finish(struct mpu9250_chip *chip) {
    chip->aux.slave = 5;
    chip->aux.byte_ns = NEVER;
    if (chip->waits_for_aux) {
        chip->waits_for_aux = false;
        signal_data_ready(chip);
    }
    show(chip);
}

// Starts the next slave's transaction after `slave`, or ends the round.
static void aux_next(struct mpu9250_chip *chip, unsigned slave) {
    struct aux *aux = &chip->aux;
    for (; slave < 4; slave++) {
        const uint8_t control = aux_control(chip, slave);
        const bool is_delayed = (chip->reg[REG_I2C_MST_DELAY_CTRL] & (1 << slave)) != 0;
        if ((control & SLV_EN) && (control & SLV_LENG) > 0 &&
            (!is_delayed || aux->delay_count == 0)) {
            aux->length = control & SLV_LENG;
            break;
        }
    }
    if (slave == 4) {
        const bool is_delayed = (chip->reg[REG_I2C_MST_DELAY_CTRL] & (1 << 4)) != 0;
        if (!(chip->reg[REG_I2C_SLV4_CTRL] & SLV_EN) ||
            (is_delayed && aux->delay_count != 0)) {
            aux_finish(chip);
            return;
        }
        aux->length = 1;
    } else if (slave > 4) {
        aux_finish(chip);
        return;
    }
    const uint8_t control =
        slave == 4 ? chip->reg[REG_I2C_SLV4_CTRL] : aux_control(chip, slave);
    const uint8_t address = chip->reg[REG_I2C_SLV0_ADDR + 3 * slave];
    const uint8_t reg = chip->reg[REG_I2C_SLV0_ADDR + 3 * slave + 1];
    aux->slave = (uint8_t)slave;
    aux->at = 0;
    aux->base = 0;
    for (unsigned i = 0; i < slave && i < 4; i++) {
        aux->base = (uint8_t)(aux->base + aux->reserved[i]);
    }
    aux->is_refused = (address & 0x7F) != AK_ADDRESS || !has_ak8963(chip);
    const bool has_reg = (control & SLV_REG_DIS) == 0;
    if (has_reg && !aux->is_refused) {
        chip->ak.pointer = reg;
    }
    // START and address, register, and for a read a second START and address.
    unsigned bits = 1 + 9 + (has_reg ? 9 : 0);
    if (aux->is_refused) {
        bits = 1 + 9 + 1;
    } else {
        bits += (address & SLV_READ) && has_reg ? 1 + 9 : 0;
        bits += 9;
    }
    aux->byte_ns = chip->now_ns + aux_bits_ns(chip, bits);
}

static void aux_put(struct mpu9250_chip *chip, unsigned index, uint8_t value) {
    if (index < sizeof chip->aux.held) {  // RM 4.25: beyond 24 bytes are lost
        chip->aux.held[index] = value;
        if (!(chip->reg[REG_I2C_MST_DELAY_CTRL] & DELAY_ES_SHADOW)) {
            chip->inner[REG_EXT_SENS_DATA_00 + index] = value;
        }
    }
}

// A byte read by slaves 0 to 3 finds its place.
static void aux_place(struct mpu9250_chip *chip, uint8_t reg, uint8_t value) {
    const struct aux *aux = &chip->aux;
    const uint8_t control = aux_control(chip, aux->slave);
    unsigned index = aux->base + aux->at;
    if (control & SLV_BYTE_SW) {
        // RM 4.13: the two bytes of a word change places; GRP says whether a word
        // starts at an even or an odd register.
        const bool is_first = ((reg & 1) != 0) == ((control & SLV_GRP) != 0);
        if (is_first && aux->at + 1 < aux->length) {
            index++;
        } else if (!is_first && aux->at > 0) {
            index--;
        }
    }
    aux_put(chip, index, value);
}

static void aux_byte(struct mpu9250_chip *chip) {
    struct aux *aux = &chip->aux;
    const unsigned slave = aux->slave;
    const uint8_t address = chip->reg[REG_I2C_SLV0_ADDR + 3 * slave];
    const bool is_read = (address & SLV_READ) != 0;
    if (aux->is_refused) {
        chip->reg[REG_I2C_MST_STATUS] |= (uint8_t)(1 << slave);
    } else if (!is_read) {
        ak_write(chip, slave == 4 ? chip->reg[REG_I2C_SLV4_DO]
                                  : chip->reg[REG_I2C_SLV0_DO + slave]);
    } else {
        const uint8_t reg = chip->ak.pointer;
        const uint8_t value = ak_read(chip);
        if (slave == 4) {
            chip->reg[REG_I2C_SLV4_DI] = value;
        } else {
            aux_place(chip, reg, value);
        }
    }
    aux->at++;
    if (!aux->is_refused && aux->at < aux->length) {
        aux->byte_ns = chip->now_ns + aux_bits_ns(chip, 9);
        return;
    }
    if (slave == 4) {
        chip->reg[REG_I2C_SLV4_CTRL] &= (uint8_t)~SLV_EN;  // RM 4.17
        chip->reg[REG_I2C_MST_STATUS] |= STATUS_SLV4_DONE;
    } else if (is_read && !aux->is_refused) {
        for (unsigned i = aux->base; i < aux->base + aux->length && i < 24U; i++) {
            chip->inner[REG_EXT_SENS_DATA_00 + i] = aux->held[i];
        }
    }
    show(chip);
    aux_next(chip, slave + 1);
}

static void aux_begin(struct mpu9250_chip *chip) {
    struct aux *aux = &chip->aux;
    const uint8_t delay = chip->reg[REG_I2C_SLV4_CTRL] & SLV4_DELAY;
    aux->delay_count = aux->delay_count >= delay ? 0 : (uint8_t)(aux->delay_count + 1);
    aux_allocate(chip);
    aux_next(chip, 0);
}

static void take_sample(struct mpu9250_chip *chip) {
    chip->tick++;
    set_next_tick(chip);
    if (find_fault(chip, MPU9250_CHIP_NO_DATA_READY) != NULL) {
        return;
    }
    chip->samples++;
    if (find_fault(chip, MPU9250_CHIP_FROZEN) == NULL) {
        sample_gyro(chip);
        sample_accel(chip);
        // RM 4.23, PS 3.4.2: 333.87 LSB/degC, 0 at 21 degC.
        put_big_endian(&chip->inner[REG_TEMP_OUT_H],
                       to_counts((chip->config.temperature_c - 21.0) * 333.87, 32767));
    }
    show(chip);
    // A round of the I2C master that is still under way goes on; this sample has none.
    const bool runs_aux = (chip->reg[REG_USER_CTRL] & USER_I2C_MST_EN) != 0;
    if (runs_aux && chip->aux.byte_ns == NEVER) {
        chip->waits_for_aux =
            (chip->reg[REG_I2C_MST_CTRL] & MST_WAIT_FOR_ES) != 0;  // RM 4.12
        if (!chip->waits_for_aux) {
            signal_data_ready(chip);
        }
        aux_begin(chip);
        return;
    }
    signal_data_ready(chip);
}

// Power and reset

static void reset_mpu(struct mpu9250_chip *chip) {
    const struct mpu9250_chip_config *config = &chip->config;
    memset(chip->reg, 0, sizeof chip->reg);
    memset(chip->inner, 0, sizeof chip->inner);
    memset(&chip->aux, 0, sizeof chip->aux);
    memcpy(&chip->reg[REG_SELF_TEST_X_GYRO], config->gyr_self_test, 3);
    memcpy(&chip->reg[REG_SELF_TEST_X_ACCEL], config->acc_self_test, 3);
    chip->reg[REG_PWR_MGMT_1] = 0x01;  // RM 3, the note under table 1
    chip->reg[REG_WHO_AM_I] = config->who_am_i;
    chip->aux.slave = 5;
    chip->aux.byte_ns = NEVER;
    chip->answers_ns = chip->now_ns + config->startup_ns;
    chip->awake_ns = chip->now_ns;
    chip->is_asleep = false;
    chip->int_level = false;
    chip->int_end_ns = NEVER;
    chip->waits_for_aux = false;
    chip->target = TARGET_NONE;
    restart_clock(chip);
}

struct mpu9250_chip_config mpu9250_chip_defaults(void) {
    return (struct mpu9250_chip_config){
        .temperature_c = 25.0,
        .startup_ns = 100 * MS,
        .who_am_i = 0x71,
        .has_ak8963 = true,
        .mag_adjust = {176, 178, 166},
        // Responses of 145, 154 and 137 deg/s and of 0.42, 0.45 and 0.52 g.
        .gyr_self_test = {200, 206, 194},
        .acc_self_test = {98, 105, 120},
    };
}

struct mpu9250_chip *mpu9250_chip_new(const struct mpu9250_chip_config *config) {
    struct mpu9250_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    chip->held[MPU9250_CHIP_ACC][2] = STANDARD_GRAVITY;
    chip->held[MPU9250_CHIP_MAG][1] = 20.0;
    chip->held[MPU9250_CHIP_MAG][2] = -40.0;
    mpu9250_chip_power_cycle(chip, 0);
    return chip;
}

void mpu9250_chip_free(struct mpu9250_chip *chip) {
    free(chip);
}

void mpu9250_chip_power_cycle(struct mpu9250_chip *chip, uint64_t now_ns) {
    chip->now_ns = now_ns;
    chip->is_transfer = false;
    chip->pointer = 0;
    ak_reset(&chip->ak, &chip->config, now_ns);
    reset_mpu(chip);
}

void mpu9250_chip_hold(struct mpu9250_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]) {
    memcpy(chip->held[MPU9250_CHIP_GYR], gyr_rad_s, sizeof chip->held[0]);
    memcpy(chip->held[MPU9250_CHIP_ACC], acc_m_s2, sizeof chip->held[0]);
    memcpy(chip->held[MPU9250_CHIP_MAG], mag_ut, sizeof chip->held[0]);
}

void mpu9250_chip_set_temperature(struct mpu9250_chip *chip, double temperature_c) {
    chip->config.temperature_c = temperature_c;
}

bool mpu9250_chip_add_fault(struct mpu9250_chip *chip,
                            const struct mpu9250_chip_fault *fault) {
    if (chip->fault_count == MPU9250_CHIP_FAULTS_MAX) {
        return false;
    }
    const unsigned i = chip->fault_count++;
    chip->faults[i] = *fault;
    chip->held_clocks[i] = 0;
    chip->held_from_ns[i] = NEVER;
    chip->is_spent[i] = false;
    chip->is_clocked_out[i] = false;
    return true;
}

void mpu9250_chip_clear_faults(struct mpu9250_chip *chip) {
    chip->fault_count = 0;
}

// Time

uint64_t mpu9250_chip_next_event(const struct mpu9250_chip *chip) {
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

void mpu9250_chip_advance(struct mpu9250_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = mpu9250_chip_next_event(chip);
        if (next > now_ns) {
            break;
        }
        chip->now_ns = next;
        if (chip->int_end_ns == next) {
            chip->int_end_ns = NEVER;
            chip->int_level = false;
        } else if (chip->ak.measured_ns == next) {
            ak_end_measurement(chip);
        } else if (chip->aux.byte_ns == next) {
            aux_byte(chip);
        } else {
            take_sample(chip);
        }
    }
    if (now_ns > chip->now_ns) {
        chip->now_ns = now_ns;
    }
}

bool mpu9250_chip_int_is_high(const struct mpu9250_chip *chip) {
    const bool is_active_low = (chip->reg[REG_INT_PIN_CFG] & INT_ACTL) != 0;
    return chip->int_level != is_active_low;
}

bool mpu9250_chip_holds_sda(struct mpu9250_chip *chip, uint64_t now_ns) {
    mpu9250_chip_advance(chip, now_ns);
    return is_sda_held(chip);
}

// Host's registers

static void clear_interrupt(struct mpu9250_chip *chip) {
    chip->reg[REG_INT_STATUS] = 0;
    if (chip->reg[REG_INT_PIN_CFG] & INT_LATCH) {
        chip->int_level = false;
        chip->int_end_ns = NEVER;
    }
}

static uint8_t mpu_read(struct mpu9250_chip *chip) {
    const uint8_t at = chip->pointer;
    uint8_t value = chip->reg[at];
    if (at == REG_INT_STATUS || (chip->reg[REG_INT_PIN_CFG] & INT_ANYRD_2CLEAR)) {
        clear_interrupt(chip);
    }
    if (at == REG_I2C_MST_STATUS) {
        chip->reg[at] = 0;  // RM 4.18: reading clears
    }
    if (at == REG_WHO_AM_I) {
        const struct mpu9250_chip_fault *fault =
            find_fault(chip, MPU9250_CHIP_WRONG_WHO_AM_I);
        value = fault != NULL ? fault->value : value;
    }
    if (at != REG_FIFO_R_W) {  // the one register that does not move on
        chip->pointer = (at + 1) & (REG_COUNT - 1);
    }
    return value;
}

static void write_power(struct mpu9250_chip *chip, uint8_t value) {
    if (value & PWR_H_RESET) {
        reset_mpu(chip);  // the AK8963 is another die and keeps its state
        return;
    }
    if (value & PWR_CYCLE) {
        complain(chip, "MPU-9250: low-power cycling is not modelled");
    }
    chip->reg[REG_PWR_MGMT_1] = value;
    const bool is_asleep = (value & PWR_SLEEP) != 0;
    if (chip->is_asleep && !is_asleep) {
        chip->awake_ns = chip->now_ns;
    }
    if (chip->is_asleep != is_asleep) {
        chip->is_asleep = is_asleep;
        restart_clock(chip);
    } else {
        set_next_tick(chip);
    }
}

static void write_user_control(struct mpu9250_chip *chip, uint8_t value) {
    if (value & 0x54) {  // FIFO_EN, I2C_IF_DIS, FIFO_RST
        complain(chip, "MPU-9250: FIFO and SPI are not modelled");
    }
    if (value & USER_I2C_MST_RST) {
        memset(&chip->aux, 0, sizeof chip->aux);
        aux_finish(chip);
    }
    if (value & USER_SIG_COND_RST) {  // RM 4.33: clears the sensors' registers too
        memset(&chip->inner[REG_ACCEL_XOUT_H], 0,
               REG_EXT_SENS_DATA_23 - REG_ACCEL_XOUT_H + 1);
    }
    chip->reg[REG_USER_CTRL] =
        value & (uint8_t) ~(USER_I2C_MST_RST | USER_SIG_COND_RST | 0x04);
    if (!(value & USER_I2C_MST_EN) && chip->aux.byte_ns != NEVER) {
        aux_finish(chip);  // the round under way is cut off
    }
}

static void mpu_write(struct mpu9250_chip *chip, uint8_t value) {
    const uint8_t at = chip->pointer;
    const uint8_t old = chip->reg[at];
    switch (at) {
    case REG_SMPLRT_DIV:
    case REG_CONFIG:
    case REG_GYRO_CONFIG:
        chip->reg[at] = value;
        if (value != old) {
            restart_clock(chip);
        }
        break;
    case REG_ACCEL_CONFIG:
    case REG_ACCEL_CONFIG_2:
    case REG_I2C_MST_CTRL:
    case REG_INT_PIN_CFG:
    case REG_I2C_MST_DELAY_CTRL:
    case REG_PWR_MGMT_2:
        chip->reg[at] = value;
        break;
    case REG_INT_ENABLE:
        chip->reg[at] = value;
        if (value & ~INT_RAW_RDY) {
            complain(chip, "MPU-9250: only the data-ready interrupt is modelled");
        }
        break;
    case REG_SIGNAL_PATH_RESET:
        break;  // RM 4.31: filters restart; the bits clear themselves
    case REG_USER_CTRL:
        write_user_control(chip, value);
        break;
    case REG_PWR_MGMT_1:
        write_power(chip, value);
        break;
    case REG_I2C_SLV4_DI:
    case REG_I2C_MST_STATUS:
        complain(chip, "MPU-9250: a read-only register written");
        break;
    default:
        if ((at >= REG_XG_OFFSET_H && at <= REG_ZG_OFFSET_L) ||
            (at >= REG_I2C_SLV0_ADDR && at <= REG_I2C_SLV4_CTRL) ||
            (at >= REG_I2C_SLV0_DO && at <= REG_I2C_SLV3_DO) ||
            (at >= REG_XA_OFFSET_H && at <= REG_ZA_OFFSET_L) ||
            at < REG_SELF_TEST_X_GYRO + 3 ||
            (at >= REG_SELF_TEST_X_ACCEL && at < REG_SELF_TEST_X_ACCEL + 3)) {
            chip->reg[at] = value;
        } else if (value != 0 || at > REG_WHO_AM_I) {
            complain(chip, "MPU-9250: a register written that is reserved, read-only "
                           "or not modelled");
        }
        break;
    }
    chip->pointer = (at + 1) & (REG_COUNT - 1);
}

// The wire

bool mpu9250_chip_start(struct mpu9250_chip *chip, uint64_t now_ns, uint8_t address,
                        bool is_read) {
    mpu9250_chip_advance(chip, now_ns);
    if (!chip->is_transfer) {
        show(chip);
        chip->is_transfer = true;
        chip->transactions++;
        chip->byte = 0;
    } else {
        chip->byte++;
    }
    chip->is_read = is_read;
    chip->has_pointer = false;
    chip->target = TARGET_NONE;
    if (is_sda_held(chip) || is_nacked(chip) || chip->now_ns < chip->answers_ns) {
        return false;
    }
    const bool is_bypass = (chip->reg[REG_INT_PIN_CFG] & INT_BYPASS_EN) != 0 &&
                           (chip->reg[REG_USER_CTRL] & USER_I2C_MST_EN) == 0;
    if (address == (chip->config.ad0 ? 0x69 : 0x68)) {
        chip->target = TARGET_MPU;
    } else if (address == AK_ADDRESS && is_bypass && has_ak8963(chip)) {
        chip->target = TARGET_AK;
    }
    return chip->target != TARGET_NONE;
}

bool mpu9250_chip_write(struct mpu9250_chip *chip, uint64_t now_ns, uint8_t byte) {
    mpu9250_chip_advance(chip, now_ns);
    chip->byte++;
    if (chip->target == TARGET_NONE || chip->is_read || is_sda_held(chip)) {
        return false;
    }
    if (is_nacked(chip)) {
        chip->target = TARGET_NONE;
        return false;
    }
    if (!chip->has_pointer) {
        chip->has_pointer = true;
        if (chip->target == TARGET_MPU) {
            chip->pointer = byte & (REG_COUNT - 1);
        } else {
            chip->ak.pointer = byte;
        }
    } else if (chip->target == TARGET_MPU) {
        mpu_write(chip, byte);
    } else {
        ak_write(chip, byte);
    }
    return true;
}

uint8_t mpu9250_chip_read(struct mpu9250_chip *chip, uint64_t now_ns, bool ack) {
    mpu9250_chip_advance(chip, now_ns);
    chip->byte++;
    if (is_sda_held(chip)) {
        return 0x00;
    }
    if (chip->target == TARGET_NONE || !chip->is_read) {
        return 0xFF;  // nobody pulls SDA down
    }
    const uint8_t value = chip->target == TARGET_MPU ? mpu_read(chip) : ak_read(chip);
    if (!ack) {
        chip->target = TARGET_NONE;
    }
    return value;
}

void mpu9250_chip_stop(struct mpu9250_chip *chip, uint64_t now_ns) {
    mpu9250_chip_advance(chip, now_ns);
    chip->target = TARGET_NONE;
    chip->is_transfer = false;
    show(chip);
}

void mpu9250_chip_scl_pulse(struct mpu9250_chip *chip, uint64_t now_ns) {
    mpu9250_chip_advance(chip, now_ns);
    for (unsigned i = 0; i < chip->fault_count; i++) {
        if (holds(chip, i) && chip->faults[i].clocks > 0) {
            chip->held_clocks[i]++;
            chip->is_clocked_out[i] = chip->held_clocks[i] >= chip->faults[i].clocks;
        }
    }
}

// Whole transactions

// False, with the STOP made where the wire allows it, for a byte that is refused.
static bool send_bytes(struct mpu9250_chip *chip, uint64_t *now_ns,
                       const uint8_t *bytes, unsigned length) {
    for (unsigned i = 0; i < length; i++) {
        *now_ns += UINT64_C(9) * BIT_NS;
        if (!mpu9250_chip_write(chip, *now_ns, bytes[i])) {
            return false;
        }
    }
    return true;
}

static int end_transaction(struct mpu9250_chip *chip, uint64_t *now_ns, bool is_good) {
    *now_ns += BIT_NS;
    if (mpu9250_chip_holds_sda(chip, *now_ns)) {
        return -3;  // no STOP either
    }
    mpu9250_chip_stop(chip, *now_ns);
    return is_good ? 0 : -1;
}

static bool begin_transaction(struct mpu9250_chip *chip, uint64_t *now_ns,
                              uint8_t address, bool is_read) {
    *now_ns += UINT64_C(10) * BIT_NS;
    return mpu9250_chip_start(chip, *now_ns, address, is_read);
}

int mpu9250_chip_read_registers(struct mpu9250_chip *chip, uint64_t *now_ns,
                                uint8_t address, uint8_t reg, uint8_t *data,
                                uint8_t length) {
    if (mpu9250_chip_holds_sda(chip, *now_ns)) {
        return -3;
    }
    bool good = begin_transaction(chip, now_ns, address, false) &&
                send_bytes(chip, now_ns, &reg, 1) &&
                begin_transaction(chip, now_ns, address, true);
    for (unsigned i = 0; good && i < length; i++) {
        *now_ns += UINT64_C(9) * BIT_NS;
        data[i] = mpu9250_chip_read(chip, *now_ns, i + 1U < length);
    }
    return end_transaction(chip, now_ns, good);
}

int mpu9250_chip_write_registers(struct mpu9250_chip *chip, uint64_t *now_ns,
                                 uint8_t address, uint8_t reg, const uint8_t *data,
                                 uint8_t length) {
    if (mpu9250_chip_holds_sda(chip, *now_ns)) {
        return -3;
    }
    const bool good = begin_transaction(chip, now_ns, address, false) &&
                      send_bytes(chip, now_ns, &reg, 1) &&
                      send_bytes(chip, now_ns, data, length);
    return end_transaction(chip, now_ns, good);
}

// For tests

uint8_t mpu9250_chip_peek(const struct mpu9250_chip *chip, uint8_t reg) {
    const uint8_t at = reg & (REG_COUNT - 1);
    return at >= REG_ACCEL_XOUT_H && at <= REG_EXT_SENS_DATA_23 ? chip->inner[at]
                                                                : chip->reg[at];
}

uint8_t mpu9250_chip_peek_ak8963(const struct mpu9250_chip *chip, uint8_t reg) {
    return reg < AK_COUNT ? chip->ak.reg[reg] : 0;
}

uint64_t mpu9250_chip_transactions(const struct mpu9250_chip *chip) {
    return chip->transactions;
}

uint64_t mpu9250_chip_samples(const struct mpu9250_chip *chip) {
    return chip->samples;
}

const char *mpu9250_chip_complaint(const struct mpu9250_chip *chip) {
    return chip->complaint;
}
