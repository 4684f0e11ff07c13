// SPDX-License-Identifier: MIT
// A virtual Arduino Nano or Mega: libsimavr's ATmega328P or ATmega2560 with its defects
// corrected, the sensor on I2C and D2, a button on D3, the host on the UART. Time is
// the processor's cycle count at 16 MHz since power came.
//
// Data sheet: ATmega328P, DS40002061B; sections beside the code. What differs on an
// ATmega2560, DS40002211, is in struct machine_kind.
#ifndef SIM_NANO_MACHINE_H
#define SIM_NANO_MACHINE_H

#include <simavr/sim_avr.h>
#include <simavr/sim_io.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "chips/module.h"
#include "run/line.h"

enum {
    MACHINE_CYCLES_PER_US = 16,
    MACHINE_EEPROM_MAX = 4096,
    MACHINE_VECTORS_MAX = 57,
    MACHINE_PAINT = 0xA5,  // fills SRAM at power-up, to find the deepest stack
    // r0 to r31 at power-up, where they hold anything: here, what looks like the causes
    // of a reset.
    MACHINE_REGISTERS = 0x05,
};
#define MACHINE_HZ 16000000U
#define MACHINE_NEVER UINT64_MAX

// What differs between the processors, and between how their boards are wired.
struct machine_kind {
    const char *mcu;     // libsimavr's name
    const char *memory;  // what is wrong with a file that is none of its EEPROM's
    uint32_t flash_size;
    uint32_t boot_start;  // where a reset begins with the fuses of a board as sold
    uint16_t sram_start, sram_end;
    uint16_t eeprom_size;
    uint16_t timer_masks_end;  // TIMSK0 and on, to before this
    uint8_t vectors;
    uint8_t external_interrupts;
    uint8_t watchdog_vector, eeprom_vector;
    // Of an interrupt: bytes of the return address, cycles into a handler, and more of
    // them out of sleep (ATmega328P 7.7.1, ATmega2560 7.8.1).
    uint8_t return_bytes, interrupt_cycles;
    // The port of D2 and D3, bits there, and the external interrupts of these pins.
    uint8_t pin_port;  // its letter
    uint16_t pins;     // PINx; DDRx and PORTx follow
    uint8_t ready_bit, ready_interrupt;
    uint8_t button_bit, button_interrupt;
    // The bus: PINx, and masks of its lines there.
    uint16_t lines;
    uint8_t sda, scl;
};
extern const struct machine_kind machine_atmega328p, machine_atmega2560;

// Data-space addresses, data sheet 30 (register summary), the same in both.
enum machine_register {
    REG_EIFR = 0x3C,
    REG_EIMSK = 0x3D,
    REG_GPIOR0 = 0x3E,
    REG_EECR = 0x3F,
    REG_EEDR = 0x40,
    REG_EEARL = 0x41,
    REG_EEARH = 0x42,
    REG_TCCR0B = 0x45,
    REG_TCNT0 = 0x46,
    REG_GPIOR1 = 0x4A,
    REG_GPIOR2 = 0x4B,
    REG_SMCR = 0x53,
    REG_MCUSR = 0x54,
    REG_WDTCSR = 0x60,
    REG_PCICR = 0x68,
    REG_EICRA = 0x69,
    REG_EICRB = 0x6A,  // of the ATmega2560
    REG_TIMSK0 = 0x6E,
    REG_ADCL = 0x78,
    REG_ADCH = 0x79,
    REG_TCCR1B = 0x81,
    REG_TCNT1L = 0x84,
    REG_TCNT1H = 0x85,
    REG_TCCR2B = 0xB1,
    REG_TCNT2 = 0xB2,
    REG_TWBR = 0xB8,
    REG_TWSR = 0xB9,
    REG_TWAR = 0xBA,
    REG_TWDR = 0xBB,
    REG_TWCR = 0xBC,
    REG_UCSR0A = 0xC0,
    REG_UCSR0B = 0xC1,
    REG_UCSR0C = 0xC2,
    REG_UBRR0L = 0xC4,
    REG_UBRR0H = 0xC5,
    REG_UDR0 = 0xC6,
};

