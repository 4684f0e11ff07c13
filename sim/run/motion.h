// SPDX-License-Identifier: MIT
// The motion of the sensor: a binary stream of records, read as it is needed.
//
// Stream, little endian: 8 bytes "IMUMOT1\0", float64 rate_hz, uint64 count (0: until
// the end), then records of 9 float32: gyr x y z rad/s, acc x y z m/s2, mag x y z uT,
// in the sensor's frame. Between records the motion is linear; before the first and
// after the last it stands.
#ifndef SIM_RUN_MOTION_H
#define SIM_RUN_MOTION_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "chips/chip_motion.h"

enum {
    MOTION_AXES = 9,
    MOTION_KEPT = 16384,  // records held back for windows that reach into the past
    MOTION_RATE_MAX_HZ =
        100000  // the longest window, 89 ms, fits twice in what is kept
};

enum motion_flag { MOTION_RECORDED = 1 };

struct motion {
    FILE *file;
    double rate_hz;
    uint64_t count;  // 0: until the end of the stream
    uint64_t flags;  // enum motion_flag
    uint64_t read;   // records read so far
    bool is_ended;   // there are no more
    bool has_start;
    int64_t start_ns;  // time of record 0
    float *kept;       // MOTION_KEPT records, a ring
};

// Null, or what is wrong. "-" is standard input.
const char *motion_open(struct motion *motion, const char *path);
void motion_close(struct motion *motion);
void motion_begin(struct motion *motion, int64_t start_ns);
// Reads the stream up to that time. True once the last record has passed by then.
bool motion_is_over(struct motion *motion, int64_t now_ns);
// A chip_motion_function, whose context is the struct motion.
void motion_mean(void *context, enum chip_quantity quantity, int64_t from_ns,
                 int64_t to_ns, double mean[3]);
// For the model of a sensor: held where no stream has been opened.
struct chip_motion_source motion_source(struct motion *motion);

#endif
