// SPDX-License-Identifier: MIT
// The RN-41, a Bluetooth module that a host sees as a serial port: is one there, are
// its settings as they should be, is somebody connected.
//
// Comments name sections of "Bluetooth Data Module Command Reference & Advanced
// Information User's Guide" (RN-BT-DATA-UG), the guide, and of the module's data sheet.
#ifndef RN41_H
#define RN41_H

#include <stdbool.h>
#include <stdint.h>

enum {
    RN41_BAUD = 921600,          // as the probe has it
    RN41_FACTORY_BAUD = 115200,  // as modules come
    RN41_NAME_SIZE = 21,         // 20 characters at most, and an end
};

// A module is there once PIO2 has been low: it is driven low while nobody is connected,
// and an input with a pull-up reads high where no module is wired.
enum rn41_state {
    RN41_LOOKING = 0,  // the first moment after a reset: what is to be sent must wait
    RN41_CABLE,        // no module has shown itself: the wire is the host's
    RN41_CONFIGURING,  // the wire is the driver's
    RN41_WAITING,      // set up; data has nowhere to go
    RN41_CONNECTED,    // the wire is the host's
    RN41_FAILED,       // given up for half a minute, then once more
};

enum rn41_event {
    RN41_NOTHING = 0,
    RN41_LINKED,   // somebody has connected
    RN41_DROPPED,  // and is gone
    RN41_FAULT,    // told once, until it works again: see `fault`
};

enum rn41_fault {
    RN41_NO_FAULT = 0,
    RN41_SILENT,   // no command mode at either rate, or no end of it
    RN41_GARBLED,  // the settings it tells make no sense
    RN41_REFUSED,  // a setting was not taken, or not kept
};

// What the driver asks of a board. None of them waits.
struct rn41_port {
    void (*send)(const char *bytes, uint8_t length);
    int16_t (*receive)(void);         // the next byte, or -1
    void (*set_baud)(uint32_t baud);  // and forgets what has not been sent
    bool (*is_linked)(void);          // PIO2 is high
    void (*hold_reset)(bool is_held);
};

// Starts with zeros. `state`, `fault` and `resets` are for all to read.
struct rn41 {
    const struct rn41_port *port;
    enum rn41_state state;
    enum rn41_fault fault;  // of the last attempt that failed
    uint16_t resets;        // to bring it back; the one at start does not count
    uint8_t phase;
    uint8_t tries;      // to enter command mode, within the attempt
    uint8_t attempts;   // failed ones in a row
    uint8_t intruders;  // who connected while it was not set up
    uint8_t rewrites;   // left until nothing is written any more
    uint8_t known;      // settings told
    uint8_t wrong;      // those that differ
    uint8_t answer;     // to the command under way
    bool is_corrected;  // in this attempt
    bool is_verified;   // its settings are right
    bool is_fresh;      // nothing has been sent since it started
    bool is_linked;     // as last seen, since linked_us
    uint32_t linked_us;
    uint32_t since_us;  // start of the phase
    uint32_t heard_us;  // last byte received
    uint8_t length;
    char line[32];  // its start; a setting of ours is 27 characters at most
    char name[RN41_NAME_SIZE];
};

// The name that a host's list shows: "imu-probe-" and the end of the probe's id.
void rn41_name(char name[RN41_NAME_SIZE], const uint8_t id[8]);

// Holds the module in reset. The name is copied.
void rn41_begin(struct rn41 *rn41, const struct rn41_port *port, const char *name,
                uint32_t now_us);

// Call it every 10 ms or oftener; rarer only makes it slower. A module that has started
// is set up in 0.5 to 1.4 s, one from the factory in 5 s and two starts of a second or
// so.
//
// What it sees to: the name; 921,600 baud; slave; a configuration timer of 0, with
// which $$$ from either side is data as long as somebody is connected (the guide,
// "Configuration Timer Settings"), and while nobody is nothing is sent. Authentication
// stays as it is: from the factory 1, where the host shows a code and the module takes
// it. A setting is written where it differs, four times at most until power goes.
//
// Who connects before the settings are known is sent away by a reset, three times; then
// he is served, as most likely they are right, and they are looked at when he has gone.
//
// While the state is RN41_CONFIGURING or RN41_FAILED the driver takes all that is
// received: nobody else may. It touches nothing that is received in the other states.
enum rn41_event rn41_step(struct rn41 *rn41, uint32_t now_us);

// What is sent reaches a host.
bool rn41_carries(const struct rn41 *rn41);

#endif
