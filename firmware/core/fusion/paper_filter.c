// SPDX-License-Identifier: MIT
// Common parts of the filters from papers; see paper_filter.h.
#include "core/fusion/paper_filter.h"

#include "core/math/constant.h"

#define BIAS_LIMIT_Q25 Q25(4)  // rad/s
#define STARTING_US UINT32_C(3000000)
#define FIELD_ABSENT_US UINT32_C(1000000)
#define INTERVAL_MAX_US UINT32_C(50000)

void paper_filter_init(struct paper_filter *base) {
    base->bias_rad_s_q25 = (struct vector){0};
    paper_filter_restart(base);
}

void paper_filter_restart(struct paper_filter *base) {
    base->age_us = 0;
    base->field_age_us = FIELD_ABSENT_US;
    base->has_level = false;
    base->has_heading = false;
}

void paper_filter_set_bias(struct paper_filter *base,
                           const struct vector *bias_rad_s_q25) {
    vector_clamp(bias_rad_s_q25, BIAS_LIMIT_Q25, &base->bias_rad_s_q25);
}

// age + interval_us, held at the limit.
static uint32_t aged(uint32_t age_us, uint32_t interval_us, uint32_t limit_us) {
    return interval_us >= limit_us - age_us ? limit_us : age_us + interval_us;
}

static bool has_field(const struct measurement *measurement) {
    const struct vector *field = &measurement->mag_ut_q18;
    return measurement->has_mag && (field->x | field->y | field->z) != 0;
}

void paper_filter_count(struct paper_filter *base,
                        const struct measurement *measurement, uint32_t interval_us) {
    base->age_us = aged(base->age_us, interval_us, STARTING_US);
    base->field_age_us = has_field(measurement)
                             ? 0
                             : aged(base->field_age_us, interval_us, FIELD_ABSENT_US);
}

void paper_filter_quality(const struct paper_filter *base,
                          struct attitude_quality *out) {
    const bool is_absent = base->field_age_us == FIELD_ABSENT_US;
    *out = (struct attitude_quality){
        .tilt_sigma_cdeg = UINT16_MAX,
        .heading_sigma_cdeg = UINT16_MAX,
        .flags = (uint8_t)((base->age_us < STARTING_US ? POSE_STARTING : 0) |
                           (is_absent ? POSE_MAG_ABSENT | POSE_HEADING_FREE : 0)),
    };
}

// East is across north and up, north across up and east. False, and nothing changed,
// if north is within a degree of the vertical, which gives no heading.
static bool face_north(const struct vector *north, struct vector rows[3]) {
    struct vector east;
    vector_cross(north, &rows[2], &east);
    if (vector_normalise(&east) < Q2_30_ONE / 64) {
        return false;
    }
    rows[0] = east;
    vector_cross(&rows[2], &rows[0], &rows[1]);
    return true;
}

// Level by the specific force, x to the east.
static bool find_level(const struct measurement *measurement, struct vector rows[3]) {
    struct vector *up = &rows[2];
    if (!paper_filter_unit(&measurement->acc_m_s2_q21, up)) {
        return false;
    }
    // North is across up and the body's x, or y where x points up or down: at least 30
    // degrees off the vertical.
    const bool is_steep = fixed_magnitude(up->x) > (uint32_t)Q2_30_ONE / 2;
    const struct vector north = is_steep
                                    ? (struct vector){.x = -up->z, .y = 0, .z = up->x}
                                    : (struct vector){.x = 0, .y = up->z, .z = -up->y};
    return face_north(&north, rows);
}

bool paper_filter_wants_start(const struct paper_filter *base,
                              const struct measurement *measurement) {
    return !base->has_level || (!base->has_heading && has_field(measurement));
}

bool paper_filter_start(struct paper_filter *base,
                        const struct measurement *measurement,
                        struct quat *world_from_body) {
    const bool finds_level = !base->has_level;
    struct vector rows[3];
    struct vector field;
    if (!finds_level) {
        quat_to_rows(world_from_body, rows);
    } else if (!find_level(measurement, rows)) {
        return true;
    }
    base->has_level = true;
    if (measurement->has_mag && paper_filter_unit(&measurement->mag_ut_q18, &field)) {
        base->has_heading = face_north(&field, rows);
    }
    if (!finds_level && !base->has_heading) {
        return false;
    }
    quat_from_rows(rows, world_from_body);
    return true;
}

int32_t paper_filter_seconds_q33(uint32_t interval_us) {
    const uint32_t us = interval_us > INTERVAL_MAX_US ? INTERVAL_MAX_US : interval_us;
    // 2^33 / 1e6 = 8589.934592; below 4.3e8.
    return (int32_t)(us * 8589 + fixed_umul_q32(us, Q32_UNSIGNED(0.934592)));
}

void paper_filter_rate(const struct paper_filter *base,
                       const struct measurement *measurement,
                       struct vector *rate_rad_s_q25) {
    vector_subtract(&measurement->gyr_rad_s_q25, &base->bias_rad_s_q25, rate_rad_s_q25);
}

void paper_filter_reference(const struct vector rows[3], const struct vector *field,
                            q2_30_t *horizontal, q2_30_t *vertical) {
    struct vector flat = {
        .x = vector_dot(&rows[0], field), .y = vector_dot(&rows[1], field), .z = 0};
    *vertical = vector_dot(&rows[2], field);
    *horizontal = vector_normalise(&flat);
}