// Reset causes, bits of MCUSR (data sheet 11.9.1).
enum machine_reset {
    MACHINE_POWER_ON = 1 << 0,
    MACHINE_EXTERNAL = 1 << 1,
    MACHINE_BROWN_OUT = 1 << 2,
    MACHINE_WATCHDOG = 1 << 3,
};

// The corrections of libsimavr, in the order of their names for `nano --self-test
// --without NAME`.
enum machine_fix {
    FIX_TWI_BYTE_TIME,
    FIX_TWI_ADDRESS_STATUS,
    FIX_TWI_FLAG,
    FIX_TWI_BUS_HELD,
    FIX_BUS_LINES,
    FIX_INTERRUPT_ENTRY,
    FIX_INTERRUPT_FLAGS,
    FIX_EXTERNAL_FLAG,
    FIX_UART_BYTE_TIME,
    FIX_UART_DOUBLE_BUFFER,
    FIX_UART_BAUD_ORDER,
    FIX_UART_POLLING,
    FIX_SLEEP,
    FIX_EEPROM_TIME,
    FIX_EEPROM_READY,
    FIX_TIMER_PRELOAD,
    FIX_WATCHDOG_RESET,
    FIX_WATCHDOG_MODES,
    FIX_RESET_CAUSE,
    FIX_FLOATING_INPUT,
    FIX_COUNT,
};
extern const char *const machine_fix_names[FIX_COUNT];

// simavr's own handlers of a register that we have taken over.
struct machine_hook {
    avr_io_write_t write;
    void *write_param;
    avr_io_read_t read;
    void *read_param;
};

// Two-wire interface, master only (data sheet 22).
struct machine_twi {
    enum { TWI_IDLE, TWI_START, TWI_STOP, TWI_BYTE } doing;
    bool owns_bus;
    bool is_addressing;  // the next byte is the address
    bool is_reading;
    bool is_lost;  // arbitration lost, or the slave gone: no data until a START
    uint8_t status;
};

// USART0 as an asynchronous UART (data sheet 20).
struct machine_uart {
    bool is_shifting;
    uint8_t shift;
    bool is_full;  // UDR holds a byte that waits for the shift register
    uint8_t buffer;
    uint8_t received[3];  // two of FIFO and the shift register, 20.7.4
    uint8_t received_count;
    uint64_t overruns;  // bytes lost for want of room
    uint64_t deaf;      // bytes that came with the receiver off
    unsigned baud;      // of the last byte that it sent
    struct line line;   // bytes on their way in, times in cycles
    bool is_receiving;
};

struct machine_eeprom {
    uint8_t bytes[MACHINE_EEPROM_MAX];
    bool is_busy;
    uint16_t address;
    uint8_t value;  // what the cell will hold
    uint8_t before;
    uint64_t started, done;  // cycles
    uint64_t writes;
};

struct machine_timer {
    uint16_t control, count, count_high;  // registers; count_high 0 for 8 bits
    uint16_t held;                        // the count while the clock is stopped
    struct machine_hook control_hook, count_hook;
};

struct machine_watchdog {
    avr_io_t io;  // first: simavr knows this address
    struct machine *machine;
    uint64_t started;           // cycle of the last WDR, or when it was switched on
    uint64_t changeable_until;  // cycle
    bool wants_reset;
};

struct machine_stack {
    uint16_t heap_start;  // first byte that is no variable
    uint16_t deepest;     // bytes
};

// Called after each instruction, and for each interrupt once its return address is on
// the stack; byte addresses. Null: not called.
struct machine_watch {
    void *context;
    void (*on_instruction)(void *context, uint32_t at, uint32_t next);
    void (*on_interrupt)(void *context, uint32_t from, uint32_t vector);
};

struct machine {
    const struct machine_kind *kind;
    struct avr_t *avr;
    struct module *module;
    uint32_t without;  // bits of machine_fix: corrections left out
    uint64_t seed;

    // Callbacks of the owner; each may be null. The cycle is the one at which it
    // happened.
    void *context;
    void (*on_byte)(void *context, uint64_t cycle, uint8_t byte);
    void (*on_mark)(void *context, uint64_t cycle, uint8_t value);  // GPIOR0
    void (*on_data_ready)(void *context);                           // edge on D2
    void (*on_bus)(void *context, bool is_start);                   // START, STOP
    void (*on_eeprom_write)(void *context, uint64_t number);
    void (*on_reset)(void *context, enum machine_reset cause);
    struct machine_watch watch;

