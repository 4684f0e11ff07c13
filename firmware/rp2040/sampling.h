// SPDX-License-Identifier: MIT
// Samples by interrupt: the data-ready pin and the sensor's bus.
#ifndef SAMPLING_H
#define SAMPLING_H

void sampling_init(void);

#endif
