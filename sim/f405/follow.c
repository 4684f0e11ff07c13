// SPDX-License-Identifier: MIT
// Calls, returns and exceptions of the virtual STM32F405 (ARM, BL, BLX); see follow.h.
// A call has returned when the stack is as it was and the next instruction is the one
// behind the call, whichever instruction led there.
#include "follow.h"

struct profile_time f405_follow_time(const struct f405 *m) {
    return (struct profile_time){m->cycle, m->asleep_cycles};
}

static uint32_t length_of(uint32_t first) {
    return first >= 0xE800 ? 4 : 2;
}

static bool is_call(uint32_t first, uint32_t second) {
    return (first & 0xFF80) == 0x4780 ||
           ((first & 0xF800) == 0xF000 && (second & 0xD000) == 0xD000);
}

static void on_instruction(void *context, uint32_t at, uint32_t next) {
    const struct f405_follow *follow = context;
    struct f405 *m = follow->machine;
    const uint8_t *code = f405_memory(m, at, 4);
    profile_instruction(follow->profile, at, f405_follow_time(m));
    if (code == NULL) {
        return;
    }
    const uint32_t first = code[0] | (uint32_t)code[1] << 8;
    const uint32_t second = code[2] | (uint32_t)code[3] << 8;
    const uint32_t back = at + length_of(first);
    if (is_call(first, second)) {
        const struct profile_call call = {at, next, back, f405_sp(m)};
        profile_call(follow->profile, call);
    } else if (next != back) {
        profile_return_to(follow->profile, next, f405_sp(m));
    }
}

static void on_enter(void *context, uint32_t from, uint32_t handler) {
    const struct f405_follow *follow = context;
    const struct profile_call call = {.from = from, .entry = handler};
    profile_interrupt(follow->profile, call, f405_follow_time(follow->machine));
}

static void on_leave(void *context) {
    const struct f405_follow *follow = context;
    profile_leave(follow->profile);
}

void f405_follow_begin(struct f405_follow *follow) {
    follow->machine->watch =
        (struct f405_watch){follow, on_instruction, on_enter, on_leave};
}
