// SPDX-License-Identifier: MIT
// The card in the socket of the virtual STM32F405; see board.h.
#include <string.h>

#include "board.h"

const char *const f405_card_faults[F405_CARD_FAULTS] = {
    [SDCARD_CHIP_PULLED] = "card_pulled", [SDCARD_CHIP_SLOW] = "card_slow",
    [SDCARD_CHIP_CRC] = "card_crc",       [SDCARD_CHIP_ERROR] = "card_error",
    [SDCARD_CHIP_WORN] = "card_worn",     [SDCARD_CHIP_DEAD] = "card_dead",
};
_Static_assert((int)FAULTS_RARE_MAX <= (int)SDCARD_CHIP_FAULTS_MAX,
               "the card takes them all");

int f405_card_insert(struct f405_board *board) {
    struct run *run = &board->run;
    for (unsigned i = 0; i < run->faults.count && board->card_image == NULL; i++) {
        const struct fault *fault = &run->faults.list[i];
        if (fault->target == FAULT_CARD || fault->card_write > 0) {
            return run_complain(run, run->options.faults, "is for a card: --card FILE");
        }
    }
    if (board->card_image == NULL) {
        return 0;
    }
    struct sdcard_chip_config config = {
        .image = board->card_image,
        .seed = run->options.seed,
        .on_block = run_on_card_write,
        .context = run,
    };
    if (board->card_kind != NULL) {
        config.kind =
            strcmp(board->card_kind, "sdhc") == 0 ? SDCARD_CHIP_SDHC : SDCARD_CHIP_SDSC;
    }
    const char *problem = NULL;
    board->card = sdcard_chip_new(&config, &problem);
    if (board->card == NULL) {
        return run_complain(run, board->card_image, problem);
    }
    board->machine.card = board->card;
    return 0;
}

const char *f405_card_check(const struct f405_board *board) {
    if (board->card_kind == NULL) {
        return NULL;
    }
    if (board->card_image == NULL) {
        return "--card-kind comes with --card FILE";
    }
    return strcmp(board->card_kind, "sdsc") == 0 ||
                   strcmp(board->card_kind, "sdhc") == 0
               ? NULL
               : "--card-kind is sdsc or sdhc";
}

void f405_card_add_fault(void *board, const struct card_fault *fault) {
    const struct sdcard_chip_fault card_fault = {
        .kind = (enum sdcard_chip_fault_kind)fault->kind,
        .from_ns = fault->from_ns,
        .for_ns = fault->for_ns,
        .first = fault->first,
        .count = fault->count,
        .after_ns = fault->after_ns,
        .block = fault->block,
        .blocks = fault->blocks,
        .ms = fault->ms,
        .wear = (enum sdcard_chip_wear)fault->value,
    };
    (void)sdcard_chip_add_fault(((struct f405_board *)board)->card, &card_fault);
}

void f405_card_report(const struct f405_board *board, struct run_report *out) {
    if (board->card != NULL) {
        out->has_card = true;
        out->card_blocks = sdcard_chip_written(board->card);
        out->card_bad_crc = sdcard_chip_bad_crc(board->card);
        out->card_busy_worst_us = sdcard_chip_busy_worst_ns(board->card) / 1000;
        out->card_complaint = sdcard_chip_complaint(board->card);
    }
}

// Unless a power cut ended the run, the card finishes the blocks that it has accepted.
void f405_card_free(struct f405_board *board) {
    if (board->card != NULL) {
        sdcard_chip_finish(board->card, f405_ns(f405_now(&board->machine)));
        sdcard_chip_free(board->card);
    }
}
