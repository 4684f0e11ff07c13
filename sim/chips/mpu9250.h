// SPDX-License-Identifier: MIT
// An MPU-9250 (with its AK8963) as its documents describe it, byte by byte on I2C. It
// serves the virtual boards and the driver's tests; it knows no emulator and no driver.
//
// Documents: RM = RM-MPU-9250A-00 rev 1.6 (register map), PS = PS-MPU-9250A-01 rev 1.0
// (product specification), ST = AN-MPU-9250A-03 (self-test), AK = AK8963 data sheet
// MS1356-E-02.
//
// Time is an argument, in nanoseconds since power came, and never goes back. Motion is
// asked for, in the frame of the accelerometer and gyroscope (PS 9.1: x right, y up the
// page, z out of the package), right-handed, SI units; the AK8963's own axes (PS 9.1:
// x = our y, y = our x, z = our -z) are the model's business.
//
// Not modelled: FIFO, DMP, wake on motion, low-power cycling, FSYNC, SPI. Writing to
// their registers is a complaint (mpu9250_chip_complaint).
#ifndef SIM_CHIPS_MPU9250_H
#define SIM_CHIPS_MPU9250_H

#include <stdbool.h>
#include <stdint.h>

enum mpu9250_chip_quantity {
    MPU9250_CHIP_GYR,  // rad/s
    MPU9250_CHIP_ACC,  // m/s2, specific force: +g on z when lying level
    MPU9250_CHIP_MAG,  // uT
};

// Writes the mean of the quantity over (from_ns, to_ns] to mean; where both are equal,
// its value then. from_ns may be negative.
typedef void (*mpu9250_chip_motion)(void *context, enum mpu9250_chip_quantity quantity,
                                    int64_t from_ns, int64_t to_ns, double mean[3]);

struct mpu9250_chip_config {
    mpu9250_chip_motion motion;  // null: what mpu9250_chip_hold() said
    void *context;
    bool is_recorded;       // the motion has been through a sensor's low-pass already
    double rate_error_ppm;  // of the sample clock; positive is fast
    double mag_rate_error_ppm;  // of the AK8963's own clock
    double temperature_c;
    uint64_t startup_ns;       // from power-up or H_RESET until registers answer
    uint8_t who_am_i;          // 0x71; 0x70 is an MPU-6500
    bool has_ak8963;           // false is an MPU-6500
    bool ad0;                  // level of the pin: address 0x68 or 0x69
    uint8_t mag_adjust[3];     // ASAX, ASAY, ASAZ
    uint8_t gyr_self_test[3];  // factory codes, registers 0 to 2
    uint8_t acc_self_test[3];  // factory codes, registers 13 to 15
};

enum mpu9250_chip_fault_kind {
    MPU9250_CHIP_NACK,            // refuses a byte; at_byte says which
    MPU9250_CHIP_STUCK_SDA,       // holds SDA low, until `clocks` SCL pulses or the end
    MPU9250_CHIP_NO_DATA_READY,   // takes no samples, gives no interrupts
    MPU9250_CHIP_WRONG_WHO_AM_I,  // answers `value`
    MPU9250_CHIP_NO_AK8963,       // nobody at 0x0C, on either bus
    MPU9250_CHIP_GYR_SELF_TEST,   // a tenth of the gyroscope's self-test response
    MPU9250_CHIP_ACC_SELF_TEST,   // a tenth of the accelerometer's
    MPU9250_CHIP_FROZEN,          // data ready goes on, the numbers stand still
};

// In force for a span of time, or, where transactions is not 0, for that many
// transactions of the host from number `first` on (the first after power-up is 1; from
// START to STOP is one, whoever is addressed).
struct mpu9250_chip_fault {
    enum mpu9250_chip_fault_kind kind;
    uint64_t from_ns;
    uint64_t for_ns;  // 0: for ever (STUCK_SDA with clocks: until clocked out)
    uint64_t first;
    uint64_t transactions;
    uint8_t
        at_byte;  // NACK, STUCK_SDA: of the transaction; 0 the address, 1 the register
    uint8_t clocks;  // STUCK_SDA: SCL pulses that free the line, 0: none do
    uint8_t value;   // WRONG_WHO_AM_I
};

