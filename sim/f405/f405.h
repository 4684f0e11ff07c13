// SPDX-License-Identifier: MIT
// A virtual STM32F405RG as on a pyboard v1.1: rare instructions in libunicorn,
// everything else here. The sensor is on I2C1 (PB6, PB7), PB0 and PB1, the button on
// PB3, the host on USART2 (PA2, PA3), a card on SPI1 (PA4 to PA7); PC6 is high during
// the work on a sample. A radio, if there is one, is between USART2 and the host: its
// RTS on PA0, its CTS on PA1, PIO2 on PB12, its reset on PB13. With a battery, half of
// its voltage is on PC0 and the charger's PGOOD and CHG are on PC1 and PC2.
//
// Documents: RM = RM0090 (reference manual), PM = PM0214 (programming manual), ARM =
// ARMv7-M architecture reference manual DDI 0403E, DS = STM32F405xx data sheet
// DocID022152. Sections are cited by their titles, which all editions share.
//
// Time is in picoseconds since power came. An instruction takes one cycle of the clock
// that the RCC sets. Waits for flash and the bus and the entry into exceptions take no
// time, so cycle counts are a lower bound. An interrupt that becomes due during one
// instruction is taken before the next one.
//
// A peripheral that is not in the table of bus.c is not modelled: an access to it ends
// the run.
#ifndef SIM_F405_F405_H
#define SIM_F405_F405_H

#include <stdbool.h>
#include <stdint.h>
#include <unicorn/unicorn.h>

#include "bus.h"
#include "f405/core/core.h"
#include "f405/core/registers.h"
#include "f405/core/thumb.h"
#include "f405/peripherals/adc.h"
#include "f405/peripherals/dma.h"
#include "f405/peripherals/flash.h"
#include "f405/peripherals/i2c.h"
#include "f405/peripherals/iwdg.h"
#include "f405/peripherals/pins.h"
#include "f405/peripherals/rcc.h"
#include "f405/peripherals/spi.h"
#include "f405/peripherals/timer.h"
#include "f405/peripherals/timer11.h"
#include "f405/peripherals/usart.h"
#include "f405/peripherals/wired.h"
#include "map.h"
#include "timing.h"

struct sensor_chip;
struct sdcard_chip;
struct rn41_chip;

// Called after each instruction, on the way into an exception and out of it; byte
// addresses. All null: not called.
struct f405_watch {
    void *context;
    void (*on_instruction)(void *context, uint32_t at, uint32_t next);
    void (*on_enter)(void *context, uint32_t from, uint32_t handler);
    void (*on_leave)(void *context);
};

struct f405_stack {
    uint32_t top, lowest;  // addresses: the first above it; the lowest that it may use
    uint32_t deepest;      // bytes
};

struct f405 {
    uc_engine *uc;
    uint8_t *flash, *ram, *ccm, *system;
    struct sensor_chip *sensor;
    struct sdcard_chip *card;  // null: none in the socket
    struct rn41_chip *radio;   // null: the wire itself
    uint64_t seed;

    // Callbacks of the owner; each may be null.
    void *context;
    void (*on_byte)(void *context, uint8_t byte);
    void (*on_mark)(void *context, bool is_begin);  // PC6
    void (*on_data_ready)(void *context);           // PB0 rises
    void (*on_bus)(void *context, bool is_start);   // I2C1: START; all is through
    void (*on_flash_write)(void *context, uint64_t number);
    void (*on_reset)(void *context);

    struct f405_watch watch;

    // Time. Cycles are those of the core's clock, asleep or not, at whatever rate.
    uint64_t cycle, base_cycle, base_ps;
    uint32_t hclk_hz;                          // 0: the clock has stopped
    uint32_t pclk_hz[2], timer_hz, timer2_hz;  // timers of APB1, of APB2
    uint32_t crystal_hz, hsi_hz;               // may be changed before power comes
    uint64_t until, next_ps, limit_cycle;
    uint64_t when;  // of the event being served; NEVER: none is
    uint64_t at[EVENTS];
    uint64_t clock_start;  // first start of TIM2 or TIM5, or NEVER
    uint64_t asleep;       // ps
    uint64_t asleep_cycles;
    uint64_t stopped;  // ps of it in STOP mode
    uint64_t resets;

