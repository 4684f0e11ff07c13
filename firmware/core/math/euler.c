// SPDX-License-Identifier: MIT
// Quaternion to angles; see euler.h for frames and bounds.
#include "core/math/euler.h"

#include "core/math/constant.h"

#define QUARTER_TURN ((turn32_t)Q32_UNSIGNED(0.25))
#define LOCK_Q30 Q30(1e-5 / 1.414214)  // 1e-5 rad / sqrt(2)

// |(x, y)|, relatively within 7e-8, for |(x, y)| < 2^31.
static int32_t length(int32_t x, int32_t y) {
    struct vector v = {.x = x, .y = y, .z = 0};
    return vector_normalise(&v);
}

void euler_from_quat(const struct quat *q, struct euler *out) {
    // Of q = q_z(yaw) q_y(pitch) q_x(roll):
    //   (w - y, x + z) is sqrt(1 - sin pitch) long and has the angle (yaw + roll) / 2,
    //   (w + y, z - x) is sqrt(1 + sin pitch) long and has the angle (yaw - roll) / 2.
    // Each is exact, at most sqrt(2) long, and only one gets short near the lock.
    const int32_t sum_x = q->w - q->y;
    const int32_t sum_y = q->x + q->z;
    const int32_t difference_x = q->w + q->y;
    const int32_t difference_y = q->z - q->x;
    const int32_t sum_length = length(sum_x, sum_y);
    const int32_t difference_length = length(difference_x, difference_y);
    turn32_t half_sum = fixed_atan2(sum_y, sum_x);
    turn32_t half_difference = fixed_atan2(difference_y, difference_x);
    if (sum_length < LOCK_Q30) {
        half_sum = half_difference;
        out->pitch = QUARTER_TURN;
    } else if (difference_length < LOCK_Q30) {
        half_difference = half_sum;
        out->pitch = -QUARTER_TURN;
    } else {
        // sin and cos, both times |q|^2, which is what keeps them below 2.
        const q2_30_t half_sine = fixed_mul_q30(q->w, q->y) - fixed_mul_q30(q->z, q->x);
        out->pitch =
            fixed_atan2(half_sine * 2, fixed_mul_q30(sum_length, difference_length));
    }
    out->yaw = turn32_add(half_sum, half_difference);
    out->roll = turn32_sub(half_sum, half_difference);
}

void euler_aerospace(const struct quat *q, struct euler *out) {
    // North-east-down from east-north-up after a half turn about x is a quarter turn
    // about z, and that half turn changes the sign of turns about y and z alone.
    euler_from_quat(q, out);
    out->yaw = turn32_sub(QUARTER_TURN, out->yaw);
    out->pitch = -out->pitch;
}

void euler_nectec(const struct quat *q, struct euler *out) {
    euler_from_quat(q, out);
    const turn32_t about_z = out->yaw;
    out->yaw = out->roll;
    out->roll = about_z;
}
