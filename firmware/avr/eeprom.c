// SPDX-License-Identifier: MIT
// The EEPROM as memory for settings and params.
#include <avr/io.h>
#include <util/atomic.h>

#include "../board.h"

_Static_assert(MEMORY_SIZE <= E2END + 1, "it must fit the EEPROM");

bool eeprom_is_ready(void *port) {
    (void)port;
    return (EECR & _BV(EEPE)) == 0;
}

uint8_t eeprom_read(void *port, uint16_t offset) {
    (void)port;
    EEAR = offset;
    EECR = _BV(EERE);
    return EEDR;
}

// Erases and writes one byte, which takes the hardware 3.4 ms. The write must follow
// its permission within four cycles ("The EEPROM Control Register").
void eeprom_write(void *port, uint16_t offset, uint8_t value) {
    (void)port;
    EEAR = offset;
    EEDR = value;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        EECR = _BV(EEMPE);
        EECR |= _BV(EEPE);
    }
}

const IN_FLASH struct memory board_memory = {eeprom_read, eeprom_write, eeprom_is_ready,
                                             0};
