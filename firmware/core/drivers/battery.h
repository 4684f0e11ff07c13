// SPDX-License-Identifier: MIT
// A Li-ion cell and its charger, a BQ24072: what their pins say, made steady.
#ifndef BATTERY_H
#define BATTERY_H

#include <stdbool.h>
#include <stdint.h>

enum {
    BATTERY_UNKNOWN = 65535,  // nothing is wired; null in the message
    // A Li-ion cell is near its end at 3.3 V: soon its protection cuts it off, at 2.4
    // to 3.0 V, and a regulator to 3.3 V already follows it down. Relieved of its load
    // it does not get back to 3.5 V by itself.
    BATTERY_LOW_MV = 3300,
    BATTERY_GOOD_MV = 3500,
    // What a divider by two can bring from a cell: below, it is not one that feeds the
    // probe; above, not one that the charger has charged, to 4.2 V.
    BATTERY_MIN_MV = 2000,
    BATTERY_MAX_MV = 4600,
    BATTERY_PERIOD_MS = 100,  // of the readings
};

struct battery_reading {
    uint16_t mv;         // BATTERY_UNKNOWN: an open pin
    bool has_supply;     // PGOOD: the charger's input is good
    bool is_charge_low;  // CHG
};

// Starts with zeros, mv with BATTERY_UNKNOWN. The first line is for all to read.
struct battery {
    uint16_t mv;  // smoothed, BATTERY_UNKNOWN
    bool is_external, is_charging, is_low;
    uint8_t supply_for;  // readings that PGOOD has differed from is_external
    uint8_t charge_for;  // readings that CHG has been low
    uint8_t low_for;     // readings that the battery has been low
    uint32_t mean;       // 1/16 mV
};

void battery_init(struct battery *battery);

// Takes a reading, one each BATTERY_PERIOD_MS. Returns true once where the battery has
// got low: below BATTERY_LOW_MV for 10 s with nothing at the charger's input, so that a
// dip under load is none. It recovers with external power or above BATTERY_GOOD_MV.
bool battery_step(struct battery *battery, const struct battery_reading *reading);

// Flags `power` of the protocol.
uint8_t battery_power(const struct battery *battery);

#endif
