// SPDX-License-Identifier: MIT
// The common ground of the papers' filters; see classic.h.
#include "core/fusion/classic.h"

#define BIAS_LIMIT_Q25 INT32_C(134217728)  // 4 rad/s
#define STARTING_US UINT32_C(3000000)
#define FIELD_ABSENT_US UINT32_C(1000000)
#define INTERVAL_MAX_US UINT32_C(50000)

void classic_init(struct classic *classic) {
    classic->bias_rad_s_q25 = (struct vector){0};
    classic_restart(classic);
}

void classic_restart(struct classic *classic) {
    classic->age_us = 0;
    classic->field_age_us = FIELD_ABSENT_US;
    classic->has_level = false;
    classic->has_heading = false;
}

void classic_set_bias(struct classic *classic, const struct vector *bias_rad_s_q25) {
    vector_clamp(bias_rad_s_q25, BIAS_LIMIT_Q25, &classic->bias_rad_s_q25);
}

// age + interval_us, held at the limit.
static uint32_t aged(uint32_t age_us, uint32_t interval_us, uint32_t limit_us) {
    return interval_us >= limit_us - age_us ? limit_us : age_us + interval_us;
}

static bool has_field(const struct measurement *measurement) {
    const struct vector *field = &measurement->mag_ut_q18;
    return measurement->has_mag && (field->x | field->y | field->z) != 0;
}

void classic_step(struct classic *classic, const struct measurement *measurement,
                  uint32_t interval_us) {
    classic->age_us = aged(classic->age_us, interval_us, STARTING_US);
    classic->field_age_us = has_field(measurement) ? 0
                                                   : aged(classic->field_age_us,
                                                          interval_us, FIELD_ABSENT_US);
}

void classic_quality(const struct classic *classic, struct attitude_quality *out) {
    const bool is_absent = classic->field_age_us == FIELD_ABSENT_US;
    *out = (struct attitude_quality){
        .tilt_sigma_cdeg = UINT16_MAX,
        .heading_sigma_cdeg = UINT16_MAX,
        .is_starting = classic->age_us < STARTING_US,
        .is_mag_absent = is_absent,
        .is_heading_free = is_absent,
    };
}

// East is across north and up, north across up and east. False, and nothing changed,
// where north is within a degree of the vertical and tells nothing.
static bool face_north(const struct vector *north, struct vector rows[3]) {
    struct vector east;
    int32_t norm;
    classic_cross(north, &rows[2], &east);
    if (!vector_normalise(&east, &east, &norm) || norm < Q2_30_ONE / 64) {
        return false;
    }
    rows[0] = east;
    classic_cross(&rows[2], &rows[0], &rows[1]);
    return true;
}

