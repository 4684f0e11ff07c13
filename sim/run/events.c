// SPDX-License-Identifier: MIT
// Schedules what happens to a virtual board: button presses, bytes, faults, power cuts.
#include "events.h"
#include "options.h"

static void misuse(struct run *run, const char *what) {
    const char *faults = run->options.faults;
    (void)run_complain(run, faults == NULL ? "the command line" : faults, what);
    run->is_misused = true;
    run->is_over = true;
}

static void add_chip_fault(struct run *run, const struct chip_fault *fault) {
    if (!run->board->add_chip_fault(run->self, fault)) {
        misuse(run, "has more faults of the sensor at one time than it can have");
    }
}

// Events at the same tick happen in the order in which they were added.
static void add_event(struct run *run, struct run_event event) {
    if (run->event_count == RUN_EVENTS_MAX) {
        misuse(run, "asks for more events than a run can have");
        return;
    }
    unsigned at = run->event_count++;
    for (; at > 0 && run->events[at - 1].tick <= event.tick; at--) {
        run->events[at] = run->events[at - 1];
    }
    run->events[at] = event;
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
            add_chip_fault(run, &fault->chip);
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
    case FAULT_CHIP:
        add_event(run, (struct run_event){tick, EVENT_CHIP_FAULT, fault});
        break;
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
    return run->event_count == 0 ? RUN_NEVER : run->events[run->event_count - 1].tick;
}

static void do_event(struct run *run, struct run_event event) {
    const struct run_board *board = run->board;
    switch (event.kind) {
    case EVENT_PRESS:
        board->press(run->self, true);
        break;
    case EVENT_RELEASE:
        board->press(run->self, false);
        break;
    case EVENT_CHIP_FAULT: {
        struct chip_fault fault = event.fault->chip;
        fault.from_ns = board->nanoseconds(event.tick);
        add_chip_fault(run, &fault);
        break;
    }
    case EVENT_FAULT:
        board->suffer(run->self, event.fault);
        break;
    case EVENT_POWER_CUT:
        board->cut_memory(run->self);
        run->is_power_cut = true;
        run->is_over = true;
        break;
    }
}

void run_do_events(struct run *run) {
    const uint64_t now = run->board->now(run->self);
    while (run_next_event(run) <= now) {
        do_event(run, run->events[--run->event_count]);
    }
}
