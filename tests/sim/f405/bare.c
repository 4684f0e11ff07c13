// SPDX-License-Identifier: MIT
// Start-up code of the bare programs; see bare.h.
#include "bare.h"

extern uint32_t data_start[], data_end[], data_image[], bss_start[], bss_end[];
extern uint32_t stack_top[];

__attribute__((aligned(512))) void (*vectors[98])(void);

static void unexpected(void) {
    uint32_t exception = 0;
    __asm__ volatile("mrs %0, ipsr" : "=r"(exception));
    say("unexpected", exception);
    end();
}

void reset(void);

__attribute__((section(".vectors"), used)) static const void *const first_vectors[4] = {
    stack_top, reset, unexpected, unexpected};

void say(const char *name, uint32_t value) {
    static const char digits[] = "0123456789abcdef";
    char text[12] = " ";
    for (unsigned i = 0; i < 8; i++) {
        text[1 + i] = digits[(value >> (28 - 4 * i)) & 15];
    }
    text[9] = '\n';
    const char *parts[] = {name, text};
    for (unsigned i = 0; i < 2; i++) {
        for (const char *at = parts[i]; *at != '\0'; at++) {
            while ((USART(U_SR) & BIT(7)) == 0) {
            }
            USART(U_DR) = (uint8_t)*at;
        }
    }
}

void flush(void) {
    while ((USART(U_SR) & BIT(6)) == 0) {
    }
}

_Noreturn void end(void) {
    flush();
    for (unsigned i = 0; i < 3; i++) {
        AT(0xE000E180 + 4 * i) = UINT32_MAX;
    }
    SYSTICK(0) = 0;
    for (;;) {
        __asm__ volatile("cpsid i\n\twfi");
    }
}

__attribute__((noreturn)) void reset(void) {
    for (uint32_t *to = data_start, *from = data_image; to < data_end;) {
        *to++ = *from++;
    }
    for (uint32_t *at = bss_start; at < bss_end;) {
        *at++ = 0;
    }
    for (unsigned i = 2; i < 98; i++) {
        vectors[i] = unexpected;
    }
    SCB(VTOR) = (uint32_t)vectors;
    RCC_AHB1ENR |= BIT(0) | BIT(1) | BIT(2);
    RCC_APB1ENR |= BIT(0) | BIT(17);
    TIM(2, TIM_PSC) = 16 - 1;
    TIM(2, TIM_EGR) = 1;
    TIM(2, TIM_SR) = 0;
    TIM(2, TIM_CR1) = 1;
    pin_alternate(GPIOA, 2, 7);
    pin_alternate(GPIOA, 3, 7);
    USART(U_BRR) = 16;
    USART(U_CR1) = BIT(13) | BIT(3) | BIT(2);
    program();
    end();
}
