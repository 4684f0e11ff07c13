// SPDX-License-Identifier: MIT
// Data-ready without a wire: the sensor's status register is asked whether there is a
// sample, again and again near the time at which the next one is due. Between a no and
// a yes lies the edge that a wire would have had.
//
// One answer tells its time to 0.1 ms, as long as a question takes. So the times at
// which an edge can have come are kept, moved on by a period, and cut by each pair of
// answers; when it is asked varies, so that the cuts do. The middle is the sample's
// time, and the period is what keeps the cuts even. It begins with the mean of the
// first edges: a sensor's clock may be off by a tenth.
#ifndef POLLED_H
#define POLLED_H

#include <stdbool.h>
#include <stdint.h>

// Times of the wire are in 1/16 us, modulo 2^32, which are 268 s.
struct polled {
    uint32_t period;
    uint32_t low, high;  // of the last edge
    uint32_t no_at;      // the last answer that there is nothing
    uint32_t first;      // the first edge, from which the period is learned
    bool has_edge, has_no;
    uint8_t learned;  // edges after it
    uint8_t turn;     // of the variation
    uint16_t missed;  // edges before the next one that is told
    uint32_t edges;   // seen or reckoned, since boot
};

// Restarts for a sensor of that rate; the counts of samples and losses are kept.
void polled_begin(struct polled *polled, uint16_t rate_hz);

// Microseconds until the sensor is to be asked; 0: now.
uint32_t polled_wait_us(const struct polled *polled, uint32_t now_us);

// An answer, and when it was given. `polled_yes` gives the edge's time and the number
// of missed edges before it; false if that is unknown: the sample is to be read and
// thrown away.
void polled_no(struct polled *polled, uint32_t at_us);
bool polled_yes(struct polled *polled, uint32_t at_us, uint32_t *edge_us,
                uint16_t *missed);

// An edge at that time is the one that is due after the last.
bool polled_is_next(const struct polled *polled, uint32_t edge_us);

// Half the width of where the last edge can lie: how wrong its time is at most.
uint32_t polled_bound_us(const struct polled *polled);

#endif