// Level by the specific force, x to the east.
static bool find_level(const struct measurement *measurement, struct vector rows[3]) {
    struct vector *up = &rows[2];
    int32_t norm;
    if (!vector_normalise(&measurement->acc_m_s2_q21, up, &norm)) {
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

bool classic_wants_start(const struct classic *classic,
                         const struct measurement *measurement) {
    return !classic->has_level || (!classic->has_heading && has_field(measurement));
}

bool classic_start(struct classic *classic, const struct measurement *measurement,
                   struct quat *world_from_body) {
    const bool finds_level = !classic->has_level;
    struct vector rows[3];
    struct vector field;
    int32_t norm;
    if (!finds_level) {
        classic_axes(world_from_body, rows);
    } else if (!find_level(measurement, rows)) {
        return true;
    }
    classic->has_level = true;
    if (measurement->has_mag &&
        vector_normalise(&measurement->mag_ut_q18, &field, &norm)) {
        classic->has_heading = face_north(&field, rows);
    }
    if (!finds_level && !classic->has_heading) {
        return false;
    }
    classic_quat(rows, world_from_body);
    return true;
}

int32_t classic_seconds_q33(uint32_t interval_us) {
    const uint32_t us = interval_us > INTERVAL_MAX_US ? INTERVAL_MAX_US : interval_us;
    // 2^33 / 1e6 = 8589 + 4014042075 / 2^32; below 4.3e8.
    return (int32_t)(us * 8589 + fixed_umul_q32(us, UINT32_C(4014042075)));
}

void classic_rate(const struct classic *classic, const struct measurement *measurement,
                  struct vector *rate_rad_s_q25) {
    vector_subtract(&measurement->gyr_rad_s_q25, &classic->bias_rad_s_q25,
                    rate_rad_s_q25);
}

void classic_half_step(const struct quat *q, const struct vector *quarter_rad_q30,
                       struct quat *out) {
    // With u the quarter: a sum of products is at most |q| |u| <= 1.3, and 0.5 + 1.3
    // fit.
    const struct vector *u = quarter_rad_q30;
    const struct quat half = {
        fixed_half_floor(q->w) - fixed_mul_q30(q->x, u->x) - fixed_mul_q30(q->y, u->y) -
            fixed_mul_q30(q->z, u->z),
        fixed_half_floor(q->x) + fixed_mul_q30(q->w, u->x) + fixed_mul_q30(q->y, u->z) -
            fixed_mul_q30(q->z, u->y),
        fixed_half_floor(q->y) + fixed_mul_q30(q->w, u->y) + fixed_mul_q30(q->z, u->x) -
            fixed_mul_q30(q->x, u->z),
        fixed_half_floor(q->z) + fixed_mul_q30(q->w, u->z) + fixed_mul_q30(q->x, u->y) -
            fixed_mul_q30(q->y, u->x),
    };
    *out = half;
}

bool classic_normalise(struct quat *q) {
    const uint32_t bits = fixed_magnitude(q->w) | fixed_magnitude(q->x) |
                          fixed_magnitude(q->y) | fixed_magnitude(q->z);
    if (bits == 0) {
        return false;
    }
    // As vector_normalise(): the largest component comes into [2^30, 2^31), the sum of
    // squares over 2^32 into [2^28, 2^32).
    const uint8_t up = (uint8_t)(fixed_leading_zeros(bits) - 1);
    q->w = fixed_scale_up(q->w, up);
    q->x = fixed_scale_up(q->x, up);
    q->y = fixed_scale_up(q->y, up);
    q->z = fixed_scale_up(q->z, up);
    const uint32_t w = fixed_magnitude(q->w);
    const uint32_t square =
        fixed_umul_q32(w, w) +
        vector_square_q32(&(struct vector){.x = q->x, .y = q->y, .z = q->z});
    const bool is_low = square < UINT32_C(0x40000000);
    const q2_30_t inverse = fixed_rsqrt(is_low ? square * 4 : square);
    const int32_t once = is_low ? 2 : 1;
    q->w = fixed_mul_q32(q->w, inverse) * once;
    q->x = fixed_mul_q32(q->x, inverse) * once;
    q->y = fixed_mul_q32(q->y, inverse) * once;
    q->z = fixed_mul_q32(q->z, inverse) * once;
    return true;
}

void classic_axes(const struct quat *q, struct vector rows[3]) {
    // A product is at most a half, and so is the sum of two; 1/2 less the sum of two
    // squares is within 1/2: twice that fits.
    const q2_30_t xx = fixed_mul_q30(q->x, q->x);
    const q2_30_t yy = fixed_mul_q30(q->y, q->y);
    const q2_30_t zz = fixed_mul_q30(q->z, q->z);
    const q2_30_t xy = fixed_mul_q30(q->x, q->y);
    const q2_30_t xz = fixed_mul_q30(q->x, q->z);
    const q2_30_t yz = fixed_mul_q30(q->y, q->z);
    const q2_30_t wx = fixed_mul_q30(q->w, q->x);
    const q2_30_t wy = fixed_mul_q30(q->w, q->y);
    const q2_30_t wz = fixed_mul_q30(q->w, q->z);
    const q2_30_t half = Q2_30_ONE / 2;
    rows[0] = (struct vector){
        .x = 2 * (half - yy - zz), .y = 2 * (xy - wz), .z = 2 * (xz + wy)};
    rows[1] = (struct vector){
        .x = 2 * (xy + wz), .y = 2 * (half - xx - zz), .z = 2 * (yz - wx)};
    rows[2] = (struct vector){
        .x = 2 * (xz - wy), .y = 2 * (yz + wx), .z = 2 * (half - xx - yy)};
}

// v / 4, so that four of them may be added.
static struct vector quarter(const struct vector *v) {
    return (struct vector){.x = fixed_scale_down(v->x, 2),
                           .y = fixed_scale_down(v->y, 2),
                           .z = fixed_scale_down(v->z, 2)};
}

void classic_quat(const struct vector rows[3], struct quat *out) {
    // w, x, y or z times all four of them, whichever has a square of at least a
    // quarter: the largest of the diagonal tells.
    const struct vector a = quarter(&rows[0]);
    const struct vector b = quarter(&rows[1]);
    const struct vector c = quarter(&rows[2]);
    const q2_30_t one = Q2_30_ONE / 4;
    if (a.x + b.y + c.z > 0) {
        *out = (struct quat){one + a.x + b.y + c.z, c.y - b.z, a.z - c.x, b.x - a.y};
    } else if (a.x >= b.y && a.x >= c.z) {
        *out = (struct quat){c.y - b.z, one + a.x - b.y - c.z, a.y + b.x, a.z + c.x};
    } else if (b.y >= c.z) {
        *out = (struct quat){a.z - c.x, a.y + b.x, one - a.x + b.y - c.z, b.z + c.y};
    } else {
        *out = (struct quat){b.x - a.y, a.z + c.x, b.z + c.y, one - a.x - b.y + c.z};
    }
    (void)classic_normalise(out);
}

void classic_field(const struct vector rows[3], const struct vector *field,
                   q2_30_t *horizontal, q2_30_t *vertical) {
    struct vector flat = {
        .x = classic_dot(&rows[0], field), .y = classic_dot(&rows[1], field), .z = 0};
    *horizontal = 0;
    *vertical = classic_dot(&rows[2], field);
    (void)vector_normalise(&flat, &flat, horizontal);
}

q2_30_t classic_dot(const struct vector *a, const struct vector *b) {
    return fixed_mul_q30(a->x, b->x) + fixed_mul_q30(a->y, b->y) +
           fixed_mul_q30(a->z, b->z);
}

void classic_cross(const struct vector *a, const struct vector *b, struct vector *out) {
    out->x = fixed_mul_q30(a->y, b->z) - fixed_mul_q30(a->z, b->y);
    out->y = fixed_mul_q30(a->z, b->x) - fixed_mul_q30(a->x, b->z);
    out->z = fixed_mul_q30(a->x, b->y) - fixed_mul_q30(a->y, b->x);
}