enum { MPU9250_CHIP_FAULTS_MAX = 32 };

struct mpu9250_chip;

// A plain MPU-9250: no rate error, 25 degC, 100 ms start-up (PS 3.4.2, the maximum),
// ASA 176 178 166, self-test codes that a real part could have.
struct mpu9250_chip_config mpu9250_chip_defaults(void);

// A chip whose power comes at time 0. Null where memory is out.
struct mpu9250_chip *mpu9250_chip_new(const struct mpu9250_chip_config *config);
void mpu9250_chip_free(struct mpu9250_chip *chip);
// Power goes and comes back at now_ns; faults stay.
void mpu9250_chip_power_cycle(struct mpu9250_chip *chip, uint64_t now_ns);

// The motion from now on where the configuration has no function. Before the first
// call: lying still, level, in a field of (0, 20, -40) uT.
void mpu9250_chip_hold(struct mpu9250_chip *chip, const double gyr_rad_s[3],
                       const double acc_m_s2[3], const double mag_ut[3]);
void mpu9250_chip_set_temperature(struct mpu9250_chip *chip, double temperature_c);

// False where there is no room for another fault.
bool mpu9250_chip_add_fault(struct mpu9250_chip *chip,
                            const struct mpu9250_chip_fault *fault);
void mpu9250_chip_clear_faults(struct mpu9250_chip *chip);

// Lets time pass; every other function with a time does so first.
void mpu9250_chip_advance(struct mpu9250_chip *chip, uint64_t now_ns);
// When something next happens by itself; UINT64_MAX where nothing will.
uint64_t mpu9250_chip_next_event(const struct mpu9250_chip *chip);
// The INT pin (an open-drain one has its pull-up).
bool mpu9250_chip_int_is_high(const struct mpu9250_chip *chip);
// True while the chip holds SDA low: then no START and no STOP can be made.
bool mpu9250_chip_holds_sda(struct mpu9250_chip *chip, uint64_t now_ns);

// The wire, from the host's side. start() is also a repeated START; it and write() are
// true for ACK. read() is told whether the host acknowledges the byte.
bool mpu9250_chip_start(struct mpu9250_chip *chip, uint64_t now_ns, uint8_t address,
                        bool is_read);
bool mpu9250_chip_write(struct mpu9250_chip *chip, uint64_t now_ns, uint8_t byte);
uint8_t mpu9250_chip_read(struct mpu9250_chip *chip, uint64_t now_ns, bool ack);
void mpu9250_chip_stop(struct mpu9250_chip *chip, uint64_t now_ns);
// One pulse on SCL from a host that works the pins by hand.
void mpu9250_chip_scl_pulse(struct mpu9250_chip *chip, uint64_t now_ns);

// A whole transaction from *now_ns on at 400 kHz; moves *now_ns to its end. 0: done,
// -1: refused (NACK), -3: SDA is held low. After -1 the STOP has been made.
int mpu9250_chip_read_registers(struct mpu9250_chip *chip, uint64_t *now_ns,
                                uint8_t address, uint8_t reg, uint8_t *data,
                                uint8_t length);
int mpu9250_chip_write_registers(struct mpu9250_chip *chip, uint64_t *now_ns,
                                 uint8_t address, uint8_t reg, const uint8_t *data,
                                 uint8_t length);

// For tests: a register with no side effects, transactions so far, samples taken so
// far, and the first thing the host did against the documents (null: nothing).
uint8_t mpu9250_chip_peek(const struct mpu9250_chip *chip, uint8_t reg);
uint8_t mpu9250_chip_peek_ak8963(const struct mpu9250_chip *chip, uint8_t reg);
uint64_t mpu9250_chip_transactions(const struct mpu9250_chip *chip);
uint64_t mpu9250_chip_samples(const struct mpu9250_chip *chip);
const char *mpu9250_chip_complaint(const struct mpu9250_chip *chip);

#endif
