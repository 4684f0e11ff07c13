// SPDX-License-Identifier: MIT
// The LSM9DS0 as two register files, three sample clocks and a wire. See the header for
// the documents that DS and AN stand for.
#include "lsm9ds0.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NEVER UINT64_MAX
#define MS UINT64_C(1000000)      // in nanoseconds
#define STANDARD_GRAVITY 9.80665  // m/s2
#define RAD_PER_DEG 0.017453292519943295
#define BIT_NS 2500  // one bit at 400 kHz

enum { REG_COUNT = 128, AXES = 3, SENSORS = 3 };

// DS register map. Both dies have these at the same place.
enum {
    REG_WHO_AM_I = 0x0F,
    REG_STATUS = 0x27,  // STATUS_REG_G, STATUS_REG_A
    REG_OUT_X_L = 0x28,
    REG_FIFO_SRC = 0x2F,
};
enum {
    REG_CTRL1_G = 0x20,
    REG_CTRL2_G = 0x21,
    REG_CTRL3_G = 0x22,
    REG_CTRL4_G = 0x23,
    REG_CTRL5_G = 0x24,
    REG_REFERENCE_G = 0x25,
    REG_FIFO_CTRL_G = 0x2E,
    REG_INT1_CFG_G = 0x30,
    REG_INT1_SRC_G = 0x31,
    REG_INT1_THS_XH_G = 0x32,
    REG_INT1_THS_XL_G = 0x33,
    REG_INT1_THS_YH_G = 0x34,
    REG_INT1_THS_YL_G = 0x35,
    REG_INT1_THS_ZH_G = 0x36,
    REG_INT1_THS_ZL_G = 0x37,
    REG_INT1_DURATION_G = 0x38,
};
enum {
    REG_OUT_TEMP_L_XM = 0x05,
    REG_OUT_TEMP_H_XM = 0x06,
    REG_STATUS_M = 0x07,
    REG_OUT_X_L_M = 0x08,
    REG_OUT_Z_H_M = 0x0D,
    REG_INT_CTRL_M = 0x12,
    REG_INT_SRC_M = 0x13,
    REG_INT_THS_L_M = 0x14,
    REG_INT_THS_H_M = 0x15,
    REG_OFFSET_X_L_M = 0x16,
    REG_OFFSET_Z_H_M = 0x1B,
    REG_REFERENCE_X = 0x1C,
    REG_REFERENCE_Z = 0x1E,
    REG_CTRL0_XM = 0x1F,
    REG_CTRL1_XM = 0x20,
    REG_CTRL2_XM = 0x21,
    REG_CTRL3_XM = 0x22,
    REG_CTRL4_XM = 0x23,
    REG_CTRL5_XM = 0x24,
    REG_CTRL6_XM = 0x25,
    REG_CTRL7_XM = 0x26,
    REG_FIFO_CTRL_XM = 0x2E,
    REG_INT_GEN_1 = 0x30,
    REG_INT_GEN_1_SRC = 0x31,
    REG_INT_GEN_1_THS = 0x32,
    REG_INT_GEN_1_DURATION = 0x33,
    REG_INT_GEN_2 = 0x34,
    REG_INT_GEN_2_SRC = 0x35,
    REG_INT_GEN_2_THS = 0x36,
    REG_INT_GEN_2_DURATION = 0x37,
    REG_CLICK_CFG = 0x38,
    REG_CLICK_SRC = 0x39,
    REG_CLICK_THS = 0x3A,
    REG_TIME_LIMIT = 0x3B,
    REG_TIME_LATENCY = 0x3C,
    REG_TIME_WINDOW = 0x3D,
    REG_ACT_THS = 0x3E,
    REG_ACT_DUR = 0x3F,
};

enum {
    // CTRL_REG1_G
    G_DR_SHIFT = 6,
    G_BW_SHIFT = 4,
    G_PD = 1 << 3,
    G_AXES = 0x07,  // Zen Yen Xen here: bit 2, 1, 0
    // CTRL_REG3_G to CTRL_REG5_G
    G_I2_DRDY = 1 << 3,
    G_BDU = 1 << 7,
    G_BLE = 1 << 6,
    G_FS_SHIFT = 4,
    G_ST_SHIFT = 1,
    BOOT = 1 << 7,  // also of CTRL_REG0_XM
    // INT_CTRL_REG_M
    XM_IEA = 1 << 3,
    // CTRL_REG1_XM to CTRL_REG4_XM
    A_ODR_SHIFT = 4,
    A_ODR_50_HZ = 5,
    A_ODR_LAST = 10,
    XM_BDU = 1 << 3,
    A_AXES = 0x07,
    A_BW_SHIFT = 6,
    A_FS_SHIFT = 3,
    A_FS_LAST = 4,
    A_ST_SHIFT = 1,
    P1_DRDYA = 1 << 2,
    P1_DRDYM = 1 << 1,
    P2_DRDYA = 1 << 3,
    P2_DRDYM = 1 << 2,
    // CTRL_REG5_XM to CTRL_REG7_XM
    TEMP_EN = 1 << 7,
    M_RES_SHIFT = 5,
    M_ODR_SHIFT = 2,
    M_ODR_100_HZ = 5,
    M_FS_SHIFT = 5,
    M_LOW_POWER = 1 << 2,
    M_MODE = 0x03,
    M_CONTINUOUS = 0,
    M_SINGLE = 1,
    M_POWER_DOWN = 2,
    // Status of all three: overrun of an axis is its "data available", four bits up.
    DATA_ALL = 1 << 3,
    OVERRUN_SHIFT = 4,
    // FIFO_SRC_REG
    FIFO_EMPTY = 1 << 5,
};

// A register that the host may write: bits that are none and must stay 0, and bits that
// turn something on that is not modelled.
struct rule {
    uint8_t reg;
    uint8_t reserved;
    uint8_t unmodelled;
};

