// SPDX-License-Identifier: MIT
// The model's life, its time, its faults and its pins.
#include "chip.h"

#include <stdlib.h>
#include <string.h>

// BC4, "Reset": between 1.5 and 4.0 ms after RST# is low; more than 5 is recommended.
#define RESET_NS (4 * MS)
#define PULSE_MIN_NS (5 * MS)

enum { OUT = 65536 };  // bytes that wait to be taken by the caller

void rn41_chip_complain(struct rn41_chip *chip, const char *what) {
    if (chip->complaint == NULL) {
        chip->complaint = what;
    }
}

bool rn41_chip_suffers(const struct rn41_chip *chip, enum rn41_chip_fault_kind kind) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct rn41_chip_fault *fault = &chip->faults[i];
        if (fault->kind == kind && chip->now >= fault->from_ns &&
            (fault->for_ns == 0 || chip->now - fault->from_ns < fault->for_ns)) {
            return true;
        }
    }
    return false;
}

static uint64_t next_edge(const struct rn41_chip *chip) {
    uint64_t next = NEVER;
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct rn41_chip_fault *fault = &chip->faults[i];
        const uint64_t edges[2] = {fault->from_ns,
                                   fault->for_ns == 0 ? NEVER
                                                      : fault->from_ns + fault->for_ns};
        for (unsigned edge = 0; edge < 2; edge++) {
            if (edges[edge] > chip->now && edges[edge] < next) {
                next = edges[edge];
            }
        }
    }
    return next;
}

// Its memory is lost.
static void stop(struct rn41_chip *chip) {
    struct rn41_chip_counters *counters = &chip->counters;
    chip->is_ready = chip->is_linked = chip->is_command = chip->is_sending = false;
    counters->lost_to_host += chip->to_air.count + chip->held;
    counters->lost_from_host += chip->from_host.count;
    chip->to_air.count = chip->from_host.count = chip->to_uart.count = 0;
    chip->waiting.count = 0;
    chip->held = chip->host_held = 0;
    chip->length = 0;
    chip->after = STAY;
    chip->boot_at = chip->air_at = chip->sent_at = NEVER;
    chip->answer_at = chip->escape_at = chip->host_escape_at = NEVER;
    rn41_chip_follow_rts(chip);
}

void rn41_chip_restart(struct rn41_chip *chip) {
    stop(chip);
    chip->counters.resets++;
    chip->is_restarted = true;
    chip->boot_at = chip->now + chip->config.boot_ns;
}

static void boot(struct rn41_chip *chip) {
    chip->boot_at = NEVER;
    chip->used = chip->stored;
    chip->rate = chip->used.rate;
    chip->is_ready = true;
    chip->has_echo = false;
    chip->up_at = chip->now;
    chip->heard_at = chip->host_heard_at = NEVER;
    chip->link_from = chip->now + chip->config.host_ns;
    if (chip->used.mode != 0 && chip->used.mode != MODE_DTR &&
        chip->used.mode != MODE_PAIR) {
        rn41_chip_complain(chip, "a master mode, which is not modelled");
    }
    if (chip->is_restarted) {
        rn41_chip_send_status(chip, "REBOOT");
    }
}

uint64_t rn41_chip_next_event(const struct rn41_chip *chip) {
    const uint64_t moments[] = {
        chip->boot_at, chip->escape_at, chip->host_escape_at, chip->answer_at,
        chip->sent_at, chip->air_at,    next_edge(chip),
    };
    uint64_t next = NEVER;
    for (size_t i = 0; i < sizeof moments / sizeof *moments; i++) {
        next = moments[i] < next ? moments[i] : next;
    }
    if (chip->is_ready && !chip->is_linked && chip->link_from > chip->now &&
        chip->link_from < next) {
        next = chip->link_from;
    }
    if (chip->to_uart.count > 0 && chip->next_at > chip->now && chip->next_at < next) {
        next = chip->next_at;
    }
    const uint64_t reset_at = chip->low_from + RESET_NS;
    if (chip->is_reset_low && reset_at > chip->now && reset_at < next) {
        next = reset_at;
    }
    return next;
}

static void do_resets(struct rn41_chip *chip) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        if (chip->faults[i].kind == RN41_CHIP_RESET && !chip->is_done[i] &&
            chip->now >= chip->faults[i].from_ns) {
            chip->is_done[i] = true;
            if (!chip->is_reset_low) {
                rn41_chip_restart(chip);
            }
        }
    }
}

