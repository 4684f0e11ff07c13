// SPDX-License-Identifier: MIT
// Reads a motion stream and takes exact means over it; see motion.h.
#include "motion.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

// Accelerometers are set to 16 g, where their converters clip: before the low-pass.
#define FORCE_MAX ((float)(16.0 * STANDARD_GRAVITY))

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "the stream is read as it is");

static bool read_record(struct motion *motion) {
    if (motion->is_ended) {
        return false;
    }
    float *record = motion->kept + MOTION_AXES * (motion->read % MOTION_KEPT);
    if ((motion->count != 0 && motion->read == motion->count) ||
        fread(record, sizeof(float), MOTION_AXES, motion->file) != MOTION_AXES) {
        motion->is_ended = true;
        return false;
    }
    motion->read++;
    for (int axis = 0; axis < 3 && (motion->flags & MOTION_RECORDED) == 0; axis++) {
        float *force = &record[3 * (int)CHIP_ACC + axis];
        *force = fmaxf(-FORCE_MAX, fminf(FORCE_MAX, *force));
    }
    return true;
}

const char *motion_open(struct motion *motion, const char *path) {
    memset(motion, 0, sizeof *motion);
    motion->file = strcmp(path, "-") == 0 ? stdin : fopen(path, "rb");
    if (motion->file == NULL) {
        return "can't be opened";
    }
    char magic[8];
    if (fread(magic, 1, sizeof magic, motion->file) != sizeof magic ||
        memcmp(magic, "IMUMOT1", sizeof magic) != 0 ||
        fread(&motion->rate_hz, sizeof motion->rate_hz, 1, motion->file) != 1 ||
        fread(&motion->count, sizeof motion->count, 1, motion->file) != 1 ||
        fread(&motion->flags, sizeof motion->flags, 1, motion->file) != 1) {
        return "is no motion stream: it should begin with IMUMOT1, rate, count, flags";
    }
    if ((motion->flags & ~(uint64_t)MOTION_RECORDED) != 0) {
        return "has flags of a later version";
    }
    if (!(motion->rate_hz > 0.0) || motion->rate_hz > MOTION_RATE_MAX_HZ) {
        return "has a rate outside 0 to 100000 Hz";
    }
    motion->kept = calloc(MOTION_KEPT, MOTION_AXES * sizeof *motion->kept);
    if (motion->kept == NULL) {
        return "does not fit into memory";
    }
    if (!read_record(motion)) {
        return "has no records";
    }
    return NULL;
}

void motion_close(struct motion *motion) {
    if (motion->file != NULL && motion->file != stdin) {
        (void)fclose(motion->file);
    }
    free(motion->kept);
    memset(motion, 0, sizeof *motion);
}

void motion_begin(struct motion *motion, int64_t start_ns) {
    motion->has_start = true;
    motion->start_ns = start_ns;
}

// A time as a number of records since the first one; below 0 before it.
static double position(const struct motion *motion, int64_t ns) {
    if (!motion->has_start) {
        return -1.0;
    }
    return (double)(ns - motion->start_ns) * 1e-9 * motion->rate_hz;
}

static void read_until(struct motion *motion, double at) {
    while ((double)motion->read <= at + 1.0 && read_record(motion)) {
    }
}

bool motion_is_over(struct motion *motion, int64_t now_ns) {
    const double at = position(motion, now_ns);
    read_until(motion, at);
    return motion->is_ended && at >= (double)(motion->read - 1);
}

static const float *record_at(const struct motion *motion, int64_t index) {
    const int64_t last = (int64_t)motion->read - 1;
    const int64_t oldest = last - MOTION_KEPT + 1;
    if (index > last) {
        index = last;
    }
    if (index < oldest) {
        index = oldest;
    }
    if (index < 0) {
        index = 0;
    }
    return motion->kept + MOTION_AXES * (index % MOTION_KEPT);
}

static void value_at(const struct motion *motion, double at, int first,
                     double value[3]) {
    const double below = floor(at);
    const double share = at - below;
    const float *a = record_at(motion, (int64_t)below);
    const float *b = record_at(motion, (int64_t)below + 1);
    for (int axis = 0; axis < 3; axis++) {
        value[axis] = (1.0 - share) * a[first + axis] + share * b[first + axis];
    }
}

void motion_mean(void *context, enum chip_quantity quantity, int64_t from_ns,
                 int64_t to_ns, double mean[3]) {
    struct motion *motion = context;
    const int first = 3 * (int)quantity;  // a record has them in the order of the enum
    const double from = position(motion, from_ns);
    const double to = position(motion, to_ns);
    read_until(motion, to);
    if (from >= to) {
        value_at(motion, to, first, mean);
        return;
    }
    // The motion is linear between records, so the mean over a piece is the mean of its
    // ends.
    double sum[3] = {0.0, 0.0, 0.0};
    double at = from;
    double left[3];
    value_at(motion, at, first, left);
    while (at < to) {
        double next = floor(at) + 1.0;
        if (next > to) {
            next = to;
        }
        double right[3];
        value_at(motion, next, first, right);
        for (int axis = 0; axis < 3; axis++) {
            sum[axis] += (next - at) * 0.5 * (left[axis] + right[axis]);
            left[axis] = right[axis];
        }
        at = next;
    }
    for (int axis = 0; axis < 3; axis++) {
        mean[axis] = sum[axis] / (to - from);
    }
}

struct chip_motion_source motion_source(struct motion *motion) {
    return (struct chip_motion_source){
        .function = motion->file != NULL ? motion_mean : NULL,
        .context = motion,
        .is_recorded = (motion->flags & MOTION_RECORDED) != 0,
    };
}
