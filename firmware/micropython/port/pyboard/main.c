// SPDX-License-Identifier: MIT
// MicroPython on the STM32F405 of a pyboard: start-up, its clocks, and main.py, again
// and again.
#include <string.h>

#include "adc.h"
#include "clock.h"
#include "cpu.h"
#include "flash.h"
#include "gpio.h"
#include "idle.h"
#include "objects.h"
#include "pins.h"
#include "py/compile.h"
#include "py/gc.h"
#include "py/mphal.h"
#include "py/runtime.h"
#include "py/stackctrl.h"
#include "reset.h"
#include "sampling.h"
#include "shared/runtime/gchelper.h"
#include "spi.h"
#include "start.h"

#include "board.h"

enum {
    AGAIN_MS = 1000,     // before main.py is run again
    STACK_SPARE = 2048,  // for interrupts, and for C that does not look
    VECTORS = 16 + IRQ_LINES,
    EXTI_LINE_0 = 16 + 6,
    EXTI_LINES_5 = 5,
    EXTI_9_5 = 16 + 23,
    EXTI_15_10 = 16 + 40,
};

extern uint8_t heap_start[], ram_end[];

volatile bool idle_has_work;

// Interrupts. The table of firmware/stm32/start.c has none for the edges of pins.

static uint32_t vectors[VECTORS] __attribute__((aligned(512)));

static void take_edges(void) {
    const uint32_t handler = (uint32_t)(uintptr_t)pins_edge;
    memcpy(vectors, (const void *)(uintptr_t)SCB->vtor, sizeof vectors);
    for (uint8_t line = 0; line < EXTI_LINES_5; line++) {
        vectors[EXTI_LINE_0 + line] = handler;
    }
    vectors[EXTI_9_5] = handler;
    vectors[EXTI_15_10] = handler;
    cpu_barrier();
    SCB->vtor = (uint32_t)(uintptr_t)vectors;
    cpu_barrier();
}

// What that table names and this image has no use for: nobody enables them.
void sampling_edge(void) {
}

void spi_exchanged(void) {
}

void sampling_bus(void) {
    bus_event();
}

uint32_t pyboard_mask(void) {
    return cpu_mask();
}

void pyboard_unmask(uint32_t state) {
    cpu_unmask(state);
}

// Time

mp_uint_t mp_hal_ticks_us(void) {
    return clock_us();
}

// Milliseconds since reset; the microseconds wrap after 71.6 min, and it is called more
// often than that.
mp_uint_t mp_hal_ticks_ms(void) {
    static uint64_t total_us;
    const uint32_t primask = cpu_mask();
    total_us += (uint32_t)(clock_us() - (uint32_t)total_us);
    const uint32_t ms = (uint32_t)(total_us / 1000);
    cpu_unmask(primask);
    return ms;
}

void mp_hal_delay_us(mp_uint_t us) {
    const uint32_t begun_us = clock_us();
    while (clock_us() - begun_us < us) {
    }
}

void mp_hal_delay_ms(mp_uint_t ms) {
    const mp_uint_t begun_ms = mp_hal_ticks_ms();
    while (mp_hal_ticks_ms() - begun_ms < ms) {
        mp_handle_pending(true);
        board_idle();
    }
}

void board_idle(void) {
    GPIOC->bsrr = BIT(PIN_BUSY) << 16;
    const uint32_t primask = cpu_mask();
    while (!idle_has_work) {
        cpu_sleep();
    }
    idle_has_work = false;
    cpu_unmask(primask);
}

// MicroPython

void gc_collect(void) {
    gc_collect_start();
    gc_helper_collect_regs_and_stack();
    gc_collect_end();
}

void nlr_jump_fail(void *value) {
    (void)value;
    reset_now();
}

static void start_clocks(void) {
    RCC->ahb1enr |= RCC_AHB1_GPIOA | RCC_AHB1_GPIOB | RCC_AHB1_GPIOC | RCC_AHB1_DMA1;
    RCC->apb1enr |= RCC_APB1_USART2 | RCC_APB1_I2C1;
    RCC->apb2enr |= RCC_APB2_ADC1 | RCC_APB2_SYSCFG;
    (void)RCC->apb2enr;  // "Delay after an RCC peripheral clock enabling" (ES0182)
    cpu_barrier();
    // The board's own accelerometer, which is on the same bus, has no supply.
    gpio_set(GPIOB, PIN_MMA_SUPPLY, false);
    gpio_set_mode(GPIOB, PIN_MMA_SUPPLY, GPIO_OUTPUT);
    gpio_set_mode(GPIOC, PIN_BUSY, GPIO_OUTPUT);
}

static void run_main(void) {
    nlr_buf_t nlr;
    if (nlr_push(&nlr) == 0) {
        (void)mp_import_name(MP_QSTR_main, mp_const_none, MP_OBJ_NEW_SMALL_INT(0));
        nlr_pop();
    } else {
        // Between zeros, so that the text costs no frame.
        (void)mp_hal_stdout_tx_strn("", 1);
        mp_obj_print_exception(&mp_plat_print, MP_OBJ_FROM_PTR(nlr.ret_val));
        (void)mp_hal_stdout_tx_strn("", 1);
    }
}

int main(void) {
    reset_init(false);
    clock_init();
    start_clocks();
    flash_init();
    adc_init();
    take_edges();
    wire_open(WIRE_BAUD);
    for (;;) {
        mp_cstack_init_with_top(stack_top,
                                (mp_uint_t)(uintptr_t)stack_size - STACK_SPARE);
        gc_init(heap_start, ram_end);
        mp_init();
        run_main();
        const mp_uint_t ended_ms = mp_hal_ticks_ms();
        pins_forget();
        mp_deinit();
        while (mp_hal_ticks_ms() - ended_ms < AGAIN_MS) {
            board_watchdog_kick();
            board_idle();
        }
    }
}
