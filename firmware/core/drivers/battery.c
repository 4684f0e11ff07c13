// SPDX-License-Identifier: MIT
// Levels and readings to claims; see battery.h.
#include "core/drivers/battery.h"

#include "core/wire/messages.h"

enum {
    // Readings.
    SUPPLY_STEADY = 3,  // while a plug goes in
    // CHG is low while the battery is charged ("Status Indicators (PGOOD, CHG)"), and
    // blinks twice a second where that has taken too long ("Dynamic Charge Timers"): no
    // second of it is low throughout.
    CHARGE_STEADY = 10,
    LOW_STEADY = 100,
    WEIGHT = 16,  // of the mean: 1.6 s
};

void battery_init(struct battery *battery) {
    *battery = (struct battery){.mv = BATTERY_UNKNOWN};
}

static void take_pins(struct battery *battery, const struct battery_reading *reading) {
    if (reading->has_supply == battery->is_external) {
        battery->supply_for = 0;
    } else if (++battery->supply_for == SUPPLY_STEADY) {
        battery->is_external = reading->has_supply;
        battery->supply_for = 0;
    }
    if (!reading->is_charge_low) {
        battery->charge_for = 0;
    } else if (battery->charge_for < CHARGE_STEADY) {
        battery->charge_for++;
    }
    battery->is_charging = battery->is_external && battery->charge_for == CHARGE_STEADY;
}

static void take_voltage(struct battery *battery, uint16_t mv) {
    if (mv < BATTERY_MIN_MV || mv > BATTERY_MAX_MV) {
        battery->mv = BATTERY_UNKNOWN;
        return;
    }
    if (battery->mv == BATTERY_UNKNOWN) {
        battery->mean = (uint32_t)mv * WEIGHT;
    } else {
        // Rounding down leaves it at 16 * mv + 15 at most.
        battery->mean = battery->mean - battery->mean / WEIGHT + mv;
    }
    battery->mv = (uint16_t)((battery->mean + WEIGHT / 2) / WEIGHT);
}

bool battery_step(struct battery *battery, const struct battery_reading *reading) {
    take_pins(battery, reading);
    take_voltage(battery, reading->mv);
    if (battery->is_external || battery->mv == BATTERY_UNKNOWN ||
        battery->mv > BATTERY_GOOD_MV) {
        battery->is_low = false;
    }
    if (battery->is_external || battery->mv >= BATTERY_LOW_MV || battery->is_low) {
        battery->low_for = 0;
        return false;
    }
    battery->low_for++;
    battery->is_low = battery->low_for == LOW_STEADY;
    return battery->is_low;
}

uint8_t battery_power(const struct battery *battery) {
    return (uint8_t)((battery->is_external ? POWER_EXTERNAL : 0u) |
                     (battery->is_charging ? POWER_CHARGING : 0u) |
                     (battery->is_low ? POWER_LOW : 0u));
}
