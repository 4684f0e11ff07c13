// SPDX-License-Identifier: MIT
// The active faults.
#include "chip.h"

#include <stddef.h>

static bool is_of_presence(const struct sdcard_chip_fault *fault) {
    return fault->kind == SDCARD_CHIP_PULLED || fault->kind == SDCARD_CHIP_DEAD;
}

static bool is_in_force(const struct sdcard_chip *chip,
                        const struct sdcard_chip_fault *fault) {
    if (fault->count > 0) {
        return !is_of_presence(fault) && chip->came >= fault->first &&
               chip->came - fault->first < fault->count;
    }
    return chip->now_ns >= fault->from_ns &&
           (fault->for_ns == 0 || chip->now_ns - fault->from_ns < fault->for_ns);
}

const struct sdcard_chip_fault *
sdcard_chip_find_fault(const struct sdcard_chip *chip,
                       enum sdcard_chip_fault_kind kind) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        if (chip->faults[i].kind == kind && is_in_force(chip, &chip->faults[i])) {
            return &chip->faults[i];
        }
    }
    return NULL;
}

bool sdcard_chip_is_worn(const struct sdcard_chip *chip, uint64_t block,
                         enum sdcard_chip_wear wear) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct sdcard_chip_fault *fault = &chip->faults[i];
        if (fault->kind == SDCARD_CHIP_WORN && fault->wear == wear &&
            block >= fault->block && block - fault->block < fault->blocks &&
            is_in_force(chip, fault)) {
            return true;
        }
    }
    return false;
}

void sdcard_chip_begin_spans(struct sdcard_chip *chip) {
    for (unsigned i = 0; i < chip->fault_count; i++) {
        struct sdcard_chip_fault *fault = &chip->faults[i];
        if (is_of_presence(fault) && fault->count > 0 && fault->first == chip->came) {
            fault->from_ns = chip->now_ns + (fault->after_ns > 0 ? fault->after_ns : 1);
            fault->count = 0;
        }
    }
}

static uint64_t earlier(const struct sdcard_chip *chip, uint64_t at, uint64_t next) {
    return at > chip->now_ns && at < next ? at : next;
}

uint64_t sdcard_chip_next_pull(const struct sdcard_chip *chip) {
    uint64_t next = NEVER;
    for (unsigned i = 0; i < chip->fault_count; i++) {
        const struct sdcard_chip_fault *fault = &chip->faults[i];
        if (fault->kind == SDCARD_CHIP_PULLED && fault->count == 0) {
            next = earlier(chip, fault->from_ns, next);
            if (fault->for_ns > 0) {
                next = earlier(chip, fault->from_ns + fault->for_ns, next);
            }
        }
    }
    return next;
}