static void step(struct rn41_chip *chip) {
    if (chip->is_reset_low && chip->now == chip->low_from + RESET_NS) {
        stop(chip);
    }
    do_resets(chip);
    if (chip->boot_at <= chip->now) {
        boot(chip);
    }
    if (chip->escape_at <= chip->now) {
        rn41_chip_end_escape(chip);
    }
    if (chip->host_escape_at <= chip->now) {
        chip->host_escape_at = NEVER;
        if (chip->is_linked && rn41_chip_lets_in(chip, TIMER_REMOTE)) {
            rn41_chip_complain(chip, "the host can take it into command mode");
        }
    }
    if (chip->answer_at <= chip->now) {
        rn41_chip_give_answer(chip);
    }
    if (chip->sent_at <= chip->now) {
        rn41_chip_end_frame(chip);
    }
    if (chip->air_at <= chip->now) {
        rn41_chip_exchange_packets(chip);
    }
    rn41_chip_follow_link(chip);
    rn41_chip_begin_sending(chip);
}

void rn41_chip_advance(struct rn41_chip *chip, uint64_t now_ns) {
    for (;;) {
        const uint64_t next = rn41_chip_next_event(chip);
        if (next > now_ns) {
            break;
        }
        chip->now = next > chip->now ? next : chip->now;
        step(chip);
    }
    chip->now = now_ns > chip->now ? now_ns : chip->now;
}

void rn41_chip_set_reset(struct rn41_chip *chip, uint64_t now_ns, bool is_low) {
    rn41_chip_advance(chip, now_ns);
    if (is_low == chip->is_reset_low) {
        return;
    }
    chip->is_reset_low = is_low;
    if (is_low) {
        chip->low_from = now_ns;
        return;
    }
    if (now_ns - chip->low_from < PULSE_MIN_NS) {
        rn41_chip_complain(chip, "a reset pulse of less than 5 ms");
    }
    if (now_ns - chip->low_from >= RESET_NS) {
        rn41_chip_restart(chip);
    }
}

int rn41_chip_rts(const struct rn41_chip *chip) {
    return !chip->is_ready ? -1 : chip->is_full ? 1 : 0;
}

int rn41_chip_pio2(const struct rn41_chip *chip) {
    return !chip->is_ready ? -1 : chip->is_linked ? 1 : 0;
}

struct rn41_chip_config rn41_chip_defaults(void) {
    return (struct rn41_chip_config){
        .address = UINT64_C(0x0006664F1A2C),  // 00-06-66 is Roving Networks
        .boot_ns = SECOND,
        .command_ns = 100 * MS,
        .host_ns = 2 * SECOND,
    };
}

static bool make(struct ring *ring, size_t room) {
    *ring = (struct ring){.bytes = malloc(room), .room = room};
    return ring->bytes != NULL;
}

struct rn41_chip *rn41_chip_new(const struct rn41_chip_config *config) {
    struct rn41_chip *chip = calloc(1, sizeof *chip);
    if (chip == NULL) {
        return NULL;
    }
    chip->config = *config;
    const bool has_all = make(&chip->to_air, BUFFER) && make(&chip->to_uart, BUFFER) &&
                         make(&chip->from_host, BUFFER) &&
                         make(&chip->waiting, 4 * LINE) && make(&chip->uart_out, OUT) &&
                         make(&chip->host_out, OUT);
    if (!has_all) {
        rn41_chip_free(chip);
        return NULL;
    }
    rn41_chip_factory_settings(chip);
    stop(chip);
    chip->used = chip->stored;
    chip->rate = FACTORY_RATE;
    chip->boot_at = config->boot_ns;
    return chip;
}

void rn41_chip_free(struct rn41_chip *chip) {
    if (chip == NULL) {
        return;
    }
    enum { RINGS = 6 };
    struct ring *rings[RINGS] = {&chip->to_air,  &chip->to_uart,  &chip->from_host,
                                 &chip->waiting, &chip->uart_out, &chip->host_out};
    for (size_t i = 0; i < RINGS; i++) {
        free(rings[i]->bytes);
    }
    free(chip);
}

void rn41_chip_power_cycle(struct rn41_chip *chip, uint64_t now_ns) {
    rn41_chip_advance(chip, now_ns);
    rn41_chip_restart(chip);
    chip->is_restarted = false;
}

bool rn41_chip_add_fault(struct rn41_chip *chip, const struct rn41_chip_fault *fault) {
    if (chip->fault_count == RN41_CHIP_FAULTS_MAX) {
        return false;
    }
    chip->faults[chip->fault_count++] = *fault;
    return true;
}

struct rn41_chip_counters rn41_chip_counters(const struct rn41_chip *chip) {
    return chip->counters;
}

const char *rn41_chip_complaint(const struct rn41_chip *chip) {
    return chip->complaint;
}