    uint64_t until;          // where machine_run() stops
    uint32_t boot_start;     // byte address; 0: no bootloader
    uint64_t clock_start;    // cycle of Timer1's first start by the firmware, or
                             // MACHINE_NEVER
    uint64_t clock_restart;  // of its last one
    uint64_t asleep;         // cycles
    uint64_t resets;         // without the first
    bool is_stuck;           // asleep with nothing that could wake it
    const char *complaint;   // the first thing the firmware did against the data sheet

    struct machine_twi twi;
    struct machine_uart uart;
    struct machine_eeprom eeprom;
    struct machine_timer timers[3];
    struct machine_watchdog watchdog;
    struct machine_stack stack;
    avr_int_vector_t *vectors[MACHINE_VECTORS_MAX];
    struct machine_hook line_port, line_ddr, line_pins, pins;
    bool scl_was_high, sda_was_high;
    bool ready_is_high, button_is_down;
    bool is_unwired;  // data-ready has no wire
};

// Makes the machine and switches power on. False where libsimavr has no such processor.
// The module stays the caller's.
bool machine_init(struct machine *machine, const struct machine_kind *kind,
                  struct module *module, uint64_t seed, uint32_t without);
void machine_free(struct machine *machine);
void machine_load(struct machine *machine, const uint8_t *code, size_t size,
                  uint32_t address);
// Has resets start there, as the fuse BOOTRST does, from this one on.
void machine_set_boot_start(struct machine *machine, uint32_t address);

// Runs until the cycle is reached. False once the processor can't go on.
bool machine_run(struct machine *machine, uint64_t until_cycle);
// From a callback: has machine_run() stop at that cycle at the latest.
void machine_pause(struct machine *machine, uint64_t at_cycle);
void machine_reset(struct machine *machine, enum machine_reset cause);

uint64_t machine_now(const struct machine *machine);
uint64_t machine_ns(uint64_t cycle);
// Sends a byte to the UART, not before that cycle. False where memory runs out.
bool machine_send(struct machine *machine, uint64_t from_cycle, uint8_t byte);
void machine_press(struct machine *machine, bool is_down);
// Leaves the EEPROM as a power cut would now.
void machine_cut_eeprom(struct machine *machine);
// Deepest stack so far, bytes.
uint16_t machine_stack_deepest(struct machine *machine);
// Program counter (bytes) and stack pointer, for a report.
uint32_t machine_pc(const struct machine *machine);
uint16_t machine_sp(const struct machine *machine);

// Between the files of the machine.
bool machine_fixes(const struct machine *machine, enum machine_fix fix);
void machine_complain(struct machine *machine, const char *what);
// Something that may cause an interrupt has changed.
void machine_poll_interrupts(struct machine *machine);
// The processor stands still for some cycles.
void machine_stall(struct machine *machine, unsigned cycles);
// The module may have changed: follows its pin and schedules its next event.
void machine_follow_module(struct machine *machine);
void machine_take(struct machine *machine, uint16_t address, avr_io_write_t write,
                  avr_io_read_t read, struct machine_hook *hook);
uint32_t machine_random(struct machine *machine);

void interrupts_init(struct machine *machine);
// Wakes a sleeping processor, and enters the handler that is due.
void interrupts_serve(struct machine *machine);
void timers_init(struct machine *machine);
void timers_reset(struct machine *machine);
void twi_init(struct machine *machine);
void twi_reset(struct machine *machine);
void lines_init(struct machine *machine);
void lines_reset(struct machine *machine);
void uart_init(struct machine *machine);
void uart_reset(struct machine *machine);
void uart_free(struct machine *machine);
void eeprom_init(struct machine *machine);
void eeprom_reset(struct machine *machine);
void watchdog_init(struct machine *machine);
// After the reset flags are set.
void watchdog_reset(struct machine *machine);
// The handler of that vector is entered.
void watchdog_served(struct machine *machine, int vector);

#endif