static const struct rule rules_g[] = {
    {REG_CTRL1_G, 0x00, 0x00},       {REG_CTRL2_G, 0xC0, 0x00},
    {REG_CTRL3_G, 0x00, 0xC7},  // INT_G, and what a FIFO would say
    {REG_CTRL4_G, 0x08, 0x01},  // SPI
    {REG_CTRL5_G, 0x20, 0x51},  // FIFO_EN, HPen, Out_Sel but LPF2
    {REG_REFERENCE_G, 0x00, 0x00},   {REG_FIFO_CTRL_G, 0x00, 0xE0},
    {REG_INT1_CFG_G, 0x00, 0xFF},    {REG_INT1_THS_XH_G, 0x80, 0x00},
    {REG_INT1_THS_XL_G, 0x00, 0x00}, {REG_INT1_THS_YH_G, 0x80, 0x00},
    {REG_INT1_THS_YL_G, 0x00, 0x00}, {REG_INT1_THS_ZH_G, 0x80, 0x00},
    {REG_INT1_THS_ZL_G, 0x00, 0x00}, {REG_INT1_DURATION_G, 0x00, 0x00},
};

static const struct rule rules_xm[] = {
    {REG_INT_CTRL_M, 0x00, 0x01},  // MIEN
    {REG_INT_THS_L_M, 0x00, 0x00},
    {REG_INT_THS_H_M, 0x80, 0x00},
    {REG_OFFSET_X_L_M, 0x00, 0xFF},
    {REG_OFFSET_X_L_M + 1, 0x00, 0xFF},
    {REG_OFFSET_X_L_M + 2, 0x00, 0xFF},
    {REG_OFFSET_X_L_M + 3, 0x00, 0xFF},
    {REG_OFFSET_X_L_M + 4, 0x00, 0xFF},
    {REG_OFFSET_Z_H_M, 0x00, 0xFF},
    {REG_REFERENCE_X, 0x00, 0x00},
    {REG_REFERENCE_X + 1, 0x00, 0x00},
    {REG_REFERENCE_Z, 0x00, 0x00},
    {REG_CTRL0_XM, 0x18, 0x67},  // FIFO_EN, WTM_EN, high-pass of clicks and interrupts
    {REG_CTRL1_XM, 0x00, 0x00},
    {REG_CTRL2_XM, 0x00, 0x01},  // SPI
    {REG_CTRL3_XM, 0x00, 0xF9},  // all but data-ready
    {REG_CTRL4_XM, 0x00, 0xF3},
    {REG_CTRL5_XM, 0x00, 0x00},
    {REG_CTRL6_XM, 0x9F, 0x00},
    {REG_CTRL7_XM, 0x18, 0x20},  // AFDS
    {REG_FIFO_CTRL_XM, 0x00, 0xE0},
    {REG_INT_GEN_1, 0x00, 0xFF},
    {REG_INT_GEN_1_THS, 0x80, 0x00},
    {REG_INT_GEN_1_DURATION, 0x80, 0x00},
    {REG_INT_GEN_2, 0x00, 0xFF},
    {REG_INT_GEN_2_THS, 0x80, 0x00},
    {REG_INT_GEN_2_DURATION, 0x80, 0x00},
    {REG_CLICK_CFG, 0xC0, 0x3F},
    {REG_CLICK_THS, 0x80, 0x00},
    {REG_TIME_LIMIT, 0x80, 0x00},
    {REG_TIME_LATENCY, 0x00, 0x00},
    {REG_TIME_WINDOW, 0x00, 0x00},
    {REG_ACT_THS, 0x80, 0x7F},
    {REG_ACT_DUR, 0x00, 0x00},
};

struct die {
    uint8_t reg[REG_COUNT];
    uint8_t pointer;
    bool moves_on;      // bit 7 of the sub-address (DS 6.1)
    uint64_t boot_end;  // of a reboot under way; NEVER for none
};

// One of gyroscope, accelerometer, magnetometer: its clock and its six output bytes.
struct sensor {
    uint64_t epoch_ns;  // sample number n falls at epoch + n periods
    uint64_t tick;      // number of the next sample
    uint64_t tick_ns;   // NEVER: off
    uint64_t samples;
    int16_t latest[AXES];
    // With BDU, output bytes of which the other half of the axis is yet to be read: the
    // axis is not updated until then (DS: BDU). `waiting` axes have a newer value.
    uint8_t half_read;
    uint8_t waiting;
};

struct lsm9ds0_chip {
    struct lsm9ds0_chip_config config;
    double held[SENSORS][AXES];  // motion by lsm9ds0_chip_quantity
    struct lsm9ds0_chip_fault faults[LSM9DS0_CHIP_FAULTS_MAX];
    unsigned fault_count;
    unsigned held_clocks[LSM9DS0_CHIP_FAULTS_MAX];   // SCL pulses seen while it holds
    uint64_t held_from_ns[LSM9DS0_CHIP_FAULTS_MAX];  // NEVER: has not held yet
    bool is_spent[LSM9DS0_CHIP_FAULTS_MAX];
    bool is_clocked_out[LSM9DS0_CHIP_FAULTS_MAX];
    const char *complaint;

    uint64_t now_ns;
    uint64_t answers_ns;  // registers answer from here on
    uint64_t gyr_on_ns;   // the gyroscope left power-down
    struct die g;
    struct die xm;
    struct sensor sensors[SENSORS];  // by lsm9ds0_chip_quantity

    struct die *target;  // null: nobody is addressed
    bool is_transfer;    // between START and STOP
    bool is_read;
    bool has_pointer;
    uint64_t byte;  // of this transaction, the address is 0
    uint64_t transactions;
};

static void complain(struct lsm9ds0_chip *chip, const char *what) {
    if (chip->complaint == NULL) {
        chip->complaint = what;
    }
}

// Faults

static bool fault_is_active(const struct lsm9ds0_chip *chip, unsigned i) {
    const struct lsm9ds0_chip_fault *fault = &chip->faults[i];
    if (fault->transactions > 0) {
        return chip->is_transfer && chip->transactions >= fault->first &&
               chip->transactions - fault->first < fault->transactions;
    }
    return chip->now_ns >= fault->from_ns &&
           (fault->for_ns == 0 || chip->now_ns - fault->from_ns < fault->for_ns);
}

static enum lsm9ds0_chip_die which(const struct lsm9ds0_chip *chip,
                                   const struct die *die) {
    return die == &chip->g ? LSM9DS0_CHIP_G : LSM9DS0_CHIP_XM;
}

static const struct lsm9ds0_chip_fault *find_fault(const struct lsm9ds0_chip *chip,
                                                   enum lsm9ds0_chip_fault_kind kind,
                                                   enum lsm9ds0_chip_die die) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct lsm9ds0_chip_fault *fault = &chip->faults[i];
        const bool concerns = fault->die == LSM9DS0_CHIP_BOTH || fault->die == die;
        if (fault->kind == kind && concerns && fault_is_active(chip, i)) {
            return fault;
        }
    }
    return NULL;
}

