// SPDX-License-Identifier: MIT
// Common parts of the filters from papers (complementary, mahony, madgwick, dcm_pi):
// the bias, the first attitude, and the little that they know of their quality.
#ifndef PAPER_FILTER_H
#define PAPER_FILTER_H

#include "core/fusion/calibrate.h"
#include "core/fusion/quality.h"
#include "core/math/quat.h"

struct own_field;  // fuse.h

struct paper_filter {
    struct vector bias_rad_s_q25;
    uint32_t age_us;        // since the start, held at 3 s
    uint32_t field_age_us;  // since the last reading of the field, held at 1 s
    bool has_level;         // a specific force has told the vertical
    bool has_heading;       // and a field north
};

void paper_filter_init(struct paper_filter *base);

// Forgets everything but the bias.
void paper_filter_restart(struct paper_filter *base);

// Takes the gyroscope's bias; each axis is held within +-4 rad/s.
void paper_filter_set_bias(struct paper_filter *base,
                           const struct vector *bias_rad_s_q25);

// Notes the time that has passed and whether the sample has a field.
void paper_filter_count(struct paper_filter *base,
                        const struct measurement *measurement, uint32_t interval_us);

// These filters never know whether the probe is at rest or the field disturbed. The
// heading is free where no field has come for a second.
void paper_filter_quality(const struct paper_filter *base,
                          struct attitude_quality *out);

// True until a specific force has given the vertical, and for samples with a field
// until one has given north: then call paper_filter_start().
bool paper_filter_wants_start(const struct paper_filter *base,
                              const struct measurement *measurement);

// The papers begin with any attitude and wait. Here the first force levels it, with the
// body's x axis to the east, and the first field turns it to north. True where the
// filter must not step with this sample: it is used up, or no force has come yet.
bool paper_filter_start(struct paper_filter *base,
                        const struct measurement *measurement,
                        struct quat *world_from_body);

// The interval, 50 ms at most, as seconds times 2^33. It makes rad/s q7_25 to rad
// q4_28, which read as q2_30 is a quarter of the angle.
int32_t paper_filter_seconds_q33(uint32_t interval_us);

// The gyroscope's rate less the bias, q7_25, each axis within 42 rad/s.
void paper_filter_rate(const struct paper_filter *base,
                       const struct measurement *measurement,
                       struct vector *rate_rad_s_q25);

// The direction of a measured force or field; false where it is zero.
static inline bool paper_filter_unit(const struct vector *v, struct vector *unit) {
    *unit = *v;
    return vector_normalise(unit) > 0;
}

// The horizontal and the vertical part, q2_30, of a field given as a unit vector in the
// body; `rows` as of quat_to_rows(). Mahony's and Madgwick's filter take this reference
// from each reading, so that a disturbed field turns only their heading in the end
// (Madgwick 2010, equations 45 and 46).
void paper_filter_reference(const struct vector rows[3], const struct vector *field,
                            q2_30_t *horizontal, q2_30_t *vertical);

// Declares what attitude.h asks of `struct name`, a paper's filter: the functions of
// fuse.h. Rate and delay are ignored, all work is done with the measurement at hand,
// and no errors are stated that a calibration or a known field has a part in.
#define PAPER_FILTER(name)                                                             \
    void name##_step(struct name *filter, const struct measurement *measurement,       \
                     uint32_t interval_us);                                            \
    static inline void name##_take(struct name *filter,                                \
                                   const struct measurement *measurement,              \
                                   uint32_t interval_us) {                             \
        name##_step(filter, measurement, interval_us);                                 \
    }                                                                                  \
    static inline void name##_work(struct name *filter) {                              \
        (void)filter;                                                                  \
    }                                                                                  \
    static inline void name##_set_accuracy(struct name *filter,                        \
                                           const struct calibration *calibration) {    \
        (void)filter;                                                                  \
        (void)calibration;                                                             \
    }                                                                                  \
    static inline void name##_use_own(struct name *filter,                             \
                                      const struct own_field *own) {                   \
        (void)filter;                                                                  \
        (void)own;                                                                     \
    }                                                                                  \
    void name##_init(struct name *filter, uint16_t rate_hz, uint16_t gyr_delay_us);    \
    void name##_restart(struct name *filter);                                          \
    void name##_set_bias(struct name *filter, const struct vector *bias_rad_s_q25);    \
    void name##_orientation(const struct name *filter, struct quat *out);              \
    void name##_quality(const struct name *filter, struct attitude_quality *out)

#endif
