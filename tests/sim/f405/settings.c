// SPDX-License-Identifier: MIT
// Appends four words to sector 10 in each run. Erases it first if the button is down.
#include "bare.h"

enum { AT_FLASH = 0x080C0000, WORDS = 16 };

IN_RAM static void wait(void) {
    while ((FLASH_SR & BIT(16)) != 0) {
    }
}

void program(void) {
    pin_mode(GPIOB, 3, 0);
    pin_pull_up(GPIOB, 3);
    wait_us(1000);
    unsigned used = 0;
    for (; used < WORDS && AT(AT_FLASH + 4 * used) != UINT32_MAX; used++) {
        say("word", AT(AT_FLASH + 4 * used));
    }
    FLASH_KEYR = 0x45670123;
    FLASH_KEYR = 0xCDEF89AB;
    if ((GPIO(GPIOB, IDR) & BIT(3)) == 0) {
        FLASH_CR = BIT(1) | 10 << 3 | 2 << 8;
        FLASH_CR |= BIT(16);
        wait();
        used = 0;
    }
    FLASH_CR = BIT(0) | 2 << 8;
    for (unsigned i = 0; i < 4; i++) {
        AT(AT_FLASH + 4 * (used + i)) = 0x12340000 + used + i;
        wait();
    }
    say("done", used + 4);
}