// Whether the byte on its way to that die is refused.
static bool is_nacked(const struct lsm9ds0_chip *chip, enum lsm9ds0_chip_die die) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct lsm9ds0_chip_fault *fault = &chip->faults[i];
        const bool concerns = fault->die == LSM9DS0_CHIP_BOTH || fault->die == die;
        if (fault->kind == LSM9DS0_CHIP_NACK && concerns && fault_is_active(chip, i) &&
            fault->at_byte == chip->byte) {
            return true;
        }
    }
    return false;
}

static bool holds(struct lsm9ds0_chip *chip, unsigned i) {
    const struct lsm9ds0_chip_fault *fault = &chip->faults[i];
    if (fault->kind != LSM9DS0_CHIP_STUCK_SDA || chip->is_spent[i]) {
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

static bool is_sda_held(struct lsm9ds0_chip *chip) {
    bool held = false;
    for (unsigned i = 0; i < chip->fault_count; i++) {
        held = holds(chip, i) || held;
    }
    return held;
}

// What the registers say of the three sensors

static struct die *die_of(struct lsm9ds0_chip *chip,
                          enum lsm9ds0_chip_quantity quantity) {
    return quantity == LSM9DS0_CHIP_GYR ? &chip->g : &chip->xm;
}

static uint8_t status_reg(enum lsm9ds0_chip_quantity quantity) {
    return quantity == LSM9DS0_CHIP_MAG ? REG_STATUS_M : REG_STATUS;
}

static uint8_t first_out_reg(enum lsm9ds0_chip_quantity quantity) {
    return quantity == LSM9DS0_CHIP_MAG ? REG_OUT_X_L_M : REG_OUT_X_L;
}

// Bit 0 is x. All three have their enable bits there; the magnetometer has none.
static uint8_t enabled_axes(const struct lsm9ds0_chip *chip,
                            enum lsm9ds0_chip_quantity quantity) {
    switch (quantity) {
    case LSM9DS0_CHIP_GYR:
        return chip->g.reg[REG_CTRL1_G] & G_AXES;
    case LSM9DS0_CHIP_ACC:
        return chip->xm.reg[REG_CTRL1_XM] & A_AXES;
    default:
        return 0x07;
    }
}

static bool has_bdu(const struct lsm9ds0_chip *chip,
                    enum lsm9ds0_chip_quantity quantity) {
    if (quantity == LSM9DS0_CHIP_GYR) {
        return (chip->g.reg[REG_CTRL4_G] & G_BDU) != 0;
    }
    return (chip->xm.reg[REG_CTRL1_XM] & XM_BDU) != 0;
}

// Samples a second by the die's own clock; 0 where the sensor is off.
static double rate_hz(const struct lsm9ds0_chip *chip,
                      enum lsm9ds0_chip_quantity quantity) {
    static const double gyro[4] = {95, 190, 380, 760};  // DS table 21
    const uint8_t ctrl1_g = chip->g.reg[REG_CTRL1_G];
    const int aodr = chip->xm.reg[REG_CTRL1_XM] >> A_ODR_SHIFT;
    const uint8_t ctrl7 = chip->xm.reg[REG_CTRL7_XM];
    const int modr = (chip->xm.reg[REG_CTRL5_XM] >> M_ODR_SHIFT) & 0x07;
    switch (quantity) {
    case LSM9DS0_CHIP_GYR:
        // DS table 22: PD 0 is power-down, PD 1 with no axis is sleep.
        return (ctrl1_g & G_PD) && (ctrl1_g & G_AXES) ? gyro[ctrl1_g >> G_DR_SHIFT]
                                                      : 0.0;
    case LSM9DS0_CHIP_ACC:
        // DS CTRL_REG1_XM: 3.125 Hz at 1, doubling up to 1600 Hz at 10.
        return aodr == 0 || aodr > A_ODR_LAST ? 0.0 : ldexp(3.125, aodr - 1);
    default:
        if ((ctrl7 & M_MODE) >= M_POWER_DOWN) {
            return 0.0;
        }
        if (ctrl7 & M_LOW_POWER) {
            return 3.125;  // DS CTRL_REG7_XM: MLP
        }
        // DS CTRL_REG5_XM: 3.125 Hz at 0, doubling up to 100 Hz at 5.
        return modr > M_ODR_100_HZ ? 0.0 : ldexp(3.125, modr);
    }
}

static double period_ns(const struct lsm9ds0_chip *chip,
                        enum lsm9ds0_chip_quantity quantity) {
    const double error_ppm = quantity == LSM9DS0_CHIP_GYR
                                 ? chip->config.g_rate_error_ppm
                                 : chip->config.xm_rate_error_ppm;
    return 1e9 / (rate_hz(chip, quantity) * (1.0 + error_ppm * 1e-6));
}

static void set_next_tick(struct lsm9ds0_chip *chip,
                          enum lsm9ds0_chip_quantity quantity) {
    struct sensor *sensor = &chip->sensors[quantity];
    const bool is_booting = die_of(chip, quantity)->boot_end != NEVER;
    if (is_booting || rate_hz(chip, quantity) == 0.0) {
        sensor->tick_ns = NEVER;
        return;
    }
    const double at = (double)sensor->tick * period_ns(chip, quantity);
    sensor->tick_ns = sensor->epoch_ns + (uint64_t)llround(at);
}

static void restart_clock(struct lsm9ds0_chip *chip,
                          enum lsm9ds0_chip_quantity quantity) {
    chip->sensors[quantity].epoch_ns = chip->now_ns;
    chip->sensors[quantity].tick = 1;
    set_next_tick(chip, quantity);
}

// Motion

static void mean_motion(struct lsm9ds0_chip *chip, enum lsm9ds0_chip_quantity quantity,
                        int64_t from_ns, int64_t to_ns, double mean[AXES]) {
    if (chip->config.motion != NULL) {
        chip->config.motion(chip->config.context, quantity, from_ns, to_ns, mean);
    } else {
        memcpy(mean, chip->held[quantity], sizeof chip->held[quantity]);
    }
}

// A moving average over w has its -3 dB point at 0.443 / w. Motion recorded behind such
// a low-pass is only brought to the sample rate.
static void low_passed(struct lsm9ds0_chip *chip, enum lsm9ds0_chip_quantity quantity,
                       double bandwidth_hz, double mean[AXES]) {
    const int64_t now = (int64_t)chip->now_ns;
    if (chip->config.is_recorded) {
        const int64_t half = (int64_t)llround(0.5 * period_ns(chip, quantity));
        mean_motion(chip, quantity, now - half, now + half, mean);
        return;
    }
    const int64_t width = (int64_t)llround(0.443e9 / bandwidth_hz);
    mean_motion(chip, quantity, now - width, now, mean);
}

// Nearest count; 16 bits two's complement.
static int16_t to_counts(double value) {
    const double counts = rint(value);
    if (counts > INT16_MAX) {
        return INT16_MAX;
    }
    if (counts < INT16_MIN) {
        return INT16_MIN;
    }
    return (int16_t)counts;
}

static void sense_gyro(struct lsm9ds0_chip *chip, double counts[AXES]) {
    // DS table 21: cut-off in Hz by DR and BW.
    static const double bandwidth_hz[4][4] = {
        {12.5, 25, 25, 25}, {12.5, 25, 50, 70}, {20, 25, 50, 100}, {30, 35, 50, 100}};
    static const double mdps_per_count[4] = {8.75, 17.50, 70, 70};  // DS table 3: G_So
    // 01: x up, y and z down; 11: the other way round.
    static const double self_test_sign[4][AXES] = {
        {0, 0, 0}, {1, -1, -1}, {0, 0, 0}, {-1, 1, 1}};
    const uint8_t ctrl1 = chip->g.reg[REG_CTRL1_G];
    const uint8_t ctrl4 = chip->g.reg[REG_CTRL4_G];
    const int range = (ctrl4 >> G_FS_SHIFT) & 0x03;
    const double *sign = self_test_sign[(ctrl4 >> G_ST_SHIFT) & 0x03];
    const bool is_weak =
        find_fault(chip, LSM9DS0_CHIP_GYR_SELF_TEST, LSM9DS0_CHIP_G) != NULL;
    const double response_dps =
        chip->config.gyr_self_test_dps[range > 2 ? 2 : range] * (is_weak ? 0.1 : 1.0);
    const bool is_good = chip->now_ns - chip->gyr_on_ns >= chip->config.gyr_turn_on_ns;
    double mean[AXES];
    low_passed(chip, LSM9DS0_CHIP_GYR,
               bandwidth_hz[ctrl1 >> G_DR_SHIFT][(ctrl1 >> G_BW_SHIFT) & 0x03], mean);
    for (int axis = 0; axis < AXES; axis++) {
        const double dps = mean[axis] / RAD_PER_DEG + sign[axis] * response_dps;
        counts[axis] = is_good ? dps * 1000.0 / mdps_per_count[range] : 0.0;
    }
}

static void sense_accel(struct lsm9ds0_chip *chip, double counts[AXES]) {
    static const double bandwidth_hz[4] = {773, 194, 362, 50};  // DS CTRL_REG2_XM
    // DS table 3: LA_So; the last does not follow from its range.
    static const double mg_per_count[A_FS_LAST + 1] = {0.061, 0.122, 0.183, 0.244,
                                                       0.732};
    static const double self_test_sign[4] = {0, 1, -1, 0};
    const uint8_t ctrl2 = chip->xm.reg[REG_CTRL2_XM];
    const int afs = (ctrl2 >> A_FS_SHIFT) & 0x07;
    const double mg = mg_per_count[afs > A_FS_LAST ? A_FS_LAST : afs];
    const bool is_weak =
        find_fault(chip, LSM9DS0_CHIP_ACC_SELF_TEST, LSM9DS0_CHIP_XM) != NULL;
    const double scale =
        self_test_sign[(ctrl2 >> A_ST_SHIFT) & 0x03] * (is_weak ? 0.1 : 1.0);
    double mean[AXES];
    low_passed(chip, LSM9DS0_CHIP_ACC, bandwidth_hz[ctrl2 >> A_BW_SHIFT], mean);
    for (int axis = 0; axis < AXES; axis++) {
        counts[axis] = (mean[axis] * 1000.0 / STANDARD_GRAVITY +
                        scale * chip->config.acc_self_test_mg[axis]) /
                       mg;
    }
}

static void sense_mag(struct lsm9ds0_chip *chip, double counts[AXES]) {
    static const double mgauss_per_count[4] = {0.08, 0.16, 0.32, 0.48};  // DS table 3
    const int range = (chip->xm.reg[REG_CTRL6_XM] >> M_FS_SHIFT) & 0x03;
    const int64_t now = (int64_t)chip->now_ns;
    double field_ut[AXES];
    mean_motion(chip, LSM9DS0_CHIP_MAG, now, now, field_ut);
    for (int axis = 0; axis < AXES; axis++) {
        // 1 uT is 10 mgauss.
        counts[axis] = chip->config.mag_sign[axis] * field_ut[axis] * 10.0 /
                       mgauss_per_count[range];
    }
}

// Output registers

// The host sees the latest value of an axis.
static void show(struct lsm9ds0_chip *chip, enum lsm9ds0_chip_quantity quantity,
                 int axis) {
    const uint16_t value = (uint16_t)chip->sensors[quantity].latest[axis];
    uint8_t *at = &die_of(chip, quantity)->reg[first_out_reg(quantity) + 2 * axis];
    const bool is_big_endian =
        quantity == LSM9DS0_CHIP_GYR && (chip->g.reg[REG_CTRL4_G] & G_BLE) != 0;
    at[is_big_endian ? 1 : 0] = (uint8_t)(value & 0xFF);
    at[is_big_endian ? 0 : 1] = (uint8_t)(value >> 8);
}

// AN3308: a new value finds the last one unread, and says so.
static void flag(uint8_t *status, uint8_t bits) {
    const uint8_t lost = *status & bits;
    *status |= (uint8_t)(bits | (lost << OVERRUN_SHIFT));
}

static void put_axis(struct lsm9ds0_chip *chip, enum lsm9ds0_chip_quantity quantity,
                     int axis) {
    struct sensor *sensor = &chip->sensors[quantity];
    uint8_t *status = &die_of(chip, quantity)->reg[status_reg(quantity)];
    const uint8_t bit = (uint8_t)(1 << axis);
    const uint8_t halves = (uint8_t)(0x03 << (2 * axis));
    if (!(sensor->half_read & halves)) {
        show(chip, quantity, axis);
        flag(status, bit);
    } else if (sensor->waiting & bit) {
        *status |= (uint8_t)(bit << OVERRUN_SHIFT);  // one more behind the held one
    } else {
        sensor->waiting |= bit;
    }
}

static void put_temperature(struct lsm9ds0_chip *chip) {
    // DS table 4: 8 LSB/degC; 12 bits, right-justified.
    const double counts =
        rint((chip->config.temperature_c - chip->config.temperature_zero_c) * 8.0);
    const int16_t value = (int16_t)fmin(fmax(counts, -2048.0), 2047.0);
    chip->xm.reg[REG_OUT_TEMP_L_XM] = (uint8_t)((uint16_t)value & 0xFF);
    chip->xm.reg[REG_OUT_TEMP_H_XM] = (uint8_t)((uint16_t)value >> 8);
}

static void sense(struct lsm9ds0_chip *chip, enum lsm9ds0_chip_quantity quantity) {
    double counts[AXES];
    if (quantity == LSM9DS0_CHIP_GYR) {
        sense_gyro(chip, counts);
    } else if (quantity == LSM9DS0_CHIP_ACC) {
        sense_accel(chip, counts);
    } else {
        sense_mag(chip, counts);
        if (chip->xm.reg[REG_CTRL5_XM] & TEMP_EN) {
            put_temperature(chip);
        }
    }
    for (int axis = 0; axis < AXES; axis++) {
        chip->sensors[quantity].latest[axis] = to_counts(counts[axis]);
    }
}

static void take_sample(struct lsm9ds0_chip *chip,
                        enum lsm9ds0_chip_quantity quantity) {
    struct sensor *sensor = &chip->sensors[quantity];
    struct die *die = die_of(chip, quantity);
    const enum lsm9ds0_chip_die name = which(chip, die);
    sensor->tick++;
    set_next_tick(chip, quantity);
    if (find_fault(chip, LSM9DS0_CHIP_NO_DATA_READY, name) != NULL ||
        (quantity == LSM9DS0_CHIP_MAG &&
         find_fault(chip, LSM9DS0_CHIP_NO_MAG, name) != NULL)) {
        return;
    }
    sensor->samples++;
    if (find_fault(chip, LSM9DS0_CHIP_FROZEN, name) == NULL) {
        sense(chip, quantity);
    }
    const uint8_t axes = enabled_axes(chip, quantity);
    for (int axis = 0; axis < AXES; axis++) {
        if (axes & (1 << axis)) {
            put_axis(chip, quantity, axis);
        }
    }
    // Where an axis is held back, nothing of the set was overwritten.
    uint8_t *status = &die->reg[status_reg(quantity)];
    if (sensor->waiting) {
        *status |= DATA_ALL;
    } else {
        flag(status, DATA_ALL);
    }
    if (quantity == LSM9DS0_CHIP_MAG &&
        (chip->xm.reg[REG_CTRL7_XM] & M_MODE) == M_SINGLE) {
        chip->xm.reg[REG_CTRL7_XM] ^= M_SINGLE ^ M_POWER_DOWN;
        set_next_tick(chip, quantity);
    }
}

// An output byte has been read: number 0 to 5.
static void release(struct lsm9ds0_chip *chip, enum lsm9ds0_chip_quantity quantity,
                    int number) {
    struct sensor *sensor = &chip->sensors[quantity];
    uint8_t *status = &die_of(chip, quantity)->reg[status_reg(quantity)];
    const int axis = number / 2;
    const uint8_t bit = (uint8_t)(1 << axis);
    const uint8_t halves = (uint8_t)(0x03 << (2 * axis));
    if (number & 1) {
        // AN3308: the flags of an axis go as its high byte is read, those of all
        // as it was the last one.
        *status &= (uint8_t) ~(bit | (bit << OVERRUN_SHIFT));
        if (!(*status & enabled_axes(chip, quantity))) {
            *status &= (uint8_t) ~(DATA_ALL | (DATA_ALL << OVERRUN_SHIFT));
        }
    }
    if (!has_bdu(chip, quantity)) {
        return;
    }
    sensor->half_read |= (uint8_t)(1 << number);
    if ((sensor->half_read & halves) != halves) {
        return;
    }
    sensor->half_read &= (uint8_t)~halves;
    if (sensor->waiting & bit) {
        sensor->waiting &= (uint8_t)~bit;
        show(chip, quantity, axis);
        *status |= bit | DATA_ALL;
    }
}

// BDU changed: nothing is held back, newer values show.
static void release_all(struct lsm9ds0_chip *chip,
                        enum lsm9ds0_chip_quantity quantity) {
    struct sensor *sensor = &chip->sensors[quantity];
    for (int axis = 0; axis < AXES; axis++) {
        if (sensor->waiting & (1 << axis)) {
            show(chip, quantity, axis);
        }
    }
    sensor->half_read = 0;
    sensor->waiting = 0;
}

// Power and reset

struct lsm9ds0_chip_config lsm9ds0_chip_defaults(void) {
    return (struct lsm9ds0_chip_config){
        .temperature_c = 25.0,
        .temperature_zero_c = 25.0,
        .startup_ns = 10 * MS,
        .gyr_turn_on_ns = 250 * MS,
        .who_am_i_g = 0xD4,
        .who_am_i_xm = 0x49,
        .int_ctrl_reg_m = 0xE8,
        .mag_sign = {1, 1, -1},
        .sa0_g = true,
        .sa0_xm = true,
        // DS table 3: 20 to 250, 70 to 400 and 150 to 1000 deg/s; 60 to 1700 mg.
        .gyr_self_test_dps = {130.0, 200.0, 530.0},
        .acc_self_test_mg = {310.0, 290.0, 520.0},
    };
}

struct lsm9ds0_chip *lsm9ds0_chip_new(const struct lsm9ds0_chip_config *config) {
    struct lsm9ds0_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    chip->held[LSM9DS0_CHIP_ACC][2] = STANDARD_GRAVITY;
    chip->held[LSM9DS0_CHIP_MAG][1] = 20.0;
    chip->held[LSM9DS0_CHIP_MAG][2] = -40.0;
    lsm9ds0_chip_power_cycle(chip, 0);
    return chip;
}

void lsm9ds0_chip_free(struct lsm9ds0_chip *chip) {
    free(chip);
}

// DS register map: the column of reset values; what it leaves out is 0.
void lsm9ds0_chip_power_cycle(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    chip->now_ns = now_ns;
    chip->answers_ns = now_ns + chip->config.startup_ns;
    chip->is_transfer = false;
    chip->target = NULL;
    memset(&chip->g, 0, sizeof chip->g);
    memset(&chip->xm, 0, sizeof chip->xm);
    chip->g.boot_end = NEVER;
    chip->g.reg[REG_WHO_AM_I] = chip->config.who_am_i_g;
    chip->g.reg[REG_CTRL1_G] = G_AXES;
    chip->g.reg[REG_FIFO_SRC] = FIFO_EMPTY;  // DS 4.3: bypass, it remains empty
    chip->xm.boot_end = NEVER;
    chip->xm.reg[REG_WHO_AM_I] = chip->config.who_am_i_xm;
    chip->xm.reg[REG_INT_CTRL_M] = chip->config.int_ctrl_reg_m;
    chip->xm.reg[REG_CTRL1_XM] = A_AXES;
    chip->xm.reg[REG_CTRL5_XM] = 0x18;
    chip->xm.reg[REG_CTRL6_XM] = 0x20;
    chip->xm.reg[REG_CTRL7_XM] = M_POWER_DOWN;
    chip->xm.reg[REG_FIFO_SRC] = FIFO_EMPTY;
    memset(chip->sensors, 0, sizeof chip->sensors);
    for (int i = 0; i < SENSORS; i++) {
        restart_clock(chip, (enum lsm9ds0_chip_quantity)i);
    }
}

void lsm9ds0_chip_hold(struct lsm9ds0_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]) {
    memcpy(chip->held[LSM9DS0_CHIP_GYR], gyr_rad_s, sizeof chip->held[0]);
    memcpy(chip->held[LSM9DS0_CHIP_ACC], acc_m_s2, sizeof chip->held[0]);
    memcpy(chip->held[LSM9DS0_CHIP_MAG], mag_ut, sizeof chip->held[0]);
}

void lsm9ds0_chip_set_temperature(struct lsm9ds0_chip *chip, double temperature_c) {
    chip->config.temperature_c = temperature_c;
}

bool lsm9ds0_chip_add_fault(struct lsm9ds0_chip *chip,
                            const struct lsm9ds0_chip_fault *fault) {
    if (chip->fault_count == LSM9DS0_CHIP_FAULTS_MAX) {
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

void lsm9ds0_chip_clear_faults(struct lsm9ds0_chip *chip) {
    chip->fault_count = 0;
}

// Time

uint64_t lsm9ds0_chip_next_event(const struct lsm9ds0_chip *chip) {
    uint64_t next =
        chip->g.boot_end < chip->xm.boot_end ? chip->g.boot_end : chip->xm.boot_end;
    for (int i = 0; i < SENSORS; i++) {
        if (chip->sensors[i].tick_ns < next) {
            next = chip->sensors[i].tick_ns;
        }
    }
    return next;
}

// At the end of a reboot BOOT is 0 again; the user's registers stay.
static void end_boot(struct lsm9ds0_chip *chip) {
    if (chip->g.boot_end == chip->now_ns) {
        chip->g.boot_end = NEVER;
        chip->g.reg[REG_CTRL5_G] &= (uint8_t)~BOOT;
        chip->gyr_on_ns = chip->now_ns;
        restart_clock(chip, LSM9DS0_CHIP_GYR);
    }
    if (chip->xm.boot_end == chip->now_ns) {
        chip->xm.boot_end = NEVER;
        chip->xm.reg[REG_CTRL0_XM] &= (uint8_t)~BOOT;
        restart_clock(chip, LSM9DS0_CHIP_ACC);
        restart_clock(chip, LSM9DS0_CHIP_MAG);
    }
}

void lsm9ds0_chip_advance(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = lsm9ds0_chip_next_event(chip);
        if (next > now_ns || next == NEVER) {
            break;
        }
        chip->now_ns = next;
        for (int i = 0; i < SENSORS; i++) {
            if (chip->sensors[i].tick_ns == next) {
                take_sample(chip, (enum lsm9ds0_chip_quantity)i);
            }
        }
        end_boot(chip);
    }
    if (now_ns > chip->now_ns) {
        chip->now_ns = now_ns;
    }
}

bool lsm9ds0_chip_pin_is_high(const struct lsm9ds0_chip *chip,
                              enum lsm9ds0_chip_pin pin) {
    const uint8_t *xm = chip->xm.reg;
    if (pin == LSM9DS0_CHIP_DRDY_G) {
        // H_Lactive is of INT_G: this pin is active high.
        return (chip->g.reg[REG_CTRL3_G] & G_I2_DRDY) != 0 &&
               (chip->g.reg[REG_STATUS] & DATA_ALL) != 0;
    }
    const bool is_first = pin == LSM9DS0_CHIP_INT1_XM;
    const uint8_t enabled = xm[is_first ? REG_CTRL3_XM : REG_CTRL4_XM];
    const bool has_acc = (enabled & (is_first ? P1_DRDYA : P2_DRDYA)) != 0 &&
                         (xm[REG_STATUS] & DATA_ALL) != 0;
    const bool has_mag = (enabled & (is_first ? P1_DRDYM : P2_DRDYM)) != 0 &&
                         (xm[REG_STATUS_M] & DATA_ALL) != 0;
    const bool is_active_high = (xm[REG_INT_CTRL_M] & XM_IEA) != 0;
    return (has_acc || has_mag) == is_active_high;
}

bool lsm9ds0_chip_holds_sda(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    lsm9ds0_chip_advance(chip, now_ns);
    return is_sda_held(chip);
}

// Host's registers

static void step(struct die *die) {
    if (die->moves_on) {
        die->pointer = (die->pointer + 1) & (REG_COUNT - 1);
    }
}

static uint8_t read_register(struct lsm9ds0_chip *chip) {
    struct die *die = chip->target;
    const uint8_t at = die->pointer;
    uint8_t value = die->reg[at];
    if (at == REG_WHO_AM_I) {
        const struct lsm9ds0_chip_fault *fault =
            find_fault(chip, LSM9DS0_CHIP_WRONG_WHO_AM_I, which(chip, die));
        value = fault != NULL ? fault->value : value;
    } else if (at >= REG_OUT_X_L && at < REG_OUT_X_L + 2 * AXES) {
        release(chip, die == &chip->g ? LSM9DS0_CHIP_GYR : LSM9DS0_CHIP_ACC,
                at - REG_OUT_X_L);
    } else if (die == &chip->xm && at >= REG_OUT_X_L_M && at <= REG_OUT_Z_H_M) {
        release(chip, LSM9DS0_CHIP_MAG, at - REG_OUT_X_L_M);
    }
    step(die);
    return value;
}

// DS CTRL_REG5_XM: 100 Hz with the accelerometer above 50 Hz or off, 110 and 111 not at
// all; M_RES is 00 or 11.
static void check_mag(struct lsm9ds0_chip *chip) {
    const uint8_t *reg = chip->xm.reg;
    const int modr = (reg[REG_CTRL5_XM] >> M_ODR_SHIFT) & 0x07;
    const int res = (reg[REG_CTRL5_XM] >> M_RES_SHIFT) & 0x03;
    const int aodr = reg[REG_CTRL1_XM] >> A_ODR_SHIFT;
    if (res == 1 || res == 2) {
        complain(chip, "LSM9DS0: a magnetic resolution that is reserved");
    }
    if ((reg[REG_CTRL7_XM] & M_MODE) >= M_POWER_DOWN ||
        (reg[REG_CTRL7_XM] & M_LOW_POWER)) {
        return;
    }
    if (modr > M_ODR_100_HZ) {
        complain(chip, "LSM9DS0: a magnetic data rate that is reserved");
    } else if (modr == M_ODR_100_HZ && aodr > 0 && aodr <= A_ODR_50_HZ) {
        complain(chip, "LSM9DS0: 100 Hz of the magnetometer with a slow accelerometer");
    }
}

static void begin_boot(struct lsm9ds0_chip *chip, struct die *die) {
    die->boot_end = chip->now_ns + chip->config.startup_ns;
    for (int i = 0; i < SENSORS; i++) {
        const enum lsm9ds0_chip_quantity quantity = (enum lsm9ds0_chip_quantity)i;
        if (die_of(chip, quantity) == die) {
            set_next_tick(chip, quantity);
        }
    }
}

static void wrote_g(struct lsm9ds0_chip *chip, uint8_t at, uint8_t old, uint8_t value) {
    const uint8_t changed = old ^ value;
    if (at == REG_CTRL1_G && changed) {
        if (!(old & G_PD)) {
            chip->gyr_on_ns = chip->now_ns;
        }
        restart_clock(chip, LSM9DS0_CHIP_GYR);
    } else if (at == REG_CTRL4_G) {
        if (((value >> G_ST_SHIFT) & 0x03) == 2) {
            complain(chip, "LSM9DS0: a self-test of the gyroscope that is reserved");
        }
        if (changed & G_BDU) {
            release_all(chip, LSM9DS0_CHIP_GYR);
        }
    } else if (at == REG_CTRL5_G && (value & BOOT)) {
        begin_boot(chip, &chip->g);
    }
}

static void wrote_xm(struct lsm9ds0_chip *chip, uint8_t at, uint8_t old,
                     uint8_t value) {
    const uint8_t changed = old ^ value;
    switch (at) {
    case REG_CTRL0_XM:
        if (value & BOOT) {
            begin_boot(chip, &chip->xm);
        }
        break;
    case REG_CTRL1_XM:
        if ((value >> A_ODR_SHIFT) > A_ODR_LAST) {
            complain(chip, "LSM9DS0: an acceleration data rate that is reserved");
        }
        if (changed >> A_ODR_SHIFT) {
            restart_clock(chip, LSM9DS0_CHIP_ACC);
        }
        if (changed & XM_BDU) {
            release_all(chip, LSM9DS0_CHIP_ACC);
            release_all(chip, LSM9DS0_CHIP_MAG);
        }
        check_mag(chip);
        break;
    case REG_CTRL2_XM:
        if (((value >> A_FS_SHIFT) & 0x07) > A_FS_LAST ||
            ((value >> A_ST_SHIFT) & 0x03) == 3) {
            complain(chip, "LSM9DS0: a range or self-test that is not allowed");
        }
        break;
    case REG_CTRL5_XM:
        if (changed & (0x07 << M_ODR_SHIFT)) {
            restart_clock(chip, LSM9DS0_CHIP_MAG);
        }
        check_mag(chip);
        break;
    case REG_CTRL7_XM:
        if (changed & (M_MODE | M_LOW_POWER) || (value & M_MODE) == M_SINGLE) {
            restart_clock(chip, LSM9DS0_CHIP_MAG);
        }
        check_mag(chip);
        break;
    default:
        break;
    }
}

static const struct rule *find_rule(const struct lsm9ds0_chip *chip,
                                    const struct die *die) {
    const bool is_g = die == &chip->g;
    const struct rule *rules = is_g ? rules_g : rules_xm;
    const size_t count = is_g ? sizeof rules_g / sizeof rules_g[0]
                              : sizeof rules_xm / sizeof rules_xm[0];
    for (size_t i = 0; i < count; i++) {
        if (rules[i].reg == die->pointer) {
            return &rules[i];
        }
    }
    return NULL;
}

static void write_register(struct lsm9ds0_chip *chip, uint8_t value) {
    struct die *die = chip->target;
    const uint8_t at = die->pointer;
    const struct rule *rule = find_rule(chip, die);
    if (die->boot_end != NEVER) {  // nothing says what becomes of it
        complain(chip, "LSM9DS0: a register written during a reboot");
    }
    if (rule == NULL) {
        complain(chip, "LSM9DS0: a register written that is reserved or read-only");
    } else {
        if (value & rule->reserved) {
            complain(chip, "LSM9DS0: a reserved bit set");
        }
        if (value & rule->unmodelled) {
            complain(chip, "LSM9DS0: something turned on that is not modelled");
        }
        const uint8_t old = die->reg[at];
        die->reg[at] = value & (uint8_t)~rule->reserved;
        if (die == &chip->g) {
            wrote_g(chip, at, old, die->reg[at]);
        } else {
            wrote_xm(chip, at, old, die->reg[at]);
        }
    }
    step(die);
}

// The wire

static struct die *addressed(struct lsm9ds0_chip *chip, uint8_t address) {
    // DS 6.1: 110101x, x being SA0_G; 0011110 or 0011101 for SA0_XM low or high.
    if (address == (chip->config.sa0_g ? 0x6B : 0x6A)) {
        return &chip->g;
    }
    return address == (chip->config.sa0_xm ? 0x1D : 0x1E) ? &chip->xm : NULL;
}

bool lsm9ds0_chip_start(struct lsm9ds0_chip *chip, uint64_t now_ns, uint8_t address,
                        bool is_read) {
    lsm9ds0_chip_advance(chip, now_ns);
    if (!chip->is_transfer) {
        chip->is_transfer = true;
        chip->transactions++;
        chip->byte = 0;
    } else {
        chip->byte++;
    }
    chip->is_read = is_read;
    chip->has_pointer = false;
    chip->target = NULL;
    struct die *die = addressed(chip, address);
    if (is_sda_held(chip) || die == NULL || chip->now_ns < chip->answers_ns ||
        is_nacked(chip, which(chip, die))) {
        return false;
    }
    chip->target = die;
    return true;
}

bool lsm9ds0_chip_write(struct lsm9ds0_chip *chip, uint64_t now_ns, uint8_t byte) {
    lsm9ds0_chip_advance(chip, now_ns);
    chip->byte++;
    if (chip->target == NULL || chip->is_read || is_sda_held(chip)) {
        return false;
    }
    if (is_nacked(chip, which(chip, chip->target))) {
        chip->target = NULL;
        return false;
    }
    if (!chip->has_pointer) {
        chip->has_pointer = true;
        chip->target->pointer = byte & (REG_COUNT - 1);
        chip->target->moves_on = (byte & 0x80) != 0;
    } else {
        write_register(chip, byte);
    }
    return true;
}

uint8_t lsm9ds0_chip_read(struct lsm9ds0_chip *chip, uint64_t now_ns, bool ack) {
    lsm9ds0_chip_advance(chip, now_ns);
    chip->byte++;
    if (is_sda_held(chip)) {
        return 0x00;
    }
    if (chip->target == NULL || !chip->is_read) {
        return 0xFF;  // nobody pulls SDA down
    }
    const uint8_t value = read_register(chip);
    if (!ack) {
        chip->target = NULL;
    }
    return value;
}

void lsm9ds0_chip_stop(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    lsm9ds0_chip_advance(chip, now_ns);
    chip->target = NULL;
    chip->is_transfer = false;
}

void lsm9ds0_chip_scl_pulse(struct lsm9ds0_chip *chip, uint64_t now_ns) {
    lsm9ds0_chip_advance(chip, now_ns);
    for (unsigned i = 0; i < chip->fault_count; i++) {
        if (holds(chip, i) && chip->faults[i].clocks > 0) {
            chip->held_clocks[i]++;
            chip->is_clocked_out[i] = chip->held_clocks[i] >= chip->faults[i].clocks;
        }
    }
}

// Whole transactions

static bool send_bytes(struct lsm9ds0_chip *chip, uint64_t *now_ns,
                       const uint8_t *bytes, unsigned length) {
    for (unsigned i = 0; i < length; i++) {
        *now_ns += UINT64_C(9) * BIT_NS;
        if (!lsm9ds0_chip_write(chip, *now_ns, bytes[i])) {
            return false;
        }
    }
    return true;
}

static int end_transaction(struct lsm9ds0_chip *chip, uint64_t *now_ns, bool is_good) {
    *now_ns += BIT_NS;
    if (lsm9ds0_chip_holds_sda(chip, *now_ns)) {
        return -3;  // no STOP either
    }
    lsm9ds0_chip_stop(chip, *now_ns);
    return is_good ? 0 : -1;
}

static bool begin_transaction(struct lsm9ds0_chip *chip, uint64_t *now_ns,
                              uint8_t address, bool is_read) {
    *now_ns += UINT64_C(10) * BIT_NS;
    return lsm9ds0_chip_start(chip, *now_ns, address, is_read);
}

int lsm9ds0_chip_read_registers(struct lsm9ds0_chip *chip, uint64_t *now_ns,
                                uint8_t address, uint8_t sub, uint8_t *data,
                                uint8_t length) {
    if (lsm9ds0_chip_holds_sda(chip, *now_ns)) {
        return -3;
    }
    const bool good = begin_transaction(chip, now_ns, address, false) &&
                      send_bytes(chip, now_ns, &sub, 1) &&
                      begin_transaction(chip, now_ns, address, true);
    for (unsigned i = 0; good && i < length; i++) {
        *now_ns += UINT64_C(9) * BIT_NS;
        data[i] = lsm9ds0_chip_read(chip, *now_ns, i + 1U < length);
    }
    return end_transaction(chip, now_ns, good);
}

int lsm9ds0_chip_write_registers(struct lsm9ds0_chip *chip, uint64_t *now_ns,
                                 uint8_t address, uint8_t sub, const uint8_t *data,
                                 uint8_t length) {
    if (lsm9ds0_chip_holds_sda(chip, *now_ns)) {
        return -3;
    }
    const bool good = begin_transaction(chip, now_ns, address, false) &&
                      send_bytes(chip, now_ns, &sub, 1) &&
                      send_bytes(chip, now_ns, data, length);
    return end_transaction(chip, now_ns, good);
}

// For tests

uint8_t lsm9ds0_chip_peek_g(const struct lsm9ds0_chip *chip, uint8_t reg) {
    return chip->g.reg[reg & (REG_COUNT - 1)];
}

uint8_t lsm9ds0_chip_peek_xm(const struct lsm9ds0_chip *chip, uint8_t reg) {
    return chip->xm.reg[reg & (REG_COUNT - 1)];
}

uint64_t lsm9ds0_chip_transactions(const struct lsm9ds0_chip *chip) {
    return chip->transactions;
}

uint64_t lsm9ds0_chip_samples(const struct lsm9ds0_chip *chip,
                              enum lsm9ds0_chip_quantity quantity) {
    return chip->sensors[quantity].samples;
}

const char *lsm9ds0_chip_complaint(const struct lsm9ds0_chip *chip) {
    return chip->complaint;
}
