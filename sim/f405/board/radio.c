// SPDX-License-Identifier: MIT
// The radio between the virtual STM32F405 and the host; see board.h.
#include <stdio.h>

#include "board.h"

// Without a file the module has its factory settings.
static bool load_radio(const struct f405_board *board) {
    char text[RN41_CHIP_TEXT + 1] = "";
    FILE *file = fopen(board->radio_file, "rb");
    if (file == NULL) {
        return true;
    }
    const size_t length = fread(text, 1, sizeof text - 1, file);
    (void)fclose(file);
    text[length] = '\0';
    return rn41_chip_load(board->radio, text);
}

int f405_radio_add(struct f405_board *board) {
    struct run *run = &board->run;
    for (unsigned i = 0; i < run->faults.count && board->radio_file == NULL; i++) {
        if (run->faults.list[i].target == FAULT_RADIO) {
            return run_complain(run, run->options.faults,
                                "is for a radio: --radio FILE");
        }
    }
    if (board->radio_file == NULL) {
        return 0;
    }
    const struct rn41_chip_config config = rn41_chip_defaults();
    board->radio = rn41_chip_new(&config);
    if (board->radio == NULL || !load_radio(board)) {
        return run_complain(run, board->radio_file, "has no settings of an RN-41");
    }
    board->machine.radio = board->radio;
    return 0;
}

void f405_radio_suffer(struct f405_board *board, const struct fault *fault) {
    static const enum rn41_chip_fault_kind kinds[] = {
        [RADIO_DROP] = RN41_CHIP_DROP,
        [RADIO_AWAY] = RN41_CHIP_AWAY,
        [RADIO_DEAF] = RN41_CHIP_DEAF,
        [RADIO_RESET] = RN41_CHIP_RESET,
    };
    const struct rn41_chip_fault radio_fault = {
        .kind = kinds[fault->radio],
        .from_ns = f405_ns(f405_now(&board->machine)),
        .for_ns = fault->chip.for_ns,
    };
    (void)rn41_chip_add_fault(board->radio, &radio_fault);
    wired_event(&board->machine);
}

void f405_radio_report(const struct f405_board *board, struct run_report *out) {
    if (board->radio == NULL) {
        return;
    }
    const struct rn41_chip_counters counters = rn41_chip_counters(board->radio);
    run_add_number(out, "radio_to_host", counters.to_host);
    run_add_number(out, "radio_from_host", counters.from_host);
    run_add_number(out, "radio_lost_to_host", counters.lost_to_host);
    run_add_number(out, "radio_lost_from_host", counters.lost_from_host);
    run_add_number(out, "radio_commands", counters.commands);
    run_add_number(out, "radio_writes", counters.writes);
    run_add_number(out, "radio_resets", counters.resets);
    run_add_number(out, "radio_links", counters.links);
    out->has_radio = true;
    out->radio_complaint = rn41_chip_complaint(board->radio);
}

bool f405_radio_save(const struct f405_board *board) {
    if (board->radio == NULL) {
        return true;
    }
    char text[RN41_CHIP_TEXT];
    rn41_chip_save(board->radio, text);
    FILE *file = fopen(board->radio_file, "wb");
    const bool good = file != NULL && fputs(text, file) >= 0;
    if (file != NULL && fclose(file) == 0 && good) {
        return true;
    }
    (void)run_complain(&board->run, board->radio_file, "can't be written");
    return false;
}
