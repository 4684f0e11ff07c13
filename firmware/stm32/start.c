// SPDX-License-Identifier: MIT
// The table that says which function an exception calls, and the first instructions
// after a reset.
#include "start.h"

#include <string.h>

#include "clock.h"
#include "registers.h"
#include "reset.h"
#include "sampling.h"
#include "spi.h"
#include "uart.h"

int main(void);

typedef void (*vector_t)(void);

// "Vector table for STM32F405xx/07xx", after the sixteen of the processor. An interrupt
// that nobody enabled is a fault.
enum { EXCEPTIONS = 16 };
#define LINE(irq) [EXCEPTIONS + (irq)]
#define LINES(from, to) [EXCEPTIONS + (from)... EXCEPTIONS + (to)]
__attribute__((section(".vectors"),
               used)) static const vector_t vectors[EXCEPTIONS + IRQ_LINES] = {
    [0] = (vector_t)stack_top,
    [1] = start_reset,
    [2] = clock_failed,  // NMI: the clock security system
    [3 ... 14] = reset_fault,
    [15] = reset_tick,
    LINES(0, IRQ_DMA1_STREAM5 - 1) = reset_fault,
    LINE(IRQ_DMA1_STREAM5) = uart_received,
    LINE(IRQ_DMA1_STREAM6) = uart_sent,
    LINES(IRQ_DMA1_STREAM6 + 1, IRQ_TIM3 - 1) = reset_fault,
    LINE(IRQ_TIM3) = sampling_edge,
    LINES(IRQ_TIM3 + 1, IRQ_I2C1_EVENT - 1) = reset_fault,
    LINE(IRQ_I2C1_EVENT) = sampling_bus,
    LINE(IRQ_I2C1_ERROR) = sampling_bus,
    LINES(IRQ_I2C1_ERROR + 1, IRQ_USART2 - 1) = reset_fault,
    LINE(IRQ_USART2) = uart_received,
    LINES(IRQ_USART2 + 1, IRQ_DMA2_STREAM2 - 1) = reset_fault,
    LINE(IRQ_DMA2_STREAM2) = spi_exchanged,
    LINES(IRQ_DMA2_STREAM2 + 1, IRQ_LINES - 1) = reset_fault,
};

// Where a bootloader has jumped here, its interrupts may be on, and its own memory at
// address 0.
static void take_over_interrupts(void) {
    SYSTICK->csr = 0;
    for (uint8_t i = 0; i <= IRQ_LINES / 32; i++) {
        NVIC->icer[i] = UINT32_MAX;
        NVIC->icpr[i] = UINT32_MAX;
    }
    SCB->vtor = (uint32_t)(uintptr_t)vectors;
    __asm__ volatile("dsb\n\tisb\n\tcpsie i" ::: "memory");
}

_Noreturn void start_reset(void) {
    clock_start();
#ifdef __ARM_FP
    // Built for the FPU, in which a compiler may keep integers too.
    SCB_CPACR |= SCB_CPACR_FPU;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
#endif
    memcpy(data_start, data_load, (size_t)data_size);
    memset(bss_start, 0, (size_t)bss_size);
    // From below up to what this very function uses.
    uintptr_t end;
    __asm__ volatile("mov %0, sp" : "=r"(end));
    volatile uint32_t *word = stack_bottom;
    for (; (uintptr_t)word < end; word++) {
        *word = STACK_PAINT;
    }
    take_over_interrupts();
    (void)main();
    reset_now();
}
