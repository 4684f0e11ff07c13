// SPDX-License-Identifier: MIT
// The address space of the virtual STM32F405: memory, the table of its peripherals, and
// accesses to them; see bus.h.
#include <string.h>

#include "f405.h"

// The peripherals on the buses (RM, "Memory map"; the core's own: PM, "Core
// peripherals"), and what they do with an access to a part of a word.
enum access { ACCESS_WORDS, ACCESS_APB, ACCESS_AHB };
enum { NO_CLOCK = 255, AHB1 = 0, APB1 = 4, APB2 = 5 };

static const struct block {
    const char *name;
    uint32_t base, size;
    uint8_t bus, bit;  // of its clock and its reset in the RCC
    enum access access;
    uint8_t unit;
    uint32_t (*read)(struct f405 *m, unsigned unit, uint32_t at);
    void (*write)(struct f405 *m, unsigned unit, uint32_t at, uint32_t value);
    void (*reset)(struct f405 *m, unsigned unit);
} blocks[] = {
    {"TIM2", 0x40000000, 0x400, APB1, 0, ACCESS_APB, 0, timer_read, timer_write,
     timer_reset},
    {"TIM3", 0x40000400, 0x400, APB1, 1, ACCESS_APB, 1, timer_read, timer_write,
     timer_reset},
    {"TIM4", 0x40000800, 0x400, APB1, 2, ACCESS_APB, 2, timer_read, timer_write,
     timer_reset},
    {"TIM5", 0x40000C00, 0x400, APB1, 3, ACCESS_APB, 3, timer_read, timer_write,
     timer_reset},
    {"IWDG", 0x40003000, 0x400, NO_CLOCK, 0, ACCESS_APB, 0, iwdg_read, iwdg_write,
     iwdg_reset},
    {"USART2", 0x40004400, 0x400, APB1, 17, ACCESS_APB, 0, usart_read, usart_write,
     usart_reset},
    {"I2C1", 0x40005400, 0x400, APB1, 21, ACCESS_APB, 0, i2c_read, i2c_write,
     i2c_reset},
    {"PWR", 0x40007000, 0x400, APB1, 28, ACCESS_APB, 0, pwr_read, pwr_write, NULL},
    {"ADC", 0x40012000, 0x400, APB2, 8, ACCESS_WORDS, 0, adc_read, adc_write,
     adc_reset},
    {"SPI1", 0x40013000, 0x400, APB2, 12, ACCESS_APB, 0, spi_read, spi_write,
     spi_reset},
    {"TIM11", 0x40014800, 0x400, APB2, 18, ACCESS_APB, 0, timer11_read, timer11_write,
     timer11_reset},
    {"SYSCFG", 0x40013800, 0x400, APB2, 14, ACCESS_APB, 0, syscfg_read, syscfg_write,
     syscfg_reset},
    {"EXTI", 0x40013C00, 0x400, NO_CLOCK, 0, ACCESS_APB, 0, exti_read, exti_write,
     exti_reset},
    {"GPIOA", 0x40020000, 0x400, AHB1, 0, ACCESS_AHB, PORT_A, pins_read, pins_write,
     pins_reset},
    {"GPIOB", 0x40020400, 0x400, AHB1, 1, ACCESS_AHB, PORT_B, pins_read, pins_write,
     pins_reset},
    {"GPIOC", 0x40020800, 0x400, AHB1, 2, ACCESS_AHB, PORT_C, pins_read, pins_write,
     pins_reset},
    {"GPIOD", 0x40020C00, 0x400, AHB1, 3, ACCESS_AHB, PORT_D, pins_read, pins_write,
     pins_reset},
    {"GPIOH", 0x40021C00, 0x400, AHB1, 7, ACCESS_AHB, PORT_H, pins_read, pins_write,
     pins_reset},
    {"RCC", 0x40023800, 0x400, NO_CLOCK, 0, ACCESS_AHB, 0, rcc_read, rcc_write, NULL},
    {"FLASH", 0x40023C00, 0x400, NO_CLOCK, 0, ACCESS_WORDS, 0, flash_read, flash_write,
     flash_reset},
    {"DMA1", 0x40026000, 0x400, AHB1, 21, ACCESS_WORDS, 0, dma_read, dma_write,
     dma_reset},
    {"DMA2", 0x40026400, 0x400, AHB1, 22, ACCESS_WORDS, 1, dma_read, dma_write,
     dma_reset},
    {"DWT", 0xE0001000, 0x1000, NO_CLOCK, 0, ACCESS_WORDS, 1, core_read, core_write,
     NULL},
    {"SCS", 0xE000E000, 0x1000, NO_CLOCK, 0, ACCESS_AHB, 0, core_read, core_write,
     NULL},
    {"DBGMCU", 0xE0042000, 0x400, NO_CLOCK, 0, ACCESS_WORDS, 2, core_read, core_write,
     NULL},
};

