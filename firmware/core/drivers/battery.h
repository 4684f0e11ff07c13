// SPDX-License-Identifier: MIT
// A Li-ion cell and its charger, a BQ24072: smooths and debounces their pins.
#ifndef BATTERY_H
#define BATTERY_H

#include <stdbool.h>
#include <stdint.h>

enum {
    BATTERY_UNKNOWN = 65535,  // nothing is connected; null in the message
    // At 3.3 V a Li-ion cell is nearly empty: its protection disconnects it at 2.4 to
    // 3.0 V, and a 3.3 V regulator already drops with it. Without load it does not
    // recover to 3.5 V.
    BATTERY_LOW_MV = 3300,
    BATTERY_GOOD_MV = 3500,
    // Limits of a plausible cell: below, it could not power the probe; above, it was
    // not charged by this charger, which stops at 4.2 V.
    BATTERY_MIN_MV = 2000,
    BATTERY_MAX_MV = 4600,
    BATTERY_PERIOD_MS = 100,  // between readings
};

struct battery_reading {
    uint16_t mv;         // BATTERY_UNKNOWN: an open pin
    bool has_supply;     // PGOOD: the charger's input is good
    bool is_charge_low;  // CHG
};

// Initialised by battery_init(). Others may read the first two lines.
struct battery {
    uint16_t mv;  // smoothed, or BATTERY_UNKNOWN
    bool is_external, is_charging, is_low;
    uint8_t supply_for;  // readings that PGOOD has differed from is_external
    uint8_t charge_for;  // readings that CHG has been low
    uint8_t low_for;     // readings that the battery has been low
    uint32_t mean;       // 1/16 mV
};

void battery_init(struct battery *battery);

// Takes one reading every BATTERY_PERIOD_MS. Returns true once when the battery becomes
// low: below BATTERY_LOW_MV for 10 s without external supply, so a short dip under load
// does not count. It is no longer low with external supply or above BATTERY_GOOD_MV.
bool battery_step(struct battery *battery, const struct battery_reading *reading);

// Returns the flags `power` of the protocol.
uint8_t battery_power(const struct battery *battery);

#endif
