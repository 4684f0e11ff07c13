// SPDX-License-Identifier: MIT
// The main loop of the virtual STM32F405: events, the core asleep or awake, resets.
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "chips/lsm9ds0.h"
#include "chips/rn41.h"
#include "chips/sdcard.h"
#include "f405.h"
#include "f405/core/engine.h"

void f405_complain(struct f405 *m, const char *what) {
    if (m->complaint == NULL) {
        m->complaint = what;
    }
}

void f405_end(struct f405 *m, const char *format, ...) {
    if (m->ended != NULL) {
        return;
    }
    va_list list;
    va_start(list, format);
    (void)vsnprintf(m->ended_text, sizeof m->ended_text, format, list);
    va_end(list);
    m->ended = m->ended_text;
    f405_attend(m);
}

void f405_not_modelled(struct f405 *m, const char *what) {
    f405_end(m, "uses what is not modelled, %s,", what);
}

// xorshift64*, Vigna 2016: noise that is the same for the same seed.
uint32_t f405_random(struct f405 *m) {
    uint64_t x = m->seed;
    x ^= x >> 12;
    x ^= x << 25;
    x ^= x >> 27;
    m->seed = x;
    return (uint32_t)((x * UINT64_C(0x2545F4914F6CDD1D)) >> 32);
}

// Resets

static void reset_peripherals(struct f405 *m) {
    for (unsigned i = 0; i < EVENTS; i++) {
        if (i != EVENT_CHIP && i != EVENT_RADIO) {
            m->at[i] = F405_NEVER;
        }
    }
    bus_reset(m);
    f405_find_next(m);
}

static void start(struct f405 *m, uint32_t cause) {
    rcc_reset(m, cause);
    reset_peripherals(m);
    core_reset(m);
    m->is_asleep = m->is_locked_up = m->is_blocked = false;
    m->is_waiting = m->is_deep = false;
    m->attention = 0;
    m->fault = FAULT_NONE;
    m->trap = -1;
    m->wants_reset = 0;
    for (int i = 0; i <= 12; i++) {
        f405_set(m, UC_ARM_REG_R0 + i, 0);
    }
    uint32_t vectors[2];
    memcpy(vectors, m->flash, sizeof vectors);
    f405_set(m, UC_ARM_REG_XPSR, UINT32_C(1) << 24);
    f405_set(m, UC_ARM_REG_CONTROL, 0);
    f405_set(m, UC_ARM_REG_PRIMASK, 0);
    f405_set(m, UC_ARM_REG_FAULTMASK, 0);
    f405_set(m, UC_ARM_REG_BASEPRI, 0);
    f405_set(m, UC_ARM_REG_FPSCR, 0);
    f405_set(m, UC_ARM_REG_SP, vectors[0] & ~UINT32_C(3));
    f405_set(m, UC_ARM_REG_LR, UINT32_MAX);
    m->pc = vectors[1] & ~UINT32_C(1);
    if ((vectors[1] & 1) == 0) {
        f405_end(m, "has no reset vector,");
    }
}

static void paint_stack(struct f405 *m) {
    const uint32_t size = m->stack.top - m->stack.lowest;
    uint8_t *memory = f405_memory(m, m->stack.lowest, size);
    if (memory != NULL && m->stack.top > m->stack.lowest) {
        memset(memory, F405_PAINT, size);
    }
}

static void forget_memory(struct f405 *m) {
    for (uint32_t i = 0; i < F405_RAM_SIZE; i++) {
        m->ram[i] = (uint8_t)f405_random(m);
    }
    for (uint32_t i = 0; i < F405_CCM_SIZE; i++) {
        m->ccm[i] = (uint8_t)f405_random(m);
    }
    paint_stack(m);
}

static void do_reset(struct f405 *m, uint32_t cause) {
    (void)f405_stack_deepest(m);
    if (cause == F405_RESET_BROWN_OUT) {
        forget_memory(m);
        const uint64_t now_ns = f405_ns(f405_now(m));
        sensor_chip_power_cycle(m->sensor, now_ns);
        if (m->card != NULL) {
            sdcard_chip_power_cycle(m->card, now_ns);
        }
        if (m->radio != NULL) {
            rn41_chip_power_cycle(m->radio, now_ns);
            wired_tell_host(m);
        }
    }
    m->resets++;
    if (m->rcc.is_stopped) {
        m->stopped += f405_now(m) - m->rcc.stopped_at;
    }
    if (m->on_reset != NULL) {
        m->on_reset(m->context);
    }
    start(m, cause);
    pins_follow(m);
    wired_follow(m);
}

