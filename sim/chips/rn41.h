// SPDX-License-Identifier: MIT
// A model of the Roving Networks RN-41, firmware 6.15, as a slave with the serial port
// profile: a UART on one side, a host over the air on the other. The virtual boards and
// the tests use it; it depends on no emulator and no driver.
//
// Documents: UG = "Bluetooth Data Module Command Reference & Advanced Information
// User's Guide", RN-BT-DATA-UG 1.0r; UM = "Advanced User Manual" rn-bluetooth-um 4.77;
// DS = RN41/RN41N data sheet, DS50002280B; BC4 = CSR BlueCore4-External data sheet, the
// chip inside.
//
// Time is an argument, in nanoseconds since power came, and never goes back. The caller
// takes what comes out: bytes whose frame on TX has ended, and bytes that have reached
// the host. It asks for the levels of RTS and PIO2.
//
// - Settings are stored at once and used after a reboot (UG, "Overview").
// - Three configuration characters with no byte within 1 second before or after them
//   start command mode; otherwise they are data (UM, "Action commands").
// - While a host is connected the configuration timer says which side may do so (UG,
//   "Configuration timer settings"): 0 neither; 1 to 252 both, for that many seconds
//   from power-up; 253 the UART's side, 254 the host's, 255 both, for ever. While none
//   is connected the UART's side always may.
// - In command mode nothing passes between the sides (UG, command T: off).
// - 240 kbit/s sustained as a slave (DS, "Features"), in packets of 2.5 ms.
//
// Open points of the documents, and the model's choice:
// - From reset to ready: 1 s (boot_ns); the maker recommends 1 to 2 s. Until then no
//   pin is driven: RTS and PIO2 have the levels of the board's pulls.
// - CMD comes 100 ms after the third character; users' programs find it there.
//   command_ns makes it as late as the rule allows, a second.
// - Answers begin 5 ms after the end of the line, 30 ms where flash was written.
// - A buffer of 2048 bytes to the air and one of 2048 to the UART; RTS rises when the
//   first is three quarters full and falls when it is half empty.
// - Bytes on RX while no host is connected, or while it starts, are lost.
// - A reset pulse: BC4 acts between 1.5 and 4 ms and wants more than 5. The model acts
//   after 4; less than 5 is a complaint.
// - A line feed at the start of a command is passed over; programs end lines with both.
// - The host's own $$$, where the timer lets it in, is a complaint: it would take the
//   module away from the probe.
//
// Not modelled, and a complaint: master modes, sniff and sleep, parity, other profiles,
// commands beyond +, ---, $$$, D, E, O, X, G, K, R, S, U, V. Pairing always succeeds.
#ifndef SIM_CHIPS_RN41_H
#define SIM_CHIPS_RN41_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { RN41_CHIP_FAULTS_MAX = 32, RN41_CHIP_TEXT = 512 };

struct rn41_chip_config {
    uint64_t address;     // 48 bits
    uint64_t boot_ns;     // from reset to ready
    uint64_t command_ns;  // from the third $ to CMD
    uint64_t host_ns;     // from ready until a host connects
};

enum rn41_chip_fault_kind {
    RN41_CHIP_DROP,   // the link is lost; the host is back at once when it is over
    RN41_CHIP_AWAY,   // no host comes; one that is there stays
    RN41_CHIP_DEAF,   // hears nothing on RX, sends nothing on TX
    RN41_CHIP_RESET,  // restarts by itself, once
};

struct rn41_chip_fault {
    enum rn41_chip_fault_kind kind;
    uint64_t from_ns;
    uint64_t for_ns;  // 0: for ever
};

struct rn41_chip_counters {
    uint64_t to_host, from_host;  // bytes that went all the way
    uint64_t lost_to_host;        // not connected, dropped link, no room, starting
    uint64_t lost_from_host;      // the same, and what came while in command mode
    uint64_t commands;            // lines in command mode
    uint64_t writes;              // settings stored
    uint64_t resets;              // starts without the first
    uint64_t links;               // connections
};

struct rn41_chip;

struct rn41_chip_config rn41_chip_defaults(void);
// Power comes at 0 ns, with factory settings.
struct rn41_chip *rn41_chip_new(const struct rn41_chip_config *config);
void rn41_chip_free(struct rn41_chip *chip);
// What survives power, as lines of text of at most RN41_CHIP_TEXT bytes. A load is for
// before the first advance; false where it makes no sense.
bool rn41_chip_load(struct rn41_chip *chip, const char *text);
void rn41_chip_save(const struct rn41_chip *chip, char text[RN41_CHIP_TEXT]);
// False: there are too many.
bool rn41_chip_add_fault(struct rn41_chip *chip, const struct rn41_chip_fault *fault);

// All that happens until that time; when something will next happen by itself.
void rn41_chip_advance(struct rn41_chip *chip, uint64_t now_ns);
uint64_t rn41_chip_next_event(const struct rn41_chip *chip);
void rn41_chip_power_cycle(struct rn41_chip *chip, uint64_t now_ns);

// The UART: a frame on RX has ended that was sent at that rate; the level of CTS; one
// that has ended on TX. Whether one is on its way.
void rn41_chip_receive(struct rn41_chip *chip, uint64_t now_ns, uint8_t byte,
                       uint32_t baud);
void rn41_chip_set_cts(struct rn41_chip *chip, uint64_t now_ns, bool is_high);
bool rn41_chip_take(struct rn41_chip *chip, uint8_t *byte, uint32_t *baud);
bool rn41_chip_is_sending(const struct rn41_chip *chip);
// Pins: -1 where the module does not drive it.
void rn41_chip_set_reset(struct rn41_chip *chip, uint64_t now_ns, bool is_low);
int rn41_chip_rts(const struct rn41_chip *chip);
int rn41_chip_pio2(const struct rn41_chip *chip);

// The host. It can write while rn41_chip_host_room() says so; what it writes with no
// link is lost.
size_t rn41_chip_host_room(const struct rn41_chip *chip);
void rn41_chip_host_write(struct rn41_chip *chip, uint64_t now_ns, uint8_t byte);
bool rn41_chip_host_read(struct rn41_chip *chip, uint8_t *byte);

struct rn41_chip_counters rn41_chip_counters(const struct rn41_chip *chip);
// The first thing that was done to it against its documents; null: nothing.
const char *rn41_chip_complaint(const struct rn41_chip *chip);

#endif
