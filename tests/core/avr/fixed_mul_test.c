// SPDX-License-Identifier: MIT
// Runs the functions of firmware/avr/fixed_mul.S, or on a host those of its twin
// core/math/fixed_mul.c, over a sequence of factors and prints hashes of the results;
// the AVR prints its cycles first.
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>

#include "core/math/matrix.h"

enum { BATCH = 1024 };  // and BATCHES of them, which the test defines

static const int32_t edges[] = {
    0,           1,          -1,
    2,           -2,         32767,
    32768,       -32768,     65535,
    65536,       0x1FFFFFFF, 0x20000000,
    -0x20000000, 0x3FFFFFFF, 0x40000000,
    -0x40000000, 0x00FF00FF, -0x00FF0100,
    INT32_MAX,   INT32_MIN,  INT32_MIN + 1,
};

static uint32_t hashes[12];

static void mix(uint32_t *hash, uint32_t result) {
    *hash = (*hash << 7 | *hash >> 25) + result;
}

static void mix_words(uint32_t *hash, const void *words, uint8_t count) {
    const uint32_t *word = words;
    while (count-- > 0) {
        mix(hash, *word++);
    }
}

// Limits and ratios, of one number and of three.
static void limit(uint32_t a, uint32_t b) {
    const int32_t bound = (int32_t)(b & INT32_MAX);
    struct vector v = {.x = (int32_t)a, .y = (int32_t)(a >> 1), .z = (int32_t)(a ^ b)};
    mix(&hashes[6], (uint32_t)fixed_clamp((int32_t)a, bound));
    fixed_add_clamped(bound >> 1, bound, &v.x);
    mix(&hashes[6], (uint32_t)v.x);
    const int16_t high = (int16_t)(bound >> 16);
    int32_t held = (int32_t)a;
    mix(&hashes[6], (uint32_t)fixed_clamp_high(held, high));
    fixed_add_clamped_high(bound >> 1, high, &held);
    mix(&hashes[6], (uint32_t)held);
    int32_t sum = (int32_t)a >> 1;
    fixed_add(bound >> 1, &sum);
    mix(&hashes[6], (uint32_t)sum);
    fixed_subtract(bound, &sum);
    mix(&hashes[6], (uint32_t)sum);
    vector_scale(&v, (int32_t)b, &v);
    mix_words(&hashes[7], &v, 3);
    vector_clamp(&v, bound, &v);
    mix_words(&hashes[7], &v, 3);
    const uint32_t denominator = (uint32_t)bound + 1;
    mix(&hashes[8], (uint32_t)fixed_ratio(a >> 1, denominator > a >> 2 ? denominator
                                                                       : (a >> 2) + 1));
    mix(&hashes[8], fixed_sqrt(a));
    mix(&hashes[8], (uint32_t)fixed_rsqrt(a | UINT32_C(0x40000000)));
}

// Products and sums of one number, and of three.
static void add_up(uint32_t a, uint32_t b) {
    const int16_t element = (int16_t)(b >> 16);
    int32_t sum = (int32_t)b;
    mix(&hashes[11], (uint32_t)fixed_square_q30((int32_t)a));
    mix(&hashes[11], (uint32_t)fixed_times((int32_t)a >> 16, (uint16_t)b));
    mix(&hashes[11], (uint32_t)fixed_mul_q14((int32_t)a, element));
    fixed_add_product((int32_t)a, element, &sum);
    fixed_add_product((int32_t)a, 0, &sum);
    mix(&hashes[11], (uint32_t)sum);
    struct vector v = {.x = (int32_t)a, .y = (int32_t)b, .z = (int32_t)(a ^ b)};
    const struct vector u = {.x = v.z, .y = v.x, .z = v.y};
    mix(&hashes[11], (uint32_t)vector_square_q30(&v));
    mix(&hashes[11], vector_square_q32(&v));
    vector_subtract(&v, &u, &v);
    mix_words(&hashes[11], &v, 3);
}