    // The core, between two instructions.
    uint32_t pc;
    struct f405_registers registers;
    struct f405_registers lent;  // as libunicorn last had them
    bool is_lent;                // libunicorn is executing with its own registers
    bool has_stepped;            // libunicorn has begun the one instruction
    unsigned attention;          // instructions until the core must stop; 0: no request
    bool is_stopped, is_in_code, is_pumping;
    bool is_blocked;  // an exception waits until a mask is cleared
    bool is_asleep, is_locked_up;
    bool is_waiting;  // a WFE is under way, or it sleeps by one
    bool is_deep;     // asleep with SLEEPDEEP
    int trap;         // libunicorn's number of an exception, -1: none
    enum { FAULT_NONE, FAULT_LOAD, FAULT_STORE, FAULT_NO_FPU, FAULT_DIVISION } fault;
    uint32_t fault_address, fault_pc;
    uint32_t wants_reset;  // enum f405_reset

    const char *ended;  // why the run is over
    char ended_text[160];
    const char *complaint;  // the firmware's first violation of the manuals

    struct f405_core core;
    struct f405_rcc rcc;
    struct f405_flash flash_control;
    struct f405_port ports[PORTS];
    bool is_button_down;
    struct f405_exti exti;
    struct f405_timer timers[TIMERS];
    struct f405_timer11 timer11;
    struct f405_dma dma[2];
    struct f405_i2c i2c;
    struct f405_usart usart;
    struct f405_spi spi;
    struct f405_adc adc;
    struct f405_iwdg iwdg;
    struct f405_wired wired;
    struct f405_stack stack;
};

// Makes the machine, without power, its flash erased. False where libunicorn has no
// such processor. The sensor stays the caller's, as do a card and a radio that it may
// add.
bool f405_init(struct f405 *m, struct sensor_chip *sensor, uint64_t seed);
// Flashes an ELF file for the STM32F405. Sectors that it does not touch stay as they
// are. False where it is no such image. Sizes in bytes: *flash for code and initial
// values, *ram for variables.
bool f405_load(struct f405 *m, const char *path, uint32_t *flash, uint32_t *ram);
void f405_free(struct f405 *m);
// Switches power on; the core starts from the vector table in flash.
void f405_power_up(struct f405 *m);

// Runs until that time. False once it can't continue: m->ended says why.
bool f405_run(struct f405 *m, uint64_t until_ps);
// From a callback: has f405_run() stop at that time at the latest.
void f405_pause(struct f405 *m, uint64_t at_ps);
void f405_reset(struct f405 *m, uint32_t cause);
// Time in STOP mode so far, ps.
uint64_t f405_stopped(const struct f405 *m);
// Sends a byte to the USART, not before that time. False where memory runs out.
bool f405_send(struct f405 *m, uint64_t from_ps, uint8_t byte);
void f405_press(struct f405 *m, bool is_down);
// Connects a cell to the board's divider. Its voltage changes in a straight line from
// now on, then stays.
void f405_battery(struct f405 *m, uint32_t from_mv, uint32_t to_mv, uint64_t for_ps);
void f405_charger(struct f405 *m, bool is_external, bool is_charging);
// The crystal dies. SDA is pulled low for a moment during the byte under way. I2C1
// reports a bus error that did not happen.
void f405_kill_crystal(struct f405 *m);
void f405_glitch(struct f405 *m);
void f405_spurious_berr(struct f405 *m);
// Leaves flash as a power cut would now.
void f405_cut_flash(struct f405 *m);
// Deepest stack so far, bytes.
uint32_t f405_stack_deepest(struct f405 *m);

// Between the parts of the machine: keeps the firmware's first violation of the
// manuals; ends the run with a reason; noise that is the same for the same seed.
void f405_complain(struct f405 *m, const char *what);
void f405_end(struct f405 *m, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
void f405_not_modelled(struct f405 *m, const char *what);
uint32_t f405_random(struct f405 *m);

#endif