void f405_reset(struct f405 *m, uint32_t cause) {
    if (m->when != F405_NEVER || m->is_in_code) {
        m->wants_reset = cause;  // once the core has stopped
        f405_attend(m);
    } else {
        do_reset(m, cause);
    }
}

void f405_power_up(struct f405 *m) {
    rcc_power_up(m);
    forget_memory(m);
    start(m, F405_RESET_POWER_ON | F405_RESET_BROWN_OUT);
    pins_follow(m);
    wired_power_up(m);
}

// The loop

static void follow_chip(struct f405 *m) {
    sensor_chip_advance(m->sensor, f405_ns(f405_when(m)));
    pins_follow(m);
}

static void do_event(struct f405 *m, enum f405_event event) {
    switch (event) {
    case EVENT_OSCILLATORS:
        rcc_event(m);
        break;
    case EVENT_CHIP:
        follow_chip(m);
        break;
    case EVENT_FLASH:
        flash_event(m);
        break;
    case EVENT_IWDG:
        iwdg_event(m);
        break;
    case EVENT_SYSTICK:
        systick_event(m);
        break;
    case EVENT_TIMER2:
    case EVENT_TIMER3:
    case EVENT_TIMER4:
    case EVENT_TIMER5:
        timer_event(m, event - EVENT_TIMER2);
        break;
    case EVENT_TIMER11:
        timer11_event(m);
        break;
    case EVENT_I2C:
        i2c_event(m);
        break;
    case EVENT_USART_SENT:
        usart_sent(m);
        break;
    case EVENT_USART_RECEIVED:
        usart_received(m);
        break;
    case EVENT_USART_IDLE:
        usart_idle(m);
        break;
    case EVENT_SPI:
        spi_event(m);
        break;
    case EVENT_ADC:
        adc_event(m);
        break;
    case EVENT_RADIO:
        wired_event(m);
        break;
    case EVENTS:
        break;
    }
}

static void do_events(struct f405 *m) {
    while (m->next_ps <= f405_now(m) && m->wants_reset == 0) {
        unsigned event = 0;
        while (m->at[event] != m->next_ps) {
            event++;
        }
        m->when = m->at[event];
        m->at[event] = F405_NEVER;
        do_event(m, (enum f405_event)event);
        f405_find_next(m);
        f405_pump(m);
        m->when = F405_NEVER;
    }
}

// Lets time pass in which the core does nothing.
static void skip_to(struct f405 *m, uint64_t ps) {
    if (m->hclk_hz == 0) {
        m->base_ps = ps;
    } else {
        const uint64_t cycle = f405_cycle_at(m, ps);
        m->cycle = cycle > m->cycle ? cycle : m->cycle;
    }
}

static void execute(struct f405 *m, uint64_t target) {
    uc_err error = UC_ERR_OK;
    m->limit_cycle = f405_cycle_at(m, target);
    m->is_stopped = false;
    m->is_in_code = true;
    enum thumb end = thumb_run(m);
    while (end == THUMB_UNKNOWN && engine_step(m, &error)) {
        end = thumb_run(m);
    }
    m->is_in_code = false;
    switch (end) {
    case THUMB_STOPPED:
        break;
    case THUMB_ASLEEP:
        (void)core_sleep(m);  // WFI
        break;
    case THUMB_RETURNS:
        core_return(m, m->pc | 1);
        break;
    case THUMB_UNKNOWN:
        engine_serve_stop(m, error);
        break;
    }
}

static void sleep_until(struct f405 *m, uint64_t target) {
    if (!core_can_wake(m) && !m->iwdg.is_running) {
        f405_end(m, "sleeps with no interrupt enabled");
        return;
    }
    const uint64_t from = f405_now(m);
    const uint64_t from_cycle = m->cycle;
    skip_to(m, target);
    m->asleep += f405_now(m) - from;
    m->asleep_cycles += m->cycle - from_cycle;
}

// Asleep, with no interrupt pending. STOP mode waits for the flash (RM, "Stop mode").
static void go_on_sleeping(struct f405 *m, uint64_t target) {
    if (m->is_deep && !m->rcc.is_stopped && !m->flash_control.is_busy) {
        pwr_stop(m, true);
    }
    if (m->ended == NULL) {
        sleep_until(m, target);
    }
}