static void multiply(uint32_t a, uint32_t b) {
    mix(&hashes[0], (uint32_t)fixed_mul_q30((int32_t)a, (int32_t)b));
    mix(&hashes[1], (uint32_t)fixed_mul_q32((int32_t)a, (int32_t)b));
    mix(&hashes[2], fixed_umul_q32(a, b));
    const int32_t v[3] = {(int32_t)a, (int32_t)b, (int32_t)(a ^ b)};
    mix(&hashes[0], (uint32_t)fixed_mul_at(&v[0], &v[1]));
    const int16_t m[3] = {(int16_t)(b >> 8), (int16_t)a, (int16_t)(a + b)};
    mix(&hashes[3], (uint32_t)fixed_dot3_q14(v, m));
    // In place, as the filter does.
    struct quat p = {v[0], v[1], v[2], (int32_t)(a + b)};
    const struct quat q = {v[1], v[2], (int32_t)(a - b), v[0]};
    quat_multiply(&p, &q, &p);
    mix_words(&hashes[4], &p, 4);
    struct vector turned = {.x = v[0], .y = v[1], .z = v[2]};
    quat_rotate(&q, &turned, &turned);
    mix_words(&hashes[5], &turned, 3);
    limit(a, b);
    add_up(a, b);
    struct vector crossed;
    vector_cross(&(struct vector){.x = v[0], .y = v[1], .z = v[2]},
                 &(struct vector){.x = q.x, .y = q.y, .z = q.z}, &crossed);
    mix_words(&hashes[9], &crossed, 3);
    struct matrix matrix;
    matrix_from_quat(&q, &matrix);
    for (uint8_t i = 0; i < 9; i++) {
        mix(&hashes[10], (uint16_t)matrix.row[i / 3][i % 3]);
    }
    struct vector moved = {.x = v[0], .y = v[1], .z = v[2]};
    matrix_turn(&matrix, moved.axis, moved.axis);
    mix_words(&hashes[10], &moved, 3);
}

// Marsaglia's xorshift32.
static uint32_t draw(uint32_t *state) {
    *state ^= *state << 13;
    *state ^= *state >> 17;
    *state ^= *state << 5;
    return *state;
}

static void report(uint8_t batch) {
    printf("%u", batch);
    for (uint8_t i = 0; i < sizeof hashes / sizeof hashes[0]; i++) {
        printf(" %08" PRIx32, hashes[i]);
    }
    puts("");
}

#ifdef __AVR__
#include <avr/io.h>

static int put(char byte, FILE *file) {
    (void)file;
    while ((UCSR0A & _BV(UDRE0)) == 0) {
    }
    UDR0 = (uint8_t)byte;
    return 0;
}

// Cycles of a function of two 32-bit arguments, `ret` included: the low byte of Timer1
// before and after, less one `lds` of 2 cycles and the `call` of 4.
#define CYCLES_OF(function)                                                            \
    __extension__({                                                                    \
        uint8_t before;                                                                \
        uint8_t after;                                                                 \
        __asm__ volatile("lds %0, %2\n\t"                                              \
                         "call " #function "\n\t"                                      \
                         "lds %1, %2"                                                  \
                         : "=&l"(before), "=&l"(after)                                 \
                         : "n"(_SFR_MEM_ADDR(TCNT1L))                                  \
                         : "r18", "r19", "r20", "r21", "r22", "r23", "r24", "r25",     \
                           "r26", "r27", "r30", "r31", "memory");                      \
        (uint8_t)(after - before - 6);                                                 \
    })

static void begin(void) {
    static FILE uart = FDEV_SETUP_STREAM(put, NULL, _FDEV_SETUP_WRITE);
    stdout = &uart;
    TCCR1B = _BV(CS10);
    UCSR0A = _BV(U2X0);
    UCSR0B = _BV(TXEN0);
    UBRR0 = 3;
    printf("cycles %u %u %u\n", CYCLES_OF(fixed_mul_q30), CYCLES_OF(fixed_mul_q32),
           CYCLES_OF(fixed_umul_q32));
}
#else
static void begin(void) {
}
#endif

int main(void) {
    begin();
    for (uint8_t i = 0; i < sizeof edges / sizeof edges[0]; i++) {
        for (uint8_t k = 0; k < sizeof edges / sizeof edges[0]; k++) {
            multiply((uint32_t)edges[i], (uint32_t)edges[k]);
        }
    }
    report(0);

    uint32_t state = 0x12345678;
    for (uint8_t batch = 1; batch <= BATCHES; batch++) {
        for (uint16_t i = 0; i < BATCH; i++) {
            const uint32_t a = draw(&state);
            multiply(a, draw(&state));
        }
        report(batch);
    }
    puts("done");
    return 0;
}
