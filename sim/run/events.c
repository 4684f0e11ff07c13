// SPDX-License-Identifier: MIT
// Schedules what happens to a virtual board: button presses, bytes, faults, power cuts.
#include "events.h"
#include "options.h"

static void add_event(struct run *run, struct run_event event) {
    if (run->event_count < RUN_EVENTS_MAX) {
        run->events[run->event_count++] = event;
    }
}

static void cut_after(struct run *run, const struct fault *fault) {
    const uint64_t at =
        run->board->now(run->self) + fault->after_us * run->board->ticks_per_us;
    add_event(run, (struct run_event){at, EVENT_POWER_CUT, fault});
    run->board->pause(run->self, at);
}

void run_on_memory_write(void *context, uint64_t number) {
    struct run *run = context;
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (fault->target == FAULT_POWER_CUT && fault->write == number) {
            cut_after(run, fault);
        }
    }
}

void run_on_card_write(void *context, uint64_t number) {
    struct run *run = context;
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (fault->target == FAULT_POWER_CUT && fault->card_write == number) {
            cut_after(run, fault);
        }
    }
}

uint64_t run_tick_of(const struct run *run, uint64_t device_us) {
    return run->board->clock_start(run->self) + device_us * run->board->ticks_per_us;
}

// Whether the fault is present from power-up on.
static bool is_from_power_up(const struct fault *fault) {
    switch (fault->target) {
    case FAULT_CHIP:
        return fault->at_us == 0 || fault->chip.transactions > 0;
    case FAULT_CARD:
        return fault->at_us == 0 || fault->card.count > 0;
    case FAULT_CRYSTAL:
    case FAULT_BATTERY:
    case FAULT_CHARGER:
    case FAULT_RADIO:
        return fault->at_us == 0;
    default:
        return false;
    }
}

// Faults that don't wait for the device clock.
void run_schedule_at_power_up(struct run *run) {
    for (unsigned i = 0; i < run->faults.count; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (!is_from_power_up(fault)) {
            continue;
        }
        if (fault->target == FAULT_CHIP) {
            run->board->add_chip_fault(run->self, &fault->chip);
        } else if (fault->target == FAULT_CARD) {
            run->board->add_card_fault(run->self, &fault->card);
        } else {
            run->board->suffer(run->self, fault);
        }
    }
}

static void schedule_fault(struct run *run, const struct fault *fault) {
    const uint64_t tick = run_tick_of(run, fault->at_us);
    if (is_from_power_up(fault)) {
        return;
    }
    switch (fault->target) {
    case FAULT_CHIP: {
        struct chip_fault chip_fault = fault->chip;
        chip_fault.from_ns = run->board->nanoseconds(tick);
        run->board->add_chip_fault(run->self, &chip_fault);
        break;
    }
    case FAULT_CARD: {
        struct card_fault card_fault = fault->card;
        card_fault.from_ns = run->board->nanoseconds(tick);
        run->board->add_card_fault(run->self, &card_fault);
        break;
    }
    case FAULT_CRYSTAL:
    case FAULT_RESET:
    case FAULT_BROWN_OUT:
    case FAULT_GLITCH:
    case FAULT_SPURIOUS_BERR:
    case FAULT_BATTERY:
    case FAULT_CHARGER:
    case FAULT_RADIO:
        add_event(run, (struct run_event){tick, EVENT_FAULT, fault});
        break;
    case FAULT_POWER_CUT:
        if (fault->write == 0 && fault->card_write == 0) {
            add_event(run, (struct run_event){tick, EVENT_POWER_CUT, fault});
        }
        break;
    }
}

// Schedules presses, bytes and the remaining faults.
void run_schedule(struct run *run) {
    const struct run_board *board = run->board;
    const struct run_options *options = &run->options;
    run->is_scheduled = true;
    motion_begin(&run->motion,
                 (int64_t)board->nanoseconds(run_tick_of(run, RUN_MOTION_AFTER_US)));
    for (unsigned i = 0; i < options->press_count; i++) {
        const uint64_t from = run_tick_of(run, options->presses[i].from_us);
        const uint64_t to = run_tick_of(run, options->presses[i].to_us);
        add_event(run, (struct run_event){from, EVENT_PRESS, NULL});
        add_event(run, (struct run_event){to, EVENT_RELEASE, NULL});
    }
    for (unsigned i = 0; i < options->send_count; i++) {
        const char *hex = options->sends[i].hex;
        for (; hex[0] != '\0'; hex += 2) {
            (void)board->send(
                run->self, run_tick_of(run, options->sends[i].at_us),
                (uint8_t)(run_hex_digit(hex[0]) * 16 + run_hex_digit(hex[1])));
        }
    }
    for (unsigned i = 0; i < run->faults.count; i++) {
        schedule_fault(run, &run->faults.list[i]);
    }
}

uint64_t run_next_event(const struct run *run) {
    uint64_t next = RUN_NEVER;
    for (unsigned i = 0; i < run->event_count; i++) {
        next = run->events[i].tick < next ? run->events[i].tick : next;
    }
    return next;
}

void run_do_events(struct run *run) {
    const struct run_board *board = run->board;
    const uint64_t now = board->now(run->self);
    for (unsigned i = 0; i < run->event_count;) {
        if (run->events[i].tick > now) {
            i++;
            continue;
        }
        switch (run->events[i].kind) {
        case EVENT_PRESS:
            board->press(run->self, true);
            break;
        case EVENT_RELEASE:
            board->press(run->self, false);
            break;
        case EVENT_FAULT:
            board->suffer(run->self, run->events[i].fault);
            break;
        case EVENT_POWER_CUT:
            board->cut_memory(run->self);
            run->is_power_cut = true;
            run->is_over = true;
            break;
        }
        run->events[i] = run->events[--run->event_count];
    }
}
