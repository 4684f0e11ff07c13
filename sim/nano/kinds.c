// SPDX-License-Identifier: MIT
// The processors, and how their boards are wired; see machine.h.
#include "machine.h"

const struct machine_kind machine_atmega328p = {
    .mcu = "atmega328p",
    .memory = "is no EEPROM of 1024 bytes",
    .flash_size = 0x8000,
    .boot_start = 0x7800,
    .sram_start = 0x100,
    .sram_end = 0x8FF,
    .eeprom_size = 1024,
    .timer_masks_end = REG_TIMSK0 + 3,
    .vectors = 26,
    .external_interrupts = 2,
    .watchdog_vector = 6,
    .eeprom_vector = 22,
    .return_bytes = 2,
    .interrupt_cycles = 4,
    .pin_port = 'D',
    .pins = 0x29,
    .ready_bit = 2,
    .ready_interrupt = 0,
    .button_bit = 3,
    .button_interrupt = 1,
    .lines = 0x26,  // PINC
    .sda = 1 << 4,  // A4
    .scl = 1 << 5,  // A5
};
const struct machine_kind machine_atmega2560 = {
    .mcu = "atmega2560",
    .memory = "is no EEPROM of 4096 bytes",
    .flash_size = 0x40000,
    .boot_start = 0x3E000,
    .sram_start = 0x200,
    .sram_end = 0x21FF,
    .eeprom_size = 4096,
    .timer_masks_end = REG_TIMSK0 + 6,
    .vectors = 57,
    .external_interrupts = 8,
    .watchdog_vector = 12,
    .eeprom_vector = 30,
    .return_bytes = 3,
    .interrupt_cycles = 5,
    .pin_port = 'E',
    .pins = 0x2C,
    .ready_bit = 4,
    .ready_interrupt = 4,
    .button_bit = 5,
    .button_interrupt = 5,
    .lines = 0x29,  // PIND
    .sda = 1 << 1,  // 20
    .scl = 1 << 0,  // 21
};
