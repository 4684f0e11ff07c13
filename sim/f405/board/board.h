// SPDX-License-Identifier: MIT
// The virtual STM32F405 with what is plugged into it: sensor, card, radio and cell.
#ifndef SIM_F405_BOARD_BOARD_H
#define SIM_F405_BOARD_BOARD_H

#include <stdbool.h>

#include "chips/lsm9ds0.h"
#include "chips/rn41.h"
#include "chips/sdcard.h"
#include "f405/f405.h"
#include "f405/follow.h"
#include "run/run.h"

struct f405_board {
    struct run run;
    struct f405 machine;
    struct sensor_chip *sensor;
    // Options.
    const char *card_image, *card_kind;
    const char *radio_file, *battery_mv;
    const char *crystal_mhz, *hsi_mhz;
    struct sdcard_chip *card;  // null: none in the socket
    struct rn41_chip *radio;   // null: a cable
    uint32_t flash, ram;       // bytes of the image
    struct f405_follow follow;
};

// Names of the card's faults, by enum sdcard_chip_fault_kind.
enum { F405_CARD_FAULTS = 6 };
extern const char *const f405_card_faults[F405_CARD_FAULTS];

// From the options to the machine, before power comes. 0, or the exit code once it has
// complained.
int f405_card_insert(struct f405_board *board);
int f405_radio_add(struct f405_board *board);
// Null, or what is wrong between the options.
const char *f405_card_check(const struct f405_board *board);

void f405_card_add_fault(void *board, const struct card_fault *fault);
// A fault of the radio begins.
void f405_radio_suffer(struct f405_board *board, const struct fault *fault);
void f405_card_report(const struct f405_board *board, struct run_report *out);
void f405_radio_report(const struct f405_board *board, struct run_report *out);
// Writes the radio's settings to its file. False once it has complained.
bool f405_radio_save(const struct f405_board *board);
void f405_card_free(struct f405_board *board);

#endif
