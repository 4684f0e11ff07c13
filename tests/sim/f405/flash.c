// SPDX-License-Identifier: MIT
// Reads, erases and programs sector 11, at 0x080E0000, and measures the time of each.
#include "bare.h"

enum { AT_FLASH = 0x080E0000, WORDS = 8 };

static void unlock(void) {
    FLASH_KEYR = 0x45670123;
    FLASH_KEYR = 0xCDEF89AB;
}

// Runs from RAM, so that it can read the timer while flash is busy.
IN_RAM static uint32_t erase_from_ram(void) {
    const uint32_t from = TIM(2, TIM_CNT);
    FLASH_CR = BIT(1) | 11 << 3 | 2 << 8;
    FLASH_CR |= BIT(16);
    uint32_t polls = 0;
    while ((FLASH_SR & BIT(16)) != 0) {
        polls++;
    }
    FLASH_CR = 0;
    return polls > 1000 ? TIM(2, TIM_CNT) - from : 0;
}

IN_RAM static void begin_erase(void) {
    FLASH_CR = BIT(1) | 11 << 3 | 2 << 8;
    FLASH_CR |= BIT(16);
}

static volatile uint32_t ticks;

static void on_tick(void) {
    ticks++;
}

static void on_fault(void) {
    say("gone", SCB(CFSR));
    end();
}

// Writes a function that returns 1, then one that returns 2, then erases it.
static void run_from_flash(void) {
    uint32_t (*const function)(void) = (uint32_t(*)(void))(AT_FLASH | 1);
    for (uint32_t i = 1; i <= 2; i++) {
        say("erase_us", erase_from_ram());
        FLASH_CR = BIT(0) | 2 << 8;
        AT(AT_FLASH) = 0x47702000 | i;  // movs r0, #i; bx lr
        while ((FLASH_SR & BIT(16)) != 0) {
        }
        say("code", function());
        say("code", function());
    }
    (void)erase_from_ram();
    FLASH_CR = BIT(31);
    FLASH_CR = BIT(0);
    say("locked", FLASH_CR);
    vectors[HARD_FAULT] = on_fault;
    (void)function();
    say("still", 1);
}

void program(void) {
    say("before", AT(AT_FLASH));
    say("locked", FLASH_CR >> 31);
    unlock();
    say("locked", FLASH_CR >> 31);
    say("erase_us", erase_from_ram());
    say("erased", AT(AT_FLASH));
    FLASH_CR = BIT(0) | 2 << 8;
    const uint32_t from = now_us();
    for (unsigned i = 0; i < WORDS; i++) {
        AT(AT_FLASH + 4 * i) = 0xC0DE0000 + i;
        while ((FLASH_SR & BIT(16)) != 0) {
        }
    }
    say("program_us", now_us() - from);
    say("first", AT(AT_FLASH));
    say("last", AT(AT_FLASH + 4 * (WORDS - 1)));
    // Zeros stay zero without an erase, and a byte is not accepted for a word.
    AT(AT_FLASH) = 0x0FFFFFFF;
    while ((FLASH_SR & BIT(16)) != 0) {
    }
    say("anded", AT(AT_FLASH));
    *(volatile uint8_t *)(AT_FLASH + 64) = 5;
    say("errors", FLASH_SR);
    say("byte", AT(AT_FLASH + 64));
    FLASH_SR = 0xF2;
    // An erase stops all code that runs from flash, handlers too.
    vectors[TICK] = on_tick;
    SYSTICK(4) = 15999;
    SYSTICK(8) = 0;
    SYSTICK(0) = 7;
    FLASH_CR = BIT(1) | 11 << 3 | 2 << 8;
    const uint32_t start = now_us();
    FLASH_CR |= BIT(16);
    const uint32_t busy = FLASH_SR & BIT(16);
    say("stall_us", now_us() - start);
    say("busy", busy);
    say("ticks", ticks);
    SYSTICK(0) = 0;
    // A return from RAM to flash waits while flash is busy.
    const uint32_t left = now_us();
    begin_erase();
    say("return_us", now_us() - left);
    run_from_flash();
}
