// SPDX-License-Identifier: MIT
// A stand-in for the boot ROM of an emulated RP2040, written from its data sheet
// ("Bootrom contents"): what the SDK looks up by two letters, and single-precision
// arithmetic for MicroPython. The flash is written straight through its window, which
// the emulator allows; a register of the emulator's own says when, and how long it
// takes.
#include <stddef.h>
#include <stdint.h>

#define FLASH ((volatile uint32_t *)0x10000000)

// Of the emulator, where the chip has its test registers (machine.mjs): a write begins
// an action on flash, a read is 1 until it would be over; or asks for the boot loader.
#define PORT (*(volatile uint32_t *)0x4006C0F0)
enum { PORT_PROGRAM = 1, PORT_ERASE = 2, PORT_LOADER = 3 };

enum { SECTOR = 4096 };

struct entry {
    uint16_t code;
    uint16_t at;
};

void *lookup(const struct entry *table, uint32_t code) {
    for (; table->code != 0; table++) {
        if (table->code == code) {
            return (void *)(uintptr_t)table->at;
        }
    }
    return NULL;
}

void *rom_copy(uint8_t *to, const uint8_t *from, uint32_t count) {
    uint8_t *out = to;
    if ((((uintptr_t)out | (uintptr_t)from) & 3) == 0) {
        for (; count >= 4; count -= 4, out += 4, from += 4) {
            *(uint32_t *)out = *(const uint32_t *)from;
        }
    }
    while (count-- > 0) {
        *out++ = *from++;
    }
    return to;
}

void *rom_set(uint8_t *to, uint32_t value, uint32_t count) {
    uint8_t *out = to;
    const uint8_t byte = (uint8_t)value;
    for (; count > 0 && ((uintptr_t)out & 3) != 0; count--) {
        *out++ = byte;
    }
    for (; count >= 4; count -= 4, out += 4) {
        *(uint32_t *)out = byte * UINT32_C(0x01010101);
    }
    while (count-- > 0) {
        *out++ = byte;
    }
    return to;
}

uint32_t rom_popcount(uint32_t value) {
    uint32_t count = 0;
    for (; value != 0; value &= value - 1) {
        count++;
    }
    return count;
}

uint32_t rom_clz(uint32_t value) {
    uint32_t count = 32;
    for (; value != 0; value >>= 1) {
        count--;
    }
    return count;
}

uint32_t rom_ctz(uint32_t value) {
    return value == 0 ? 32 : 31 - rom_clz(value & (0 - value));
}

uint32_t rom_reverse(uint32_t value) {
    uint32_t out = 0;
    for (int i = 0; i < 32; i++, value >>= 1) {
        out = out << 1 | (value & 1);
    }
    return out;
}

void rom_nothing(void) {
}

static void act(uint32_t action) {
    PORT = action;
    while (PORT != 0) {
    }
}

void rom_erase(uint32_t at, uint32_t count, uint32_t block, uint32_t command) {
    (void)block;
    (void)command;
    for (uint32_t from = at; from < at + count; from += SECTOR) {
        act(PORT_ERASE);
        for (uint32_t i = 0; i < SECTOR / 4; i++) {
            FLASH[from / 4 + i] = UINT32_MAX;
        }
    }
}

void rom_program(uint32_t at, const uint8_t *data, uint32_t count) {
    for (uint32_t i = 0; i < count; i += 4) {
        if (i % 256 == 0) {
            act(PORT_PROGRAM);
        }
        FLASH[(at + i) / 4] &= (uint32_t)data[i] | (uint32_t)data[i + 1] << 8 |
                               (uint32_t)data[i + 2] << 16 |
                               (uint32_t)data[i + 3] << 24;
    }
}

void halt(void);

void rom_usb_boot(uint32_t pins, uint32_t disabled) {
    (void)pins;
    (void)disabled;
    PORT = PORT_LOADER;
    halt();
}

// The table `SF`: by the SDK's order (pico/bootrom/sf_table.h). What is not here stops.
extern float __aeabi_fadd(float, float), __aeabi_fsub(float, float);
extern float __aeabi_fmul(float, float), __aeabi_fdiv(float, float);

// The integer square root of the mantissa, rounded; half the exponent.
static float root(float value) {
    union {
        float number;
        uint32_t bits;
    } it = {value};
    if ((int32_t)it.bits <= 0) {
        return value == 0 ? value : -__builtin_inff();
    }
    const int32_t exponent = (int32_t)(it.bits >> 23) - 127;
    const uint64_t square = (uint64_t)((it.bits & 0x7FFFFF) | 0x800000)
                            << ((exponent & 1) != 0 ? 26 : 25);
    uint64_t found = 0;
    for (uint64_t bit = UINT64_C(1) << 25; bit != 0; bit >>= 1) {
        if ((found + bit) * (found + bit) <= square) {
            found += bit;
        }
    }
    found = (found + 1) >> 1;
    const int32_t half = (exponent - (exponent & 1)) / 2;
    it.bits = (uint32_t)((half + 127) << 23) + ((uint32_t)found - 0x800000);
    return it.number;
}

static int32_t to_int(float value) {
    const int32_t whole = (int32_t)value;
    return (float)whole > value ? whole - 1 : whole;
}

static int64_t to_int64(float value) {
    const int64_t whole = (int64_t)value;
    return (float)whole > value ? whole - 1 : whole;
}

static uint32_t to_uint(float value) {
    return value < 0 ? 0 : (uint32_t)value;
}

static uint64_t to_uint64(float value) {
    return value < 0 ? 0 : (uint64_t)value;
}

static float of_int(int32_t value) {
    return (float)value;
}

static float of_uint(uint32_t value) {
    return (float)value;
}

static float of_int64(int64_t value) {
    return (float)value;
}

static float of_uint64(uint64_t value) {
    return (float)value;
}

static double to_double(float value) {
    return (double)value;
}

typedef void (*function)(void);
#define OF(name) ((function)(name))
#define NONE OF(halt)

// The two bytes before the address in the table of data are its length and revision.
struct floats {
    uint8_t pad[2], length, revision;
    function at[32];
};
__attribute__((section(".floats"), aligned(4))) const struct floats floats = {
    .length = 32,
    .at = {OF(__aeabi_fadd),
           OF(__aeabi_fsub),
           OF(__aeabi_fmul),
           OF(__aeabi_fdiv),
           NONE,
           NONE,
           OF(root),
           OF(to_int),
           NONE,
           OF(to_uint),
           NONE,
           OF(of_int),
           NONE,
           OF(of_uint),
           NONE,
           NONE,
           NONE,
           NONE,
           NONE,
           NONE,
           NONE,
           NONE,
           NONE,
           OF(of_int64),
           NONE,
           OF(of_uint64),
           NONE,
           OF(to_int64),
           NONE,
           OF(to_uint64),
           NONE,
           OF(to_double)},
};
