// SPDX-License-Identifier: MIT
// The RN-41, a Bluetooth module that appears to a host as a serial port. The driver
// detects the module, corrects its settings, and reports whether a host is connected.
//
// Comments name sections of "Bluetooth Data Module Command Reference & Advanced
// Information User's Guide" (RN-BT-DATA-UG), the guide, and of the module's data sheet.
#ifndef RN41_H
#define RN41_H

#include <stdbool.h>
#include <stdint.h>

enum {
    RN41_BAUD = 921600,          // the probe's
    RN41_FACTORY_BAUD = 115200,  // of a new module
    RN41_NAME_SIZE = 21,         // 20 characters at most, and an end
};

// PIO2 shows that a module is there: the module drives it low while no host is
// connected; without a module the pin's pull-up reads high.
enum rn41_state {
    RN41_LOOKING = 0,  // just after a reset: sending must wait
    RN41_CABLE,        // no module was detected: the wire leads to a host
    RN41_CONFIGURING,  // the driver uses the wire
    RN41_WAITING,      // configured; no host is connected
    RN41_CONNECTED,    // the wire leads to a host
    RN41_FAILED,       // it tries again after half a minute
};

enum rn41_event {
    RN41_NOTHING = 0,
    RN41_LINKED,   // a host has connected
    RN41_DROPPED,  // the host has disconnected
    RN41_FAULT,    // reported once until it works again; see `fault`
};

enum rn41_fault {
    RN41_NO_FAULT = 0,
    RN41_SILENT,   // it does not enter, or does not leave, command mode
    RN41_GARBLED,  // it reports impossible settings
    RN41_REFUSED,  // it did not accept, or did not keep, a setting
};

// The functions of the board. None of them waits.
struct rn41_port {
    void (*send)(const char *bytes, uint8_t length);
    int16_t (*receive)(void);         // the next byte, or -1
    void (*set_baud)(uint32_t baud);  // also discards unsent bytes
    bool (*is_linked)(void);          // PIO2 is high
    void (*hold_reset)(bool is_held);
};

// Starts with zeros. Others may read `state`, `fault` and `resets`.
struct rn41 {
    const struct rn41_port *port;
    enum rn41_state state;
    enum rn41_fault fault;  // of the last attempt that failed
    uint16_t resets;        // to recover the module, without the one at start
    uint8_t phase;
    uint8_t tries;        // to enter command mode, within the attempt
    uint8_t attempts;     // failed ones in a row
    uint8_t early_peers;  // hosts that connected before it was configured
    uint8_t rewrites;     // how often settings may still be written
    uint8_t known;        // settings that were read
    uint8_t wrong;        // those that differ
    uint8_t answer;       // to the command in progress
    bool is_corrected;    // in this attempt
    bool is_verified;     // its settings are right
    bool is_fresh;        // nothing has been sent since it started
    bool is_linked;       // as last seen, since linked_us
    uint32_t linked_us;
    uint32_t since_us;  // start of the phase
    uint32_t heard_us;  // last byte received
    uint8_t length;
    char line[32];  // its start; a setting of ours is 27 characters at most
    char name[RN41_NAME_SIZE];
};

// The name in a host's list: "imu-probe-" and the end of the probe's id.
void rn41_name(char name[RN41_NAME_SIZE], const uint8_t id[8]);

// Holds the module in reset. The name is copied.
void rn41_begin(struct rn41 *rn41, const struct rn41_port *port, const char *name,
                uint32_t now_us);

// Call it at least every 10 ms; calling it less often only slows it down. It configures
// a started module in 0.5 to 1.4 s, and a new one in 5 s plus two starts of about 1 s.
//
// It sets: the name; 921,600 baud; slave; and a configuration timer of 0. With that,
// $$$ is ordinary data while a host is connected (the guide, "Configuration Timer
// Settings"), and nothing is sent while none is. It does not change authentication: the
// factory's setting is 1, where the host shows a code that the module accepts. A
// setting is written only if it differs, and at most four times until power is lost.
//
// If a host connects before the settings are known, a reset disconnects it, up to three
// times. After that the host is served, because the settings are probably right, and
// they are checked once it has disconnected.
//
// In the states RN41_CONFIGURING and RN41_FAILED the driver reads all received bytes,
// and nobody else may. In the other states it reads none.
enum rn41_event rn41_step(struct rn41 *rn41, uint32_t now_us);

// True if bytes that are sent reach a host.
bool rn41_carries(const struct rn41 *rn41);

#endif