const struct bus_window bus_windows[BUS_WINDOWS] = {
    {0x22000000, 0x02000000},  // RAM bit by bit
    {0x40000000, 0x00008000},  // APB1
    {0x40010000, 0x00008000},  // APB2
    {0x40020000, 0x00060000},  // AHB1
    {0x42000000, 0x02000000},  // peripherals bit by bit
    {0x50000000, 0x00061000},  // AHB2
    {0xA0000000, 0x00001000},  // FSMC
    {0xE0000000, 0x00100000},  // the core's own
};
bool f405_is_flash(uint32_t address) {
    return address < F405_FLASH_SIZE || address - F405_FLASH < F405_FLASH_SIZE;
}

uint8_t *f405_memory(struct f405 *m, uint32_t address, uint32_t size) {
    if (address - F405_FLASH <= F405_FLASH_SIZE - size) {
        return m->flash + (address - F405_FLASH);
    }
    if (address - F405_RAM <= F405_RAM_SIZE - size) {
        return m->ram + (address - F405_RAM);
    }
    if (address <= F405_FLASH_SIZE - size) {
        return m->flash + address;
    }
    if (address - F405_CCM <= F405_CCM_SIZE - size) {
        return m->ccm + (address - F405_CCM);
    }
    return NULL;
}

bool f405_is_clocked(const struct f405 *m, unsigned bus, unsigned bit) {
    return bus == NO_CLOCK || ((m->rcc.enr[bus] >> bit) & 1) != 0;
}

static const struct block *find_block(uint32_t address) {
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) {
        if (address - blocks[i].base < blocks[i].size) {
            return &blocks[i];
        }
    }
    return NULL;
}

static bool is_window(uint32_t address) {
    for (unsigned i = 0; i < BUS_WINDOWS; i++) {
        if (address - bus_windows[i].base < bus_windows[i].size) {
            return true;
        }
    }
    return false;
}

// The block at an address. Null where the access ends the run, or where the block has
// no clock.
static const struct block *reach(struct f405 *m, uint32_t address, bool is_write) {
    const struct block *block = find_block(address);
    if (block == NULL) {
        f405_end(m, "%s 0x%08x, which is not modelled,", is_write ? "writes" : "reads",
                 address);
        return NULL;
    }
    if (!f405_is_clocked(m, block->bus, block->bit)) {
        f405_complain(m, "a peripheral used with its clock off");
        return NULL;
    }
    return block;
}

bool f405_bus_read(struct f405 *m, uint32_t address, unsigned size, uint32_t *value) {
    const uint8_t *memory = f405_memory(m, address, size);
    *value = 0;
    if (memory != NULL) {
        memcpy(value, memory, size);
        return true;
    }
    if (!is_window(address)) {
        return false;
    }
    const struct block *block = reach(m, address, false);
    if (block != NULL) {
        const uint32_t word =
            block->read(m, block->unit, (address - block->base) & ~UINT32_C(3));
        *value = (word >> (8 * (address & 3))) & (UINT32_MAX >> (32 - 8 * size));
        f405_pump(m);
    }
    return true;
}

// Makes a word of a write of one or two bytes: the APB repeats them over the word (RM,
// "AHB/APB bridges"), registers on the AHB keep their other bytes.
static uint32_t widen(struct f405 *m, const struct block *block, uint32_t at,
                      unsigned size, uint32_t value) {
    const uint32_t mask = UINT32_MAX >> (32 - 8 * size);
    if (block->access == ACCESS_WORDS) {
        f405_complain(m, "a part of a register written that takes words alone");
    }
    if (block->access == ACCESS_APB) {
        const uint32_t part = value & mask;
        return size == 1 ? part * UINT32_C(0x01010101) : part * UINT32_C(0x00010001);
    }
    const unsigned shift = 8 * (at & 3);
    const uint32_t word = block->read(m, block->unit, at & ~UINT32_C(3));
    return (word & ~(mask << shift)) | ((value & mask) << shift);
}

bool f405_bus_write(struct f405 *m, uint32_t address, unsigned size, uint32_t value) {
    uint8_t *memory = f405_memory(m, address, size);
    if (memory != NULL) {
        if (f405_is_flash(address)) {
            return false;  // no bus master but the core programs it
        }
        memcpy(memory, &value, size);
        return true;
    }
    if (!is_window(address)) {
        return false;
    }
    const struct block *block = reach(m, address, true);
    if (block != NULL) {
        const uint32_t at = address - block->base;
        if (size != 4) {
            value = widen(m, block, at, size, value);
        }
        block->write(m, block->unit, at & ~UINT32_C(3), value);
        f405_pump(m);
    }
    return true;
}

void f405_pump(struct f405 *m) {
    if (m->is_pumping) {
        return;
    }
    m->is_pumping = true;
    while (i2c_pump(m) || usart_pump(m) || spi_pump(m) || adc_pump(m)) {
    }
    m->is_pumping = false;
}

void bus_reset(struct f405 *m) {
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) {
        if (blocks[i].reset != NULL) {
            blocks[i].reset(m, blocks[i].unit);
        }
    }
}
