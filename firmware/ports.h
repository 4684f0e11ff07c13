// SPDX-License-Identifier: MIT
// The functions of this board as core/ gets them. main.c hands them over. With
// PORTS_FIXED core/ has them from here: direct calls take less flash.
#ifndef PORTS_H
#define PORTS_H

#include "board.h"

#ifdef PORTS_FIXED
#include "parts.h"
#define BOARD_SENSOR fixed_sensor
#define BOARD_BUS fixed_bus
#define BOARD_MEMORY fixed_memory
#define PORT_GIVEN(port) 0
#else
#define BOARD_SENSOR board_sensor
#define BOARD_BUS board_bus
#define BOARD_MEMORY board_memory
#define PORT_GIVEN(port) (&(port))
#endif

// Of main.c.
extern struct outlet main_wire;
void main_describe(struct message_hello *out);
void main_measure(struct message_status *out);

static const IN_FLASH struct probe_port probe_port = {
    .wire = &main_wire,
    .memory = PORT_GIVEN(BOARD_MEMORY),
    .describe = main_describe,
    .measure = main_measure,
    .unique_id = board_unique_id,
    .entropy = board_entropy,
};
static const IN_FLASH struct acquisition_port acquisition_port = {
    .sensor = &BOARD_SENSOR,
    .bus = PORT_GIVEN(BOARD_BUS),
    .recover_bus = board_bus_recover,
    .start_sampling = board_sampling_start,
    .stop_sampling = board_sampling_stop,
    .take_reading = board_reading_take,
#ifndef ACQUISITION_WIRED_ONLY
    .time_us = board_time_us,
#endif
};

#endif