static void wake(struct f405 *m) {
    if (m->rcc.is_stopped) {
        const uint64_t from = f405_now(m);
        pwr_stop(m, false);
        m->asleep += f405_now(m) - from;
    }
    if (m->is_waiting) {
        m->core.has_event = false;
    }
    m->is_asleep = m->is_waiting = m->is_deep = false;
}

static void step(struct f405 *m, uint64_t target) {
    const struct f405_flash *flash = &m->flash_control;
    if (m->is_locked_up && !m->iwdg.is_running) {
        f405_end(m, "is locked up: a fault in the handler of faults");
    } else if ((m->hclk_hz == 0 && !m->rcc.is_stopped) || m->is_locked_up) {
        skip_to(m, target);
    } else if (flash->is_busy && f405_is_flash(m->pc)) {
        // A read waits until the write is done (RM, "Read-while-write").
        skip_to(m, target < flash->busy_until ? target : flash->busy_until);
    } else if (m->is_asleep && !core_wakes(m)) {
        go_on_sleeping(m, target);
    } else {
        if (m->is_asleep) {
            wake(m);
        }
        if (!core_take(m)) {
            execute(m, target);
        }
    }
}

bool f405_run(struct f405 *m, uint64_t until_ps) {
    m->until = until_ps;
    while (m->ended == NULL) {
        do_events(m);
        if (m->wants_reset != 0) {
            do_reset(m, m->wants_reset);
        }
        if (f405_now(m) >= m->until || m->ended != NULL) {
            break;
        }
        step(m, m->next_ps < m->until ? m->next_ps : m->until);
    }
    return m->ended == NULL;
}

// Life

// RM, "Device electronic signature"; DS, "Embedded reference voltage" and "Temperature
// sensor characteristics".
static void sign(struct f405 *m) {
    memset(m->system, 0xFF, F405_SYSTEM_SIZE);
    uint8_t *unique = m->system + 0xA10;
    for (unsigned i = 0; i < 12; i++) {
        unique[i] = (uint8_t)f405_random(m);
    }
    const uint16_t kilobytes = F405_FLASH_SIZE / 1024;
    const uint16_t calibration[3] = {
        1502,  // VREFINT: 1.21 V of 3.3 V
        943,   // 30 degC: 0.76 V + 5 * 2.5 mV, less what 12 bits leave
        1176,  // 110 degC
    };
    memcpy(m->system + 0xA22, &kilobytes, sizeof kilobytes);
    memcpy(m->system + 0xA2A, calibration, sizeof calibration);
}

bool f405_init(struct f405 *m, struct sensor_chip *sensor, uint64_t seed) {
    memset(m, 0, sizeof *m);
    m->sensor = sensor;
    m->seed = seed * UINT64_C(0x9E3779B97F4A7C15) + UINT64_C(0x6A09E667F3BCC909);
    m->crystal_hz = F405_HSE_HZ;
    m->hsi_hz = F405_HSI_HZ;
    m->clock_start = m->when = F405_NEVER;
    m->stack.lowest = m->stack.top = F405_RAM;
    for (unsigned i = 0; i < EVENTS; i++) {
        m->at[i] = F405_NEVER;
    }
    m->flash = aligned_alloc(4096, F405_FLASH_SIZE);
    m->ram = aligned_alloc(4096, F405_RAM_SIZE);
    m->ccm = aligned_alloc(4096, F405_CCM_SIZE);
    m->system = aligned_alloc(4096, F405_SYSTEM_SIZE);
    if (m->flash == NULL || m->ram == NULL || m->ccm == NULL || m->system == NULL) {
        return false;
    }
    memset(m->flash, 0xFF, F405_FLASH_SIZE);
    sign(m);
    return engine_open(m);
}

void f405_free(struct f405 *m) {
    engine_close(m);
    usart_free(m);
    free(m->flash);
    free(m->ram);
    free(m->ccm);
    free(m->system);
    memset(m, 0, sizeof *m);
}

// The unused part between variables and stack is one run of equal words: our paint, or
// the firmware's own where it paints too. The first word that differs belongs to the
// stack.
uint32_t f405_stack_deepest(struct f405 *m) {
    struct f405_stack *stack = &m->stack;
    const uint8_t *memory = f405_memory(m, stack->lowest, stack->top - stack->lowest);
    if (memory == NULL || stack->top <= stack->lowest) {
        return 0;
    }
    const uint32_t size = stack->top - stack->lowest;
    uint32_t at = 0;
    while (at < size && memcmp(memory + at, memory, 4) == 0) {
        at += 4;
    }
    stack->deepest = size - at > stack->deepest ? size - at : stack->deepest;
    return stack->deepest;
}
