// SPDX-License-Identifier: MIT
// The interface of a board for main.c. Chosen at link time by the folder that is
// compiled. Every function but board_init returns within 5 ms; none is called from an
// interrupt.
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "core/drivers/bus.h"
#include "core/drivers/sensor.h"
#include "core/probe/acquisition.h"
#include "core/probe/probe.h"
#include "core/storage/memory.h"

// Clocks, pins, interrupts. The device clock runs from reset.
void board_init(void);

// Device time, microseconds since reset, wraps after 71.6 min.
uint32_t board_time_us(void);

// Identity of this board: enum board of the protocol, its reset cause (flags
// reset_cause), and processor cycles a microsecond.
uint8_t board_kind(void);
uint8_t board_reset_cause(void);
// Where the program was when it came to grief before this start, or 0.
uint32_t board_reset_address(void);
uint8_t board_cycles_per_us(void);

// Fills an id that the silicon is born with and returns true, or returns false.
bool board_unique_id(uint8_t id[8]);
// Some unpredictable bits, for an id where the silicon has none.
uint16_t board_entropy(void);

// The sensor of this board (the first that is tried), and its bus for set-up (not while
// sampling).
extern const IN_FLASH struct sensor_driver board_sensor;
extern const IN_FLASH struct bus_device board_bus;
// Frees a held bus by clocking it, then a STOP. BUS_OK when both lines are high.
enum bus_result board_bus_recover(void) MUST_CHECK;

// From now on each data-ready edge stamps the time and starts the bursts, `count` of
// them in turn, by interrupt. They are copied. Some sensors hold data-ready until they
// are read: there a line that is high while no burst is due starts one as its edge
// would, or no edge would ever come again.
void board_sampling_start(const struct bus_burst *bursts, uint8_t count);
void board_sampling_stop(void);
enum reading_result board_reading_take(struct reading *out) MUST_CHECK;
// Data-ready edges seen since reset.
uint32_t board_samples_ready(void);

// The wire. Sends all `length` bytes or, where there is no room, none.
bool board_send(const uint8_t *bytes, uint8_t length) MUST_CHECK;
// True when everything handed over has left.
bool board_send_is_idle(void);
// The next received byte, or -1.
int16_t board_receive(void);
// Received bytes lost for want of room since reset.
uint16_t board_receive_lost(void);

bool board_button_is_down(void);
void board_led_set(bool on);

// Memory that survives without power; see core/storage/memory.h.
extern const IN_FLASH struct memory board_memory;

// Supply in mV, 0 where it can't be known. Bytes of stack never used yet.
uint16_t board_supply_mv(void);
uint16_t board_stack_free(void);

// Equipment other than sensor, wire and button: clock, radio, card, battery.
// Nothing in a build with PROBE_WIRE_ONLY. `begin` says so to the probe, after
// probe_begin; `step` is for each turn of the main loop.
#ifdef PROBE_WIRE_ONLY
static inline void board_equipment_begin(struct probe *probe) {
    (void)probe;
}
static inline void board_equipment_step(struct probe *probe, uint32_t now_us) {
    (void)probe;
    (void)now_us;
}
static inline bool board_equipment_is_done(void) {
    return true;
}
#else
void board_equipment_begin(struct probe *probe);
void board_equipment_step(struct probe *probe, uint32_t now_us);
// Nothing is left to be written: power may fail. After wants_reset it becomes
// true automatically.
bool board_equipment_is_done(void);
#endif

void board_watchdog_kick(void);
// Sleeps until an interrupt, unless one has brought work since the last call.
void board_idle(void);
// The same for 1 ms at most, or not at all.
void board_pause(void);
// Restarts at once, as software reset.
_Noreturn void board_reset(void);

#endif
